"""Where on a floor, and looking which way, a robot would know where it is: every place and every heading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from maps.poses import Array, Pose2, wrap_angle
from maps.rooms import Room
from maps.symmetries import symmetries_of
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.localizability import ExpectationConfig, ExpectedLook, expected_look
from vision.projection import Projector
from vision.twins import TwinFinder

#: A fix with a position known this well is good, or a fix at all [m].
GOOD_M, FIX_M = 0.05, 0.15

#: Called after every place with how many are done, and of how many.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """What C places (cells of the floor) times H headings promise.

    `places`: (C, 2) the cells' centres, metres, map frame. `headings`: (H,) radians. `segments`: (C, H) how many
    are in view. `sigma_m`: (C, H, 2) standard deviations of a fix along its worst and its best direction, and
    `sigma_phi`: (C, H) of its heading, infinite where unconstrained. `twins`: (C, H) number of look-alike poses,
    NaN where there is too little to compare. `twin_of`: (T, 2) place and heading that the look-alikes
    `twin_poses` (T, 3) belong to.
    """

    cell_m: float
    places: Array
    headings: Array
    segments: NDArray[np.int64]
    sigma_m: Array
    sigma_phi: Array
    twins: Array
    twin_of: NDArray[np.int64]
    twin_poses: Array

    @property
    def worst_sigma_m(self) -> Array:
        """The position's standard deviation along its worst direction, (C, H); infinite: unconstrained."""
        result: Array = self.sigma_m[..., 0]
        return result

    @property
    def mistakable(self) -> NDArray[np.bool_]:
        """Whether there are look-alikes, (C, H)."""
        return np.asarray(self.twins > 0.0)

    def share(self, better_than_m: float) -> float:
        """The share of places and headings whose fix would be better than this."""
        return float((self.worst_sigma_m < better_than_m).mean())


def cover(
    wire_map: WireMap,
    camera: Camera,
    places: Array,
    cell_m: float,
    headings: int,
    progress: Progress,
    config: ExpectationConfig | None = None,
) -> Coverage:
    """Look from every place (C, 2) in every heading, as the map and the camera foretell."""
    projector, config = Projector(camera, wire_map), config or ExpectationConfig()
    finder = TwinFinder(projector, symmetries_of(wire_map))
    rows = np.arange(len(wire_map))
    angles = wrap_angle(2.0 * np.pi * np.arange(headings) / headings)
    looks: list[list[ExpectedLook]] = []
    twins: list[list[list[Pose2] | None]] = []
    for done, (x, y) in enumerate(places.tolist(), start=1):
        poses = [Pose2(x, y, phi) for phi in angles.tolist()]
        looks.append([expected_look(projector, pose, rows, config) for pose in poses])
        twins.append([finder.twins(look) for look in looks[-1]])
        progress(done, len(places))
    return _gathered(places, cell_m, angles, looks, twins)


def _gathered(
    places: Array,
    cell_m: float,
    angles: Array,
    looks: list[list[ExpectedLook]],
    twins: list[list[list[Pose2] | None]],
) -> Coverage:
    """Stack looks and look-alikes by place and heading."""
    found = [
        (place, heading, pose)
        for place, row in enumerate(twins)
        for heading, poses in enumerate(row)
        for pose in poses or ()
    ]
    return Coverage(
        cell_m=cell_m,
        places=places,
        headings=angles,
        segments=np.array([[look.segments for look in row] for row in looks]),
        sigma_m=np.array([[[_or(s, np.inf) for s in look.sigma_m] for look in row] for row in looks]),
        sigma_phi=np.array([[_or(look.sigma_phi, np.inf) for look in row] for row in looks]),
        twins=np.array([[np.nan if poses is None else len(poses) for poses in row] for row in twins]),
        twin_of=np.array([entry[:2] for entry in found], np.int64).reshape(-1, 2),
        twin_poses=np.array([pose.as_array() for *_, pose in found]).reshape(-1, 3),
    )


def places_on(wire_map: WireMap, cell_m: float) -> Array:
    """Return the centres (C, 2) of the grid's cells that lie on the floor; the grid is the map frame's own."""
    x0, y0, x1, y1 = wire_map.floor.bounds
    x, y = (
        (np.arange(np.floor(low / cell_m), np.ceil(high / cell_m)) + 0.5) * cell_m
        for low, high in ((x0, x1), (y0, y1))
    )
    grid = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
    return np.asarray(grid[shapely.contains_xy(wire_map.floor, grid[:, 0], grid[:, 1])], np.float64)


def rooms_at(rooms: tuple[Room, ...], points: Array) -> NDArray[np.int64]:
    """Return the number of the room that each point (P, 2) lies in, -1 in passages, (P,)."""
    inside = np.array([shapely.contains_xy(room.outline, points[:, 0], points[:, 1]) for room in rooms])
    if not len(rooms):
        return np.full(len(points), -1)
    return np.where(inside.any(axis=0), inside.argmax(axis=0), -1)


def _or(value: float | None, other: float) -> float:
    return other if value is None else value
