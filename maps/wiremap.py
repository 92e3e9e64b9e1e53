"""The wire-frame map: 3D segments, the navigable floor, lintels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon

from maps.poses import Array


@dataclass(frozen=True, slots=True, eq=False)
class WireMap:
    """A building as its users measured it; see `maps.mapfile` for the file.

    `endpoints`: (N, 2, 3) metres, map frame, read-only. `names`, `kinds`: N strings each.
    `sigma_m`: (N,) how well each edge is known. `detection_rate`: (N,) share of the times an edge is
    seen where it should be, NaN where unknown. `polarity`: (N,) +1 brighter on the right when looking
    along p0 -> p1 in the image, -1 darker, 0 unknown.
    `floor`: navigable space; what lies outside it is solid.
    `walls`: (W, 2, 2) the floor's boundary edges, plan view, the floor on their left.
    `wall_tops_m`: (W,) infinite, or the top of an obstacle that one can look over.
    `lintels`: (L, 2, 2) plan view, and `lintel_bottoms_m`: (L,), solid from there up.
    """

    endpoints: Array
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    sigma_m: Array
    detection_rate: Array
    polarity: NDArray[np.int8]
    floor: MultiPolygon
    walls: Array
    wall_tops_m: Array
    lintels: Array
    lintel_bottoms_m: Array

    def __len__(self) -> int:
        return len(self.endpoints)
