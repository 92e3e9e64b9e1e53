"""The wire-frame map as the rest of the program sees it."""

from __future__ import annotations

from dataclasses import dataclass

from shapely.geometry import MultiPolygon

from maps.poses import Array


@dataclass(frozen=True, slots=True, eq=False)
class WireMap:
    """A building as it was measured; `maps.mapfile` reads it from map.yaml. Arrays are read-only.

    `endpoints`: (N, 2, 3) metres, map frame. `names`, `kinds`: N strings each.
    `sigma_m`: (N,) how well each edge is known. `detection_rate`: (N,) share of the times an edge is
    seen where it should be, NaN where unknown. `polarity`: (N,) +1 brighter on the right-hand side when
    looking along p0 -> p1 in the image, -1 darker, 0 unknown.
    `floor`: navigable space; what lies outside it is solid.
    `sight_endpoints`: (N, 2, 3) the end points moved a little into the floor, so that an edge on a wall,
    or in a window's recess, is not hidden by its own wall.
    `walls`: (W, 2, 2) the floor's boundary edges in plan, the floor on their left; `wall_tops_m`: (W,)
    infinite, or the top of an obstacle that one can look over.
    `lintels`: (L, 2, 2) plan, vertical planes solid from `lintel_bottoms_m` (L,) up.
    """

    endpoints: Array
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    sigma_m: Array
    detection_rate: Array
    polarity: Array
    floor: MultiPolygon
    sight_endpoints: Array
    walls: Array
    wall_tops_m: Array
    lintels: Array
    lintel_bottoms_m: Array

    def __len__(self) -> int:
        return len(self.endpoints)
