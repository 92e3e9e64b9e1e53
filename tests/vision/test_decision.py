"""Decisions: too little evidence, rivals elsewhere, neighbours merged."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from vision.association import Matches
from vision.decision import DecisionConfig, decide
from vision.projection import Prediction
from vision.refinement import Candidate

CONFIG = DecisionConfig()
#: So few poses that the best of them is no accident.
TRIED = 10.0
COVARIANCE = np.diag([0.01, 0.02, 0.005]) ** 2


def candidate(score: float, x: float = 0.0, phi: float = 0.0, matched: int = 10) -> Candidate:
    rows = np.arange(matched)
    nothing = np.zeros((matched, 2))
    view = Prediction(rows, np.zeros((matched, 2, 2)), nothing, np.zeros((matched, 3)), nothing)
    belief = PoseBelief(5, Pose2(x, 1.0, phi), COVARIANCE)
    return Candidate(belief, view, Matches(rows, rows, nothing, nothing), score, gate_px=5.0)


def test_one_good_candidate_is_the_fix() -> None:
    outcome = decide([candidate(80.0)], Look(), TRIED, CONFIG)
    assert isinstance(outcome, Fix)
    assert outcome.belief.stamp_ns == 5
    assert outcome.belief.pose == Pose2(0.0, 1.0, 0.0)
    np.testing.assert_allclose(outcome.belief.covariance, COVARIANCE)


@pytest.mark.parametrize(
    "weak", [candidate(CONFIG.min_score - 1.0), candidate(80.0, matched=CONFIG.min_matched - 1)]
)
def test_too_little_evidence_is_no_fix(weak: Candidate) -> None:
    outcome = decide([weak], Look(), TRIED, CONFIG)
    assert isinstance(outcome, NoFix)
    assert outcome.reason is Reason.WEAK_EVIDENCE


def test_the_best_of_many_poses_needs_more_evidence() -> None:
    many = math.exp(40.0 / CONFIG.tried_weight)
    for score, tried, enough in (
        (39.0, many, False),
        (41.0, many, True),
        (CONFIG.min_score + 1.0, 1.0, True),
    ):
        outcome = decide([candidate(score)], Look(), tried, CONFIG)
        assert isinstance(outcome, Fix) == enough
        if isinstance(outcome, NoFix):
            assert outcome.reason is Reason.WEAK_EVIDENCE


def test_an_equal_rival_elsewhere_makes_the_image_ambiguous() -> None:
    for rival in (candidate(79.0, x=1.0), candidate(79.0, phi=0.5)):
        outcome = decide([candidate(80.0), rival], Look(), TRIED, CONFIG)
        assert isinstance(outcome, Ambiguous)
        assert sum(outcome.odds) == pytest.approx(1.0)
        assert outcome.odds[0] > outcome.odds[1]
        assert outcome.beliefs[1] is rival.belief


def test_a_far_weaker_rival_does_not() -> None:
    assert isinstance(decide([candidate(80.0), candidate(30.0, x=1.0)], Look(), TRIED, CONFIG), Fix)


def test_many_weak_rivals_count_together() -> None:
    rivals = [candidate(80.0 - 4.0 * np.log(60.0), x=1.0 + x) for x in range(5)]
    assert isinstance(decide([candidate(80.0), *rivals[:1]], Look(), TRIED, CONFIG), Fix)
    assert isinstance(decide([candidate(80.0), *rivals], Look(), TRIED, CONFIG), Ambiguous)


def test_of_many_places_the_likeliest_are_named_and_their_odds_sum_to_one() -> None:
    crowd = [candidate(80.0 - 0.5 * number, x=float(number)) for number in range(CONFIG.max_places + 3)]
    outcome = decide(crowd, Look(), TRIED, CONFIG)
    assert isinstance(outcome, Ambiguous)
    assert [belief.pose.x for belief in outcome.beliefs] == list(range(CONFIG.max_places))
    assert sum(outcome.odds) == pytest.approx(1.0)
    assert sorted(outcome.odds, reverse=True) == list(outcome.odds)


def test_places_far_less_likely_than_the_best_are_not_named() -> None:
    crowd = [candidate(80.0), candidate(79.0, x=1.0), candidate(40.0, x=2.0)]
    outcome = decide(crowd, Look(), TRIED, CONFIG)
    assert isinstance(outcome, Ambiguous)
    assert [belief.pose.x for belief in outcome.beliefs] == [0.0, 1.0]


def test_several_optima_of_one_place_count_together() -> None:
    # Alone the best is elsewhere; together the three at 1 m are likelier.
    crowd = [candidate(80.0), *(candidate(79.5, x=1.0 + 0.05 * number) for number in range(3))]
    outcome = decide(crowd, Look(), TRIED, CONFIG)
    assert isinstance(outcome, Ambiguous)
    assert [belief.pose.x for belief in outcome.beliefs] == pytest.approx([1.05, 0.0])
    assert outcome.odds[0] > 0.6


def test_neighbours_merge_and_their_distance_widens_the_covariance() -> None:
    outcome = decide([candidate(80.0), candidate(80.0, x=0.08)], Look(), TRIED, CONFIG)
    assert isinstance(outcome, Fix)
    assert outcome.belief.pose.x == pytest.approx(0.04)
    expected = COVARIANCE + np.diag([0.04**2, 0.0, 0.0])
    np.testing.assert_allclose(outcome.belief.covariance, expected, atol=1e-12)


def test_neighbours_across_the_wrap_merge_there() -> None:
    outcome = decide(
        [candidate(80.0, phi=np.pi - 0.01), candidate(80.0, phi=-np.pi + 0.01)], Look(), TRIED, CONFIG
    )
    assert isinstance(outcome, Fix)
    assert abs(outcome.belief.pose.phi) == pytest.approx(np.pi)
    assert outcome.belief.heading_std_rad == pytest.approx(np.hypot(0.005, 0.01))
