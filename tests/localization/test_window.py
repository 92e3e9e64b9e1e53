import math

import numpy as np
import pytest
from scipy.stats import chi2, norm

from localization.ekf import Estimate
from localization.hypotheses import Hypotheses, Hypothesis
from localization.trust import Mind
from localization.window import WindowConfig, search_windows, window_about
from maps.outcomes import PoseBelief, SearchWindow
from maps.poses import Pose2


def belief(std_x: float, std_y: float, std_phi: float, phi: float = 0.0) -> PoseBelief:
    cos, sin = math.cos(phi), math.sin(phi)
    turning = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return PoseBelief(
        0, Pose2(1.0, 2.0, 3.0), turning @ np.diag([std_x**2, std_y**2, std_phi**2]) @ turning.T
    )


@pytest.mark.parametrize("phi", [0.0, 0.7, 2.0])
def test_window_holds_the_worst_direction(phi):
    window = window_about(belief(0.4, 0.1, 0.2, phi), 0, WindowConfig())
    assert window.centre == Pose2(1.0, 2.0, 3.0)
    assert window.dt_m == pytest.approx(0.4 * math.sqrt(chi2.ppf(0.999, 2)))
    assert window.dphi_rad == pytest.approx(0.2 * norm.ppf(0.9995))


def test_window_has_floors_grows_and_is_capped():
    config = WindowConfig(floor_m=0.2, floor_rad=0.1, growth=2.0, largest_growth=5.0)
    sizes = [window_about(belief(0.001, 0.001, 0.001), misses, config) for misses in range(5)]
    assert [size.dt_m for size in sizes] == pytest.approx([0.2, 0.4, 0.8, 1.0, 1.0])
    assert [size.dphi_rad for size in sizes] == pytest.approx([0.1, 0.2, 0.4, 0.5, 0.5])
    assert window_about(belief(1.0, 1.0, 3.0), 4, config).dphi_rad == math.pi


def mind_of(*places: tuple[PoseBelief, float], elsewhere: float = 0.01, trusted: bool = True) -> Mind:
    """The first place leads."""
    known = [Hypothesis(Estimate.of(at), weight, 0, 2.0, name) for name, (at, weight) in enumerate(places)]
    known.sort(key=lambda place: -place.weight)
    return Mind(Hypotheses(tuple(known), elsewhere), 0 if places else None, trusted)


NEAR, FAR = belief(0.05, 0.05, 0.02), PoseBelief(0, Pose2(5.0, 2.0, 0.0), 0.0025 * np.eye(3))


def test_a_sure_place_has_one_window():
    config = WindowConfig()
    assert search_windows(mind_of((NEAR, 0.99)), config) == (window_about(NEAR, 0, config),)


def test_every_place_that_counts_has_its_window_and_doubt_looks_everywhere():
    config = WindowConfig()
    windows = search_windows(mind_of((NEAR, 0.6), (FAR, 0.3), (belief(1, 1, 1), 0.001)), config)
    assert windows == (window_about(NEAR, 0, config), window_about(FAR, 0, config), SearchWindow.everywhere())
    windows = search_windows(mind_of((NEAR, 0.95), (FAR, 0.04)), config)
    assert windows == (window_about(NEAR, 0, config), window_about(FAR, 0, config))


def test_the_lost_look_everywhere_and_where_they_have_been_seen():
    config = WindowConfig()
    assert search_windows(Mind.lost(), config) == (SearchWindow.everywhere(),)
    windows = search_windows(mind_of((FAR, 0.95), trusted=False), config)
    assert windows == (window_about(FAR, 0, config), SearchWindow.everywhere())
