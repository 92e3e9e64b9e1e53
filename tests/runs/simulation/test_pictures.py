"""Pictures of a map: edges where the map has them, hidden where walls hide them, and a sensor's faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from maps.mapfile import read_map
from maps.poses import Array, Pose2, frozen
from maps.wiremap import WireMap
from runs.robot import Robot
from runs.simulation.casting import cast_picture
from runs.simulation.clutter import scaled
from runs.simulation.facets import Material
from runs.simulation.filming import Filming, frame_stamps
from runs.simulation.paths import DriveKind, simulate_drive
from runs.simulation.photograph import IDEAL, GreyImage, Photographer, Sensor, pixel_corners
from runs.simulation.scene import Conditions, Scene, scene_of
from runs.simulation.walls import low_obstacles
from runs.templates import MAP
from tests.toy_building import toy_building
from vision.camera import Camera, CameraModel, CameraMount
from vision.lines import LineConfig, extract_segments
from vision.projection import Projector

MOUNT = CameraMount(0.1, 0.0, 1.2, 0.1, 0.05, 0.01)
PLAIN = Camera(CameraModel.PINHOLE_RADTAN, 320, 240, 220.0, 220.0, 160.2, 119.3, np.zeros(5), MOUNT)
BARREL = replace(PLAIN, distortion=np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0]))
FISHEYE = replace(
    PLAIN, model=CameraModel.FISHEYE, fx=150.0, fy=150.0, distortion=np.array([0.02, -0.01, 0.0, 0.0])
)
BARE = Conditions(sun=False, clutter=scaled(0.0))
NOWHERE = np.zeros((0, 2))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> WireMap:
    path = tmp_path_factory.mktemp("room") / "map.yaml"
    path.write_text(MAP)
    return read_map(path)


@pytest.fixture(scope="module")
def toy_map(tmp_path_factory: pytest.TempPathFactory) -> WireMap:
    return toy_building().read(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def bare_room(room: WireMap) -> Scene:
    return scene(room, BARE)


def scene(wire_map: WireMap, conditions: Conditions, seed: int = 1, keep_off: Array = NOWHERE) -> Scene:
    return scene_of(wire_map, conditions, np.random.default_rng(seed), MOUNT.height_m, keep_off)


def picture(of: Scene, camera: Camera, pose: Pose2, sensor: Sensor = IDEAL, seed: int = 0) -> GreyImage:
    rotation, centre = camera.map_from_optical(pose)
    moments = np.tile(rotation, (sensor.rays, 1, 1)), np.tile(centre, (sensor.rays, 1))
    return Photographer(of, camera, sensor).take(*moments, np.random.default_rng(seed))


def offsets_px(image: GreyImage, camera: Camera, wire_map: WireMap, pose: Pose2) -> Array:
    """Return how far the nearest found line is from each visible map edge of 40 px, NaN where there is none."""
    lines = extract_segments(image, camera, LineConfig()).ideal_px
    predicted = Projector(camera, wire_map).predict(pose, np.arange(len(wire_map)))
    found = []
    for start, end in predicted.ideal_px[predicted.lengths_px >= 40.0]:
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        beside = (lines - start) @ np.array([-along[1], along[0]])
        reach = np.sort((lines - start) @ along, axis=1)
        shared = np.minimum(reach[:, 1], length) - np.maximum(reach[:, 0], 0.0)
        fits = (np.abs(beside).max(axis=1) < 1.5) & (shared > 0.4 * length)
        found.append(np.abs(beside[fits].mean(axis=1)).min() if fits.any() else np.nan)
    return np.array(found)


@pytest.mark.parametrize("camera", [PLAIN, BARREL, FISHEYE], ids=["plain", "barrel", "fisheye"])
def test_edges_are_drawn_where_the_map_has_them(room: WireMap, bare_room: Scene, camera: Camera) -> None:
    poses = [Pose2(1.0, 1.0, 0.6), Pose2(1.2, 2.6, -0.3), Pose2(4.2, 3.0, -2.6)]
    off = np.concatenate([offsets_px(picture(bare_room, camera, pose), camera, room, pose) for pose in poses])
    assert len(off) >= 25
    assert np.isfinite(off).mean() > 0.55
    assert np.nanmedian(off) < 0.1


def test_frames_recesses_and_panels_are_drawn_too(toy_map: WireMap) -> None:
    bare = scene(toy_map, BARE)
    poses = [Pose2(3.0, 3.8, -1.6), Pose2(1.5, 1.2, 0.3), Pose2(2.5, 5.0, -2.9)]
    off = np.concatenate([offsets_px(picture(bare, PLAIN, pose), PLAIN, toy_map, pose) for pose in poses])
    assert np.isfinite(off).mean() > 0.6
    # Panels stand 2 mm out: beside each edge there is that of its side, up to a pixel away.
    assert np.nanpercentile(off, 25) < 0.15
    assert np.nanmedian(off) < 0.35


def test_a_window_is_a_pane_and_a_lamp_shines(toy_map: WireMap) -> None:
    paints = scene(toy_map, BARE).mesh.paints
    assert np.count_nonzero(paints[:, 0] == Material.PANE) == 0
    kinds = tuple(
        "window" if "window" in name else kind
        for name, kind in zip(toy_map.names, toy_map.kinds, strict=True)
    )
    glazed = scene(replace(toy_map, kinds=kinds), BARE)
    assert np.count_nonzero(glazed.mesh.paints[:, 0] == Material.PANE) == 1
    view = picture(glazed, PLAIN, Pose2(3.0, 3.8, -1.6))
    assert (view == 255).mean() > 0.01


def test_walls_hide_and_doors_let_see(toy_map: WireMap) -> None:
    """A camera in a room sees no farther than its walls, but for the door."""
    bare = scene(toy_map, BARE)
    region = bare.mesh.paints[:, 6]
    second = [row for row in np.unique(region) if _mean_x(bare, region == row) > 8.3]
    paints = bare.mesh.paints.copy()
    paints[np.isin(region, second), 1] *= 0.3
    dark = replace(bare, mesh=bare.mesh._replace(paints=frozen(paints)))
    before, after = (picture(of, PLAIN, Pose2(6.5, 1.5, 0.0)).astype(int) for of in (bare, dark))
    columns = np.flatnonzero((np.abs(before - after) > 40).mean(axis=0) > 0.1)
    assert 40 < len(columns) < 200
    away = Pose2(2.0, 3.5, np.pi)
    np.testing.assert_array_equal(picture(bare, PLAIN, away), picture(dark, PLAIN, away))


def _mean_x(of: Scene, facets: Array) -> float:
    return float(of.mesh.triangles[facets[of.mesh.facet_of], 0].mean())


#: A room with a low wall that leaves a gap of a millimetre to a high one, as importers do.
SLIVER = """
segments: [{p0: [0, 0, 0], p1: [6, 0, 0]}, {p0: [6, 0, 0], p1: [6, 0, 2.5]}]
floor:
- outer: [[0, 0], [6, 0], [6, 4], [3, 4], [3, 3], [0, 3]]
  holes: [[[2.5, 2.999], [2.5, 2.8], [2.999, 2.8], [2.999, 2.999]], [[4, 2], [4.5, 2], [4.5, 2.5], [4, 2.5]]]
  hole_tops_m: [1.0, 0.9]
"""


def test_buildings_are_closed(room: WireMap, toy_map: WireMap, tmp_path: Path) -> None:
    path = tmp_path / "sliver.yaml"
    path.write_text(SLIVER)
    sliver = read_map(path)
    assert [top_m for _, top_m in low_obstacles(sliver)] == [0.9, 1.0]
    wide = replace(PLAIN, fx=120.0, fy=120.0)
    for wire_map, places in {
        room: [(1.0, 1.0), (4.0, 2.0)],
        toy_map: [(1.5, 1.2), (6.5, 1.5), (10.0, 1.0), (2.5, 6.0)],
        sliver: [(1.0, 1.0), (2.7, 2.0), (5.5, 3.5)],
    }.items():
        bare = scene(wire_map, BARE)
        for x, y in places:
            for phi in np.arange(4) * 0.5 * np.pi + 0.2:
                rotation, centre = wide.map_from_optical(Pose2(x, y, float(phi)))
                seen = cast_picture(
                    pixel_corners(wide), rotation[None], centre[None], bare.mesh, bare.lights, 0
                )
                # Where triangles meet, rounding may let a single ray through.
                assert np.count_nonzero(seen == 0.0) <= 1


def test_the_seed_decides_the_looks_and_the_noise(room: WireMap) -> None:
    pose = Pose2(1.0, 1.0, 0.6)
    one, same, other = (picture(scene(room, Conditions(), seed), PLAIN, pose, Sensor()) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one.astype(int) - other).mean() > 5.0


def test_noise_is_that_of_the_sensor(bare_room: Scene) -> None:
    pose, sensor = Pose2(1.0, 1.0, 0.6), Sensor(blur_px=0.0, vignetting=0.0)
    clean = picture(bare_room, PLAIN, pose, IDEAL).astype(float)
    noisy = [picture(bare_room, PLAIN, pose, sensor, seed).astype(float) for seed in range(8)]
    grey = (clean > 60) & (clean < 160)
    spread = np.std(noisy, axis=0)[grey]
    share = (clean[grey] / 255.0) ** 2.2
    electrons = sensor.full_well * share
    slope = 255.0 / 2.2 * share ** (1.0 / 2.2 - 1.0)
    expected = slope * np.sqrt(electrons + sensor.read_electrons**2) / sensor.full_well
    assert 0.8 < np.median(spread / expected) < 1.25


def test_corners_get_less_light(bare_room: Scene) -> None:
    pose = Pose2(1.0, 1.0, 0.6)
    flat = picture(bare_room, PLAIN, pose, replace(IDEAL, vignetting=0.0)).astype(float)
    dim = picture(bare_room, PLAIN, pose, replace(IDEAL, vignetting=0.5)).astype(float)
    darker = dim / np.maximum(flat, 1.0)
    assert darker[:20, :20].mean() < 0.85 * darker[110:130, 150:170].mean()


def test_turning_smears_upright_edges(toy_map: WireMap) -> None:
    robot, bare = Robot(Path("robot.yaml"), None, PLAIN, 0, None), scene(toy_map, BARE)
    spin = simulate_drive(np.random.default_rng(0), 6.0, DriveKind.TURNING, start=Pose2(3.0, 3.8, 0.0))
    turning = np.abs(np.append(0.0, spin.steps()[1])) > 0.015
    quick = spin.stamps_ns[turning][::80] + 5_000_000

    def sharpness(exposure_s: float) -> float:
        filming = Filming(bare, robot, replace(IDEAL, rays=4, exposure_s=exposure_s), 0.0)
        frames = filming.frames(spin, quick, np.random.default_rng(0))
        return float(np.mean([np.abs(np.diff(frame.astype(float), axis=1)).max() for frame in frames]))

    assert sharpness(0.06) < 0.8 * sharpness(0.0)


def test_clutter_hides_edges_and_leaves_the_way_free(room: WireMap) -> None:
    way = np.column_stack([np.linspace(0.6, 2.4, 30), np.full(30, 2.0)])
    cluttered = scene(room, Conditions(clutter=scaled(5.0)), 2, way)
    bare = scene(room, BARE, 2)
    assert len(cluttered.mesh.planes) > len(bare.mesh.planes) + 30
    triangles = cluttered.mesh.triangles.reshape(-1, 3, 3)
    corners = np.concatenate(
        [triangles[:, 0], triangles[:, 0] + triangles[:, 1], triangles[:, 0] + triangles[:, 2]]
    )
    standing = corners[(corners[:, 2] > 0.05) & (corners[:, 2] < 2.0)]
    inside = standing[shapely.contains_xy(room.floor.buffer(-0.02), standing[:, 0], standing[:, 1])]
    gaps = np.linalg.norm(inside[:, None, :2] - way[None], axis=2).min()
    assert gaps > 0.5


def test_frames_come_at_their_rate() -> None:
    drive = simulate_drive(np.random.default_rng(0), 20.0, DriveKind.STANDING)
    stamps_ns = frame_stamps(drive, 2.0, np.random.default_rng(0))
    np.testing.assert_allclose(np.diff(stamps_ns), 5e8, atol=1)
    assert 38 <= len(stamps_ns) <= 40
    assert 0 < stamps_ns[0] < 5e8
