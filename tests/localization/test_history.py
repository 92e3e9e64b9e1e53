import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from localization.ekf import Estimate, predict, update
from localization.history import History
from localization.odometry import OdometryStep
from localization.verdicts import Fused, Refusal, Rejected
from maps.outcomes import PoseBelief
from maps.poses import Pose2

GATE = 0.999
SPAN_NS = 1e9
STEP_NS = 100_000_000
SYSTEMATIC = np.array([[5e-3, 0.0, 0.0, 0.0], [0.0, 1e-2, 2e-3, 0.0], [0.0, 0.0, 0.0, 1e-3]])
ANCHOR = PoseBelief(0, Pose2(0.0, 0.0, 3.0), np.diag([0.04, 0.04, 0.04]))
START = Estimate.of(ANCHOR)


def step_to(end: int) -> OdometryStep:
    turn = 0.1 * math.cos(end)
    return OdometryStep(
        *((end - 1) * STEP_NS, end * STEP_NS, 0.1, turn),
        *(np.array([[1e-4, 1e-5], [1e-5, 4e-4]]), 1e-5, SYSTEMATIC, 0.01, 10.0),
    )


def fix_of(stamp_ns: int, x: float = 0.0, y: float = 0.0) -> PoseBelief:
    return PoseBelief(stamp_ns, Pose2(x, y, 3.0), np.diag([0.01, 0.02, math.inf]))


def same(a: PoseBelief | Estimate | None, b: PoseBelief | Estimate | None) -> bool:
    return (
        a is not None
        and b is not None
        and a.stamp_ns == b.stamp_ns
        and a.pose == b.pose
        and np.array_equal(a.covariance, b.covariance)
    )


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_any_order_of_arrival_gives_the_same_belief_bit_for_bit(data):
    """Ten steps in order; fixes, of which some lie beyond the gate or share a stamp, in between."""
    stamps = st.one_of(st.integers(0, 10 * STEP_NS), st.sampled_from([0, STEP_NS, 250_000_000, 10 * STEP_NS]))
    near, far = st.floats(-0.5, 0.5), st.floats(-3.0, 3.0)
    fixes = data.draw(st.lists(st.builds(fix_of, stamps, st.one_of(near, far), near), min_size=1, max_size=6))
    steps = [step_to(end) for end in range(1, 11)]
    in_order = History(ANCHOR, GATE, SPAN_NS)
    for event in sorted([*steps, *fixes], key=lambda event: event.stamp_ns):
        in_order.append(event) if isinstance(event, OdometryStep) else in_order.insert(event)

    shuffled = History(ANCHOR, GATE, SPAN_NS)
    arrivals = [data.draw(st.integers(0, 10), label="steps before") for _ in fixes]
    for count in range(11):
        for fix, arrival in zip(fixes, arrivals, strict=True):
            if arrival == count:
                shuffled.insert(fix)
        if count < 10:
            shuffled.append(steps[count])

    assert same(in_order.belief, shuffled.belief)
    assert same(in_order.belief_at(250_000_000), shuffled.belief_at(250_000_000))
    assert in_order.fused_ns == shuffled.fused_ns
    # Fixes of equal content may change places.
    verdicts = [sorted(str(history.verdict_of(fix)) for fix in fixes) for history in (in_order, shuffled)]
    assert verdicts[0] == verdicts[1]


def test_a_fix_is_fused_at_its_own_stamp():
    history = History(ANCHOR, GATE, SPAN_NS)
    for end in (1, 2):
        history.append(step_to(end))
    fix = fix_of(150_000_000, 0.05, 0.1)
    assert isinstance(history.insert(fix), Fused)
    before = predict(predict(START, step_to(1)), step_to(2).part(STEP_NS, 150_000_000))
    after = predict(update(before, fix), step_to(2).part(150_000_000, 2 * STEP_NS))
    assert same(history.belief, after)
    assert history.fused_ns == 150_000_000


def test_no_fix_means_dead_reckoning():
    history, expected = History(ANCHOR, GATE, SPAN_NS), START
    for end in range(1, 30):
        history.append(step_to(end))
        expected = predict(expected, step_to(end))
    assert same(history.belief, expected)
    assert history.fused_ns == 0


def test_rejected_fix_moves_nothing():
    history = History(ANCHOR, GATE, SPAN_NS)
    history.append(step_to(1))
    before = history.belief
    verdict = history.insert(fix_of(50_000_000, 5.0, 5.0))
    assert isinstance(verdict, Rejected)
    assert verdict.reason is Refusal.GATE
    assert verdict.nis is not None
    assert verdict.nis > 100.0
    assert history.belief.pose.minus(before.pose) == pytest.approx(np.zeros(3), abs=1e-12)
    assert history.fused_ns == 0


def test_too_old_and_too_new():
    history = History(ANCHOR, GATE, SPAN_NS)
    assert history.insert(fix_of(-1)) == Rejected(Refusal.TOO_OLD)
    for end in range(1, 31):
        history.append(step_to(end))
    assert history.insert(fix_of(19 * STEP_NS)) == Rejected(Refusal.TOO_OLD)
    assert history.insert(fix_of(40 * STEP_NS + 1)) == Rejected(Refusal.TOO_NEW)
    verdict = history.insert(fix_of(20 * STEP_NS, -1.5, 0.0))
    assert not isinstance(verdict, Rejected) or verdict.reason is Refusal.GATE
    assert len(history.steps) == 11


def test_a_fix_ahead_of_odometry_is_fused_on_a_guess_and_again_on_the_step():
    history = History(ANCHOR, GATE, SPAN_NS)
    history.append(step_to(1))
    fix = fix_of(150_000_000, -0.1, 0.0)
    assert isinstance(history.insert(fix), Fused)
    guessed = history.belief
    assert guessed.stamp_ns == 150_000_000
    assert guessed.covariance[0, 0] < ANCHOR.covariance[0, 0]
    history.append(step_to(2))
    in_order = History(ANCHOR, GATE, SPAN_NS)
    for end in (1, 2):
        in_order.append(step_to(end))
    in_order.insert(fix)
    assert same(history.belief, in_order.belief)


def test_belief_between_beyond_and_before():
    history = History(ANCHOR, GATE, SPAN_NS)
    for end in (1, 2):
        history.append(step_to(end))
    assert same(history.belief_at(STEP_NS), predict(START, step_to(1)))
    assert same(history.belief_at(50_000_000), predict(START, step_to(1).part(0, 50_000_000)))
    ahead = history.belief_at(250_000_000)
    assert ahead is not None
    assert ahead.stamp_ns == 250_000_000
    assert np.linalg.eigvalsh(ahead.covariance - history.belief.covariance)[-1] > 0.0
    assert history.belief_at(-1) is None


def test_repeated_and_missing_odometry():
    history = History(ANCHOR, GATE, SPAN_NS)
    for end in (1, 1, 2, 1):
        history.append(step_to(end))
    twice = predict(predict(START, step_to(1)), step_to(2))
    assert same(history.belief, twice)
    history.append(step_to(5))
    assert history.belief.stamp_ns == 5 * STEP_NS
    assert history.belief.covariance[0, 0] > twice.covariance[0, 0] + 0.03  # 0.2 m were guessed
