"""Verification of matching hypotheses (section 3.3): a pose for each, a score for each pose, the best one.

A hypothesis is scored by equation (8): of the distances between its own projected and viewed segments, the k-th
smallest. Edges that it leaves out, and pairs beyond the best k, have no say; that is how the paper has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2, wrap_angle
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import level_from_optical
from vision.lines import ImageSegments
from vision.paper.binary import VerticalPairs
from vision.paper.combinations import HypothesisList
from vision.paper.distance import SegmentDistance, mean_distance, printed_distance
from vision.paper.leastsquares import Equations, best_position, solve_pose
from vision.paper.selection import ViewedDisc, viewed_disc
from vision.paper.trees import Combinations
from vision.paper.unary import UnaryPairs
from vision.projection import line_normals

#: What lies nearer to the image plane than this is cut off.
_NEAR_M = 0.05
#: In a wider window the estimate is no start for a least squares in the heading; several are.
_ONE_START_RAD = math.radians(60.0)


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts:
    """N hypotheses, judged.

    `cameras`: (N, 3) psi, x, y of the camera, map frame; `scores`: (N,) pixels, equation (8), infinite where a
    hypothesis puts too many edges behind the camera. `best`: the hypothesis with the least score; -1 if none.
    """

    cameras: Array
    scores: Array
    best: int


@dataclass(frozen=True, slots=True, eq=False)
class Winner:
    """The best hypothesis.

    `rows`: (K,) of the wire map, `lines`: (K,) of the image, paired. `pose`: the robot's. `covariance`: (3, 3) over
    (x, y, phi); None where the pairs leave a direction open. `score_px`: equation (8).
    """

    rows: NDArray[np.int64]
    lines: NDArray[np.int64]
    pose: Pose2
    covariance: Array | None
    score_px: float


@dataclass(frozen=True, slots=True, eq=False)
class PairList:
    """All pairs of both trees, numbered through: those of the unary constraint, then the vertical ones.

    `rows`, `lines`: (P,). `offset`: the number of the first vertical one.
    """

    rows: NDArray[np.int64]
    lines: NDArray[np.int64]
    offset: int


def verify(
    camera: Camera,
    wire_map: WireMap,
    segments: ImageSegments,
    pairs: PairList,
    system: Equations,
    lists: tuple[Combinations, Combinations],
    hypotheses: HypothesisList,
    window: SearchWindow,
    k: int,
    distance: SegmentDistance,
) -> Verdicts:
    """Compute pose and score of each hypothesis and choose the best.

    `system`: the equations of `pairs`; `lists`: of the horizontal tree and of the vertical one. The least squares
    starts at the window's centre (the estimate); in a window too wide for that, at several headings of it.
    """
    level = level_from_optical(camera)
    horizontal, vertical = lists
    ends = wire_map.endpoints[pairs.rows] - [0.0, 0.0, camera.mount.height_m]
    cameras, scores = _judge(
        hypotheses.horizontal,
        hypotheses.vertical,
        horizontal.pairs,
        horizontal.sizes,
        vertical.pairs,
        vertical.sizes,
        pairs.offset,
        system.terms,
        np.ascontiguousarray(ends),
        np.ascontiguousarray(segments.ideal_px[pairs.lines]),
        level,
        camera.focal_px,
        start_headings(camera, window),
        viewed_disc(camera, window).centre,
        k,
        distance is SegmentDistance.PRINTED,
    )
    return _with_best(cameras, scores)


def all_pairs(unary: UnaryPairs, verticals: VerticalPairs) -> PairList:
    """Return the pairs of both trees in one list."""
    return PairList(
        np.concatenate([unary.rows, verticals.rows]),
        np.concatenate([unary.lines, verticals.lines]),
        len(unary),
    )


def members(
    pairs: PairList, lists: tuple[Combinations, Combinations], hypotheses: HypothesisList, number: int
) -> NDArray[np.int64]:
    """Return the numbers of the pairs (K,) that one hypothesis holds."""
    horizontal, vertical = hypotheses.horizontal[number], hypotheses.vertical[number]
    first = lists[0].pairs[horizontal, : lists[0].sizes[horizontal]]
    second = lists[1].pairs[vertical, : lists[1].sizes[vertical]]
    return np.concatenate([first, pairs.offset + second]).astype(np.int64)


def inside(verdicts: Verdicts, disc: ViewedDisc) -> Verdicts:
    """Return the verdicts with the poses outside the window thrown away."""
    away = verdicts.cameras[:, 1:] - disc.centre
    out = np.hypot(away[:, 0], away[:, 1]) > disc.radius_m
    out |= np.abs(wrap_angle(verdicts.cameras[:, 0] - disc.psi)) > disc.dpsi
    return _with_best(verdicts.cameras, np.where(out, np.inf, verdicts.scores))


def line_residuals(camera: Camera, wire_map: WireMap, segments: ImageSegments, winner: Winner) -> Array:
    """Return the root mean square distance of each paired line's ends from its projected edge, pixels (K,)."""
    rotation, centre = camera.map_from_optical(winner.pose)
    normals = line_normals((wire_map.endpoints[winner.rows] - centre) @ rotation)
    ends = segments.ideal_px[winner.lines]
    distances = (ends @ normals[:, :2, None])[..., 0] + camera.focal_px * normals[:, 2, None]
    result: Array = np.sqrt((distances**2).mean(axis=1))
    return result


def _with_best(cameras: Array, scores: Array) -> Verdicts:
    best = int(scores.argmin()) if np.isfinite(scores).any() else -1
    return Verdicts(cameras, scores, best)


def start_headings(camera: Camera, window: SearchWindow) -> Array:
    """Return the camera's headings from which the least squares starts, (S,)."""
    psi = window.centre.phi + camera.mount.yaw_rad
    span = min(window.dphi_rad, math.pi)
    number = max(math.ceil(span / _ONE_START_RAD), 1)
    inner = span * (1.0 - 1.0 / number)
    return np.linspace(psi - inner, psi + inner, number)


@njit(cache=True, nogil=True)
def kth_smallest(values: Array, k: int) -> float:
    """Return the k-th smallest of some values, equation (8); the largest where there are fewer."""
    ordered = np.sort(values)
    return float(ordered[min(k, len(values)) - 1])


@njit(cache=True, nogil=True)
def _judge(
    first: NDArray[np.int32],
    second: NDArray[np.int32],
    pairs_h: NDArray[np.int32],
    sizes_h: NDArray[np.int32],
    pairs_v: NDArray[np.int32],
    sizes_v: NDArray[np.int32],
    offset: int,
    terms: Array,
    ends: Array,
    lines_px: Array,
    level: Array,
    focal_px: float,
    headings: Array,
    centre: Array,
    k: int,
    printed: bool,
) -> tuple[Array, Array]:
    """Poses (N, 3) and scores (N,) of all hypotheses."""
    count = len(first)
    cameras, scores = np.empty((count, 3)), np.empty(count)
    room = pairs_h.shape[1] + pairs_v.shape[1]
    members, own, distances = np.empty(room, np.int64), np.empty((room, 8)), np.empty(room)
    for row in range(count):
        size = 0
        for place in range(sizes_h[first[row]]):
            members[size] = pairs_h[first[row], place]
            size += 1
        for place in range(sizes_v[second[row]]):
            members[size] = offset + pairs_v[second[row], place]
            size += 1
        for place in range(size):
            own[place] = terms[members[place]]
        least = np.inf
        for heading in headings:
            x, y = centre[0], centre[1]
            if len(headings) > 1:
                x, y = best_position(own[:size], heading, x, y)
            cost, psi, x, y = solve_pose(own[:size], heading, x, y)
            if cost < least:
                least = cost
                cameras[row, 0], cameras[row, 1], cameras[row, 2] = psi, x, y
        for place in range(size):
            pair = members[place]
            distances[place] = _pair_distance(
                ends[pair], lines_px[pair], cameras[row], level, focal_px, printed
            )
        scores[row] = kth_smallest(distances[:size], k)
    return cameras, scores


@njit(cache=True, nogil=True)
def _pair_distance(
    ends: Array, line_px: Array, camera: Array, level: Array, focal_px: float, printed: bool
) -> float:
    """D of a map segment (2, 3), z from the camera's height, projected from a pose, and a viewed line (2, 2)."""
    cos, sin = math.cos(camera[0]), math.sin(camera[0])
    optical = np.empty((2, 3))
    for end in range(2):
        dx, dy, up = ends[end, 0] - camera[1], ends[end, 1] - camera[2], ends[end, 2]
        forward, left = cos * dx + sin * dy, cos * dy - sin * dx
        for axis in range(3):
            optical[end, axis] = level[0, axis] * forward + level[1, axis] * left + level[2, axis] * up
    if optical[0, 2] < _NEAR_M and optical[1, 2] < _NEAR_M:
        return np.inf
    for end in range(2):
        if optical[end, 2] < _NEAR_M:
            other = 1 - end
            share = (_NEAR_M - optical[end, 2]) / (optical[other, 2] - optical[end, 2])
            for axis in range(3):
                optical[end, axis] += share * (optical[other, axis] - optical[end, axis])
    px, py = focal_px * optical[0, 0] / optical[0, 2], focal_px * optical[0, 1] / optical[0, 2]
    qx, qy = focal_px * optical[1, 0] / optical[1, 2], focal_px * optical[1, 1] / optical[1, 2]
    sx, sy, ex, ey = line_px[0, 0], line_px[0, 1], line_px[1, 0], line_px[1, 1]
    if printed:
        return printed_distance(px, py, qx, qy, sx, sy, ex, ey)
    return mean_distance(px, py, qx, qy, sx, sy, ex, ey)
