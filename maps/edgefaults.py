"""Faults of a map's segments: too short, drawn twice, out of the building, in the air."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from maps.findings import Fault, Finding, Severity
from maps.poses import Array
from maps.rooms import FOOT_M, LEVEL_M, Room, ceiling_of
from maps.wiremap import WireMap

#: Shorter edges are a few pixels long from where a robot can see them.
SHORT_M = 0.05
#: Two edges nearer to each other than this everywhere are one edge drawn twice.
SAME_M = 0.005
#: Edges on one line that share less than this only touch.
SHARED_M = 0.05
#: Thicker than the walls between rooms; what is farther from the floor stands where nobody can look.
WALL_M = 0.5
#: How far lamps and signs hang below a ceiling, and where to expect it if no edge shows one.
HANGING_M, LOW_CEILING_M = 1.0, 2.0


def edge_faults(wire_map: WireMap, rooms: Sequence[Room], space: BaseGeometry) -> list[Finding]:
    """Return what is wrong with single segments and with pairs of them.

    `space`: the floor with the obstacles that one can look over.
    """
    return [
        *_same_names(wire_map),
        *_short(wire_map),
        *_doubled(wire_map),
        *_outside(wire_map, space),
        *_heights(wire_map, rooms),
    ]


def _same_names(wire_map: WireMap) -> Iterator[Finding]:
    for name, times in Counter(wire_map.names).items():
        if times > 1:
            what, advice = f"{times} segments have this name", "number them, so that results can name one"
            yield Finding(Severity.NOTE, Fault.SAME_NAME, (name,), what, advice)


def _short(wire_map: WireMap) -> Iterator[Finding]:
    lengths = np.linalg.norm(wire_map.endpoints[:, 1] - wire_map.endpoints[:, 0], axis=1)
    for row in np.flatnonzero(lengths < SHORT_M):
        yield Finding(
            Severity.WARNING,
            Fault.TOO_SHORT,
            (wire_map.names[row],),
            f"{1e3 * lengths[row]:.1f} mm long",
            "delete it: no camera can make it out",
        )


def _doubled(wire_map: WireMap) -> Iterator[Finding]:
    """Pairs of segments on one line: the same, or with a stretch in common."""
    first, second = _near_pairs(wire_map.endpoints)
    a, b = wire_map.endpoints[first], wire_map.endpoints[second]
    apart = np.minimum(_furthest(a, b), _furthest(a, b[:, ::-1]))
    shared = _shared_lengths(a, b)
    for pair in np.flatnonzero((apart <= SAME_M) | (shared > SHARED_M)):
        rows = int(first[pair]), int(second[pair])
        where = wire_map.names[rows[0]], wire_map.names[rows[1]]
        if apart[pair] <= SAME_M:
            same_kind = wire_map.kinds[rows[0]] == wire_map.kinds[rows[1]]
            severity = Severity.ERROR if same_kind else Severity.WARNING
            what = f"the same edge, within {1e3 * apart[pair]:.1f} mm"
            yield Finding(severity, Fault.DOUBLED, where, what, "delete one of them")
        else:
            what = f"on one line for {shared[pair]:.2f} m"
            advice = "join them, or cut one back to where the other begins"
            yield Finding(Severity.WARNING, Fault.OVERLAPPING, where, what, advice)


def _near_pairs(endpoints: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows first < second of the segments that come near each other in plan."""
    plans = _plans(endpoints)
    first, second = shapely.STRtree(plans).query(plans, predicate="dwithin", distance=SAME_M)
    return first[first < second], second[first < second]


def _plans(endpoints: Array) -> NDArray[np.object_]:
    """Return segments (N, 2, 3) as lines in plan, (N,); upright ones have no length."""
    return np.asarray(shapely.linestrings(endpoints[:, :, :2]))


def _furthest(a: Array, b: Array) -> Array:
    """Return the larger of the distances between first ends and between second ends, (K,)."""
    distances: Array = np.linalg.norm(a - b, axis=2).max(axis=1)
    return distances


def _shared_lengths(a: Array, b: Array) -> Array:
    """Return how much of each pair's shorter segment runs along the longer one, 0 off its line, (K,)."""
    swap = np.linalg.norm(a[:, 1] - a[:, 0], axis=1) < np.linalg.norm(b[:, 1] - b[:, 0], axis=1)
    long, short = np.where(swap[:, None, None], b, a), np.where(swap[:, None, None], a, b)
    way = long[:, 1] - long[:, 0]
    length = np.linalg.norm(way, axis=1)
    way = way / length[:, None]
    reach = short - long[:, :1]
    along = np.einsum("kij,kj->ki", reach, way)
    off = np.linalg.norm(reach - along[:, :, None] * way[:, None, :], axis=2).max(axis=1)
    overlap = np.minimum(along.max(axis=1), length) - np.maximum(along.min(axis=1), 0.0)
    return np.where(off <= SAME_M, np.maximum(overlap, 0.0), 0.0)


def _outside(wire_map: WireMap, space: BaseGeometry) -> Iterator[Finding]:
    plans = _plans(wire_map.endpoints)
    far = shapely.distance(space, shapely.points(wire_map.endpoints[:, :, :2])).max(axis=1)
    buried = np.asarray(shapely.length(shapely.difference(plans, space.buffer(WALL_M))))
    for row in np.flatnonzero((far > WALL_M) | (buried > SHORT_M)):
        beyond = far[row] > WALL_M
        what = f"{far[row]:.2f} m from the floor" if beyond else f"{buried[row]:.2f} m in solid wall"
        advice = "correct its ends, or the floor: no robot can see it there"
        yield Finding(Severity.ERROR, Fault.OUTSIDE, (wire_map.names[row],), what, advice)


def _heights(wire_map: WireMap, rooms: Sequence[Room]) -> Iterator[Finding]:
    """Segments under the floor; room by room, those above its ceiling or in the air."""
    low, high = wire_map.endpoints[:, :, 2].min(axis=1), wire_map.endpoints[:, :, 2].max(axis=1)
    for row in np.flatnonzero(low < -LEVEL_M):
        what, advice = f"reaches down to {low[row]:.2f} m", "the floor is at 0: correct the height"
        yield Finding(Severity.ERROR, Fault.BELOW_FLOOR, (wire_map.names[row],), what, advice)
    from_wall = np.asarray(shapely.distance(wire_map.floor.boundary, _plans(wire_map.endpoints)))
    for room in rooms:
        ceiling = ceiling_of(room, wire_map)
        hangs_from = LOW_CEILING_M if ceiling is None else ceiling - HANGING_M
        for row in room.rows:
            where = (wire_map.names[row],)
            if ceiling is not None and high[row] > ceiling + LEVEL_M:
                what = f"reaches up to {high[row]:.2f} m, the ceiling is at {ceiling:.2f} m"
                yield Finding(Severity.WARNING, Fault.ABOVE_CEILING, where, what, "correct the height")
            elif from_wall[row] > WALL_M and low[row] > FOOT_M and high[row] < hangs_from:
                what = f"{from_wall[row]:.2f} m from any wall, {low[row]:.2f} m above the floor"
                advice = "correct its place, or draw what carries it as a hole in the floor"
                yield Finding(Severity.WARNING, Fault.FLOATING, where, what, advice)
