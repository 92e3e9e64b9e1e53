"""Visibility events: the lines of the plan across which some map segment appears or disappears.

Section 2 of the paper. A corner c of the walls that juts into the floor (a convex corner of the environment)
hides things. Whoever crosses the line through c and another point V, on c's far side as V sees it, sees V
appear or disappear behind c. If V juts out as well, what appears lies beyond V, in the gap between the two.
Nothing else changes what can be seen in plan, so between events visibility is constant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.plan import Plan
from maps.poses import Array, frozen
from maps.visibility import cross_plan

#: Tolerance of plan geometry: walls that touch, edges that end on each other.
_TOUCH_M = 1e-6
#: How near to a line counts as on it, where too many is better than too few.
_NEAR_M = 0.01
#: How far a sight line may cut a corner, and from how near a corner's targets that matters.
_GRAZE_M = 1.5e-3
_GRAZED_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Events:
    """E stretches of event lines, and the rows of the plan that crossing each may show or hide.

    `lines`: (E, 2, 2) metres, from the corner to the wall where its say ends. `rows`: (R,) of the plan, those of
    event e in rows[starts[e]:starts[e + 1]].
    """

    lines: Array
    rows: NDArray[np.int64]
    starts: NDArray[np.int64]


def visibility_events(plan: Plan) -> Events:
    """Find all event lines of a plan.

    Every test leans to the side of too many events: one too many makes a list longer, one too few makes it
    wrong.
    """
    places, rows_at, starts_at = _places(plan)
    corners = _convex_corners(plan.walls)
    targets = np.concatenate([places, corners[:, 1]])
    wall_rows = plan.first_wall + np.arange(len(plan.walls))
    found: list[Array] = []
    rows: list[NDArray[np.int64]] = []
    for before, corner, after in corners:
        walls = plan.walls[plan.seen(_just_inside(before, corner, after), wall_rows) - plan.first_wall]
        seen = _seen_and_tangent(before, corner, after, targets, walls)
        seen, away = _with_grazes(seen, corner - targets[seen])
        ends = corner + away * _reach(corner[None], away, walls)[:, None]
        for target, end in zip(seen.tolist(), ends, strict=True):
            if target < len(places):
                behind = rows_at[starts_at[target] : starts_at[target + 1]]
            else:
                behind = _met_beyond(plan, corner, targets[target])
            if len(behind):
                found.append(np.array([corner, end]))
                rows.append(behind)
    counts = [len(behind) for behind in rows]
    return Events(
        lines=frozen(np.array(found).reshape(-1, 2, 2)),
        rows=np.concatenate(rows) if rows else np.zeros(0, np.int64),
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
    )


def _places(plan: Plan) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Distinct points (V, 2) where rows end, with the rows that end there, as rows and starts."""
    ends = plan.sight[:, :, :2].reshape(-1, 2)
    owner = np.repeat(np.arange(len(plan.sight)), 2)
    keys = np.round(ends / 1e-3).astype(np.int64)
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    pairs = np.unique(np.column_stack([place.ravel(), owner]), axis=0)
    starts = np.searchsorted(pairs[:, 0], np.arange(len(first) + 1))
    return ends[first], pairs[:, 1], starts


def _just_inside(before: Array, corner: Array, after: Array) -> Array:
    """A point of the floor a millimetre off a convex corner, away from both its walls."""
    away = corner - np.stack([before, after])
    middle: Array = (away / np.linalg.norm(away, axis=1)[:, None]).sum(axis=0)
    return np.asarray(corner + 1e-3 * middle / np.maximum(np.linalg.norm(middle), 1e-9))


def _convex_corners(walls: Array) -> Array:
    """Corners that jut into the floor, (C, 3, 2): the wall's point before, the corner, the point after.

    The floor lies left of its walls, so there they turn right.
    """
    by_start = {tuple(np.round(wall[0], 6)): wall[1] for wall in walls}
    corners = [
        (wall[0], wall[1], by_start[key])
        for wall in walls
        if (key := tuple(np.round(wall[1], 6))) in by_start
        and cross_plan(wall[1] - wall[0], by_start[key] - wall[1]) < 0.0
    ]
    return np.array(corners).reshape(-1, 3, 2)


def _seen_and_tangent(
    before: Array, corner: Array, after: Array, targets: Array, walls: Array
) -> NDArray[np.int64]:
    """Indices of targets (V, 2) that see the corner, with the walls beside it on one side of their line."""
    away = corner - targets
    distance = np.linalg.norm(away, axis=1)
    side_before = cross_plan(away, before - corner) / np.maximum(distance, _TOUCH_M)
    side_after = cross_plan(away, after - corner) / np.maximum(distance, _TOUCH_M)
    tangent = (np.minimum(side_before, side_after) >= -1e-3) | (np.maximum(side_before, side_after) <= 1e-3)
    near = np.flatnonzero(tangent & (distance > 1e-3))
    reach = _reach(targets[near], away[near], walls)
    return near[reach >= 1.0 - 1e-6]


def _with_grazes(seen: NDArray[np.int64], away: Array) -> tuple[NDArray[np.int64], Array]:
    """The targets (K,) and directions (K, 2), and for targets near the corner the directions beside them.

    A millimetre at a corner is a decimetre at the eye when the target is close behind the corner, as door
    linings are: whether it is seen there depends on how far walls and edges are trusted.
    """
    distance = np.linalg.norm(away, axis=1)
    near = np.flatnonzero(distance < _GRAZED_M)
    turn = _GRAZE_M / distance[near]
    beside = [
        np.column_stack(
            [
                np.cos(side * turn) * away[near, 0] - np.sin(side * turn) * away[near, 1],
                np.sin(side * turn) * away[near, 0] + np.cos(side * turn) * away[near, 1],
            ]
        )
        for side in (-1.0, 1.0)
    ]
    return np.concatenate([seen, seen[near], seen[near]]), np.concatenate([away, *beside])


def _reach(origins: Array, directions: Array, walls: Array) -> Array:
    """How far rays (K, 2) + t (K, 2) go, as t, before they properly cross a wall; (K,), touching is free."""
    origins = np.broadcast_to(origins, directions.shape)
    edge = walls[:, 1] - walls[:, 0]
    length = np.linalg.norm(edge, axis=1)
    reach = np.empty(len(directions))
    for first in range(0, len(directions), 256):
        rows = slice(first, first + 256)
        direction, origin = directions[rows, None], origins[rows, None]
        turn = cross_plan(direction, edge[None])
        with np.errstate(divide="ignore", invalid="ignore"):
            along = cross_plan(walls[None, :, 0] - origin, edge[None]) / turn
            across = cross_plan(walls[None, :, 0] - origin, direction) / turn
        slack = 1e-3 / length
        blocked = (np.abs(turn) > 1e-12) & (across > slack) & (across < 1.0 - slack)
        scale = _TOUCH_M / np.maximum(np.linalg.norm(directions[rows], axis=1), 1e-12)
        blocked &= along > scale[:, None]
        reach[rows] = np.where(blocked, along, np.inf).min(axis=1, initial=np.inf)
    furthest = np.ptp(walls.reshape(-1, 2), axis=0).sum() if len(walls) else 1.0
    limit = furthest / np.maximum(np.linalg.norm(directions, axis=1), 1e-12)
    result: Array = np.minimum(reach, limit)
    return result


def _met_beyond(plan: Plan, corner: Array, gap: Array) -> NDArray[np.int64]:
    """The rows that the line from `corner` through `gap` meets beyond `gap`, up to the wall."""
    direction = gap - corner
    end = gap + direction * _reach(gap[None], direction[None], plan.walls)[0]
    length = np.linalg.norm(end - gap)
    if length < _TOUCH_M:
        return np.zeros(0, np.int64)
    ahead = (end - gap) / length
    offset = plan.sight[:, :, :2] - gap
    side, along = cross_plan(ahead, offset), offset @ ahead
    straddles = (side.min(axis=1) <= _NEAR_M) & (side.max(axis=1) >= -_NEAR_M)
    # Where a segment crosses the line; one that runs along it meets it anywhere.
    gap_width = side[:, 0] - side[:, 1]
    parallel = np.abs(gap_width) <= 2.0 * _NEAR_M
    share = np.clip(side[:, 0] / np.where(parallel, 1.0, gap_width), 0.0, 1.0)
    crossing = along[:, 0] + share * (along[:, 1] - along[:, 0])
    first = np.where(parallel, along.max(axis=1), crossing)
    last = np.where(parallel, along.min(axis=1), crossing)
    return np.flatnonzero(straddles & (first >= -_NEAR_M) & (last <= length + 5.0 * _NEAR_M))
