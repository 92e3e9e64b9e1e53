"""How large the search is, by formula and as measured, and how it grows (paper, section 3.6).

The paper sets (n + 1)^m leaves of one tree against (n + 1)^mh + (nv + 1)^mv of two. Its example, mv = mh = 5,
n = 10, nv = 5, has a gain of 153 633; the printed 240 660 is what n^mh in place of (n + 1)^mh gives. The sum
counts the trees alone: the list of hypotheses is their product.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from maps.poses import Array
from runs.experiments.cases import QUALITIES
from runs.experiments.methods import SearchCounts
from runs.experiments.synthetic import Trial, of
from runs.experiments.syntheticimage import WIDTH
from runs.experiments.zones import zone_px

#: The paper's example.
EXAMPLE = {"mv": 5, "mh": 5, "n": 10, "nv": 5}
PRINTED_GAIN = 240_660
#: De Souza and Kak's estimate errors, and the edge that the paper looks at.
ZONE_EXAMPLE = (0.5, 10.0)
ZONE_DISTANCE_M = 6.0


def one_tree(mv: int, mh: int, n: int) -> int:
    """Return the leaves of the classical interpretation tree, (n + 1)^m."""
    leaves: int = (n + 1) ** (mv + mh)
    return leaves


def two_trees(mv: int, mh: int, n: int, nv: int) -> int:
    """Return the leaves of the paper's two sub-trees, (n + 1)^mh + (nv + 1)^mv."""
    others: int = (n + 1) ** mh
    verticals: int = (nv + 1) ** mv
    return others + verticals


def gain(mv: int, mh: int, n: int, nv: int) -> float:
    """Return how many times smaller two trees are than one."""
    return one_tree(mv, mh, n) / two_trees(mv, mh, n, nv)


def growth(lines: Array, values: Array) -> float | None:
    """Return the exponent p of values ~ lines^p, by least squares of logarithms; None from less than 2 points."""
    good = (lines > 0.0) & np.greater(values, 0.0)
    if good.sum() < 2 or np.ptp(lines[good]) == 0.0:
        return None
    return float(np.polyfit(np.log(lines[good]), np.log(values[good]), 1)[0])


def complexity(
    trials: Sequence[Trial],
    cases: Sequence[str],
    images: int,
    seed: int,
    zones: Sequence[tuple[int, int]] = (),
) -> dict[str, Any]:
    """Return formula, zones, counts of each image and growth with the added lines; None for what is not known.

    `zones`: by image, pairs that De Souza and Kak's zones leave, and all pairs; of the first case.
    """
    everything = sum(possible for _, possible in zones)
    methods = list(dict.fromkeys(trial.method for trial in trials))
    return {
        "images": images,
        "seed": seed,
        "example": {**EXAMPLE, "gain": gain(**EXAMPLE), "printed_gain": PRINTED_GAIN},
        "zones": [_zone(*estimate) for estimate in (ZONE_EXAMPLE, *QUALITIES.values())],
        "growth": [_growth(trials, method, cases) for method in methods],
        "zone_pairs_kept_share": sum(left for left, _ in zones) / everything if everything else None,
        "selection": [found for method in methods if (found := _selection(of(trials, method, cases[0])))],
        "counts": [
            {"image": trial.image, "method": trial.method, **_counts(trial.counts)}
            for trial in trials
            if trial.case == cases[0] and trial.counts is not None
        ],
    }


def _zone(dt_m: float, dphi_deg: float) -> dict[str, float]:
    likely, worst = zone_px(dt_m, dphi_deg, ZONE_DISTANCE_M)
    return {
        "dt_m": dt_m,
        "dphi_deg": dphi_deg,
        "distance_m": ZONE_DISTANCE_M,
        "likely_px": likely,
        "worst_px": worst,
        "likely_share_of_image": min(likely / WIDTH, 1.0),
    }


def _growth(trials: Sequence[Trial], method: str, cases: Sequence[str]) -> dict[str, Any]:
    """Medians by number of added lines, and the exponents of time and products over the number of lines."""
    points = []
    for case in cases:
        found = of(trials, method, case)
        points.append(
            {
                "case": case,
                "lines": float(np.median([trial.lines for trial in found])),
                "ms": float(np.median([trial.total_ms for trial in found])),
                "p90_ms": float(np.percentile([trial.total_ms for trial in found], 90.0)),
                "hypotheses": float(np.median([trial.hypotheses for trial in found])),
                "products": _median([t.counts.products for t in found if t.counts is not None]),
                "exhausted": sum(trial.exhausted for trial in found),
            }
        )
    lines = np.array([point["lines"] for point in points])
    exponents = {
        f"{name}_exponent": growth(lines, np.array([point[name] for point in points], float))
        for name in ("ms", "products")
    }
    return {"method": method, "points": points, **exponents}


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def _selection(trials: Sequence[Trial]) -> dict[str, Any] | None:
    """What the tests leave of all pairs, for comparison with the zones."""
    counts = [trial.counts for trial in trials if trial.counts is not None]
    if not counts:
        return None
    possible = sum(count.mh * count.n for count in counts)
    return {
        "method": trials[0].method,
        "model_segments": float(np.mean([count.mv + count.mh for count in counts])),
        "pairs_kept_share": sum(count.pairs for count in counts) / possible if possible else None,
        "median_log10_gain": float(np.median([_counts(count)["log10_gain"] for count in counts])),
    }


def _counts(counts: SearchCounts) -> dict[str, Any]:
    """The counts of one image, with what the formulas make of them; logarithms, for they are large."""
    log_one = (counts.mv + counts.mh) * math.log10(counts.n + 1)
    log_two = math.log10(two_trees(counts.mv, counts.mh, counts.n, counts.nv))
    return {
        **asdict(counts),
        "log10_one_tree": log_one,
        "log10_two_trees": log_two,
        "log10_product": counts.log10_most,
        "log10_gain": log_one - log_two,
    }
