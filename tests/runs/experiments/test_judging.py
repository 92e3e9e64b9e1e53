"""The four categories of table 3, and ambiguity, from answers made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.outcomes import Ambiguous, Fix, Look, NoFix, Outcome, PoseBelief, Reason
from maps.poses import Pose2
from runs.experiments.hall import hall_map
from runs.experiments.judging import Category, Judgement, judge, on_one_line
from runs.experiments.methods import Answer

HALL = hall_map()
TRUTH = Pose2(5.0, 6.0, 3.1)
BOUND = np.diag([0.2, 0.2, 0.02]) ** 2
SOURCES = np.array([4, -1, 10, 20])


def fix(pose: Pose2, *pairs: tuple[int, int]) -> Fix:
    """A fix with these pairs of map row and image line."""
    rows, lines = np.array(pairs, np.int64).reshape(-1, 2).T
    return Fix(PoseBelief(0, pose, BOUND), Look(matched_map=rows, matched_image=lines))


def judged(outcome: Outcome) -> Judgement:
    return judge(Answer(outcome), TRUTH, BOUND, SOURCES, HALL)


RIGHT, WRONG, CLUTTER = (4, 0), (11, 2), (20, 1)
NEAR, BOUNDED, FAR = Pose2(5.1, 6.0, -3.14), Pose2(5.5, 6.0, 3.1), Pose2(7.0, 6.0, 3.1)


@pytest.mark.parametrize(
    ("outcome", "category", "wrong"),
    [
        (fix(NEAR, RIGHT, (10, 2)), Category.SUCCESS, False),
        (fix(FAR, RIGHT), Category.SUCCESS, True),
        (fix(NEAR, RIGHT, WRONG), Category.CONSISTENT, False),
        (fix(NEAR, RIGHT, CLUTTER), Category.CONSISTENT, False),
        (fix(BOUNDED, RIGHT, WRONG), Category.CONSISTENT, True),
        (fix(FAR, RIGHT, WRONG), Category.INCONSISTENT, True),
        (fix(FAR), Category.INCONSISTENT, True),
        (NoFix(Reason.NO_HYPOTHESIS), Category.FALSE_NEGATIVE, False),
    ],
)
def test_categories(outcome: Outcome, category: Category, wrong: bool) -> None:
    found = judged(outcome)
    assert (found.category, found.strictly_wrong) == (category, wrong)


def test_heading_is_compared_across_the_cut() -> None:
    found = judged(fix(NEAR, RIGHT))
    np.testing.assert_allclose(found.error, [0.1, 0.0, math.tau - 6.24])
    assert found.nees == pytest.approx(0.25 + ((math.tau - 6.24) / 0.02) ** 2)


def test_an_ambiguous_answer_may_list_the_truth() -> None:
    near, far = PoseBelief(0, NEAR, BOUND), PoseBelief(0, FAR, BOUND)
    assert judged(Ambiguous((far, near), (0.6, 0.4))).truth_listed
    found = judged(Ambiguous((far, far), (0.5, 0.5)))
    assert (found.category, found.truth_listed) == (Category.AMBIGUOUS, False)
    assert math.isnan(found.nees)


def test_pieces_of_one_line_are_the_same_edge() -> None:
    ends = np.array(
        [
            [[0, 0, 0], [1, 0, 0]],
            [[3, 0, 0], [2, 0, 0]],
            [[0, 0.05, 0], [1, 0.05, 0]],
            [[0, 0, 0], [0, 0, 1]],
        ],
        float,
    )
    first, second = np.array([0, 0, 0]), np.array([1, 2, 3])
    assert on_one_line(ends, first, second).tolist() == [True, False, False]
