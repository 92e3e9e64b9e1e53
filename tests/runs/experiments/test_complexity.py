"""Section 3.6 by formula: the corrected gain, De Souza and Kak's zone, exponents of growth."""

from __future__ import annotations

import numpy as np
import pytest

from runs.experiments.cases import CASES
from runs.experiments.complexity import EXAMPLE, PRINTED_GAIN, gain, growth, one_tree
from runs.experiments.hall import hall_map
from runs.experiments.methods import SearchCounts
from runs.experiments.zones import ZoneStudy, zone_px


def test_the_papers_gain_is_153_633_and_the_printed_one_a_slip() -> None:
    assert round(gain(**EXAMPLE)) == 153_633
    n, nv, mh, mv = (EXAMPLE[name] for name in ("n", "nv", "mh", "mv"))
    slip = one_tree(mv, mh, n) / (n**mh + (nv + 1) ** mv)
    assert round(slip) == PRINTED_GAIN


def test_the_zone_is_that_of_an_edge_seen_from_both_ends_of_the_uncertainty() -> None:
    likely, worst = zone_px(0.5, 10.0, 6.0)
    assert likely == pytest.approx(390.0, abs=1.0)
    # Half the zone: an edge 6 m ahead, from 0.5 m to the side, 10 degrees turned away.
    bearing = np.arctan2(0.5, 6.0) + np.radians(10.0)
    assert worst / 2.0 == pytest.approx(1000.0 * np.tan(bearing))


def test_worse_estimates_leave_more_pairs_in_the_zones() -> None:
    share = []
    for name in ("qi1", "qi3"):
        study = ZoneStudy(hall_map(), CASES[name], 2)
        found = [pairs for number in range(5) for pairs in study(number)]
        share.append(sum(left for left, _ in found) / sum(possible for _, possible in found))
    assert 0.3 < share[0] < share[1] <= 1.0


def test_exponents() -> None:
    lines = np.array([10.0, 20.0, 40.0])
    assert growth(lines, 3.0 * lines**2.5) == pytest.approx(2.5)
    assert growth(lines[:1], lines[:1]) is None
    assert growth(np.full(3, 7.0), lines) is None


def test_large_counts_do_not_overflow() -> None:
    counts = SearchCounts(200, 300, 400, 150, *([0] * 6))
    assert counts.log10_most == pytest.approx(300 * np.log10(401) + 200 * np.log10(151))
