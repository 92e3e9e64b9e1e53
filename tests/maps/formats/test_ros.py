"""Occupancy grids: straight walls from cells, frames, thresholds, pictures of both kinds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import Polygon

from maps.errors import InputError
from maps.formats.imported import ImportOptions
from maps.formats.pgm import pgm_bytes, read_pgm
from maps.formats.ros import import_ros
from maps.mapfile import build_map

RESOLUTION = 0.05
#: An L with a block in it, 9 x 7 m.
ROOM = Polygon([(1, 1), (10, 1), (10, 5), (6, 5), (6, 8), (1, 8)], [[(3, 3), (4, 3), (4, 4.5), (3, 4.5)]])


def grid(folder, room, origin=(0.0, 0.0, 0.0), size=(210, 180), leak=None, **changes):
    """Draw a room as a scanner would: hits on its walls, unknown behind them; return the YAML."""
    columns, rows = size
    x, y = np.meshgrid((np.arange(columns) + 0.5) * RESOLUTION, (np.arange(rows)[::-1] + 0.5) * RESOLUTION)
    grey = np.where(shapely.contains_xy(room, x, y), 254, 205).astype(np.uint8)
    grey[shapely.distance(room.boundary, shapely.points(x, y)) < 0.5 * RESOLUTION] = 0
    if leak is not None:
        grey[leak] = 254
    (folder / "map.pgm").write_bytes(pgm_bytes(grey))
    content = {"image": "map.pgm", "resolution": RESOLUTION, "origin": list(origin), "negate": 0}
    content |= {"occupied_thresh": 0.65, "free_thresh": 0.196} | changes
    path = folder / "map.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in content.items()))
    return path


def floor_of(path, options=ImportOptions()):  # noqa: B008
    return build_map(import_ros(path, options).document, path).floor


def corners(room):
    return sum(len(ring.coords) - 1 for ring in (room.exterior, *room.interiors))


def test_an_aligned_room_comes_back_with_its_corners(tmp_path):
    path = grid(tmp_path, ROOM)
    floor = floor_of(path)
    assert len(floor.geoms) == 1
    assert corners(floor.geoms[0]) == 10
    assert floor.hausdorff_distance(ROOM) < RESOLUTION
    kinds = [segment.kind for segment in import_ros(path, ImportOptions()).document.segments]
    assert (kinds.count("floor"), kinds.count("ceiling"), kinds.count("corner")) == (10, 10, 10)


@settings(max_examples=8, deadline=None)
@given(turn=st.floats(-45.0, 45.0))
def test_a_turned_room_has_straight_walls_too(tmp_path_factory, turn):
    room = affinity.translate(affinity.rotate(ROOM, turn, origin=(5.5, 4.5)), 1.02, 1.71)
    floor = floor_of(grid(tmp_path_factory.mktemp("turned"), room, size=(260, 250)))
    assert floor.symmetric_difference(room).area < 0.02 * room.area
    assert corners(floor.geoms[0]) <= 14
    outline = np.asarray(floor.geoms[0].exterior.coords)
    sides = np.diff(outline, axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    angles = np.degrees(np.arctan2(sides[:, 1], sides[:, 0]))
    off = np.abs((angles - turn + 45.0) % 90.0 - 45.0)
    assert off[lengths > 1.0].max() < 1.5


def test_the_picture_is_read_top_down_and_moved_by_its_origin(tmp_path):
    floor = floor_of(grid(tmp_path, ROOM, origin=(-3.0, 2.0, 0.0)))
    assert floor.hausdorff_distance(affinity.translate(ROOM, -3.0, 2.0)) < RESOLUTION


def test_an_origin_with_a_yaw_turns_the_map(tmp_path):
    floor = floor_of(grid(tmp_path, ROOM, origin=(1.0, 0.5, 0.4)))
    turned = affinity.translate(affinity.rotate(ROOM, math.degrees(0.4), origin=(0, 0)), 1.0, 0.5)
    assert floor.hausdorff_distance(turned) < RESOLUTION


def test_negated_pictures(tmp_path):
    path = grid(tmp_path, ROOM, negate=1)
    grey = np.round(read_pgm(tmp_path / "map.pgm") * 255).astype(np.uint8)
    (tmp_path / "map.pgm").write_bytes(pgm_bytes(255 - grey))
    assert floor_of(path).hausdorff_distance(ROOM) < RESOLUTION


def test_unknown_cells_are_no_floor_even_where_the_threshold_lets_them_pass(tmp_path):
    result = import_ros(grid(tmp_path, ROOM, free_thresh=0.25), ImportOptions())
    assert build_map(result.document, tmp_path).floor.area == pytest.approx(ROOM.area, rel=0.01)
    assert any("unknown" in sentence for sentence in result.report.guessed)


def test_leaks_through_cracks_and_other_rooms_are_left_out_and_said(tmp_path):
    # A beam of three cells through the north wall, and a patch beyond.
    result = import_ros(grid(tmp_path, ROOM, leak=(slice(10, 60), slice(60, 63))), ImportOptions())
    assert build_map(result.document, tmp_path).floor.hausdorff_distance(ROOM) < 2 * RESOLUTION
    assert any("free cells" in sentence for sentence in result.report.dropped)


def test_specks_are_filled(tmp_path):
    path = grid(tmp_path, ROOM)
    grey = np.round(read_pgm(tmp_path / "map.pgm") * 255).astype(np.uint8)
    grey[140, 40:42] = 0
    (tmp_path / "map.pgm").write_bytes(pgm_bytes(grey))
    assert len(floor_of(path).geoms[0].interiors) == 1


def test_a_told_height_is_used_and_a_guessed_one_said(tmp_path):
    path = grid(tmp_path, ROOM)
    told, guessed = import_ros(path, ImportOptions(wall_height_m=3.1)), import_ros(path, ImportOptions())
    assert max(s.p1[2] for s in told.document.segments) == 3.1
    assert not any("--wall-height" in sentence for sentence in told.report.guessed)
    assert any("--wall-height" in sentence for sentence in guessed.report.guessed)
    assert told.document.sigma_m == RESOLUTION


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"resolution": 0.0}, "resolution"),
        ({"origin": [0, 0]}, "origin"),
        ({"image": "other.pgm"}, "other.pgm"),
        ({"mode": "raw"}, "mode"),
        ({"occupied_thresh": 2}, "occupied_thresh"),
        ({"free_thresh": 0.0}, "no free area"),
    ],
)
def test_bad_descriptions_name_their_key(tmp_path, change, said):
    with pytest.raises(InputError, match=said):
        import_ros(grid(tmp_path, ROOM, **change), ImportOptions())


def test_pictures_as_text_and_of_two_bytes(tmp_path):
    path = tmp_path / "a.pgm"
    path.write_text("P2\n# made by hand\n3 2\n# white\n10\n0 5 10\n10 5 0\n")
    np.testing.assert_allclose(read_pgm(path), [[0, 0.5, 1], [1, 0.5, 0]])
    path.write_bytes(b"P5 2 1 1000\n" + bytes([0, 250, 3, 232]))
    np.testing.assert_allclose(read_pgm(path), [[0.25, 1.0]])


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"P6 1 1 255\n\x00\x00\x00",
        b"P5 2 2 255\n\x00\x00\x00",
        b"P2 2 2 255\n1 2 x 4",
        b"P2 2 2 9\n1 2 3 10",
        b"P2 2 2 9\n1 2 3 -1",
        b"P5 99999999 99999999 255\n",
        b"P5 0 0 255\n",
        b"P5 1 1 0\n\x00",
        b"P5 1 1 70000\n\x00\x00",
    ],
)
def test_bad_pictures_are_refused(tmp_path, content):
    path = tmp_path / "a.pgm"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_pgm(path)
    assert str(caught.value).startswith(str(path))
