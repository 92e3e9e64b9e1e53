import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from localization.ekf import Estimate
from localization.hypotheses import Hypotheses, Hypothesis
from localization.trust import Mind
from localization.window import WindowConfig, WindowShape, search_windows, window_about
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


def test_an_ellipse_holds_the_belief_and_no_corner_of_the_disc():
    config, thin = WindowConfig(), belief(0.4, 0.1, 0.2, 0.7)
    window = window_about(thin, 0, config)
    along, across = np.array([math.cos(0.7), math.sin(0.7)]), np.array([-math.sin(0.7), math.cos(0.7)])
    draws = np.random.default_rng(1).multivariate_normal(thin.pose.as_array(), thin.covariance, 5000)
    held = np.mean([window.holds(Pose2.from_array(pose)) for pose in draws])
    assert held == pytest.approx(0.998, abs=0.002)
    for away, inside in ((1.4 * along, True), (0.35 * across, True), (0.7 * across, False)):
        pose = Pose2(*(thin.pose.as_array()[:2] + away), thin.pose.phi)
        assert window.holds(pose) is inside
        assert window_about(thin, 0, WindowConfig(shape=WindowShape.DISC)).holds(pose)


@pytest.mark.parametrize("misses", [0, 2])
def test_an_ellipse_is_nowhere_thinner_than_the_floors(misses):
    config = WindowConfig(floor_m=0.2, floor_rad=0.1, growth=2.0)
    window = window_about(belief(0.5, 0.001, 0.001, 0.7), misses, config)
    for angle in np.linspace(0.0, 6.0, 13):
        away = 0.199 * config.growth**misses * np.array([math.cos(angle), math.sin(angle)])
        for side in (-1.0, 0.0, 1.0):
            turn = side * 0.099 * config.growth**misses
            assert window.holds(Pose2(1.0 + away[0], 2.0 + away[1], 3.0 + turn))


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
    places = (NEAR, 0.6), (FAR, 0.3), (belief(1, 1, 1), 0.001)
    windows = search_windows(mind_of(*places, elsewhere=0.11), config)
    assert windows == (window_about(NEAR, 0, config), window_about(FAR, 0, config), SearchWindow.everywhere())
    windows = search_windows(mind_of((NEAR, 0.95), (FAR, 0.04)), config)
    assert windows == (window_about(NEAR, 0, config), window_about(FAR, 0, config))


def test_places_that_compete_are_searched_for_near_the_leading_one_and_not_everywhere():
    config = WindowConfig()
    windows = search_windows(mind_of((NEAR, 0.6), (FAR, 0.39)), config)
    aside = SearchWindow(NEAR.pose, config.aside_m, config.aside_rad)
    assert windows == (window_about(NEAR, 0, config), window_about(FAR, 0, config), aside)


def test_the_lost_look_everywhere_and_where_they_have_been_seen():
    config = WindowConfig()
    assert search_windows(Mind.lost(), config) == (SearchWindow.everywhere(),)
    windows = search_windows(mind_of((FAR, 0.95), trusted=False), config)
    assert windows == (window_about(FAR, 0, config), SearchWindow.everywhere())


def test_a_strained_place_is_searched_for_beside_it_and_not_everywhere():
    config = WindowConfig()
    aside = SearchWindow(NEAR.pose, config.aside_m, config.aside_rad)
    pulled = replace(mind_of((NEAR, 0.75), elsewhere=0.25), strain=1.0)
    assert search_windows(pulled, config) == (window_about(NEAR, 0, config), aside)
    vainly = replace(pulled, unexplained=config.unexplained)
    assert search_windows(vainly, config)[-1] == SearchWindow.everywhere()
