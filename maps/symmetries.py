"""Motions that carry a part of a map onto another part of it: where a building repeats itself.

A lost robot mistakes one place for another where a turn and a shift of the plan bring what it sees there over
what it sees here. Such motions belong to the map, and not to any camera: every couple of like edges votes for
the motion that brings one over the other, and the motions with several votes are kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from maps.poses import Array, Pose2, frozen, wrap_angle
from maps.rooms import vertical
from maps.wiremap import WireMap

#: Edges are alike where both ends agree this well; votes this near to each other are for one motion.
ALIKE_M = 0.05
#: A motion carries at least this many edges.
MIN_VOTES = 4
#: A motion smaller than this, of everything, is none.
_STILL_M, _STILL_RAD = 0.3, np.radians(5.0)
#: Buildings have few directions; those beyond the longest so many are left out.
_MAX_DIRECTIONS = 6
_SAME_DIRECTION_RAD = np.radians(0.5)
#: Carried edges are compared with the map's at points this far apart, and edges' directions at this distance.
_SAMPLE_M, _LEVER_M = 0.1, 1.0
#: The places along an edge where it is looked whether it comes to lie on another, from p0 (0) to p1 (1).
PLACES = 6
PLACES_AT = frozen((np.arange(PLACES) + 0.5) / PLACES)
#: The motions with most votes; more than these differ only in what carries next to nothing.
_MAX_MOTIONS = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Symmetries:
    """K motions of the plan, most votes first.

    `motions`: (K, 3) x, y, phi of the transform that carries a point (`Pose2`: there_from_here).
    `carries`: (K, N, `PLACES`) whether places along each segment, at `PLACES_AT`, come to lie on, and along, some
    segment of the map.
    """

    motions: Array
    carries: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.motions)

    def carried(self, motion: int, pose: Pose2) -> Pose2:
        """Return where a motion brings a pose."""
        return Pose2.from_array(self.motions[motion]) @ pose


def symmetries_of(wire_map: WireMap) -> Symmetries:
    """Return the motions that carry at least `MIN_VOTES` edges of a map onto edges of it."""
    motions = motions_of(wire_map, np.arange(len(wire_map)))
    return Symmetries(frozen(motions), _carries(wire_map.endpoints, motions))


def motions_of(wire_map: WireMap, rows: NDArray[np.int64]) -> Array:
    """Return the motions (K, 3) that carry at least `MIN_VOTES` of some edges onto edges of the map, most first."""
    some = wire_map.endpoints[rows]
    found = [_shifts(some, wire_map.endpoints, turn) for turn in _turns(wire_map.endpoints)]
    motions = np.concatenate([moves for moves, _ in found])
    votes = np.concatenate([counts for _, counts in found])
    # Of turns about a far point that hardly differ from standing still, none is here: turns are discrete.
    moves = np.hypot(motions[:, 0], motions[:, 1]) > _STILL_M
    keep = np.flatnonzero(moves | (np.abs(motions[:, 2]) > _STILL_RAD))
    keep = keep[np.argsort(-votes[keep], kind="stable")][:_MAX_MOTIONS]
    result: Array = motions[keep]
    return result


def _turns(endpoints: Array) -> list[float]:
    """The turns that bring one of the map's main directions over another, or over itself."""
    level = endpoints[~vertical(endpoints)]
    way = (level[:, 1] - level[:, 0])[:, :2]
    lengths, angles = np.hypot(way[:, 0], way[:, 1]), np.arctan2(way[:, 1], way[:, 0]) % np.pi
    directions: list[float] = []
    while len(lengths) and len(directions) < _MAX_DIRECTIONS:
        # Modulo a half turn, by doubling.
        near = np.abs(wrap_angle(2.0 * (angles[:, None] - angles))) < 2.0 * _SAME_DIRECTION_RAD
        best = int(np.argmax(near @ lengths))
        directions.append(float(angles[best]))
        angles, lengths = angles[~near[best]], lengths[~near[best]]
    turns: list[float] = [0.0, np.pi]
    for a, b in product(directions, directions):
        for half in (0.0, np.pi):
            turn = float(wrap_angle(a - b + half))
            if all(abs(wrap_angle(turn - other)) > _SAME_DIRECTION_RAD for other in turns):
                turns.append(turn)
    return turns


def _shifts(some: Array, endpoints: Array, turn: float) -> tuple[Array, NDArray[np.int64]]:
    """The motions (K, 3) with one turn that bring several of some edges over their like, and their votes (K,)."""
    turned, nothing = _turned(some, turn), (np.zeros((0, 3)), np.zeros(0, np.int64))
    there = np.concatenate([endpoints, endpoints[:, ::-1]])
    # Alike but for a shift of the plan: the same way from end to end, at the same height.
    tree = cKDTree(_shape(there))
    couples = cKDTree(_shape(turned)).sparse_distance_matrix(tree, ALIKE_M, output_type="coo_matrix")
    if not couples.nnz:
        return nothing
    shifts = (there[couples.col].mean(axis=1) - turned[couples.row].mean(axis=1))[:, :2]
    cells, cell, counts = np.unique(
        np.round(shifts / ALIKE_M).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    cell = cell.ravel()
    around = np.zeros(len(cells), np.int64)
    sums = np.zeros((len(cells), 2))
    middle = np.column_stack([np.bincount(cell, shifts[:, axis], len(cells)) for axis in (0, 1)])
    tree = cKDTree(cells)
    pairs = tree.sparse_distance_matrix(tree, 1.5, output_type="coo_matrix")
    np.add.at(around, pairs.row, counts[pairs.col])
    np.add.at(sums, pairs.row, middle[pairs.col])
    highest = np.zeros(len(cells), np.int64)
    np.maximum.at(highest, pairs.row, around[pairs.col])
    peaks = np.flatnonzero((around >= MIN_VOTES) & (around >= highest))
    shift = sums[peaks] / around[peaks, None]
    return np.column_stack([shift, np.full(len(peaks), turn)]), around[peaks]


def _carries(endpoints: Array, motions: Array) -> NDArray[np.bool_]:
    """Whether places along each moved segment lie on and along a segment of the map, (K, N, PLACES)."""
    counts = np.maximum(np.ceil(np.linalg.norm(endpoints[:, 1] - endpoints[:, 0], axis=1) / _SAMPLE_M), 1)
    which = np.repeat(np.arange(len(endpoints)), counts.astype(np.int64) + 1)
    place = np.concatenate([np.linspace(0.0, 1.0, int(count) + 1) for count in counts])
    tree = cKDTree(_with_direction(endpoints, which, place))
    few = np.repeat(np.arange(len(endpoints)), PLACES)
    where = np.tile(PLACES_AT, len(endpoints))
    reach = math.hypot(0.5 * _SAMPLE_M, ALIKE_M)
    result = np.zeros((len(motions), len(endpoints), PLACES), bool)
    for row, (x, y, phi) in enumerate(motions):
        moved = _turned(endpoints, phi) + [x, y, 0.0]
        distance, _ = tree.query(_with_direction(moved, few, where), distance_upper_bound=reach)
        result[row] = np.isfinite(distance).reshape(-1, PLACES)
    return result


def _with_direction(endpoints: Array, rows: NDArray[np.int64], place: Array) -> Array:
    """Points of segments (P, 3), followed by their direction in the plan without its sense (P, 2)."""
    start, way = endpoints[rows, 0], endpoints[rows, 1] - endpoints[rows, 0]
    double = 2.0 * np.arctan2(way[:, 1], way[:, 0])
    level = np.hypot(way[:, 0], way[:, 1]) / np.linalg.norm(way, axis=1)
    arrow = _LEVER_M * level[:, None] * np.column_stack([np.cos(double), np.sin(double)])
    return np.hstack([start + place[:, None] * way, arrow])


def _shape(endpoints: Array) -> Array:
    """The way from end to end and the height of the middle, (N, 4)."""
    return np.column_stack([endpoints[:, 1] - endpoints[:, 0], endpoints[:, :, 2].mean(axis=1)])


def _turned(endpoints: Array, turn: float) -> Array:
    """Turn segments (N, 2, 3) about the z axis."""
    cos, sin = np.cos(turn), np.sin(turn)
    x, y, z = np.moveaxis(endpoints, -1, 0)
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)
