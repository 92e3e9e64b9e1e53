import math

import numpy as np
import pytest
from scipy.stats import chi2, norm

from localization.window import State, StateConfig, WindowConfig, search_window, state_of
from maps.outcomes import PoseBelief
from maps.poses import Pose2

SECOND_NS = 1_000_000_000


def belief(std_x: float, std_y: float, std_phi: float, phi: float = 0.0) -> PoseBelief:
    cos, sin = math.cos(phi), math.sin(phi)
    turning = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return PoseBelief(
        0, Pose2(1.0, 2.0, 3.0), turning @ np.diag([std_x**2, std_y**2, std_phi**2]) @ turning.T
    )


@pytest.mark.parametrize("phi", [0.0, 0.7, 2.0])
def test_window_holds_the_worst_direction(phi):
    window = search_window(belief(0.4, 0.1, 0.2, phi), 0, WindowConfig())
    assert window.centre == Pose2(1.0, 2.0, 3.0)
    assert window.dt_m == pytest.approx(0.4 * math.sqrt(chi2.ppf(0.999, 2)))
    assert window.dphi_rad == pytest.approx(0.2 * norm.ppf(0.9995))


def test_window_has_floors_grows_and_is_capped():
    config = WindowConfig(floor_m=0.2, floor_rad=0.1, growth=2.0, largest_growth=5.0)
    sizes = [search_window(belief(0.001, 0.001, 0.001), misses, config) for misses in range(5)]
    assert [size.dt_m for size in sizes] == pytest.approx([0.2, 0.4, 0.8, 1.0, 1.0])
    assert [size.dphi_rad for size in sizes] == pytest.approx([0.1, 0.2, 0.4, 0.5, 0.5])
    assert search_window(belief(1.0, 1.0, 3.0), 4, config).dphi_rad == math.pi


@pytest.mark.parametrize(
    ("stds", "fused_ns", "state"),
    [
        ((0.1, 0.1, 0.03), 0, State.TRACKING),
        ((0.1, 0.2, 0.03), 0, State.UNCERTAIN),
        ((0.1, 0.1, 0.06), 0, State.UNCERTAIN),
        ((0.1, 0.1, 0.03), -11 * SECOND_NS, State.UNCERTAIN),
    ],
)
def test_state(stds, fused_ns, state):
    assert state_of(belief(*stds), fused_ns, StateConfig()) is state
