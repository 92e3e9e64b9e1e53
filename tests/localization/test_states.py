import numpy as np
import pytest

from localization.ekf import Estimate
from localization.hypotheses import Hypotheses, Hypothesis
from localization.states import Doubt, State, StateConfig, diagnose
from localization.trust import Mind
from maps.outcomes import PoseBelief
from maps.poses import Pose2

SECOND_NS = 1_000_000_000
CONFIG = StateConfig()


def mind(stds=(0.1, 0.1, 0.03), weight=0.99, trusted=True, unexplained=0.0) -> Mind:
    belief = PoseBelief(0, Pose2(1.0, 2.0, 3.0), np.diag(np.square(stds)))
    place = Hypothesis(Estimate.of(belief), weight, 0, 2.0, 7)
    return Mind(Hypotheses((place,), 1.0 - weight), 7, trusted, 5, unexplained)


@pytest.mark.parametrize(
    ("known", "seconds", "state", "doubts"),
    [
        (mind(), 0.0, State.TRACKING, ()),
        (mind((0.1, 0.2, 0.03)), 0.0, State.UNCERTAIN, (Doubt.ELLIPSE,)),
        (mind((0.1, 0.1, 0.06)), 0.0, State.UNCERTAIN, (Doubt.ELLIPSE,)),
        (mind(), 11.0, State.UNCERTAIN, (Doubt.NO_UPDATE,)),
        (mind(weight=0.7), 0.0, State.UNCERTAIN, (Doubt.CONTRADICTED,)),
        (mind(unexplained=2.9), 0.0, State.TRACKING, ()),
        (mind(unexplained=3.0), 0.0, State.UNCERTAIN, (Doubt.UNEXPLAINED,)),
        (mind(trusted=False), 0.0, State.LOST, (Doubt.NO_PLACE,)),
        (mind(trusted=False, weight=0.5), 0.0, State.LOST, (Doubt.NO_PLACE, Doubt.CONTRADICTED)),
        (Mind.lost(), 0.0, State.LOST, (Doubt.NO_PLACE,)),
    ],
)
def test_every_state_has_its_reasons(known, seconds, state, doubts):
    found = diagnose(known, round(seconds * SECOND_NS), CONFIG)
    assert (found.state, found.doubts) == (state, doubts)


def test_figures():
    found = diagnose(mind((0.1, 0.2, 0.03)), 4 * SECOND_NS, CONFIG)
    # 99.9 %: 3.717 standard deviations in the plane, 3.291 on a line.
    assert found.radius_m == pytest.approx(0.2 * 3.717, rel=1e-3)
    assert found.radius_rad == pytest.approx(0.03 * 3.291, rel=1e-3)
    assert (found.silent_s, found.probability, found.places, found.misses) == (4.0, 0.99, 1, 5)
