"""Matched lines as measurements of everything at once: the pose, a swaying camera, its mount, and the map.

`vision.pose` estimates one image's pose with the camera and the map as nuisances; here the same distances,
with their derivatives by all that is shared between images, serve to estimate what is shared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.camera import Camera, CameraMount
from vision.linecost import STATES, linearise
from vision.measurements import LineMeasurements
from vision.projection import Projector
from vision.refinement import Candidate, RefinementConfig, Scene, refine_poses
from vision.weighing import map_deviations_px

#: The mount's parameters, in the order of the derivatives' columns.
MOUNT_PARAMETERS = ("x_m", "y_m", "height_m", "pitch_down_rad", "roll_rad", "yaw_rad")
#: Where in the derivatives' columns each part is.
FRAME, MOUNT, PLACE = slice(0, 5), slice(5, 11), slice(11, 13)
COLUMNS = 13


@dataclass(frozen=True, slots=True, eq=False)
class SeenLines:
    """K image lines, of one frame or several, that are matched with map segments.

    `frames`: (K,) the frame of each, rising. `rows`: (K,) of the wire map. `rays`: (K, 2, 3) two points of
    each line, as in `LineObservations`.
    `sigma_middle_px`, `sigma_slope_px`: (K,) deviations of the half sum and the half difference of the two points'
    distances: the image's noise, and in the slope the doubt about the segment's direction, but not that about its
    place, which is estimated.
    """

    frames: NDArray[np.int64]
    rows: NDArray[np.int64]
    rays: Array
    sigma_middle_px: Array
    sigma_slope_px: Array

    @classmethod
    def joined(cls, parts: Sequence[SeenLines]) -> SeenLines:
        """Put the lines of several frames together, in their order."""
        return cls(
            np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
            np.concatenate([part.rows for part in parts]),
            np.concatenate([part.rays for part in parts]),
            np.concatenate([part.sigma_middle_px for part in parts]),
            np.concatenate([part.sigma_slope_px for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, slots=True, eq=False)
class MapLines:
    """The map's N segments as lines: `moments`, `directions` (N, 3); `across`: (N, 2, 3) two unit vectors, at right
    angles to the segment and to each other, along which its place may be wrong.
    """

    moments: Array
    directions: Array
    across: Array

    @classmethod
    def of(cls, wire_map: WireMap) -> MapLines:
        """Take them from a map."""
        way = wire_map.endpoints[:, 1] - wire_map.endpoints[:, 0]
        directions = way / np.linalg.norm(way, axis=1)[:, None]
        moments = np.cross(wire_map.endpoints[:, 0], directions)
        # The axis that a segment is least along gives a well-conditioned first vector.
        axes = np.eye(3)[np.abs(directions).argmin(axis=1)]
        first = np.cross(directions, axes)
        first /= np.linalg.norm(first, axis=1)[:, None]
        return cls(moments, directions, np.stack([first, np.cross(directions, first)], axis=1))


def with_mount(camera: Camera, values: Array) -> Camera:
    """Return a camera with another mount: (6,) as `MOUNT_PARAMETERS` says; its deviations stay."""
    named = {name: float(value) for name, value in zip(MOUNT_PARAMETERS, values, strict=True)}
    return replace(camera, mount=replace(camera.mount, **named))


def mount_values(mount: CameraMount) -> Array:
    """Return a mount's parameters (6,), in the order of `MOUNT_PARAMETERS`."""
    return np.array([getattr(mount, name) for name in MOUNT_PARAMETERS])


def line_residuals(
    camera: Camera, frames: Array, seen: SeenLines, segments: MapLines, shifts: Array
) -> tuple[Array, Array]:
    """Return the whitened residuals (K, 2) of all frames' lines, and their derivatives (K, 2, 13).

    `frames`: (F, 5) of x, y, phi, and what pitch and roll are off in this frame alone. `shifts`: (N, 2) of the
    segments' places along their two `across` vectors, [m].
    Residuals: half sum and half difference of the two points' distances from the predicted line, over their
    deviations. Columns: the frame's five; `MOUNT_PARAMETERS`; the place of the line's own segment.
    """
    directions, across = segments.directions[seen.rows], segments.across[seen.rows]
    shift = (shifts[seen.rows][:, :, None] * across).sum(axis=1)
    moments = segments.moments[seen.rows] + np.cross(shift, directions)
    distances, by_state = np.empty((len(seen), 2)), np.empty((len(seen), 2, STATES))
    mount = mount_values(camera.mount)
    bounds = np.searchsorted(seen.frames, np.arange(len(frames) + 1))
    for frame, low, high in zip(frames, bounds[:-1], bounds[1:], strict=True):
        state = np.zeros(STATES)
        state[:3], state[4:6] = frame[:3], frame[3:]
        these = slice(low, high)
        linearise(
            state,
            mount,
            moments[these],
            directions[these],
            seen.rays[these],
            distances[these],
            by_state[these],
        )
    jacobian = np.empty((len(seen), 2, COLUMNS))
    jacobian[:, :, :3], jacobian[:, :, 3:5] = by_state[:, :, :3], by_state[:, :, 4:6]
    heading = frames[seen.frames, 2, None]
    cos, sin = np.cos(heading), np.sin(heading)
    by_x, by_y = by_state[:, :, 0], by_state[:, :, 1]
    jacobian[:, :, 5], jacobian[:, :, 6] = cos * by_x + sin * by_y, cos * by_y - sin * by_x
    jacobian[:, :, 7:11] = by_state[:, :, 3:7]
    # A segment that moves one way looks like a camera that moves the other.
    jacobian[:, :, PLACE] = -(by_state[:, :, [0, 1, 3]] @ across.transpose(0, 2, 1))
    return _halves(distances, seen), _halves(jacobian, seen)


def look_again(
    projector: Projector, lines: LineMeasurements, pose: Pose2, config: RefinementConfig
) -> tuple[Candidate, SeenLines] | None:
    """Match an image's lines with the map once more, from a pose near the true one; None where too few match."""
    scene = Scene(projector, np.arange(len(projector.wire_map)), lines)
    found = refine_poses(scene, [pose], 0, config)
    if not found:
        return None
    best = found[0]
    predicted, matches = best.predicted, best.matches
    share = lines.lengths_px[matches.lines] / predicted.lengths_px[matches.pieces]
    map_slope_px = map_deviations_px(projector, predicted)[matches.pieces] * np.minimum(share, 1.0)
    seen = SeenLines(
        frames=np.zeros(len(matches), np.int64),
        rows=predicted.rows[matches.pieces],
        rays=lines.rays[matches.lines],
        sigma_middle_px=lines.sigma_middle_px[matches.lines],
        sigma_slope_px=np.hypot(lines.sigma_slope_px[matches.lines], map_slope_px),
    )
    return best, seen


def _halves(ends: Array, seen: SeenLines) -> Array:
    """Turn values at two points (K, 2, ...) into half sums and half differences over their deviations."""
    sigmas = np.stack([seen.sigma_middle_px, seen.sigma_slope_px], axis=1)
    halves = 0.5 * np.stack([ends[:, 0] + ends[:, 1], ends[:, 1] - ends[:, 0]], axis=1)
    result: Array = halves / sigmas.reshape(sigmas.shape + (1,) * (halves.ndim - 2))
    return result
