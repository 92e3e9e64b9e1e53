"""Line extraction beside OpenCV's LSD, in one process on one thread: speed, precision, recall.

`make bench` prints the figures; pytest on this file with `--benchmark-only -s` these alone.
"""

from __future__ import annotations

import csv
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from maps.mapfile import read_map
from maps.poses import Pose2
from runs.robot import read_robot
from tests.drawnedges import covered_px, draw_edge, miss_of
from vision.camera import Camera, CameraModel, CameraMount
from vision.images import read_image
from vision.lines import LineConfig, LineMethod, extract_segments
from vision.lsd import find_lsd
from vision.projection import Projector

SESSIONS = ("building_a", "building_b", "building_0001", "building_0001_return", "building_0002")
DRAWN = 400
PLAIN = Camera(
    CameraModel.PINHOLE_RADTAN, 640, 480, 640.0, 640.0, 319.5, 239.5, np.zeros(5), CameraMount()
)  # fmt: skip


@pytest.fixture(autouse=True)
def one_thread():
    """OpenCV shall not help itself to a second core."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def tell(*figures: object) -> None:
    print(*figures)


def lsd_ideal(image, camera):
    config = LineConfig(method=LineMethod.LSD, min_length_px=0.0)
    return extract_segments(image, camera, config).ideal_px


def photographs(data: Path):
    """Real photographs, each with its camera and labelled lines, ideal pixels."""
    for path in sorted((data / "york_urban_open" / "images").glob("*.jpg")):
        labels = np.loadtxt(
            path.parents[1] / "lines" / f"{path.stem}.csv", delimiter=",", skiprows=1, ndmin=2
        )
        yield read_image(path), PLAIN, labels[:, :4].reshape(-1, 2, 2) - [PLAIN.cx, PLAIN.cy]


def frames(data: Path, session: str, step: int = 3):
    """Every so many-th frame of a session, with its camera and the map's pieces seen from the true pose."""
    folder = data / "rendered" / session
    camera = read_robot(folder / "robot.yaml").camera
    own = folder / "map.yaml"
    wire_map = read_map(own if own.exists() else folder.parent / "map.yaml")
    projector = Projector(camera, wire_map)
    with (folder / "frames.csv").open() as listed, (folder / "ground_truth.csv").open() as truth:
        rows = list(zip(csv.DictReader(listed), csv.DictReader(truth), strict=True))
    for frame, at in rows[::step]:
        pose = Pose2(float(at["x_m"]), float(at["y_m"]), float(at["phi_rad"]))
        pieces = projector.predict(pose, np.arange(len(wire_map)))
        yield read_image(folder / frame["filename"]), camera, pieces.ideal_px


def fastest_ms(function, rounds: int = 5) -> float:
    spent = []
    for _ in range(rounds):
        started = time.perf_counter()
        function()
        spent.append(time.perf_counter() - started)
    return 1e3 * min(spent)


@pytest.mark.parametrize("name", ["york", *SESSIONS])
def test_speed(benchmark, data, name):
    """Three times as fast as LSD in the median, and never slower."""
    images = list(photographs(data) if name == "york" else frames(data, name))
    config = LineConfig()
    extract_segments(*images[0][:2], config)
    spent = np.array(
        [
            [
                fastest_ms(lambda image=image: find_lsd(image)),
                fastest_ms(lambda image=image, camera=camera: extract_segments(image, camera, config)),
            ]
            for image, camera, _ in images
        ]
    )
    ratio = spent[:, 0] / spent[:, 1]
    tell(
        f"{name}: LSD {np.median(spent[:, 0]):.1f} ms, here {np.median(spent[:, 1]):.1f} ms; "
        f"{np.median(ratio):.2f} times as fast, at least {ratio.min():.2f} times"
    )
    benchmark(extract_segments, *images[0][:2], config)
    assert np.median(ratio) >= 3.0
    assert ratio.min() >= 1.0


def test_precision(benchmark):
    """On drawn edges: a twentieth of a pixel and of a degree, no bias, honest deviations."""
    rng = np.random.default_rng(1)
    misses, lsd = [], []
    for _ in range(DRAWN):
        edge = draw_edge(rng)
        found = extract_segments(edge.image, PLAIN, LineConfig())
        miss = miss_of(edge, found.raw_px)
        assert miss is not None, "every drawn edge must be found"
        assert found.polarity[miss.row] == miss.sense
        sigma = found.sigma_middle_px[miss.row], found.sigma_angle_rad[miss.row]
        misses.append([miss.offset_px, miss.angle_rad, *sigma, found.contrast[miss.row] / edge.contrast])
        other = miss_of(edge, find_lsd(edge.image))
        if other is not None:
            lsd.append([other.offset_px, other.angle_rad])
    for name, of in (("here", np.array(misses)), ("LSD", np.array(lsd))):
        tell(
            f"{name}: across {np.median(np.abs(of[:, 0])):.4f} px, bias {of[:, 0].mean():+.4f} px, "
            f"angle {np.degrees(np.median(np.abs(of[:, 1]))):.4f} deg, found {len(of)} of {DRAWN}"
        )
    offset, angle, sigma_offset, sigma_angle, contrast = np.array(misses).T
    honest = np.mean((offset / sigma_offset) ** 2), np.mean((angle / sigma_angle) ** 2)
    tell(f"squared errors over variance: offset {honest[0]:.2f}, angle {honest[1]:.2f}")
    benchmark(extract_segments, edge.image, PLAIN, LineConfig())
    assert np.median(np.abs(offset)) <= 0.05
    assert np.degrees(np.median(np.abs(angle))) <= 0.05
    assert abs(offset.mean()) <= 0.01
    assert all(0.8 <= value <= 1.25 for value in honest)
    assert abs(np.median(contrast) - 1.0) < 0.05


def recall(images) -> tuple[float, float, float]:
    """Covered shares of LSD and here, and the total length found here over LSD's."""
    sums = np.zeros((2, 3))
    for image, camera, labels in images:
        for row, ideal in enumerate(
            (lsd_ideal(image, camera), extract_segments(image, camera, LineConfig()).ideal_px)
        ):
            length = float(np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1).sum())
            sums[row] += [*covered_px(labels, ideal), length]
    shares = sums[:, 1] / sums[:, 0]
    return float(shares[0]), float(shares[1]), float(sums[1, 2] / sums[0, 2])


def test_recall_of_labelled_lines(benchmark, data):
    """Three points more of the labelled length than all that LSD finds, with little more to offer."""
    lsd, here, longer = benchmark.pedantic(lambda: recall(photographs(data)), rounds=1)
    tell(f"york: LSD {100 * lsd:.1f} %, here {100 * here:.1f} %, with {longer:.2f} of its length")
    assert here >= lsd + 0.03
    assert longer <= 1.1


@pytest.mark.parametrize("session", SESSIONS)
def test_recall_of_the_maps_edges(benchmark, data, session):
    """Three points more of the visible length than all that LSD finds."""
    lsd, here, longer = benchmark.pedantic(lambda: recall(frames(data, session)), rounds=1)
    tell(f"{session}: LSD {100 * lsd:.1f} %, here {100 * here:.1f} %, with {longer:.2f} of its length")
    assert here >= lsd + 0.03
