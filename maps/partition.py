"""Convex cells of the floor, cut along event lines until their visibility lists are tight.

The exact partition by all event lines has tens of thousands of cells in a real building. Here a convex piece
of the floor is cut only where that shortens lists: what can be seen from a convex cell is what its centre sees
and what the events that cross the cell may add, so a cell that no event crosses is exact, and one whose events
add little is left whole. A list may be longer than the truth, never shorter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon

from maps.events import Events
from maps.plan import Plan
from maps.poses import Array
from maps.visibility import cross_plan, inside_interval


@dataclass(frozen=True, slots=True)
class PartitionConfig:
    """When a cell is good enough."""

    #: Segments that events may add, as a share of those that the cell's centre sees.
    surplus: float = 0.15
    #: Cells narrower than this are not cut again.
    min_width_m: float = 0.25
    #: Distance within which an event line counts as crossing a cell.
    tolerance_m: float = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A convex polygon `corners` (V, 2), counter-clockwise, and the rows visible from it, `rows` (K,)."""

    corners: Array
    rows: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """A cell on its way: what may be visible, and which events may cross it."""

    corners: Array
    candidates: NDArray[np.int64]
    events: NDArray[np.int64]


def convex_pieces(floor: MultiPolygon) -> list[Array]:
    """Cut the floor into convex polygons (V, 2): its Delaunay triangles, merged while they stay convex."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(floor))
    pieces = {number: polygon for number, polygon in enumerate(triangles) if polygon.area > 1e-9}
    tree = shapely.STRtree(triangles)
    first, second = tree.query(triangles, predicate="touches")
    shared = shapely.length(shapely.intersection(triangles[first], triangles[second]))
    beside = (first < second) & (shared > 1e-6)
    owner = {number: number for number in pieces}

    def root(number: int) -> int:
        while owner[number] != number:
            number = owner[number]
        return number

    # Longest shared edges first: they leave the roundest pieces.
    for pair in np.argsort(-shared):
        if not beside[pair] or first[pair] not in owner or second[pair] not in owner:
            continue
        a, b = root(int(first[pair])), root(int(second[pair]))
        if a == b:
            continue
        union = shapely.union(pieces[a], pieces[b])
        if union.geom_type == "Polygon" and union.convex_hull.area - union.area < 1e-9:
            pieces[a], owner[b] = union, a
            del pieces[b]
    return [_outline(polygon) for polygon in pieces.values()]


def partition(plan: Plan, pieces: list[Array], events: Events, config: PartitionConfig) -> list[Cell]:
    """Return cells that cover the pieces, with what can be seen of the plan from each."""
    everything, all_events = np.arange(len(plan.sight)), np.arange(len(events.lines))
    waiting = [_Piece(corners, everything, all_events) for corners in pieces]
    cells: list[Cell] = []
    while waiting:
        piece = waiting.pop()
        seen = plan.seen(_centroid(piece.corners), piece.candidates)
        crossing = piece.events[_crosses(piece.corners, events.lines[piece.events], config.tolerance_m)]
        rows = np.union1d(seen, rows_of(events, crossing))
        surplus = len(rows) - len(seen)
        halves = (
            _halves(piece.corners, events.lines[crossing], config.min_width_m)
            if surplus > config.surplus * len(seen)
            else None
        )
        if halves is None:
            cells.append(Cell(piece.corners, rows))
        else:
            waiting += [_Piece(half, rows, crossing) for half in halves]
    return cells


def rows_of(events: Events, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the distinct rows of the chosen events."""
    if not len(chosen):
        return np.zeros(0, np.int64)
    spans = [events.rows[events.starts[e] : events.starts[e + 1]] for e in chosen.tolist()]
    return np.unique(np.concatenate(spans))


def _outline(polygon: shapely.Polygon) -> Array:
    corners = shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1]
    return np.asarray(corners, np.float64)


def _centroid(corners: Array) -> Array:
    after = np.roll(corners, -1, axis=0)
    weight = cross_plan(corners, after)
    if abs(weight.sum()) < 1e-12:
        return np.asarray(corners.mean(axis=0))
    return np.asarray(((corners + after) * weight[:, None]).sum(axis=0) / (3.0 * weight.sum()))


def _crosses(corners: Array, lines: Array, tolerance_m: float) -> NDArray[np.bool_]:
    """Which segments (E, 2, 2) come within the tolerance of a convex polygon, (E,)."""
    edge = np.roll(corners, -1, axis=0) - corners
    normal = (
        np.column_stack([-edge[:, 1], edge[:, 0]]) / np.maximum(np.linalg.norm(edge, axis=1), 1e-12)[:, None]
    )
    offset = (normal * corners).sum(axis=1) - tolerance_m
    start, end = (list(normal @ lines[:, side].T - offset[:, None]) for side in (0, 1))
    low, high = inside_interval(start, end)
    return low < high


def _halves(corners: Array, lines: Array, min_width_m: float) -> tuple[Array, Array] | None:
    """Cut a convex polygon along the event line that cuts it deepest; None where none cuts wide pieces."""
    if not len(lines):
        return None
    direction = lines[:, 1] - lines[:, 0]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    offset = corners[None] - lines[:, :1]
    side = cross_plan(direction[:, None], offset)
    depth = np.minimum(side.max(axis=1), -side.min(axis=1))
    best = int(depth.argmax())
    if depth[best] < min_width_m:
        return None
    return _clipped(corners, side[best]), _clipped(corners, -side[best])


def _clipped(corners: Array, side: Array) -> Array:
    """The part of a convex polygon where the corners' signed distances `side` are positive."""
    kept: list[Array] = []
    for here in range(len(corners)):
        after = (here + 1) % len(corners)
        if side[here] >= 0.0:
            kept.append(corners[here])
        if side[here] * side[after] < 0.0:
            share = side[here] / (side[here] - side[after])
            kept.append(corners[here] + share * (corners[after] - corners[here]))
    return np.array(kept)
