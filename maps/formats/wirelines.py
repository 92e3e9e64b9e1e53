"""Straight edges on their way into a map: doubled and collinear ones become one, names become unique."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from maps.poses import Array

#: Nearer than this, two lines are one drawn twice; the edges of a door frame are 2 cm apart or more.
SAME_LINE_M = 5e-3
#: Shorter edges are of no use to a camera.
MIN_LENGTH_M = 0.05
#: Directions that no building's edge is perpendicular to: it tells the two ways along a line apart.
_ALONG = np.array([0.8131, 0.5077, 0.2847])

Point3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class WireLine:
    """An edge of the building: end points in metres, map frame; `sigma_m` None: as the whole map's."""

    name: str
    kind: str
    p0: Point3
    p1: Point3
    sigma_m: float | None = None

    def entry(self) -> dict[str, Any]:
        """Return the edge as map.yaml writes it."""
        entry = {"name": self.name, "kind": self.kind, "p0": self.p0, "p1": self.p1}
        return entry if self.sigma_m is None else {**entry, "sigma_m": self.sigma_m}


def tidy(lines: Sequence[WireLine]) -> list[WireLine]:
    """Return the lines without doubles and crumbs; pieces of one straight edge that touch are joined.

    A joined line has the name and kind of its longest piece, and the least certain sigma.
    """
    lines = [line for line in lines if _length(line) > 1e-6]
    if not lines:
        return []
    ends = np.array([[line.p0, line.p1] for line in lines], np.float64)
    joined = [
        line
        for members in _on_one_line(ends)
        for line in _joined([lines[row] for row in members], ends[members])
    ]
    return uniquely_named([line for line in joined if _length(line) >= MIN_LENGTH_M])


def uniquely_named(lines: Sequence[WireLine]) -> list[WireLine]:
    """Return the lines with a number behind every name that occurred before."""
    numbers: Counter[str] = Counter()
    taken: set[str] = set()
    unique = []
    for line in lines:
        numbers[line.name] += 1
        name = line.name
        while name in taken:
            name = f"{line.name}.{numbers[line.name]}"
            numbers[line.name] += name in taken
        taken.add(name)
        unique.append(replace(line, name=name))
    return unique


def _length(line: WireLine) -> float:
    return float(np.linalg.norm(np.subtract(line.p1, line.p0)))


def _on_one_line(ends: Array) -> list[list[int]]:
    """Group segments (N, 2, 3) by the infinite line they lie on; groups in order of their first member."""
    origin = ends.mean(axis=(0, 1))
    way = ends[:, 1] - ends[:, 0]
    way /= np.linalg.norm(way, axis=1)[:, None]
    way *= np.where(way @ _ALONG < 0.0, -1.0, 1.0)[:, None]
    middle = ends.mean(axis=1) - origin
    foot = middle - np.sum(middle * way, axis=1)[:, None] * way
    # Over the extent of the building a turn of this much moves an end by a line's tolerance.
    extent = max(float(np.ptp(ends, axis=(0, 1)).max()), 1.0)
    pairs = cKDTree(np.hstack([foot, way * extent])).query_pairs(SAME_LINE_M, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(ends), len(ends)))
    _, labels = connected_components(graph, directed=False)
    groups: dict[int, list[int]] = {}
    for row, label in enumerate(labels.tolist()):
        groups.setdefault(label, []).append(row)
    return list(groups.values())


def _joined(lines: list[WireLine], ends: Array) -> list[WireLine]:
    """Join those of some collinear lines, their ends (N, 2, 3), that touch or overlap."""
    if len(lines) == 1:
        return lines
    longest = max(range(len(lines)), key=lambda row: _length(lines[row]))
    start = ends[longest, 0]
    way = (ends[longest, 1] - start) / _length(lines[longest])
    reach = (ends - start) @ way
    order = np.argsort(reach.min(axis=1), kind="stable")
    runs: list[list[int]] = []
    reached = -np.inf
    for row in order.tolist():
        if reach[row].min() > reached + SAME_LINE_M:
            runs.append([])
        runs[-1].append(row)
        reached = max(reached, float(reach[row].max()))
    return [_spanning([lines[row] for row in run], ends[run]) for run in runs]


def _spanning(lines: list[WireLine], ends: Array) -> WireLine:
    longest = max(lines, key=_length)
    if len(lines) == 1:
        return longest
    start, stop = np.array(longest.p0), np.array(longest.p1)
    way = (stop - start) / np.linalg.norm(stop - start)
    reach = (ends - start) @ way
    sigmas = [line.sigma_m for line in lines if line.sigma_m is not None]
    return WireLine(
        longest.name,
        longest.kind,
        _point(start + reach.min() * way),
        _point(start + reach.max() * way),
        max(sigmas, default=None),
    )


def _point(values: Array) -> Point3:
    x, y, z = values.tolist()
    return x, y, z
