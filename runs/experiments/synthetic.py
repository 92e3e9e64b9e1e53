"""The synthetic experiment: every method on the same images, and table 3 of each case (paper, section 4.1)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from maps.poses import Array
from maps.wiremap import WireMap
from runs.experiments.cases import Case
from runs.experiments.judging import Category, judge
from runs.experiments.methods import Method, SearchCounts
from runs.experiments.recalls import Kept, recall_table, stage_recalls
from runs.experiments.syntheticimage import SyntheticImage, draw_scene, synthetic_image

#: Where the image itself cannot tell the position to this, its bound would outweigh all others.
UNBOUND_M = 2.0

#: Methods that have compiled what they compile at their first image, in this process.
_warm: set[str] = set()


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One method on one image of one case.

    `error`: (3,) x, y, phi, NaN without a fix. `bound`: (3, 3) Cramer-Rao. `lines`: segments in the image,
    `viewed` of them from the map. `recalls`: what each stage keeps of what is true, None where a method has no
    such stages. For the rest see `Answer`, `Judgement` and `Look`.
    """

    image: int
    method: str
    case: str
    category: Category
    strictly_wrong: bool
    truth_listed: bool
    error: Array
    bound: Array
    nees: float
    lines: int
    viewed: int
    matches: int
    right: int
    hypotheses: int
    counts: SearchCounts | None
    recalls: Mapping[str, Kept] | None
    exhausted: bool
    ms: dict[str, float]

    @property
    def usable(self) -> bool:
        """Whether the pose is right, by its pairs or by itself."""
        return self.category in (Category.SUCCESS, Category.CONSISTENT)

    @property
    def position_error_m(self) -> float:
        """Distance from the truth, NaN without a fix."""
        return math.hypot(self.error[0], self.error[1])

    @property
    def total_ms(self) -> float:
        """All stages together."""
        return sum(self.ms.values())

    @property
    def bound_variance_m2(self) -> float:
        """The bound on the mean square of that distance."""
        return float(self.bound[0, 0] + self.bound[1, 1])


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticStudy:
    """All cases and methods on an image; called with the image's number, anywhere and in any order."""

    wire_map: WireMap
    methods: tuple[Method, ...]
    cases: tuple[Case, ...]
    seed: int

    def __call__(self, number: int) -> list[Trial]:
        """Draw the image and let every method look at it."""
        scene = draw_scene(self.wire_map, self.seed, number)
        trials = []
        for case in self.cases:
            image = synthetic_image(self.wire_map, scene, case)
            for method in self.methods:
                if method.name not in _warm:
                    method.match_segments(image.camera, image.segments, image.window)
                    _warm.add(method.name)
                trials.append(self._trial(number, method, case, image))
        return trials

    def _trial(self, number: int, method: Method, case: Case, image: SyntheticImage) -> Trial:
        answer = method.match_segments(image.camera, image.segments, image.window)
        judged = judge(answer, image.truth, image.bound, image.sources, self.wire_map)
        stages = answer.stages
        return Trial(
            image=number,
            method=method.name,
            case=case.name,
            category=judged.category,
            strictly_wrong=judged.strictly_wrong,
            truth_listed=judged.truth_listed,
            error=judged.error,
            bound=image.bound,
            nees=judged.nees,
            lines=len(image.segments),
            viewed=int((image.sources >= 0).sum()),
            matches=judged.matches,
            right=judged.right,
            hypotheses=answer.outcome.look.hypotheses,
            counts=answer.counts,
            recalls=stage_recalls(stages, image.sources, self.wire_map.endpoints) if stages else None,
            exhausted=answer.exhausted,
            ms=dict(answer.ms),
        )


def of(trials: Sequence[Trial], method: str, case: str) -> list[Trial]:
    """Return a method's trials of a case."""
    return [trial for trial in trials if trial.method == method and trial.case == case]


def summary(trials: Sequence[Trial], images: int, seed: int) -> dict[str, Any]:
    """Return the counts and figures of every method and case; None for what is not known.

    RMS over bound and ANEES are over poses that are not inconsistent: with one gross error among them they
    would tell of that alone; RMS leaves out images whose own bound is over `UNBOUND_M`.
    """
    pairs = dict.fromkeys((trial.method, trial.case) for trial in trials)
    results = [
        {"method": method, "case": case, **_figures(of(trials, method, case))} for method, case in pairs
    ]
    return {"images": images, "seed": seed, "results": results}


def _figures(trials: Sequence[Trial]) -> dict[str, Any]:
    counts = Counter(trial.category for trial in trials)
    usable = [trial for trial in trials if trial.usable]
    hypotheses = np.array([trial.hypotheses for trial in trials], float)
    total_ms = np.array([trial.total_ms for trial in trials])
    stages = dict.fromkeys(stage for trial in trials for stage in trial.ms)
    recalls = [trial.recalls for trial in trials if trial.recalls is not None]
    return {
        **{category.value: counts[category] for category in Category},
        "ambiguous_with_truth": sum(trial.truth_listed for trial in trials),
        "wrong_strict": sum(trial.strictly_wrong for trial in trials),
        "hypotheses": {
            "median": float(np.median(hypotheses)),
            "p90": float(np.percentile(hypotheses, 90.0)),
            "max": float(hypotheses.max()),
        },
        "position_rms_over_bound": _over_bound(usable),
        "anees": float(np.mean([trial.nees for trial in usable]) / 3.0) if usable else None,
        "ms": {"median": float(np.median(total_ms)), "p90": float(np.percentile(total_ms, 90.0))},
        "stage_ms": {
            stage: float(np.median([trial.ms.get(stage, 0.0) for trial in trials])) for stage in stages
        },
        "exhausted": sum(trial.exhausted for trial in trials),
        "recalls": recall_table(recalls) if recalls else None,
    }


def _over_bound(usable: Sequence[Trial]) -> float | None:
    bound = [trial for trial in usable if trial.bound_variance_m2 <= UNBOUND_M**2]
    expected = sum(trial.bound_variance_m2 for trial in bound)
    found = sum(trial.position_error_m**2 for trial in bound)
    return math.sqrt(found / expected) if expected > 0.0 else None
