"""Several places at once: founding, competing, splitting, merging, and how many are kept."""

import math

import numpy as np
import pytest

from localization.hypotheses import Hypotheses, HypothesesConfig
from localization.odometry import OdometryStep
from localization.sightings import Sighting
from localization.verdicts import Unused
from maps.outcomes import PoseBelief
from maps.poses import Pose2

CONFIG, GATE, SECOND_NS = HypothesesConfig(), 0.999, 1_000_000_000


def at(x: float, y: float = 0.0, phi: float = 0.0, std: float = 0.05) -> PoseBelief:
    return PoseBelief(0, Pose2(x, y, phi), std**2 * np.eye(3))


def look(*beliefs: PoseBelief, odds=None, seconds: float = 1.0, doubt=None) -> Sighting:
    share = tuple(1.0 / len(beliefs) for _ in beliefs) if odds is None else odds
    return Sighting(round(seconds * SECOND_NS), beliefs, share, doubt, Unused.AMBIGUOUS)


def after(start: Hypotheses, *looks: Sighting, leader: int | None = 0) -> Hypotheses:
    for sighting in looks:
        start = start.seen(sighting, leader, GATE, CONFIG)
        total = sum(place.weight for place in start.places) + start.elsewhere
        assert total == pytest.approx(1.0)
        assert [place.weight for place in start.places] == sorted(
            (place.weight for place in start.places), reverse=True
        )
        assert len({place.name for place in start.places}) == len(start.places) <= CONFIG.most
    return start


def xs(hypotheses: Hypotheses) -> list[float]:
    return [round(place.estimate.pose.x, 1) for place in hypotheses.places]


def test_a_look_founds_a_place_and_a_second_one_makes_it_likely():
    once = after(Hypotheses.none(), look(at(3.0)))
    assert xs(once) == [3.0]
    # Half of elsewhere goes there; a tenth stays, since looks may be wrong.
    assert once.places[0].weight == pytest.approx(0.5 / 0.6)
    assert (once.places[0].views, once.places[0].fused_ns) == (1.0, SECOND_NS)
    twice = after(once, look(at(3.0), seconds=2.0))
    assert twice.places[0].weight == pytest.approx(0.5 / 0.51)
    assert twice.places[0].views == 2.0


@pytest.mark.parametrize("seconds", [1.0, 1.1])
def test_a_look_at_the_same_moment_counts_as_far_as_it_is_another_one(seconds):
    twice = after(Hypotheses.none(), look(at(3.0)), look(at(3.0), seconds=seconds))
    count = (seconds - 1.0) / CONFIG.apart_s
    assert twice.places[0].views == pytest.approx(1.0 + count)
    assert twice.elsewhere == pytest.approx(0.1 * 0.1**count / (0.5 + 0.1 * 0.1**count))


def test_moving_makes_another_look_of_it_too():
    once = after(Hypotheses.none(), look(at(3.0)))
    moved = once.moved(OdometryStep(0, 1, 0.05, 0.0, np.zeros((2, 2))), CONFIG)
    assert moved.independence(SECOND_NS, CONFIG) == pytest.approx(0.5)
    turned = once.moved(OdometryStep(0, 1, 0.0, -0.2, np.zeros((2, 2))), CONFIG)
    assert turned.independence(SECOND_NS, CONFIG) == 1.0


def test_vague_looks_and_positions_alone_found_nothing():
    blind = PoseBelief(0, Pose2(3.0, 0.0, 0.0), np.diag([0.01, 0.01, math.inf]))
    assert after(Hypotheses.none(), look(blind), look(at(3.0, std=0.6), seconds=2.0)).places == ()


def test_what_one_place_explains_is_fused_there_alone():
    both = after(Hypotheses.none(), look(at(0.0), at(5.0)), leader=None)
    one = after(both, look(at(5.0), seconds=2.0), leader=None)
    assert xs(one) == [5.0, 0.0]
    assert one.places[0].weight > 5.0 * one.places[1].weight
    variances = [place.estimate.covariance[0, 0] for place in one.places]
    assert variances == pytest.approx([0.05**2 / 2, 0.05**2])
    assert (one.places[0].nis, one.places[1].nis) == (pytest.approx(0.0), None)


def test_a_place_that_two_explain_splits_and_the_heavier_keeps_the_name():
    start = Hypotheses.at(at(0.0, std=0.4), CONFIG)
    split = after(start, look(at(-0.6, std=0.02), at(0.5, std=0.02)))
    assert xs(split) == [0.5, -0.6]
    assert split.named(0) is split.places[0]
    assert split.places[1].name != 0


def test_an_unlikely_place_of_an_ambiguous_look_is_not_fused():
    start = Hypotheses.at(at(0.0), CONFIG)
    seen = after(start, look(at(5.0), at(0.02), odds=(0.9, 0.1)))
    assert seen.named(0).nis is None
    assert seen.named(0).estimate.pose.x == 0.0


def test_close_places_that_explain_each_other_become_one():
    both = after(Hypotheses.none(), look(at(0.0, std=0.1), at(0.2, std=0.1), odds=(0.6, 0.4)), leader=None)
    assert xs(both) == [0.0]
    assert both.places[0].weight == pytest.approx(0.5 / 0.6)


def test_close_places_that_contradict_each_other_are_kept():
    """Or a fix just outside the gate could never win over a belief that is too sure of itself."""
    start = Hypotheses.at(at(0.0, std=0.01), CONFIG)
    assert xs(after(start, look(at(0.2, std=0.01)))) == [0.0, 0.2]


def test_five_at_most_and_the_leading_one_among_them():
    start = Hypotheses.at(at(50.0), CONFIG)
    many = after(start, *(look(at(3.0 * n), seconds=n + 1.0) for n in range(8)))
    assert len(many.places) == CONFIG.most
    assert many.named(0) is not None


def test_a_challenger_is_dropped_once_the_leading_place_is_seen_again():
    start = after(Hypotheses.at(at(0.0), CONFIG), look(at(4.0)))
    assert xs(start) == [0.0, 4.0]
    assert xs(after(start, look(at(0.0), seconds=2.0))) == [0.0]


def test_what_speaks_against_all_speaks_for_elsewhere():
    start = Hypotheses.at(at(0.0), CONFIG)
    assert after(start, look(doubt=1.0)).elsewhere == pytest.approx(0.01)
    assert after(start, look(doubt=0.25)).elsewhere == pytest.approx(0.01 / (0.01 + 0.99 * 0.25))
    # And what comes after finds a place sooner.
    doubted = after(start, look(doubt=0.25), look(doubt=0.25, seconds=2.0), look(at(4.0), seconds=3.0))
    assert doubted.places[1].weight > 0.2


def test_a_place_that_has_become_vague_goes_elsewhere():
    start = after(Hypotheses.at(at(0.0), CONFIG), look(at(4.0)))
    wild = OdometryStep(0, 1, 0.0, 0.0, np.diag([0.0, 2.0]))
    assert start.moved(wild, CONFIG).places == ()
    assert start.moved(wild, CONFIG).elsewhere == pytest.approx(1.0)


def test_a_place_seen_again_weighs_no_less_than_a_new_one():
    start = Hypotheses.at(at(0.0), CONFIG)
    forgotten = after(start, *(look(doubt=0.25, seconds=n) for n in range(1, 12)))
    assert forgotten.places[0].weight < 1e-3
    seen = after(forgotten, look(at(0.0), seconds=20.0))
    assert seen.places[0].weight == pytest.approx(0.5 / 0.6, rel=0.01)


def test_a_fix_beside_a_place_shows_no_other_place():
    """On a map that is off by some centimetres fixes lie farther apart than they say."""
    start = Hypotheses.at(at(0.0, std=0.01), CONFIG)
    far = 0.01 * math.sqrt(2.0 * 25.0)
    (place,) = after(start, look(at(far, std=0.01))).places
    assert place.estimate.pose.x == pytest.approx(0.5 * far)
    assert place.estimate.belief.covariance[0, 0] > 1.5 * 0.5 * 0.01**2
    assert place.views == 1.0
    # Beyond twice the gate it is an outlier or another place.
    assert len(after(start, look(at(0.01 * math.sqrt(2.0 * 40.0), std=0.01))).places) == 2
    # As far in standard deviations, but too far in metres.
    wide = Hypotheses.at(at(0.0, std=0.1), CONFIG)
    assert len(after(wide, look(at(0.1 * math.sqrt(2.0 * 25.0), std=0.1))).places) == 2
