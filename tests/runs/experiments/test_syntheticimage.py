"""Synthetic images: the protocol of section 4.1, and that their bound is the one that can be reached."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from maps.errors import InputError
from runs.experiments.cases import CASES, FEWEST, MOST
from runs.experiments.hall import hall_map
from runs.experiments.syntheticimage import (
    CENTRE_PX,
    HEIGHT,
    MIN_LENGTH_PX,
    WIDTH,
    Scene,
    draw_scene,
    exactly_known,
    observed,
    synthetic_image,
)
from vision.pose import estimate_pose

HALL = exactly_known(hall_map())


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    """Return scenes of 60 images."""
    return [draw_scene(HALL, 7, number) for number in range(60)]


def test_scenes_show_enough_and_stand_clear_of_walls(scenes: list[Scene]) -> None:
    for scene in scenes:
        assert FEWEST <= len(scene.rows) <= MOST
        assert len(np.unique(scene.rows)) == len(scene.rows)
        assert (np.linalg.norm(scene.ends[:, 1] - scene.ends[:, 0], axis=1) >= MIN_LENGTH_PX).all()
        assert abs(scene.pitch_rad) <= math.radians(8.0)
    counts = [len(scene.rows) for scene in scenes]
    assert min(counts) < 8 < max(counts)


def test_an_image_hangs_on_seed_and_number_alone(scenes: list[Scene]) -> None:
    case = CASES["qi2"]
    again = synthetic_image(HALL, draw_scene(HALL, 7, 3), case)
    first = synthetic_image(HALL, scenes[3], case)
    np.testing.assert_array_equal(first.segments.ideal_px, again.segments.ideal_px)
    assert first.window == again.window
    other = synthetic_image(HALL, draw_scene(HALL, 8, 3), case)
    assert other.truth != first.truth


def test_cases_share_what_they_do_not_change(scenes: list[Scene]) -> None:
    one, two, busy = (synthetic_image(HALL, scenes[0], CASES[name]) for name in ("qi1", "qi3", "clutter60"))
    np.testing.assert_array_equal(one.segments.ideal_px, two.segments.ideal_px)
    ratio = one.window.centre.minus(one.truth) / two.window.centre.minus(two.truth)
    np.testing.assert_allclose(ratio, [0.3 / 0.75, 0.3 / 0.75, 0.5])
    assert (busy.sources == -1).sum() == 60
    own = busy.segments.ideal_px[busy.sources >= 0]
    np.testing.assert_allclose(np.sort(own.ravel()), np.sort(one.segments.ideal_px[one.sources >= 0].ravel()))


def test_the_truth_is_in_the_window(scenes: list[Scene]) -> None:
    for name in ("qi1", "qi3", "far", "global"):
        for scene in scenes[:20]:
            image = synthetic_image(HALL, scene, CASES[name])
            away = image.truth.minus(image.window.centre)
            assert math.hypot(away[0], away[1]) <= image.window.dt_m
            assert abs(away[2]) <= image.window.dphi_rad


def test_added_lines_lie_in_the_image_and_missed_ones_do_not(scenes: list[Scene]) -> None:
    low = -np.array(CENTRE_PX)
    missed = total = 0
    for scene in scenes[:20]:
        image = synthetic_image(HALL, scene, CASES["clutter40"])
        added = image.segments.ideal_px[image.sources < 0]
        assert (added >= low - 1e-6).all()
        assert (added <= low + [WIDTH - 1 + 1e-6, HEIGHT - 1 + 1e-6]).all()
        assert (image.segments.lengths_px[image.sources < 0] >= MIN_LENGTH_PX - 1e-6).all()
        thinned = synthetic_image(HALL, scene, CASES["missed"])
        missed += len(scene.rows) - (thinned.sources >= 0).sum()
        total += len(scene.rows)
    assert 0.15 < missed / total < 0.45


def test_fragments_lie_on_their_edge_and_are_long_enough(scenes: list[Scene]) -> None:
    exact = replace(CASES["fragments"], noise=0.0)
    more = 0
    for scene in scenes[:10]:
        image = synthetic_image(HALL, scene, exact)
        own = image.sources >= 0
        more += own.sum() - len(scene.rows)
        assert (image.segments.lengths_px[own] >= MIN_LENGTH_PX - 1e-6).all()
        for row, ends in zip(image.sources[own], image.segments.ideal_px[own], strict=True):
            start, end = scene.ends[scene.rows == row][0]
            offset, span = ends - start, end - start
            across = offset[:, 0] * span[1] - offset[:, 1] * span[0]
            np.testing.assert_allclose(across / np.linalg.norm(span), 0.0, atol=1e-6)
    assert more > 20


def test_a_tilted_camera_is_told_another_pitch(scenes: list[Scene]) -> None:
    off = []
    for scene in scenes:
        mount = synthetic_image(HALL, scene, CASES["tilt"]).camera.mount
        assert mount.std_pitch_down_rad == pytest.approx(math.radians(1.0))
        off.append(mount.pitch_down_rad - scene.pitch_rad)
    assert math.degrees(float(np.std(off))) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("name", ["qi3", "point_noise", "low_noise", "tilt", "fragments"])
def test_right_pairs_reach_the_bound_and_no_better(scenes: list[Scene], name: str) -> None:
    case = CASES[name]
    squared = []
    for scene in scenes:
        image = synthetic_image(HALL, scene, case)
        own = image.sources >= 0
        seen = observed(HALL, image.camera, image.sources[own], image.segments.ideal_px[own], case)
        error = estimate_pose(image.truth, image.camera, seen).pose.minus(image.truth)
        squared.append(error @ np.linalg.solve(image.bound, error))
    # The mean of 180 squared normal deviates has a deviation of 0.105.
    assert 0.65 < np.sum(squared) / (3.0 * len(squared)) < 1.4


def test_a_map_that_shows_too_little_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runs.experiments.syntheticimage._MOST_DRAWS", 200)
    bare = replace(
        HALL,
        endpoints=HALL.endpoints[:3],
        sight_endpoints=HALL.sight_endpoints[:3],
        names=HALL.names[:3],
        kinds=HALL.kinds[:3],
        sigma_m=HALL.sigma_m[:3],
        detection_rate=HALL.detection_rate[:3],
        polarity=HALL.polarity[:3],
    )
    with pytest.raises(InputError, match="hardly any pose"):
        draw_scene(bare, 1, 0)
