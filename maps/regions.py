"""View-invariant regions: convex cells of the floor, each with the segments that can be seen from it.

Section 2 of the paper. A cell's list holds every segment of which some part can be seen from some point of
the cell, by a camera anywhere in a range of heights, and for each segment the range of bearings under which
the cell sees it. A window that touches a few cells needs to look at their segments only.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from maps.events import visibility_events
from maps.partition import Cell, PartitionConfig, convex_pieces, partition
from maps.plan import Plan, plan_of
from maps.poses import Array, frozen, wrap_angle
from maps.visibility import hidden_by_heights
from maps.wiremap import WireMap


@dataclass(frozen=True, slots=True, eq=False)
class ViewRegion:
    """One convex cell.

    `corners`: (V, 2) metres, counter-clockwise. `rows`: (K,) visible segments. `ranges`: (K, 2) the least and
    the largest bearing [rad, map frame] of each segment from the cell; the first in (-pi, pi], the second not
    below it, and beyond pi where the range straddles the cut. A segment that touches the cell has the full turn.
    """

    corners: Array
    rows: NDArray[np.int64]
    ranges: Array


@dataclass(frozen=True, slots=True, eq=False)
class ViewRegions:
    """All cells of a map, for cameras between two heights.

    Flat arrays: the corners of cell k are corners[corner_starts[k]:corner_starts[k + 1]], its segments
    rows[row_starts[k]:row_starts[k + 1]], with as many ranges.
    """

    heights_m: tuple[float, float]
    corners: Array
    corner_starts: NDArray[np.int64]
    rows: NDArray[np.int64]
    ranges: Array
    row_starts: NDArray[np.int64]
    build_seconds: float
    _tree: shapely.STRtree

    def __len__(self) -> int:
        return len(self.row_starts) - 1

    @property
    def memory_bytes(self) -> int:
        """What the arrays take."""
        arrays = (self.corners, self.corner_starts, self.rows, self.ranges, self.row_starts)
        return sum(array.nbytes for array in arrays)

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many segments each cell sees, (R,)."""
        return np.diff(self.row_starts)

    def region(self, number: int) -> ViewRegion:
        """Return one cell."""
        corners = slice(self.corner_starts[number], self.corner_starts[number + 1])
        rows = slice(self.row_starts[number], self.row_starts[number + 1])
        return ViewRegion(self.corners[corners], self.rows[rows], self.ranges[rows])

    def at(self, point: tuple[float, float]) -> int | None:
        """Return the cell that holds a point of the floor; None off the floor."""
        found = self._tree.query(shapely.Point(point), predicate="intersects")
        return int(found.min()) if len(found) else None

    def touching(self, point: tuple[float, float], radius_m: float) -> NDArray[np.int64]:
        """Return the cells within a distance of a point, in order; the nearest one where there is none."""
        found = self._tree.query(shapely.Point(point), predicate="dwithin", distance=radius_m)
        nearest = self._tree.query_nearest(shapely.Point(point)) if not len(found) else found
        return np.sort(nearest)

    def visible(
        self, point: tuple[float, float], radius_m: float, heading_rad: float, spread_rad: float
    ) -> NDArray[np.int64]:
        """Return the segments (K,) that can be seen from within a disc, in a range of bearings.

        `spread_rad`: half the range, on both sides of the heading; pi or more for all around.
        """
        found: list[NDArray[np.int64]] = []
        for number in self.touching(point, radius_m).tolist():
            rows = slice(self.row_starts[number], self.row_starts[number + 1])
            ranges = self.ranges[rows]
            half = 0.5 * (ranges[:, 1] - ranges[:, 0])
            away = np.abs(wrap_angle(ranges[:, 0] + half - heading_rad))
            found.append(self.rows[rows][away <= half + spread_rad])
        return np.unique(np.concatenate(found)) if found else np.zeros(0, np.int64)


def build_regions(
    wire_map: WireMap, heights_m: tuple[float, float], config: PartitionConfig | None = None
) -> ViewRegions:
    """Build a map's regions for cameras between two heights (low, high) in metres."""
    started = time.perf_counter()
    plan = plan_of(wire_map)
    events = visibility_events(plan)
    pieces = convex_pieces(wire_map.floor)
    cells = partition(plan, pieces, events, config or PartitionConfig())
    cells = [_of_the_map(wire_map, plan, cell, heights_m) for cell in cells]
    ranges = [bearing_ranges(cell.corners, wire_map.endpoints[cell.rows]) for cell in cells]
    return assemble(
        heights_m,
        corners=np.concatenate([cell.corners for cell in cells]),
        corner_starts=_starts([len(cell.corners) for cell in cells]),
        rows=np.concatenate([cell.rows for cell in cells]),
        ranges=np.concatenate(ranges),
        row_starts=_starts([len(cell.rows) for cell in cells]),
        build_seconds=time.perf_counter() - started,
    )


def _of_the_map(wire_map: WireMap, plan: Plan, cell: Cell, heights_m: tuple[float, float]) -> Cell:
    """The cell with the map's own rows, without what a lintel or a low obstacle hides from all of it."""
    rows = plan.segments_of(cell.rows)
    low_walls, lintels = plan.low_walls_of(cell.rows), plan.lintels_of(cell.rows)
    hidden = hidden_by_heights(wire_map, cell.corners, heights_m, rows, low_walls, lintels)
    return Cell(cell.corners, rows[~hidden])


def assemble(
    heights_m: tuple[float, float],
    *,
    corners: Array,
    corner_starts: NDArray[np.int64],
    rows: NDArray[np.int64],
    ranges: Array,
    row_starts: NDArray[np.int64],
    build_seconds: float,
) -> ViewRegions:
    """Put flat arrays, as in `ViewRegions`, together with their spatial index."""
    rings = np.split(corners, corner_starts[1:-1])
    tree = shapely.STRtree([shapely.Polygon(ring) for ring in rings])
    for array in (rows, corner_starts, row_starts):
        array.setflags(write=False)
    return ViewRegions(
        heights_m, frozen(corners), corner_starts, rows, frozen(ranges), row_starts, build_seconds, tree
    )


def bearing_ranges(corners: Array, endpoints: Array) -> Array:
    """Return the bearings under which a convex cell (V, 2) sees segments (K, 2, 3): least and largest, (K, 2).

    The bearing of a point is extreme at the cell's corners, and that of a segment at its end points, as long as
    neither the cell nor the segment's plan meets the other: then the range is the full turn.
    """
    offset = endpoints[:, :, None, :2] - corners
    bearings = np.arctan2(offset[..., 1], offset[..., 0]).reshape(len(endpoints), -1)
    # Seen from the cell's middle, so that the range cannot straddle the cut.
    middle = endpoints[:, :, :2].mean(axis=1) - corners.mean(axis=0)
    reference = np.arctan2(middle[:, 1], middle[:, 0])
    away = wrap_angle(bearings - reference[:, None])
    least, largest = away.min(axis=1), away.max(axis=1)
    around = (largest - least > 0.75 * np.pi) | _meets(corners, endpoints[:, :, :2])
    start = wrap_angle(np.where(around, -np.pi, reference + least))
    return np.column_stack([start, start + np.where(around, 2.0 * np.pi, largest - least)])


def _meets(corners: Array, segments: Array) -> NDArray[np.bool_]:
    """Whether plan segments (K, 2, 2) touch a convex cell, (K,)."""
    cell = shapely.Polygon(corners)
    return np.asarray(shapely.intersects(cell, shapely.linestrings(segments)))


def _starts(counts: list[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
