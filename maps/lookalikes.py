"""Rooms that a lost robot may mistake for each other: the same edges, after quarter turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from maps.poses import Array
from maps.rooms import Room
from maps.wiremap import WireMap

#: Rooms look alike where this share of their edges, by length, agree within this distance.
ALIKE_SHARE, ALIKE_M = 0.9, 0.1
#: Rooms whose areas differ by more than this share are not compared.
_AREA_SHARE = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class LookAlike:
    """Two rooms, or one room and itself, that agree after a turn; `share` of their edges by length."""

    rooms: tuple[Room, Room]
    turn_deg: int
    share: float


def look_alikes(rooms: Sequence[Room], wire_map: WireMap) -> list[LookAlike]:
    """Return the rooms whose edges are congruent after quarter turns: a lost robot may mistake them.

    Each room is compared with itself, and with the first of each sort of rooms before it.
    """
    found, firsts = [], list[tuple[Room, Array]]()
    for room in (room for room in rooms if len(room.rows)):
        edges = _about_centre(room, wire_map)
        itself = _best_turn(edges, edges, range(1, 4))
        if itself is not None:
            found.append(LookAlike((room, room), *itself))
        for first, first_edges in firsts:
            if abs(first.outline.area / room.outline.area - 1.0) < _AREA_SHARE:
                turn = _best_turn(first_edges, edges, range(4))
                if turn is not None:
                    found.append(LookAlike((first, room), *turn))
                    break
        else:
            firsts.append((room, edges))
    return found


def _best_turn(a: Array, b: Array, quarters: range) -> tuple[int, float] | None:
    """Return the turn [deg] of `a` that agrees best with `b`, and the share; None where none is enough."""
    shares = [_agreement(_turned(a, count), b) for count in quarters]
    best = int(np.argmax(shares))
    return (90 * quarters[best], shares[best]) if shares[best] >= ALIKE_SHARE else None


def _about_centre(room: Room, wire_map: WireMap) -> Array:
    centre = room.outline.centroid
    edges: Array = wire_map.endpoints[room.rows] - [centre.x, centre.y, 0.0]
    return edges


def _turned(edges: Array, quarters: int) -> Array:
    """Turn segments (N, 2, 3) about the z axis by quarters, counter-clockwise and exactly."""
    x, y, z = np.moveaxis(edges, -1, 0)
    for _ in range(quarters):
        x, y = -y, x
    return np.stack([x, y, z], axis=-1)


def _agreement(a: Array, b: Array) -> float:
    """Return the smaller of the shares of each set's length that has its like in the other set."""
    return min(_covered(a, b), _covered(b, a))


def _covered(edges: Array, by: Array) -> float:
    both_ways = np.concatenate([by, by[:, ::-1]]).reshape(-1, 6)
    distances, _ = cKDTree(both_ways).query(edges.reshape(-1, 6))
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    # The distance is over both ends together.
    return float(lengths[distances <= np.sqrt(2.0) * ALIKE_M].sum() / lengths.sum())
