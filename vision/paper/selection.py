"""Which model segments can matter: those of the regions that the window touches (sections 2 and 3.2).

One region, several or all: incremental and global localization are the same process.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import SearchWindow
from maps.partition import PartitionConfig
from maps.poses import Array
from maps.regioncache import cached_regions
from maps.regions import ViewRegions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import camera_centre, level_from_optical, segment_lines, upright


@dataclass(frozen=True, slots=True, eq=False)
class ViewedDisc:
    """Where the camera may be: `centre` (2,) and `radius_m`, map frame; `psi` its heading, within `dpsi`."""

    centre: Array
    radius_m: float
    psi: float
    dpsi: float


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """L of section 3.2, divided into L_v and L_h.

    `regions`: numbers of the regions touched. `rows`: (m,) all selected map segments; `vertical`: (mv,) and
    `other`: (mh,) its two parts, rows of the wire map.
    """

    regions: NDArray[np.int64]
    rows: NDArray[np.int64]
    vertical: NDArray[np.int64]
    other: NDArray[np.int64]


def exact_regions(wire_map: WireMap, height_m: float) -> ViewRegions:
    """Return a map's regions cut along every visibility event, as the paper has them, from the cache.

    In large buildings they are many; any `ViewRegions` will do, at the price of more segments to try.
    """
    return cached_regions(wire_map, (height_m, height_m), PartitionConfig(surplus=0.0))


def viewed_disc(camera: Camera, window: SearchWindow) -> ViewedDisc:
    """Return the window as the camera's, which need not sit in the robot's middle."""
    lever = math.hypot(camera.mount.x_m, camera.mount.y_m)
    swing = 2.0 * lever * math.sin(0.5 * min(window.dphi_rad, math.pi))
    return ViewedDisc(
        camera_centre(camera, window.centre),
        window.dt_m + swing,
        window.centre.phi + camera.mount.yaw_rad,
        min(window.dphi_rad, math.pi) + camera.mount.std_yaw_rad,
    )


def half_field_of_view(camera: Camera) -> float:
    """Return the largest bearing to either side under which the camera sees anything, radians."""
    u, v = np.linspace(0, camera.width - 1.0, 33), np.linspace(0, camera.height - 1.0, 33)
    border = [np.column_stack([u, np.full(33, edge)]) for edge in (0.0, camera.height - 1.0)]
    border += [np.column_stack([np.full(33, edge), v]) for edge in (0.0, camera.width - 1.0)]
    normalised = camera.undistort(np.concatenate(border))
    rays = np.column_stack([normalised, np.ones(len(normalised))]) @ level_from_optical(camera).T
    return float(np.abs(np.arctan2(rays[:, 1], rays[:, 0])).max())


def select_segments(
    camera: Camera, wire_map: WireMap, regions: ViewRegions, window: SearchWindow
) -> Selection:
    """Return the segments that some touched region sees, in the window's headings and half the view more."""
    disc = viewed_disc(camera, window)
    spread = disc.dpsi + half_field_of_view(camera)
    place = (float(disc.centre[0]), float(disc.centre[1]))
    rows = regions.visible(place, disc.radius_m, disc.psi, spread)
    vertical = upright(segment_lines(wire_map, rows)[0])
    return Selection(regions.touching(place, disc.radius_m), rows, rows[vertical], rows[~vertical])
