"""The noise of drawn lines is what the methods are told, for both readings of table 1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maps.poses import Array
from runs.experiments.cases import CASES, STD_CENTRE_PX, STD_SCALE, Case
from runs.experiments.linenoise import deviations, disturbed, image_segments

DRAWS = 20_000
PER_IMAGE, PER_POINT = CASES["qi3"], CASES["point_noise"]
LINE = np.array([[[120.0, -60.0], [250.0, 170.0]]])


def errors_at_pivot(line: Array, case: Case) -> tuple[Array, Array]:
    """Offsets [px] at the stated pivot, and turns [rad], of many draws against the exact line."""
    lines = np.repeat(line, DRAWS, axis=0)
    noisy = disturbed(lines, case, np.random.default_rng(5))
    span = lines[0, 1] - lines[0, 0]
    along = span / np.linalg.norm(span)
    across = np.array([-along[1], along[0]])
    pivot = line[0].mean(axis=0) + deviations(line, case).pivot_px[0] * along
    found = noisy[:, 1] - noisy[:, 0]
    turns = np.arctan2(found @ across, found @ along)
    offsets = (noisy[:, 0] - pivot) @ across - ((noisy[:, 0] - pivot) @ along) * np.tan(turns)
    return offsets, turns


@pytest.mark.parametrize("case", [replace(PER_IMAGE, noise=0.5), PER_POINT, replace(PER_POINT, noise=0.3)])
def test_stated_deviations_are_those_of_the_draws(case: Case) -> None:
    known = deviations(LINE, case)
    offsets, turns = errors_at_pivot(LINE, case)
    if not case.per_point:
        # One calibration for all lines of an image: it is the camera's to tell, not the lines'.
        offsets, turns = offsets - offsets.mean(), turns - turns.mean()
    assert offsets.std() == pytest.approx(known.offset_px[0], rel=0.03)
    assert turns.std() == pytest.approx(known.angle_rad[0], rel=0.03)
    assert abs(np.corrcoef(offsets, turns)[0, 1]) < 0.03


def test_calibration_is_one_draw_an_image_or_one_a_point() -> None:
    lines = np.repeat(LINE, 400, axis=0)
    # Without the lines' own noise only calibration is left; it moves every point of an image alike.
    silent = np.random.default_rng(1)
    shifts = disturbed(lines, PER_IMAGE, silent) - lines
    assert np.ptp(shifts[:, 0, 0]) > 1.0  # line noise is there
    means = [
        (disturbed(lines, PER_IMAGE, np.random.default_rng(seed)) - lines).mean(axis=(0, 1))
        for seed in range(300)
    ]
    expected = np.hypot(STD_SCALE * LINE[0].mean(axis=0), STD_CENTRE_PX)
    across = np.array([-230.0, 130.0]) / np.hypot(230.0, 130.0)
    # Only what is across the line shows: the ends follow it.
    assert np.std(np.array(means) @ across) == pytest.approx(np.linalg.norm(expected * across), rel=0.25)
    per_point = (disturbed(lines, PER_POINT, np.random.default_rng(0)) - lines).mean(axis=(0, 1))
    assert np.linalg.norm(per_point) < 1.0


def test_ends_move_across_their_line_only_and_not_at_all_without_noise() -> None:
    lines = LINE + np.random.default_rng(2).uniform(-50, 50, (30, 1, 2))
    exact = disturbed(lines, CASES["no_noise"], np.random.default_rng(3))
    np.testing.assert_allclose(exact, lines, atol=1e-9)
    lone = replace(PER_POINT, noise=1e-3)
    moved = disturbed(lines, lone, np.random.default_rng(3)) - lines
    assert 0.0 < np.abs(moved).max() < 0.1


def test_an_end_points_deviation_adds_up_offset_and_lever() -> None:
    known = deviations(LINE, PER_IMAGE)
    segments = image_segments(LINE, (320.0, 240.0), PER_IMAGE)
    half = 0.5 * np.linalg.norm(LINE[0, 1] - LINE[0, 0])
    ends = (
        known.offset_px[0] ** 2 + (np.array([-half, half]) - known.pivot_px[0]) ** 2 * known.angle_rad[0] ** 2
    )
    assert segments.sigma_px[0] ** 2 == pytest.approx(ends.mean())
    np.testing.assert_allclose(segments.raw_px, LINE + [320.0, 240.0])
    # The pivot is the foot of the principal point.
    along = (LINE[0, 1] - LINE[0, 0]) / (2.0 * half)
    foot = LINE[0].mean(axis=0) + known.pivot_px[0] * along
    assert abs(foot @ along) < 1e-9
