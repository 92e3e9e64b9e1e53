"""Lines as the estimator weighs them: two points about the pivot, and honest deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawing import CAMERA, segments_at

from maps.poses import Array
from vision.lines import ImageSegments
from vision.measurements import measured_lines

FOCAL_PX = CAMERA.focal_px


def some_segments() -> ImageSegments:
    rng = np.random.default_rng(40)
    starts = rng.uniform([-300, -220], [300, 220], (20, 2))
    return segments_at(np.stack([starts, starts + rng.normal(0.0, 80.0, starts.shape)], axis=1))


def test_without_a_pivot_the_two_points_are_the_ends() -> None:
    segments = some_segments()
    lines = measured_lines(segments, FOCAL_PX, 0.5)
    assert len(lines) == len(segments)
    np.testing.assert_allclose(lines.rays[..., :2], segments.ideal_px, atol=1e-9)
    np.testing.assert_array_equal(lines.rays[..., 2], FOCAL_PX)
    np.testing.assert_array_equal(lines.ends_px, segments.ideal_px)
    np.testing.assert_array_equal(lines.polarity, segments.polarity)


def test_the_pivot_moves_both_points_along_the_line_and_not_its_ends() -> None:
    segments = some_segments()
    pivot = np.linspace(-40.0, 40.0, len(segments))
    lines = measured_lines(replace(segments, pivot_px=pivot), FOCAL_PX, 0.5)
    moved = lines.rays[..., :2] - segments.ideal_px
    np.testing.assert_allclose(moved[:, 0], moved[:, 1], atol=1e-9)
    # Towards the second end where it is positive.
    np.testing.assert_allclose((moved[:, 0] * lines.along).sum(axis=1), pivot, atol=1e-9)
    np.testing.assert_allclose(moved[:, 0], pivot[:, None] * lines.along, atol=1e-9)
    np.testing.assert_array_equal(lines.ends_px, segments.ideal_px)


@pytest.mark.parametrize("model_px", [0.0, 0.5, 2.0])
def test_deviations_are_the_measurements_and_the_models(model_px: float) -> None:
    segments = some_segments()
    lines = measured_lines(segments, FOCAL_PX, model_px)
    # Two ends that err independently, by 0.5 px and by what the model lacks.
    expected = np.full(len(lines), np.hypot(0.5, model_px) / np.sqrt(2.0))
    np.testing.assert_allclose(lines.sigma_middle_px, expected)
    np.testing.assert_allclose(lines.sigma_slope_px, expected)


def test_deviations_are_those_of_the_points_distances() -> None:
    """Draw lines with errors of offset and direction about the pivot; see how the two points scatter."""
    rng, count = np.random.default_rng(41), 20_000
    truth = segments_at(np.array([[[-50.0, 10.0], [70.0, 40.0]]]))
    truth = replace(
        truth,
        sigma_middle_px=np.array([0.3]),
        sigma_angle_rad=np.array([0.004]),
        pivot_px=np.array([35.0]),
    )
    promised = measured_lines(truth, FOCAL_PX, 0.0)
    along = promised.along[0]
    across = np.array([-along[1], along[0]])
    pivot = truth.ideal_px[0].mean(axis=0) + 35.0 * along
    offset, turn = rng.normal(0.0, 0.3, count), rng.normal(0.0, 0.004, count)
    # The line's own ends, where an extractor would have put them.
    reach: Array = (truth.ideal_px[0] - pivot) @ along
    ends = pivot + reach[:, None] * along + (offset[:, None] + turn[:, None] * reach)[..., None] * across
    drawn = replace(segments_at(ends), pivot_px=np.full(count, 35.0))
    distances = (measured_lines(drawn, FOCAL_PX, 0.0).rays[..., :2] - pivot) @ across
    middle, slope = distances.mean(axis=1), 0.5 * (distances[:, 1] - distances[:, 0])
    assert middle.std() == pytest.approx(promised.sigma_middle_px[0], rel=0.03)
    assert slope.std() == pytest.approx(promised.sigma_slope_px[0], rel=0.03)
    assert abs(np.corrcoef(middle, slope)[0, 1]) < 0.03


def test_no_lines_and_a_line_without_length_are_finite() -> None:
    assert len(measured_lines(segments_at(np.zeros((0, 2, 2))), FOCAL_PX, 0.5)) == 0
    point = measured_lines(segments_at(np.full((1, 2, 2), 7.0)), FOCAL_PX, 0.5)
    assert np.isfinite(point.rays).all()
    assert np.isfinite(point.along).all()
