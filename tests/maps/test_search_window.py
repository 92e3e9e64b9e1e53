"""Windows: the disc and slice of headings, and the ellipsoid that may cut them down."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from maps.outcomes import PoseBelief, PoseEllipsoid, SearchWindow
from maps.poses import Array, Pose2

CENTRE = Pose2(1.0, -2.0, math.pi - 0.05)
#: Half a metre to the north-east, 5 cm across; a turn goes with the way.
ALONG, ACROSS = np.array([1.0, 1.0, 0.2]), np.array([1.0, -1.0, 0.0])
COVARIANCE = 0.125 * np.outer(ALONG, ALONG) + 0.00125 * np.outer(ACROSS, ACROSS) + np.diag([0.0, 0.0, 0.0004])
THIN = PoseEllipsoid(CENTRE, COVARIANCE, 9.0)


def at(*away: Array) -> Pose2:
    return Pose2.from_array(CENTRE.as_array() + sum(away, np.zeros(3)))


def test_an_ellipsoid_is_long_and_thin_and_goes_over_the_wrap() -> None:
    # Three standard deviations are 1.06 of ALONG, and 0.106 of ACROSS.
    inside = [at(), at(1.0 * ALONG), at(-1.0 * ALONG), at(0.1 * ACROSS)]
    outside = [at(1.1 * ALONG), at(0.12 * ACROSS), at(np.array([0.7, 0.7, -0.14]))]
    assert any(pose.phi < 0.0 for pose in inside), "over the wrap"
    assert THIN.holds(np.array([pose.as_array() for pose in inside])).all()
    assert not THIN.holds(np.array([pose.as_array() for pose in outside])).any()


def test_it_holds_as_many_draws_as_its_gate_says() -> None:
    ellipsoid = PoseEllipsoid(CENTRE, COVARIANCE, float(chi2.ppf(0.9, 3)))
    draws = np.random.default_rng(3).multivariate_normal(CENTRE.as_array(), COVARIANCE, 20_000)
    assert ellipsoid.holds(draws).mean() == pytest.approx(0.9, abs=0.01)


def test_its_volume_is_that_of_the_share_of_a_box() -> None:
    box = np.array([1.2, 1.2, 0.4])
    draws = CENTRE.as_array() + np.random.default_rng(4).uniform(-box, box, (200_000, 3))
    assert THIN.volume == pytest.approx(THIN.holds(draws).mean() * np.prod(2.0 * box), rel=0.05)


def test_a_window_with_an_ellipsoid_holds_what_both_hold() -> None:
    disc = SearchWindow(CENTRE, 0.8, 0.3)
    both = SearchWindow(CENTRE, 0.8, 0.3, THIN)
    assert disc.holds(at(0.3 * ACROSS))
    assert not both.holds(at(0.3 * ACROSS))
    assert THIN.holds(at(0.9 * ALONG).as_array()[None]).all()
    assert not both.holds(at(0.9 * ALONG))
    assert both.holds(at(0.4 * ALONG))


def test_a_vague_belief_may_still_lie_inside() -> None:
    beside = at(0.2 * ACROSS)
    exact, vague = (PoseBelief(0, beside, std**2 * np.eye(3)) for std in (0.001, 0.1))
    assert not THIN.may_hold(exact)
    assert THIN.may_hold(vague)


def test_equal_windows_are_equal_whatever_arrays_they_hold() -> None:
    one, same = (SearchWindow(CENTRE, 1.0, 0.3, PoseEllipsoid(CENTRE, COVARIANCE, 9.0)) for _ in range(2))
    other = SearchWindow(CENTRE, 1.0, 0.3, PoseEllipsoid(CENTRE, 2.0 * COVARIANCE, 9.0))
    assert one == same
    assert hash(one) == hash(same)
    assert len({one, same, other, SearchWindow(CENTRE, 1.0, 0.3)}) == 3
    assert THIN != "ellipsoid"


def test_near_the_centre_fewer_poses_are_as_likely_and_never_more_than_the_volume_at_the_rim() -> None:
    exact = 1e-12 * np.eye(3)
    away = [PoseBelief(0, at(share * ALONG), exact) for share in (0.0, 0.5, 1.0, 3.0)]
    held = [THIN.spread_at(belief) for belief in away]
    density = multivariate_normal(np.zeros(3), COVARIANCE).pdf([0.0 * ALONG, 0.5 * ALONG])
    assert held[:2] == pytest.approx(1.0 / density, rel=1e-6)
    assert held[0] < held[1] < held[2] <= THIN.volume
    assert held[3] == THIN.volume
