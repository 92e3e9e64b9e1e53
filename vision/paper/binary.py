"""The binary constraint on couples of vertical edges and image lines (section 3.2, equations 3 and 4).

From where a camera sees edge A at an angle w to the left of edge B, it stands on an arc of the circle through
both, on the right of the way from A to B: the order of appearance settles the side. A couple of pairs is kept if
the arc meets the window's disc, within the error of w (section 3.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from maps.poses import Array
from maps.wiremap import WireMap
from vision.paper.errors import Bearings
from vision.paper.selection import ViewedDisc
from vision.paper.tables import ToleranceTable

#: What a couple says about the order of its edges in the image; their union where it cannot be told.
APART, FIRST_LEFT, FIRST_RIGHT = 0, 1, 2
#: An angle between two bearings that is nothing but a straight line.
_STRAIGHT_RAD = 1e-7
#: No edge is nearer than this, for what its place in the map adds to its bearing.
_NEAR_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class VerticalPairs:
    """P pairs of a vertical edge and a line that may be one, and which of them agree, two by two.

    `rows`: (P,) of the wire map, sorted; `lines`: (P,) of the image. `agrees`: (P, P) `APART` for couples that
    fail, else the orders of appearance they allow. `couples`: how many pass, `tested`: of how many. `dropped`:
    pairs left out since there were too many.
    """

    rows: NDArray[np.int64]
    lines: NDArray[np.int64]
    agrees: NDArray[np.int8]
    couples: int
    tested: int
    dropped: int

    def __len__(self) -> int:
        return len(self.rows)


def binary_constraint(
    wire_map: WireMap,
    bearings: Bearings,
    rows: NDArray[np.int64],
    lines: NDArray[np.int64],
    disc: ViewedDisc,
    sigmas: float,
    table: ToleranceTable | None = None,
    dropped: int = 0,
) -> VerticalPairs:
    """Test all couples of the pairs (`rows`, `lines`), (P,) each; pairs that share an edge or a line fail.

    `table`: tolerances by Monte Carlo; without one the errors of the bearings are propagated.
    """
    points = wire_map.endpoints[rows].mean(axis=1)[:, :2]
    distance = np.linalg.norm(points - disc.centre, axis=1)
    blur = wire_map.sigma_m[rows] / np.maximum(distance, _NEAR_M)
    own = np.hypot(bearings.own[lines], blur)
    spreads = np.zeros((0, 0, 3)) if table is None else table.circle_covariance
    reach = 1.0 if table is None else table.reach_rad
    agrees, tested = _couples(
        rows,
        lines,
        np.ascontiguousarray(points),
        bearings.bearings[lines],
        own,
        bearings.shared[lines],
        disc.centre,
        disc.radius_m,
        sigmas,
        spreads,
        reach,
    )
    couples = int(np.count_nonzero(agrees)) // 2
    return VerticalPairs(rows, lines, agrees, couples, int(tested), dropped)


@njit(cache=True, nogil=True)
def subtended(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Return how far to the left of B one sees A from (x, y), radians in (-pi, pi]."""
    cross = (bx - x) * (ay - y) - (by - y) * (ax - x)
    return math.atan2(cross, (bx - x) * (ax - x) + (by - y) * (ay - y))


@njit(cache=True, nogil=True)
def circle(ax: float, ay: float, bx: float, by: float, angle: float) -> tuple[float, float, float]:
    """Return centre and radius of the circle from which A is seen `angle` to the left of B, equation (4).

    `angle` in (0, pi). The centre is the baseline's middle plus (d / 2) cot(angle) times its right normal.
    """
    dx, dy = bx - ax, by - ay
    half = 0.5 / math.tan(angle)
    radius = 0.5 * math.sqrt(dx * dx + dy * dy) / math.sin(angle)
    return 0.5 * (ax + bx) + half * dy, 0.5 * (ay + by) - half * dx, radius


@njit(cache=True, nogil=True)
def arc_distance(ax: float, ay: float, bx: float, by: float, angle: float, x: float, y: float) -> float:
    """Return the distance in metres of (x, y) from the arc that sees A `angle` to the left of B.

    A negative angle means that B is on the left.
    """
    if angle < 0.0:
        ax, ay, bx, by, angle = bx, by, ax, ay, -angle
    angle = min(max(angle, _STRAIGHT_RAD), math.pi - _STRAIGHT_RAD)
    cx, cy, radius = circle(ax, ay, bx, by, angle)
    away = max(math.sqrt((x - cx) ** 2 + (y - cy) ** 2), 1e-12)
    # The nearest point of the circle counts if it is on the right of the way from A to B.
    qx, qy = cx + radius * (x - cx) / away, cy + radius * (y - cy) / away
    if (qx - ax) * (by - ay) - (qy - ay) * (bx - ax) >= 0.0:
        return abs(away - radius)
    return math.sqrt(min((x - ax) ** 2 + (y - ay) ** 2, (x - bx) ** 2 + (y - by) ** 2))


@njit(cache=True, nogil=True)
def disc_sees(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    angle: float,
    slack: float,
    x: float,
    y: float,
    radius: float,
) -> bool:
    """Return whether somewhere in a disc A is seen `angle`, give or take `slack`, to the left of B.

    The places are those between the arcs of the two extreme angles.
    """
    low, high = max(angle - slack, -math.pi), min(angle + slack, math.pi)
    if low <= subtended(ax, ay, bx, by, x, y) <= high:
        return True
    nearest = min(arc_distance(ax, ay, bx, by, low, x, y), arc_distance(ax, ay, bx, by, high, x, y))
    return nearest <= radius


@njit(cache=True, nogil=True)
def circle_slack(
    ax: float, ay: float, bx: float, by: float, angle: float, spread: Array, x: float, y: float
) -> float:
    """Return the standard deviation in metres of the distance of (x, y) from the circle, by a table's `spread`.

    `spread`: (3,) for a baseline of one metre: variance of the centre's distance from it, covariance with the
    radius, variance of the radius.
    """
    if angle < 0.0:
        ax, ay, bx, by, angle = bx, by, ax, ay, -angle
    angle = min(max(angle, _STRAIGHT_RAD), math.pi - _STRAIGHT_RAD)
    cx, cy, _ = circle(ax, ay, bx, by, angle)
    dx, dy = bx - ax, by - ay
    away = max(math.sqrt((x - cx) ** 2 + (y - cy) ** 2), 1e-12)
    by_centre = ((x - cx) * dy - (y - cy) * dx) / away
    baseline = math.sqrt(dx * dx + dy * dy)
    variance = by_centre**2 * spread[0] + 2.0 * by_centre * baseline * spread[1] + baseline**2 * spread[2]
    return math.sqrt(max(variance, 0.0))


@njit(cache=True, nogil=True)
def _couples(
    rows: NDArray[np.int64],
    lines: NDArray[np.int64],
    points: Array,
    bearings: Array,
    own: Array,
    shared: Array,
    centre: Array,
    radius: float,
    sigmas: float,
    spreads: Array,
    reach: float,
) -> tuple[NDArray[np.int8], int]:
    """Orders of appearance that each couple allows, (P, P), and how many couples were tested."""
    count, tested = len(rows), 0
    agrees = np.zeros((count, count), np.int8)
    x, y = centre[0], centre[1]
    last = spreads.shape[0] - 1
    for i in range(count):
        for k in range(i + 1, count):
            if rows[i] == rows[k] or lines[i] == lines[k]:
                continue
            tested += 1
            ax, ay, bx, by = points[i, 0], points[i, 1], points[k, 0], points[k, 1]
            if (ax - bx) ** 2 + (ay - by) ** 2 < 1e-12:
                continue
            angle = bearings[i] - bearings[k]
            variance = own[i] ** 2 + own[k] ** 2
            for source in range(shared.shape[1]):
                variance += (shared[i, source] - shared[k, source]) ** 2
            slack = sigmas * math.sqrt(variance)
            if last < 0:
                fits = disc_sees(ax, ay, bx, by, angle, slack, x, y, radius)
            else:
                u = int(min(max(round(0.5 * last * (bearings[i] / reach + 1.0)), 0), last))
                v = int(min(max(round(0.5 * last * (bearings[k] / reach + 1.0)), 0), last))
                allowed = sigmas * circle_slack(ax, ay, bx, by, angle, spreads[u, v], x, y)
                fits = arc_distance(ax, ay, bx, by, angle, x, y) <= radius + allowed
            if not fits:
                continue
            if angle > slack:
                agrees[i, k], agrees[k, i] = FIRST_LEFT, FIRST_RIGHT
            elif angle < -slack:
                agrees[i, k], agrees[k, i] = FIRST_RIGHT, FIRST_LEFT
            else:
                agrees[i, k] = agrees[k, i] = FIRST_LEFT | FIRST_RIGHT
    return agrees, tested
