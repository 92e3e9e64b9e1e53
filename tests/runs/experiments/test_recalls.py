"""What each stage of the paper's method keeps of what is true, counted by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from runs.experiments.recalls import Kept, recall_table, stage_recalls
from vision.paper.interpretation import Interpretation

#: Upright edges 0 to 3, the last above the first; level ones 4 to 6.
ENDPOINTS = np.array(
    [
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [1.0, 0.0, 1.0]],
        [[2.0, 0.0, 0.0], [2.0, 0.0, 1.0]],
        [[0.0, 0.0, 1.5], [0.0, 0.0, 2.0]],
        [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]],
        [[1.0, 0.0, 1.0], [2.0, 0.0, 1.0]],
        [[0.0, 3.0, 1.0], [2.0, 3.0, 1.0]],
    ]
)
#: Line by line; the fifth belongs to nothing, and edge 4 shows in two fragments.
SOURCES = np.array([0, 1, 2, 3, -1, 4, 4, 5, 6])


def found(agrees: np.ndarray) -> Interpretation:
    """Edge 6 is not selected, line 2 is not taken for upright, (4, 6) and (3, 3) are lost."""
    stages = SimpleNamespace(
        selection=SimpleNamespace(rows=np.arange(6), vertical=np.array([0, 1, 2, 3]), other=np.array([4, 5])),
        vertical_lines=np.array([0, 1, 3, 4]),
        unary=SimpleNamespace(rows=np.array([4, 5, 5]), lines=np.array([5, 7, 4])),
        verticals=SimpleNamespace(rows=np.array([0, 1, 1]), lines=np.array([0, 1, 4]), agrees=agrees),
    )
    return cast(Interpretation, stages)


@pytest.mark.parametrize("agree", [0, 1])
def test_each_stage_is_judged_on_what_is_left_to_it(agree: int) -> None:
    agrees = np.zeros((3, 3), np.int8)
    agrees[0, 1] = agrees[1, 0] = agree
    recalls = stage_recalls(found(agrees), SOURCES, ENDPOINTS)
    assert recalls == {
        "selection": Kept(7, 8),
        "vertical": Kept(3, 4),
        "unary": Kept(2, 3),
        # Of three couples the two edges one above the other say nothing, and one lost its pair.
        "binary": Kept(agree, 2),
    }


def test_shares_are_over_all_images() -> None:
    one = dict.fromkeys(("selection", "vertical", "unary"), Kept(1, 2)) | {"binary": Kept(0, 0)}
    two = dict.fromkeys(("selection", "vertical", "unary"), Kept(6, 6)) | {"binary": Kept(0, 0)}
    table = recall_table([one, two])
    assert table["unary"] == {"kept": 7, "of": 8, "share": 0.875}
    assert table["binary"]["share"] is None
