"""What the paper's method made of one image: the result and the counts of each of its stages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.paper.binary import VerticalPairs
from vision.paper.combinations import HypothesisList, most_hypotheses, most_nodes
from vision.paper.selection import Selection
from vision.paper.trees import Combinations
from vision.paper.unary import UnaryPairs
from vision.paper.verification import Verdicts, Winner


@dataclass(frozen=True, slots=True, eq=False)
class Interpretation:
    """One image, stage by stage.

    `lines`: n, the number of image lines; `vertical_lines`: (nv,) those that may be vertical edges. `unary` and
    `verticals`: the pairs that the constraints leave; `horizontal_list` and `vertical_list`: the combinations of
    the two trees; `hypotheses`: their product; `verdicts`: poses and scores. `least`: k. `stage_ms`:
    milliseconds by stage.
    """

    selection: Selection
    lines: int
    vertical_lines: NDArray[np.int64]
    unary: UnaryPairs
    verticals: VerticalPairs
    horizontal_list: Combinations
    vertical_list: Combinations
    hypotheses: HypothesisList
    verdicts: Verdicts
    least: int
    winner: Winner | None
    stage_ms: dict[str, float]

    @property
    def exhausted(self) -> bool:
        """Whether a limit cut the search short: a better combination may have gone unseen."""
        return not (
            self.horizontal_list.complete and self.vertical_list.complete and self.hypotheses.complete
        )

    @property
    def most_hypotheses(self) -> int:
        """How many combinations there would be without constraints (Fig. 11)."""
        return most_hypotheses(self.mh, self.mv, self.lines, len(self.vertical_lines))

    @property
    def most_nodes(self) -> int:
        """How many paths the two trees would have without constraints (section 3.6)."""
        return most_nodes(self.mh, self.mv, self.lines, len(self.vertical_lines))

    @property
    def mv(self) -> int:
        """How many selected segments are vertical."""
        return len(self.selection.vertical)

    @property
    def mh(self) -> int:
        """How many selected segments are not."""
        return len(self.selection.other)

    def counts(self) -> dict[str, int | float | bool]:
        """Return all counts by name, for tables and JSON."""
        return {
            "regions": len(self.selection.regions),
            "selected": len(self.selection.rows),
            "mv": self.mv,
            "mh": self.mh,
            "n": self.lines,
            "nv": len(self.vertical_lines),
            "nh": self.lines - len(self.vertical_lines),
            "unary_tested": self.unary.tested,
            "unary_pairs": len(self.unary),
            "vertical_pairs": len(self.verticals),
            "couples_tested": self.verticals.tested,
            "couples": self.verticals.couples,
            "horizontal_list": len(self.horizontal_list),
            "vertical_list": len(self.vertical_list),
            "products": self.hypotheses.possible,
            "hypotheses_counted": self.hypotheses.counted,
            "hypotheses": len(self.hypotheses),
            "most_hypotheses": self.most_hypotheses,
            "most_nodes": self.most_nodes,
            "exhausted": self.exhausted,
            "total_ms": sum(self.stage_ms.values()),
        }
