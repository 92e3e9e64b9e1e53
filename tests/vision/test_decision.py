"""Decisions: too little evidence, rivals elsewhere, neighbours merged."""

from __future__ import annotations

import numpy as np
import pytest

from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from vision.association import Matches
from vision.decision import DecisionConfig, decide
from vision.projection import Prediction
from vision.refinement import Candidate

CONFIG = DecisionConfig()
COVARIANCE = np.diag([0.01, 0.02, 0.005]) ** 2


def candidate(score: float, x: float = 0.0, phi: float = 0.0, matched: int = 10) -> Candidate:
    rows = np.arange(matched)
    nothing = np.zeros((matched, 2))
    view = Prediction(rows, np.zeros((matched, 2, 2)), nothing, np.zeros((matched, 3)))
    belief = PoseBelief(5, Pose2(x, 1.0, phi), COVARIANCE)
    return Candidate(belief, view, Matches(rows, rows, nothing, nothing), score)


def test_one_good_candidate_is_the_fix() -> None:
    outcome = decide([candidate(80.0)], Look(), CONFIG)
    assert isinstance(outcome, Fix)
    assert outcome.belief.stamp_ns == 5
    assert outcome.belief.pose == Pose2(0.0, 1.0, 0.0)
    np.testing.assert_allclose(outcome.belief.covariance, COVARIANCE)


@pytest.mark.parametrize(
    "weak", [candidate(CONFIG.min_score - 1.0), candidate(80.0, matched=CONFIG.min_matched - 1)]
)
def test_too_little_evidence_is_no_fix(weak: Candidate) -> None:
    outcome = decide([weak], Look(), CONFIG)
    assert isinstance(outcome, NoFix)
    assert outcome.reason is Reason.WEAK_EVIDENCE


def test_an_equal_rival_elsewhere_makes_the_image_ambiguous() -> None:
    for rival in (candidate(79.0, x=1.0), candidate(79.0, phi=0.5)):
        outcome = decide([candidate(80.0), rival], Look(), CONFIG)
        assert isinstance(outcome, Ambiguous)
        assert sum(outcome.odds) == pytest.approx(1.0)
        assert outcome.odds[0] > outcome.odds[1]
        assert outcome.beliefs[1] is rival.belief


def test_a_far_weaker_rival_does_not() -> None:
    assert isinstance(decide([candidate(80.0), candidate(30.0, x=1.0)], Look(), CONFIG), Fix)


def test_many_weak_rivals_count_together() -> None:
    rivals = [candidate(80.0 - 4.0 * np.log(300.0), x=1.0 + x) for x in range(5)]
    assert isinstance(decide([candidate(80.0), *rivals[:1]], Look(), CONFIG), Fix)
    assert isinstance(decide([candidate(80.0), *rivals], Look(), CONFIG), Ambiguous)


def test_neighbours_merge_and_their_distance_widens_the_covariance() -> None:
    outcome = decide([candidate(80.0), candidate(80.0, x=0.08)], Look(), CONFIG)
    assert isinstance(outcome, Fix)
    assert outcome.belief.pose.x == pytest.approx(0.04)
    expected = COVARIANCE + np.diag([0.04**2, 0.0, 0.0])
    np.testing.assert_allclose(outcome.belief.covariance, expected, atol=1e-12)


def test_neighbours_across_the_wrap_merge_there() -> None:
    outcome = decide([candidate(80.0, phi=np.pi - 0.01), candidate(80.0, phi=-np.pi + 0.01)], Look(), CONFIG)
    assert isinstance(outcome, Fix)
    assert abs(outcome.belief.pose.phi) == pytest.approx(np.pi)
    assert outcome.belief.heading_std_rad == pytest.approx(np.hypot(0.005, 0.01))
