"""Visibility by brute force: points along every segment, and a sight line to each."""

from __future__ import annotations

import numpy as np
import shapely

from maps.wiremap import WireMap

STEP_M = 0.05
#: Edges on walls are looked at a little in front of them.
MARGIN_M = 0.04
GRAZE_M = 1e-3


def seen_by_sight_lines(wire_map: WireMap, points: np.ndarray, height_m: float) -> np.ndarray:
    """Whether each segment is seen from each point (K, 2) at a height: (K, N) bool."""
    samples, owner = _samples(wire_map)
    inner = wire_map.floor.buffer(-MARGIN_M)
    nearest = shapely.shortest_line(inner, shapely.points(samples[:, :2]))
    targets = shapely.get_coordinates(shapely.get_point(nearest, 0))
    places, place = np.unique(np.round(targets, 6), axis=0, return_inverse=True)
    tall = _tall_floor(wire_map).buffer(GRAZE_M, join_style="mitre")
    shapely.prepare(tall)
    result = np.zeros((len(points), len(wire_map)), bool)
    for number, (x, y) in enumerate(points):
        starts = np.broadcast_to([x, y], places.shape)
        clear = shapely.covers(tall, shapely.linestrings(np.stack([starts, places], axis=1)))[place.ravel()]
        clear &= ~_hidden(wire_map, np.array([x, y, height_m]), samples, targets)
        result[number] = np.bincount(owner[clear], minlength=len(wire_map)) > 0
    return result


def _samples(wire_map: WireMap) -> tuple[np.ndarray, np.ndarray]:
    ends = wire_map.endpoints
    counts = np.maximum(3, (np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / STEP_M).astype(int))
    owner = np.repeat(np.arange(len(ends)), counts)
    along = np.concatenate([(np.arange(count) + 0.5) / count for count in counts])[:, None]
    return ends[owner, 0] + along * (ends[owner, 1] - ends[owner, 0]), owner


def _tall_floor(wire_map: WireMap) -> shapely.Geometry:
    """The floor with its low obstacles filled in: one can look over them."""
    low = wire_map.walls[np.isfinite(wire_map.wall_tops_m)]
    boxes = shapely.polygonize(shapely.linestrings(low)) if len(low) else shapely.GeometryCollection()
    return shapely.union(wire_map.floor, shapely.union_all(shapely.get_parts(boxes)))


def _hidden(wire_map: WireMap, eye: np.ndarray, samples: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Whether a lintel or a low obstacle's side hides each sample."""
    hidden = np.zeros(len(samples), bool)
    low = np.isfinite(wire_map.wall_tops_m)
    edges = np.concatenate([wire_map.lintels, wire_map.walls[low]])
    limits = np.concatenate([wire_map.lintel_bottoms_m + 0.01, wire_map.wall_tops_m[low] - 0.01])
    for (a, b), limit, hanging in zip(
        edges, limits, np.arange(len(edges)) < len(wire_map.lintels), strict=True
    ):
        way, edge, offset = targets - eye[:2], b - a, a - eye[:2]
        turn = way[:, 0] * -edge[1] + way[:, 1] * edge[0]
        turn[np.abs(turn) < 1e-12] = 1e-12
        along = (offset[0] * -edge[1] + offset[1] * edge[0]) / turn
        across = (way[:, 0] * offset[1] - way[:, 1] * offset[0]) / turn
        height = eye[2] + along * (samples[:, 2] - eye[2])
        beyond = height > limit if hanging else height < limit
        hidden |= (along > 0.0) & (along < 0.98) & (across > 0.0) & (across < 1.0) & beyond
    return hidden
