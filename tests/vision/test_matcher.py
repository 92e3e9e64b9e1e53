"""The matcher on drawn pictures: right where it answers, silent or of two minds where it should be."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drawing import BARREL, CAMERA, FISHEYE, draw, window_around
from scipy.stats import chi2
from toy_building import hall, toy_building

from maps.outcomes import Ambiguous, Fix, Look, NoFix, Outcome, PoseEllipsoid, Reason, SearchWindow
from maps.poses import Pose2
from maps.regions import ViewRegions, build_regions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.images import GreyImage
from vision.lines import extract_segments
from vision.matcher import LineMatcher

#: In the first room, through the door, in the second room and back through the door.
POSES = (
    Pose2(1.0, 1.0, 0.6),
    Pose2(6.0, 1.0, 2.5),
    Pose2(2.0, 5.5, -0.9),
    Pose2(4.0, 1.5, 0.0),
    Pose2(10.5, 1.5, 3.0),
    Pose2(3.0, 6.0, -2.0),
)
CASES = [(CAMERA, pose) for pose in POSES]
CASES += [(camera, pose) for camera in (BARREL, FISHEYE) for pose in POSES[:3]]
#: A Gaussian error is beyond this once in ten thousand times.
HONEST = float(chi2.ppf(0.9999, 3))
WINDOW = (0.3, math.radians(10.0))


@cache
def picture(camera: Camera, pose: Pose2, clutter: int = 0) -> GreyImage:
    return draw(toy_building().faces, camera, pose, np.random.default_rng(26), clutter)


def nees(outcome: Fix, pose: Pose2) -> float:
    error = outcome.belief.pose.minus(pose)
    return float(error @ np.linalg.solve(outcome.belief.covariance, error))


def assert_right(outcome: Outcome, pose: Pose2) -> None:
    assert isinstance(outcome, Fix)
    assert not outcome.partial
    away = outcome.belief.pose.minus(pose)
    assert np.hypot(away[0], away[1]) < 0.03
    assert abs(away[2]) < math.radians(0.3)
    assert nees(outcome, pose) < HONEST


@pytest.mark.parametrize(("camera", "pose"), CASES)
def test_a_picture_gives_its_pose(toy_map: WireMap, camera: Camera, pose: Pose2) -> None:
    matcher = LineMatcher(camera, toy_map)
    window = window_around(pose, np.random.default_rng(27), *WINDOW)
    outcome = matcher.match(picture(camera, pose), 42, window)
    assert_right(outcome, pose)
    assert isinstance(outcome, Fix)
    assert outcome.belief.stamp_ns == 42
    assert_consistent(outcome.look, toy_map)
    assert matcher.timing_ms["match"] > 0.0


def assert_consistent(look: Look, wire_map: WireMap) -> None:
    assert len(look.matched_map) == len(look.matched_image) == len(look.residuals_px) > 0
    assert len(np.unique(look.matched_image)) == len(look.matched_image)
    assert set(look.matched_map) <= set(look.predicted_map) <= set(range(len(wire_map)))
    assert look.predicted_px.shape == (len(look.predicted_map), 2, 2)
    assert look.matched_image.max() < len(look.lines_px)
    assert look.selected > 0
    assert look.hypotheses > 0


@pytest.mark.parametrize("pose", POSES[:3])
def test_strokes_that_are_in_no_map_do_not_mislead(toy_map: WireMap, pose: Pose2) -> None:
    window = window_around(pose, np.random.default_rng(28), *WINDOW)
    outcome = LineMatcher(CAMERA, toy_map).match(picture(CAMERA, pose, clutter=40), 0, window)
    assert_right(outcome, pose)


def test_over_the_wrap_of_the_heading(toy_map: WireMap) -> None:
    pose = Pose2(10.5, 1.5, math.pi - 0.01)
    window = SearchWindow(Pose2(10.4, 1.6, -math.pi + 0.05), *WINDOW)
    assert_right(LineMatcher(CAMERA, toy_map).match(picture(CAMERA, pose), 0, window), pose)


@pytest.mark.parametrize("pose", POSES[:3])
def test_an_ellipsoid_holds_the_fix_with_fewer_hypotheses_and_one_elsewhere_does_not(
    toy_map: WireMap, pose: Pose2
) -> None:
    centre = pose @ Pose2(0.2, 0.02, 0.02)
    cos, sin = math.cos(pose.phi), math.sin(pose.phi)
    turning = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    disc = SearchWindow(centre, 0.4, math.radians(12.0))
    long, wide = (
        replace(
            disc,
            ellipsoid=PoseEllipsoid(centre, turning @ np.diag([*stds, 0.03]) ** 2 @ turning.T, 9.0),
        )
        for stds in ((0.1, 0.03), (0.03, 0.1))
    )
    image = picture(CAMERA, pose)
    matcher = LineMatcher(CAMERA, toy_map)
    whole, less = matcher.match(image, 0, disc), matcher.match(image, 0, long)
    assert_right(less, pose)
    assert less.look.hypotheses < whole.look.hypotheses
    assert not isinstance(matcher.match(image, 0, wide), Fix)


def test_a_narrow_window_around_the_pose_is_enough(toy_map: WireMap) -> None:
    window = SearchWindow(POSES[0], 0.02, math.radians(0.5))
    assert_right(LineMatcher(CAMERA, toy_map).match(picture(CAMERA, POSES[0]), 0, window), POSES[0])


@pytest.fixture(scope="module")
def toy_regions(toy_map: WireMap) -> ViewRegions:
    return build_regions(toy_map, (CAMERA.mount.height_m, CAMERA.mount.height_m))


@pytest.mark.parametrize("pose", POSES)
def test_with_regions_the_fix_is_the_same(toy_map: WireMap, toy_regions: ViewRegions, pose: Pose2) -> None:
    window = window_around(pose, np.random.default_rng(27), *WINDOW)
    alone = LineMatcher(CAMERA, toy_map).match(picture(CAMERA, pose), 0, window)
    quick = LineMatcher(CAMERA, toy_map, regions=toy_regions).match(picture(CAMERA, pose), 0, window)
    assert isinstance(alone, Fix)
    assert isinstance(quick, Fix)
    np.testing.assert_allclose(quick.belief.pose.minus(alone.belief.pose), 0.0, atol=1e-6)
    np.testing.assert_allclose(quick.belief.covariance, alone.belief.covariance, rtol=1e-4, atol=1e-12)
    assert quick.look.score == pytest.approx(alone.look.score)
    np.testing.assert_array_equal(quick.look.matched_map, alone.look.matched_map)
    assert quick.look.selected <= alone.look.selected


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["as it is", "the other way round"])
def test_known_bright_sides_are_heeded(toy_map: WireMap, side: float) -> None:
    """Sides learnt from one picture hold in another; turned round, they leave nothing to match."""
    taught, pose = LineMatcher(CAMERA, toy_map), POSES[2]
    image = picture(CAMERA, pose)
    first = taught.match(image, 0, SearchWindow(pose, *WINDOW))
    assert isinstance(first, Fix)
    found = extract_segments(image, CAMERA, taught.config.lines)[first.look.matched_image]
    view = taught.projector.predict(first.belief.pose, first.look.matched_map)
    polarity = np.zeros(len(toy_map))
    for row, line, sign in zip(first.look.matched_map, found.ideal_px, found.polarity, strict=True):
        piece = view.ideal_px[np.flatnonzero(view.rows == row)[0]]
        polarity[row] = side * sign * np.sign((line[1] - line[0]) @ (piece[1] - piece[0]))
    known = LineMatcher(CAMERA, replace(toy_map, polarity=polarity))
    other = Pose2(pose.x + 0.15, pose.y - 0.1, pose.phi + 0.04)
    outcome = known.match(picture(CAMERA, other), 0, SearchWindow(pose, *WINDOW))
    if side > 0.0:
        assert_right(outcome, other)
    else:
        assert not isinstance(outcome, Fix)


def test_the_same_question_has_the_same_answer_bit_for_bit(toy_map: WireMap) -> None:
    image, window = picture(CAMERA, POSES[2], 40), SearchWindow(Pose2(2.1, 5.4, -0.85), *WINDOW)
    first, second = LineMatcher(CAMERA, toy_map), LineMatcher(CAMERA, toy_map)
    first.match(picture(CAMERA, POSES[0]), 0, SearchWindow(POSES[0], *WINDOW))
    outcomes = [first.match(image, 0, window), first.match(image, 0, window), second.match(image, 0, window)]
    for outcome in outcomes:
        assert isinstance(outcome, Fix)
        assert isinstance(outcomes[0], Fix)
        assert outcome.belief.pose == outcomes[0].belief.pose
        assert outcome.belief.covariance.tobytes() == outcomes[0].belief.covariance.tobytes()
        assert outcome.look.score == outcomes[0].look.score
        np.testing.assert_array_equal(outcome.look.matched_image, outcomes[0].look.matched_image)


def noise(rng: np.random.Generator) -> GreyImage:
    return rng.integers(0, 256, (480, 640), dtype=np.uint8)


EMPTY: dict[str, Callable[[], GreyImage]] = {
    "black": lambda: np.zeros((480, 640), np.uint8),
    "grey": lambda: np.full((480, 640), 127, np.uint8),
    "saturated": lambda: np.full((480, 640), 255, np.uint8),
    "noise": lambda: noise(np.random.default_rng(29)),
}


@pytest.mark.parametrize("image", EMPTY.values(), ids=EMPTY.keys())
def test_an_image_without_edges_has_too_few(toy_map: WireMap, image: Callable[[], GreyImage]) -> None:
    outcome = LineMatcher(CAMERA, toy_map).match(image(), 0, SearchWindow(POSES[0], *WINDOW))
    assert isinstance(outcome, NoFix)
    assert outcome.reason is Reason.TOO_FEW_SEGMENTS


def test_strokes_alone_are_no_fix(toy_map: WireMap) -> None:
    for seed in range(3):
        image = draw([], CAMERA, POSES[0], np.random.default_rng(seed), clutter=80)
        outcome = LineMatcher(CAMERA, toy_map).match(image, 0, SearchWindow(POSES[0], *WINDOW))
        assert isinstance(outcome, NoFix)
        assert outcome.reason in {Reason.WEAK_EVIDENCE, Reason.NO_HYPOTHESIS}
        assert len(outcome.look.lines_px) > 30


def test_facing_a_blank_wall_nothing_is_visible(toy_map: WireMap) -> None:
    facing = Pose2(7.2, 3.2, 0.0)
    outcome = LineMatcher(CAMERA, toy_map).match(
        picture(CAMERA, POSES[0]), 0, SearchWindow(facing, 0.1, 0.05)
    )
    assert isinstance(outcome, NoFix)
    assert outcome.reason is Reason.NOTHING_VISIBLE
    assert outcome.look.selected < 6


@pytest.mark.parametrize("pose", POSES)
def test_a_picture_of_another_building_is_no_fix(
    tmp_path_factory: pytest.TempPathFactory, pose: Pose2
) -> None:
    other = hall([1.0, 2.1, 4.0, 6.5]).read(tmp_path_factory.mktemp("hall"))
    matcher = LineMatcher(CAMERA, other)
    for place in (Pose2(3.0, 3.0, math.pi / 2), Pose2(7.0, 2.5, 2.5), Pose2(11.0, 4.0, -2.8)):
        assert not isinstance(matcher.match(picture(CAMERA, pose), 0, SearchWindow(place, *WINDOW)), Fix)


def test_a_window_elsewhere_in_the_right_building_is_no_fix(toy_map: WireMap) -> None:
    matcher = LineMatcher(CAMERA, toy_map)
    for pose, place in zip(POSES, (*POSES[1:], POSES[0]), strict=True):
        assert not isinstance(matcher.match(picture(CAMERA, pose), 0, SearchWindow(place, *WINDOW)), Fix)


@pytest.mark.parametrize("offset", [0.0, 0.2, -0.2])
def test_equal_panels_along_a_wall_are_never_told_apart(
    tmp_path_factory: pytest.TempPathFactory, offset: float
) -> None:
    building = hall([0.5 + 0.7 * count for count in range(19)])
    wire_map = building.read(tmp_path_factory.mktemp("hall"))
    pose = Pose2(7.0, 3.4, math.pi / 2)
    image = draw(building.faces, CAMERA, pose, np.random.default_rng(30))
    window = SearchWindow(Pose2(7.35 + offset, 3.4, math.pi / 2), 0.62, math.radians(5.0))
    outcome = LineMatcher(CAMERA, wire_map).match(image, 0, window)
    assert isinstance(outcome, Ambiguous)
    away = [belief.pose.minus(pose) for belief in outcome.beliefs]
    assert min(np.abs(gap).max() for gap in away) < 0.03
    assert abs(away[0][0] - away[1][0]) == pytest.approx(0.7, abs=0.03)
    assert sum(outcome.odds) == pytest.approx(1.0)


def test_a_window_with_one_of_the_equal_panels_gives_the_fix(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    building = hall([0.5 + 0.7 * count for count in range(19)])
    pose = Pose2(7.0, 3.4, math.pi / 2)
    image = draw(building.faces, CAMERA, pose, np.random.default_rng(30))
    matcher = LineMatcher(CAMERA, building.read(tmp_path_factory.mktemp("hall")))
    assert_right(matcher.match(image, 0, SearchWindow(Pose2(7.05, 3.4, 1.55), 0.2, math.radians(5.0))), pose)
