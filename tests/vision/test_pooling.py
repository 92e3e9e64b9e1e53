import math

import numpy as np
import pytest

from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from vision.decision import DecisionConfig
from vision.pooling import pooled

CONFIG = DecisionConfig()


def at(x: float) -> PoseBelief:
    return PoseBelief(0, Pose2(x, 0.0, 0.0), 1e-4 * np.eye(3))


def found(x: float, score: float) -> Fix:
    return Fix(at(x), Look(score=score))


def test_without_a_place_it_is_the_first_reason():
    nothing = [NoFix(Reason.WEAK_EVIDENCE), NoFix(Reason.NO_HYPOTHESIS)]
    assert pooled(nothing, CONFIG) is nothing[0]


def test_the_only_place_is_it():
    only = found(1.0, 20.0)
    assert pooled([NoFix(Reason.NO_HYPOTHESIS), only], CONFIG) is only


def test_much_more_evidence_wins():
    best = found(5.0, 80.0)
    outcome = pooled([found(1.0, 20.0), best], CONFIG)
    assert isinstance(outcome, Fix)
    assert (outcome.belief, outcome.look) == (best.belief, best.look)


def test_like_evidence_for_two_places_is_ambiguous():
    outcome = pooled([found(1.0, 40.0), found(5.0, 42.0)], CONFIG)
    assert isinstance(outcome, Ambiguous)
    assert [belief.pose.x for belief in outcome.beliefs] == [5.0, 1.0]
    odds = math.exp(2.0 / CONFIG.score_temper)
    assert outcome.odds == pytest.approx((odds / (1.0 + odds), 1.0 / (1.0 + odds)))


def test_one_place_in_two_windows_counts_once():
    outcome = pooled([found(1.0, 40.0), found(1.1, 42.0)], CONFIG)
    assert isinstance(outcome, Fix)
    assert outcome.belief.pose.x == 1.1


def test_ambiguous_windows_bring_their_odds():
    both = Ambiguous((at(1.0), at(5.0)), (0.75, 0.25), Look(score=40.0))
    outcome = pooled([both, found(9.0, 40.0)], CONFIG)
    assert isinstance(outcome, Ambiguous)
    assert outcome.odds == pytest.approx((0.5, 0.375, 0.125))
    assert sum(outcome.odds) == pytest.approx(1.0)
