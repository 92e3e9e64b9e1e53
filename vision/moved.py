"""Edges that are not where the map has them: where their lines, seen from several places, meet instead.

A line off its predicted place says only how far off across the line of sight. An edge that has moved by d (3,)
explains the distances r of the lines in all images at once, r + pull . d = 0; a line that happens to run beside
the edge, or the other edge of a door's lining seen for want of this one, does so rarely in as many images.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from maps.wiremap import WireMap
from vision.mapsightings import Sightings

#: Distances agree within so many standard deviations, and within this share of a pixel more.
_SIGMAS, _SLACK_PX = 3.0, 1.0
_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class MovedConfig:
    """When an edge counts as moved."""

    #: Images that show it at one other place, at least, and their share of those that should show it.
    least_looks: int = 5
    least_share: float = 0.5
    #: Where the map has it, it shows in no more than this share.
    most_at_place: float = 0.2
    #: Nearer than this it is the map's uncertainty, or the edge's twin [m], and in the image [px].
    least_m: float = 0.03
    least_px: float = 6.0
    #: Farther away it is something else that runs the same way [m].
    most_m: float = 0.15
    #: Standard deviation of moves, across which nothing else is known [m].
    usual_m: float = 0.15
    #: Another edge of the map this near to where it would be is what was seen.
    other_m: float = 0.04


@dataclass(frozen=True, slots=True)
class Moved:
    """An edge shows at an offset [m, map frame] in `seen` of the `looks` images that should show it."""

    offset_m: tuple[float, float, float]
    looks: int
    seen: int


def moved_segments(wire_map: WireMap, sightings: Sightings, config: MovedConfig) -> dict[int, Moved]:
    """Return the segments that have moved, by row."""
    found = {}
    for row in np.unique(sightings.line_rows[~sightings.at_place]).tolist():
        looks = np.unique(sightings.frames[sightings.rows == row])
        lines = np.flatnonzero((sightings.line_rows == row) & np.isin(sightings.line_frames, looks))
        at_place = np.unique(sightings.line_frames[lines[sightings.at_place[lines]]])
        if len(looks) < config.least_looks or len(at_place) > config.most_at_place * len(looks):
            continue
        offset, agreeing = _best_offset(sightings, lines, config)
        seen = len(np.unique(sightings.line_frames[agreeing]))
        far_px = float(np.median(np.abs(sightings.off_px[agreeing]))) if len(agreeing) else 0.0
        if seen < max(config.least_looks, config.least_share * len(looks)) or far_px < config.least_px:
            continue
        if not config.least_m < np.linalg.norm(offset) < config.most_m or _is_another(
            wire_map, row, offset, config
        ):
            continue
        x, y, z = offset.tolist()
        found[row] = Moved((x, y, z), len(looks), seen)
    return found


def _best_offset(
    sightings: Sightings, lines: NDArray[np.int64], config: MovedConfig
) -> tuple[Array, NDArray[np.int64]]:
    """The offset (3,) at which lines agree in most images, and these lines."""
    pull, off = sightings.pull[lines], sightings.off_px[lines]
    allowed = _SIGMAS * sightings.sigma_px[lines] + _SLACK_PX
    frames = sightings.line_frames[lines]
    best, most = (np.zeros(3), lines[:0]), 0
    for start in range(len(lines)):
        # The least offset that explains one line; what it leaves open, the others tell.
        offset = -off[start] * pull[start] / (pull[start] @ pull[start])
        for _ in range(_ROUNDS):
            agree = np.abs(off + pull @ offset) <= allowed
            weighted = pull[agree] / sightings.sigma_px[lines[agree], None]
            information = weighted.T @ weighted + np.eye(3) / config.usual_m**2
            offset = -np.linalg.solve(
                information, weighted.T @ (off[agree] / sightings.sigma_px[lines[agree]])
            )
        agree = np.abs(off + pull @ offset) <= allowed
        if (count := len(np.unique(frames[agree]))) > most:
            best, most = (offset, lines[agree]), count
    return best


def _is_another(wire_map: WireMap, row: int, offset: Array, config: MovedConfig) -> bool:
    """Whether another edge of the map runs where this one would be."""
    ends = wire_map.endpoints
    way = ends[:, 1] - ends[:, 0]
    direction = way / np.linalg.norm(way, axis=1)[:, None]
    places = ends[row, 0] + np.linspace(0.1, 0.9, 5)[:, None] * way[row] + offset
    apart = places[None] - ends[:, None, 0]
    along = np.clip((apart * direction[:, None]).sum(axis=2), 0.0, np.linalg.norm(way, axis=1)[:, None])
    distance = np.linalg.norm(apart - along[..., None] * direction[:, None], axis=2)
    near = np.median(distance, axis=1) < config.other_m
    near &= np.abs(direction @ direction[row]) > 0.99
    near[row] = False
    return bool(near.any())
