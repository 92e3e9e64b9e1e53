"""The default line extraction and the paper's beside OpenCV's LSD, in one process on one thread.

Speed, precision, recall.

`make bench` prints the figures; pytest on this file with `--benchmark-only -s` these alone.
"""

from __future__ import annotations

import csv
import time
from pathlib import Path

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
HERE, HOUGH = LineConfig(), LineConfig(method=LineMethod.HOUGH)
#: Of LSD all that it finds, however short.
LSD = LineConfig(method=LineMethod.LSD, min_length_px=0.0)
PLAIN = Camera(
    CameraModel.PINHOLE_RADTAN, 640, 480, 640.0, 640.0, 319.5, 239.5, np.zeros(5), CameraMount()
)  # fmt: skip


def tell(*figures: object) -> None:
    print(*figures)


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


def fastest_ms(image, camera, rounds: int = 5) -> list[float]:
    """Best times of LSD alone, the default and the paper's extractor, taken by turns."""
    calls = (
        lambda: find_lsd(image),
        lambda: extract_segments(image, camera, HERE),
        lambda: extract_segments(image, camera, HOUGH),
    )
    spent = []
    for _ in range(rounds):
        for call in calls:
            started = time.perf_counter()
            call()
            spent.append(time.perf_counter() - started)
    return (1e3 * np.reshape(spent, (rounds, len(calls))).min(axis=0)).tolist()


@pytest.mark.parametrize("name", ["york", *SESSIONS])
def test_speed(benchmark, data, name):
    """Three times as fast as LSD in the median, and never slower."""
    images = list(photographs(data) if name == "york" else frames(data, name))
    for config in (HERE, HOUGH):
        extract_segments(*images[0][:2], config)
    spent = np.array([fastest_ms(image, camera) for image, camera, _ in images])
    ratio = spent[:, :1] / spent
    tell(
        "{}: LSD {:.1f} ms, here {:.1f} ms, Hough {:.1f} ms;".format(name, *np.median(spent, axis=0)),
        "here {1:.2f} times as fast, Hough {2:.2f};".format(*np.median(ratio, axis=0)),
        "at least {1:.2f}, {2:.2f}".format(*ratio.min(axis=0)),
    )
    benchmark(extract_segments, *images[0][:2], HERE)
    assert np.median(ratio[:, 1]) >= 3.0
    assert ratio[:, 1].min() >= 1.0


def test_precision(benchmark):
    """On drawn edges: a twentieth of a pixel and of a degree, no bias, honest deviations."""
    rng = np.random.default_rng(1)
    misses, lsd, hough = [], [], []
    for _ in range(DRAWN):
        edge = draw_edge(rng)
        found = extract_segments(edge.image, PLAIN, HERE)
        miss = miss_of(edge, found.raw_px)
        assert miss is not None, "every drawn edge must be found"
        assert found.polarity[miss.row] == miss.sense
        sigma = found.sigma_middle_px[miss.row], found.sigma_angle_rad[miss.row]
        misses.append([miss.offset_px, miss.angle_rad, *sigma, found.contrast[miss.row] / edge.contrast])
        other = miss_of(edge, find_lsd(edge.image))
        if other is not None:
            lsd.append([other.offset_px, other.angle_rad])
        found = extract_segments(edge.image, PLAIN, HOUGH)
        other = miss_of(edge, found.raw_px)
        if other is not None:
            assert found.polarity[other.row] == other.sense
            sigma = found.sigma_middle_px[other.row], found.sigma_angle_rad[other.row]
            hough.append([other.offset_px, other.angle_rad, *sigma])
    for name, of in (("here", np.array(misses)), ("LSD", np.array(lsd)), ("Hough", np.array(hough))):
        tell(
            f"{name}: across {np.median(np.abs(of[:, 0])):.4f} px, bias {of[:, 0].mean():+.4f} px, "
            f"angle {np.degrees(np.median(np.abs(of[:, 1]))):.4f} deg, found {len(of)} of {DRAWN}"
        )
    for name, of in (("here", np.array(misses)), ("Hough", np.array(hough))):
        honest = np.mean((of[:, :2] / of[:, 2:4]) ** 2, axis=0)
        tell(f"{name}: squared errors over variance: offset {honest[0]:.2f}, angle {honest[1]:.2f}")
        assert all(0.8 <= value <= 1.25 for value in honest)
    benchmark(extract_segments, edge.image, PLAIN, HERE)
    offset, angle, contrast = np.array(misses)[:, [0, 1, 4]].T
    assert np.median(np.abs(offset)) <= 0.05
    assert np.degrees(np.median(np.abs(angle))) <= 0.05
    assert abs(offset.mean()) <= 0.01
    assert abs(np.median(contrast) - 1.0) < 0.05


def recall(images, name: str) -> tuple[list[float], list[float]]:
    """Covered shares of LSD, the default and the paper's extractor, and total lengths found over LSD's."""
    sums = np.zeros((3, 3))
    for image, camera, labels in images:
        for row, config in enumerate((LSD, HERE, HOUGH)):
            ideal = extract_segments(image, camera, config).ideal_px
            length = float(np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1).sum())
            sums[row] += [*covered_px(labels, ideal), length]
    shares, lengths = sums[:, 1] / sums[:, 0], sums[:, 2] / sums[0, 2]
    tell(
        "{}: LSD {:.1f} %, here {:.1f} %, Hough {:.1f} %;".format(name, *(100.0 * shares)),
        "with {1:.2f}, {2:.2f} of its length".format(*lengths),
    )
    return shares.tolist(), lengths.tolist()


def test_recall_of_labelled_lines(benchmark, data):
    """Three points more of the labelled length than all that LSD finds, with little more to offer."""
    shares, lengths = benchmark.pedantic(lambda: recall(photographs(data), "york"), rounds=1)
    assert shares[1] >= shares[0] + 0.03
    assert lengths[1] <= 1.1


@pytest.mark.parametrize("session", SESSIONS)
def test_recall_of_the_maps_edges(benchmark, data, session):
    """Three points more of the visible length than all that LSD finds."""
    shares, _ = benchmark.pedantic(lambda: recall(frames(data, session), session), rounds=1)
    assert shares[1] >= shares[0] + 0.03
