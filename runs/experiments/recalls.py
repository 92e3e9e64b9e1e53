"""How many true pairs the constraints of the paper's method keep, stage by stage (section 3.2).

A true pair is an edge and a line that it made. Each stage is judged on what the stages before have left, so that
none answers for another's loss.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from runs.experiments.judging import on_one_line
from vision.paper.interpretation import Interpretation

#: What is judged, in the order of the method.
STAGES = {
    "selection": "edge selected",
    "vertical": "upright edge's line taken for upright",
    "unary": "pair passes the unary constraint",
    "binary": "couple passes the binary constraint",
}


@dataclass(frozen=True, slots=True)
class Kept:
    """`kept` true ones `of` so many."""

    kept: int
    of: int


def stage_recalls(found: Interpretation, sources: NDArray[np.int64], endpoints: Array) -> Mapping[str, Kept]:
    """Count what each stage keeps of an image.

    `sources`: (M,) the map row that made each image line, -1 for none. `endpoints`: (N, 2, 3) of the map.
    """
    lines = np.flatnonzero(sources >= 0)
    rows = sources[lines]
    selected = np.isin(rows, found.selection.rows)
    upright = np.isin(rows, found.selection.vertical)
    taken = upright & np.isin(lines, found.vertical_lines)
    other = np.isin(rows, found.selection.other)
    passed = _paired(rows[other], lines[other], found.unary.rows, found.unary.lines)
    return {
        "selection": Kept(int(selected.sum()), len(lines)),
        "vertical": Kept(int(taken.sum()), int(upright.sum())),
        "unary": Kept(int(passed.sum()), int(other.sum())),
        "binary": _couples(rows[taken], lines[taken], found, endpoints),
    }


def _paired(
    rows: NDArray[np.int64], lines: NDArray[np.int64], among: NDArray[np.int64], lined: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether pairs (K,) are among others (P,), (K,)."""
    listed = set(zip(among.tolist(), lined.tolist(), strict=True))
    return np.array([pair in listed for pair in zip(rows.tolist(), lines.tolist(), strict=True)], bool)


def _couples(
    rows: NDArray[np.int64], lines: NDArray[np.int64], found: Interpretation, endpoints: Array
) -> Kept:
    """True couples of upright edges, of two different ones, that agree; pairs dropped for their number are lost."""
    pairs = found.verticals
    numbers = {
        pair: number
        for number, pair in enumerate(zip(pairs.rows.tolist(), pairs.lines.tolist(), strict=True))
    }
    places = [numbers.get(pair) for pair in zip(rows.tolist(), lines.tolist(), strict=True)]
    first, second = np.triu_indices(len(rows), 1)
    # Edges one above the other are seen under one bearing: no angle between them, nothing to test.
    apart = ~on_one_line(endpoints, rows[first], rows[second])
    kept = 0
    for one, other in zip(first[apart], second[apart], strict=True):
        a, b = places[one], places[other]
        kept += a is not None and b is not None and bool(pairs.agrees[a, b])
    return Kept(kept, int(apart.sum()))


def recall_table(trials: Sequence[Mapping[str, Kept]]) -> dict[str, Any]:
    """Return by stage the share kept over all images, of how many; None where there was nothing to keep."""
    table: dict[str, Any] = {}
    for stage in STAGES:
        kept, of = (sum(getattr(trial[stage], name) for trial in trials) for name in ("kept", "of"))
        table[stage] = {"kept": kept, "of": of, "share": kept / of if of else None}
    return table
