"""Counting map edges in pictures whose pose is known."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from maps.poses import Pose2
from runs.simulation.observable import Observed, observed
from tests.sessionframes import rendered_session
from tests.toy_building import toy_building
from vision.camera import Camera, CameraModel, CameraMount
from vision.projection import Projector

MOUNT = CameraMount(0.0, 0.0, 1.2, 0.0, 0.0, 0.0)
CAMERA = Camera(CameraModel.PINHOLE_RADTAN, 320, 240, 200.0, 200.0, 159.5, 119.5, np.zeros(5), MOUNT)
POSE = Pose2(2.0, 3.5, 0.3)


@pytest.fixture(scope="module")
def projector(tmp_path_factory: pytest.TempPathFactory) -> Projector:
    return Projector(CAMERA, toy_building().read(tmp_path_factory.mktemp("toy")))


def drawn(projector: Projector, share: float) -> np.ndarray:
    """Draw the first share of each visible piece as a step between two greys."""
    seen = projector.predict(POSE, np.arange(len(projector.wire_map)))
    rows, columns = np.mgrid[:240, :320]
    picture = np.full((240, 320), 100.0)
    for start, end in seen.ideal_px + [159.5, 119.5]:
        way = (end - start) / np.linalg.norm(end - start)
        along = (columns - start[0]) * way[0] + (rows - start[1]) * way[1]
        beside = (columns - start[0]) * -way[1] + (rows - start[1]) * way[0]
        on = (along >= 0.0) & (along <= share * np.linalg.norm(end - start)) & (np.abs(beside) < 2.0)
        picture[on] = 220.0
    return picture.astype(np.uint8)


def test_edges_that_are_drawn_are_found_and_those_that_are_not_are_visible_all_the_same(projector) -> None:
    whole, some, none = (observed(drawn(projector, share), projector, POSE) for share in (1.0, 0.3, 0.0))
    assert whole.visible == some.visible == none.visible > 8
    assert whole.observable >= 0.8 * whole.visible
    assert some.observable < 0.5 * whole.observable
    assert none.observable == 0


def test_a_camera_that_looks_elsewhere_sees_other_edges(projector) -> None:
    picture = drawn(projector, 1.0)
    turned = observed(picture, projector, replace(POSE, phi=POSE.phi + 0.2))
    assert turned.observable < 0.4 * observed(picture, projector, POSE).observable


def test_nothing_in_sight(projector) -> None:
    wall = Pose2(0.3, 3.5, np.pi)
    assert observed(np.full((240, 320), 90, np.uint8), projector, wall) == Observed(0, 0)


def test_rendered_sessions_say_the_same(data) -> None:
    """Their files come from samples and sight lines, one by one."""
    for name in ("building_a", "building_b"):
        folder = data / "rendered" / name
        session = rendered_session(folder)
        projector = Projector(session.camera, session.wire_map)
        with (folder / "observable.csv").open() as file:
            told = [(int(row["visible"]), int(row["observable"])) for row in csv.DictReader(file)][::10]
        counted = [observed(frame.image, projector, frame.truth) for frame in session.frames[::10]]
        for (visible, observable), own in zip(told, counted, strict=True):
            assert own.visible == pytest.approx(visible, abs=4)
            assert own.observable == pytest.approx(observable, abs=4)
