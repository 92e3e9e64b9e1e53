"""Where a robot fits, and ways through it: a road map over the floor less the robot's radius."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from maps.poses import Array, frozen

#: Nodes lie this near to each other, farther where a large floor would get more than so many.
_SPACING_M, _MOST_NODES = 0.8, 800
#: Each node is joined with so many of its nearest, where the straight way is free.
_NEIGHBOURS = 16
#: Ways keep this off the border of the free floor where they can.
_COMFORT_M = 0.1


class NoRoomError(ValueError):
    """The robot does not fit anywhere on the floor."""


@dataclass(frozen=True, slots=True, eq=False)
class FreeFloor:
    """Places for the robot's centre, `area`, and a graph over `nodes` (N, 2) of straight ways inside it.

    Everything in `area` can be reached from everywhere else in it by way of the nodes.
    """

    area: BaseGeometry
    nodes: Array
    graph: csr_array

    @classmethod
    def of(cls, floor: MultiPolygon, radius_m: float, passages: Array | None = None) -> FreeFloor:
        """Build it for a robot of that radius; NoRoomError where it does not fit.

        `passages`: (L, 2) points that ways should be able to go through, as the middles of lintels.
        """
        free = floor.buffer(-radius_m, join_style="mitre")
        if free.is_empty:
            raise NoRoomError(f"no room for a robot of {2.0 * radius_m:g} m across")
        shapely.prepare(free)
        nodes = _nodes(free, np.zeros((0, 2)) if passages is None else passages)
        graph = _joined(free, nodes)
        _, part = connected_components(graph, directed=False)
        largest = np.flatnonzero(part == np.bincount(part).argmax())
        piece = max(
            shapely.get_parts(free), key=lambda one: shapely.covers(one, shapely.points(nodes[largest])).sum()
        )
        shapely.prepare(piece)
        return cls(piece, frozen(nodes[largest]), csr_array(graph[largest][:, largest]))

    def place(self, rng: np.random.Generator) -> Array:
        """Draw a place (2,), every spot as likely as any other."""
        low_x, low_y, high_x, high_y = self.area.bounds
        while True:
            points = rng.uniform([low_x, low_y], [high_x, high_y], (64, 2))
            inside = points[shapely.contains_xy(self.area, points[:, 0], points[:, 1])]
            for point in inside:
                if len(self._seen(point)):
                    return np.asarray(point)

    def sees(self, starts: Array, ends: Array) -> NDArray[np.bool_]:
        """Whether the straight ways (K, 2) to (K, 2) are free, (K,)."""
        ways = shapely.linestrings(np.stack([starts, ends], axis=1))
        return np.asarray(shapely.covers(self.area, ways), np.bool_)

    def covers(self, points: Array) -> bool:
        """Whether the convex hull of points (K, 2) is free."""
        return bool(shapely.covers(self.area, shapely.MultiPoint(points).convex_hull))

    def route(self, start: Array, goal: Array) -> Array:
        """Return a short polyline (P, 2) from one place to another, corners cut where that is free."""
        if self.sees(start[None], goal[None])[0]:
            return np.array([start, goal])
        from_start, to_goal = self._seen(start), self._seen(goal)
        lengths, previous = dijkstra(self.graph, indices=from_start, return_predecessors=True)
        total = (
            np.hypot(*(self.nodes[from_start] - start).T)[:, None]
            + lengths[:, to_goal]
            + np.hypot(*(self.nodes[to_goal] - goal).T)
        )
        row, column = np.unravel_index(total.argmin(), total.shape)
        chain = [int(to_goal[column])]
        while chain[-1] != from_start[row]:
            chain.append(int(previous[row, chain[-1]]))
        return self._shortened(np.concatenate([[start], self.nodes[chain[::-1]], [goal]]))

    def _shortened(self, points: Array) -> Array:
        kept = [0]
        while kept[-1] < len(points) - 1:
            here = kept[-1]
            later = np.arange(here + 1, len(points))
            free = self.sees(np.broadcast_to(points[here], (len(later), 2)), points[later])
            kept.append(int(later[free].max()) if free.any() else here + 1)
        result: Array = points[kept]
        return result

    def _seen(self, point: Array) -> NDArray[np.int64]:
        """Return the nearest nodes that the point sees."""
        nearest = np.argsort(np.hypot(*(self.nodes - point).T))[: 2 * _NEIGHBOURS]
        free = self.sees(np.broadcast_to(point, (len(nearest), 2)), self.nodes[nearest])
        return nearest[free][:4]


def open_floor(side_m: float = 10.0) -> FreeFloor:
    """Return an empty square around the origin."""
    half = 0.5 * side_m
    return FreeFloor.of(
        MultiPolygon([Polygon([(-half, -half), (half, -half), (half, half), (-half, half)])]), 0.0
    )


def _nodes(free: BaseGeometry, passages: Array) -> Array:
    """Return a triangular grid over the free floor, its corners, and the passages in it."""
    spacing = max(_SPACING_M, math.sqrt(free.area / _MOST_NODES))
    low_x, low_y, high_x, high_y = free.bounds
    rows = np.arange(low_y + 0.37 * spacing, high_y, spacing * math.sqrt(0.75))
    columns = np.arange(low_x + 0.31 * spacing, high_x + spacing, spacing)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    grid[1::2, :, 0] -= 0.5 * spacing
    inner = free.buffer(-_COMFORT_M)
    corners = shapely.get_coordinates(free)
    if not inner.is_empty:
        # A narrow door has no inner floor; its corners stay where they are.
        moved = shapely.get_coordinates(
            shapely.get_point(shapely.shortest_line(inner, shapely.points(corners)), 0)
        )
        near = np.hypot(*(moved - corners).T) < 3.0 * _COMFORT_M
        corners = np.where(near[:, None], moved, corners)
    points = np.concatenate([grid.reshape(-1, 2), corners, passages])
    return np.unique(points[shapely.intersects_xy(free, points[:, 0], points[:, 1])].round(6), axis=0)


def _joined(free: BaseGeometry, nodes: Array) -> csr_array:
    """Return the lengths of the free straight ways between near nodes, (N, N)."""
    distances = np.hypot(*(nodes[:, None] - nodes[None]).transpose(2, 0, 1))
    nearest = np.argsort(distances, axis=1)[:, 1 : _NEIGHBOURS + 1]
    start, end = np.repeat(np.arange(len(nodes)), nearest.shape[1]), nearest.ravel()
    free_ways = shapely.covers(free, shapely.linestrings(nodes[np.stack([start, end], axis=1)]))
    start, end = start[free_ways], end[free_ways]
    graph = csr_array((distances[start, end], (start, end)), shape=(len(nodes), len(nodes)))
    return graph.maximum(graph.T).tocsr()
