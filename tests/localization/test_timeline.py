"""Late is in-order: whatever the order of arrival, bit for bit, with one place or several, tracking or lost."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from localization.ekf import Estimate, predict
from localization.localizer import Localizer
from localization.odometry import OdometryStep
from localization.sightings import EvidenceConfig, Sighting, sighting_of
from localization.timeline import Timeline, TimelineConfig
from localization.trust import Mind
from localization.verdicts import Fused, Missed, Refusal, Rejected
from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason, SearchWindow
from maps.poses import Pose2

STEP_NS = 100_000_000
ANCHOR = PoseBelief(0, Pose2(0.0, 0.0, 3.0), np.diag([0.04, 0.04, 0.04]))
PARTS = TimelineConfig(0.999, 1e9)
SYSTEMATIC = np.array([[5e-3, 0.0, 0.0, 0.0], [0.0, 1e-2, 2e-3, 0.0], [0.0, 0.0, 0.0, 1e-3]])
LOOK = Look(predicted_px=np.zeros((20, 2, 2)))


def step_to(end: int) -> OdometryStep:
    turn = 0.1 * math.cos(end)
    noise = np.array([[1e-4, 1e-5], [1e-5, 4e-4]])
    return OdometryStep(
        *((end - 1) * STEP_NS, end * STEP_NS, 0.1, turn, noise, 1e-5), *(SYSTEMATIC, 0.01, 10.0)
    )


def place(stamp_ns: int, x: float = 0.0, y: float = 0.0, measured: bool = True) -> PoseBelief:
    return PoseBelief(stamp_ns, Pose2(x, y, 3.0), np.diag([0.01, 0.02, 0.01 if measured else math.inf]))


def ambiguous(stamp_ns: int, x: float, y: float, share: float) -> Ambiguous:
    return Ambiguous((place(stamp_ns, x, y), place(stamp_ns, x + 2.0, y)), (share, 1.0 - share))


STAMPS = st.one_of(st.integers(0, 10 * STEP_NS), st.sampled_from([0, STEP_NS, 250_000_000, 10 * STEP_NS]))
NEAR, FAR = st.floats(-0.5, 0.5), st.floats(-3.0, 3.0)
LOOKS = STAMPS.flatmap(
    lambda stamp_ns: st.tuples(
        st.just(stamp_ns),
        st.one_of(
            st.builds(lambda x, y: Fix(place(stamp_ns, x, y)), st.one_of(NEAR, FAR), NEAR),
            st.builds(lambda x, y: Fix(place(stamp_ns, x, y, False)), NEAR, NEAR),
            st.builds(lambda x, y, s: ambiguous(stamp_ns, x, y, s), FAR, NEAR, st.floats(0.3, 0.7)),
            st.sampled_from(list(Reason)).map(lambda reason: NoFix(reason, LOOK)),
        ),
    )
)


class Watched(Localizer):
    """Remembers whether it searched for a heading: what that brings depends on when it begins."""

    searched = False

    def _searching(self, start):
        self.searched = True
        return super()._searching(start)


def run(localizer: Localizer, looks, arrivals) -> Localizer:
    """Hand over ten steps in order, and each look before the step of its number."""
    for count in range(11):
        for (stamp_ns, outcome), arrival in zip(looks, arrivals, strict=True):
            if arrival == count:
                localizer.fuse(outcome, SearchWindow(Pose2(0.0, 0.0, 0.0), 0.5, 0.3), stamp_ns)
        if count < 10:
            localizer.predict(step_to(count + 1))
    return localizer


def known(localizer: Localizer) -> list[object]:
    """Everything that it knows, in a form that compares bit for bit."""
    beliefs = [
        (belief.stamp_ns, belief.pose, belief.covariance.tobytes(), weight)
        for belief, weight in localizer.beliefs
    ]
    at = localizer.belief_at(250_000_000)
    return [
        *beliefs,
        localizer.diagnosis,
        localizer.windows_at(10 * STEP_NS),
        at and (at.pose, at.covariance.tobytes()),
    ]


@settings(max_examples=80, deadline=None)
@given(st.data(), st.lists(LOOKS, min_size=1, max_size=7), st.sampled_from([ANCHOR, None]))
def test_any_order_of_arrival_leads_to_the_same_mind_bit_for_bit(data, looks, initial):
    """Fixes, positions, ambiguous looks and looks that show nothing; some at one stamp; started known or lost."""
    # A localizer that knows nothing begins with its first event; a still one pins it for both.
    begin = PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.diag([math.inf] * 3)) if initial is None else ANCHOR
    if initial is None:
        # Lost, positions alone would begin a search for the heading.
        looks = [
            look for look in looks if not (isinstance(look[1], Fix) and not look[1].belief.measured.all())
        ]
    ordered = sorted(looks, key=lambda look: look[0])
    in_order = run(Watched(begin), ordered, [-(-look[0] // STEP_NS) for look in ordered])
    arrivals = [data.draw(st.integers(0, 10), label="steps before") for _ in looks]
    shuffled = run(Watched(begin), looks, arrivals)
    assume(not in_order.searched and not shuffled.searched)
    assert known(in_order) == known(shuffled)


def sighting(outcome, stamp_ns: int = 0) -> Sighting:
    return sighting_of(outcome, stamp_ns, None, EvidenceConfig())


def timeline(steps: int = 0) -> Timeline:
    line = Timeline(0, Mind.at(ANCHOR, PARTS.hypotheses), PARTS)
    for end in range(1, steps + 1):
        line.append(step_to(end))
    return line


def test_a_look_is_taken_at_its_own_stamp():
    line = timeline(2)
    assert isinstance(line.insert(sighting(Fix(place(150_000_000, -0.1, 0.0)))), Fused)
    assert line.mind_at(149_999_999).leading.fused_ns == 0
    assert line.mind_at(150_000_000).leading.fused_ns == 150_000_000
    assert line.mind_at(line.end_ns).leading.estimate.stamp_ns == 2 * STEP_NS


def test_too_old_and_too_new():
    line = timeline()
    assert line.insert(sighting(Fix(place(-1)))) == Rejected(Refusal.TOO_OLD)
    assert line.insert(sighting(NoFix(Reason.NO_HYPOTHESIS), -1)) == Missed(Reason.NO_HYPOTHESIS)
    for end in range(1, 31):
        line.append(step_to(end))
    assert line.insert(sighting(Fix(place(19 * STEP_NS)))) == Rejected(Refusal.TOO_OLD)
    assert line.insert(sighting(Fix(place(40 * STEP_NS + 1)))) == Rejected(Refusal.TOO_NEW)
    verdict = line.insert(sighting(Fix(place(20 * STEP_NS, -1.5, 0.0))))
    assert not isinstance(verdict, Rejected) or verdict.reason is Refusal.GATE
    assert len(line.steps) == 11
    assert line.mind_at(19 * STEP_NS) is None


def test_a_look_ahead_of_odometry_is_judged_on_a_guess_and_again_on_the_step():
    line = timeline(1)
    ahead = sighting(Fix(place(150_000_000, -0.1, 0.0)))
    assert isinstance(line.insert(ahead), Fused)
    assert line.newest_ns == 150_000_000
    line.append(step_to(2))
    in_order = timeline(2)
    assert line.verdict_of(ahead) == in_order.insert(ahead)
    ends = [of.mind_at(2 * STEP_NS).leading.estimate for of in (line, in_order)]
    assert ends[0].pose == ends[1].pose
    assert np.array_equal(ends[0].covariance, ends[1].covariance)


def same(mind: Mind | None, estimate: Estimate) -> bool:
    place = mind.leading.estimate
    return place.pose == estimate.pose and np.array_equal(place.covariance, estimate.covariance)


def test_without_looks_it_is_dead_reckoning_at_any_stamp():
    line, one = timeline(2), predict(Estimate.of(ANCHOR), step_to(1))
    assert same(line.mind_at(50_000_000), predict(Estimate.of(ANCHOR), step_to(1).part(0, 50_000_000)))
    assert same(line.mind_at(STEP_NS), one)
    assert same(line.mind_at(2 * STEP_NS), predict(one, step_to(2)))
    ahead = line.mind_at(250_000_000).leading.estimate
    assert ahead.stamp_ns == 250_000_000
    assert line.mind_at(-1) is None


def test_repeated_and_missing_odometry():
    line, twice = timeline(), predict(predict(Estimate.of(ANCHOR), step_to(1)), step_to(2))
    for end in (1, 1, 2, 1):
        line.append(step_to(end))
    assert same(line.mind_at(line.end_ns), twice)
    line.append(step_to(5))
    after = line.mind_at(line.end_ns).leading.estimate
    assert after.stamp_ns == 5 * STEP_NS
    assert after.covariance[0, 0] > twice.covariance[0, 0] + 0.03  # 0.2 m were guessed


@pytest.mark.parametrize("delay_s", [0.0, 1.0])
def test_a_late_contradiction_takes_back_what_was_believed_since(delay_s):
    """Three looks that show another place count as soon as they come, late or not."""
    line = timeline()
    looks = [sighting(Fix(place((second + 1) * STEP_NS, 5.0, 5.0))) for second in range(3)]
    for end in range(1, 9):
        line.append(step_to(end))
        due = [look for look in looks if look.stamp_ns == end * STEP_NS] if not delay_s else []
        for look in due:
            line.insert(look)
    for look in looks if delay_s else []:
        line.insert(look)
    assert line.mind_at(line.end_ns).leading.estimate.pose.x > 3.0
