"""Hypotheses over the whole floor: the heading first, then the position.

A building has few directions. Each image line that is not upright says under which headings it could run along one
of them, wherever the robot is: lines vote for headings (equation 2.a with c = 0), and only the headings with many
votes are tried over the floor, on a coarse grid with a wide kernel, then on a fine one around the best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from maps.poses import Array, wrap_angle
from maps.regions import ViewRegions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import level_normals
from vision.linefield import FieldConfig, field_scores, line_field
from vision.lines import ImageSegments
from vision.projection import Projector
from vision.viewpoints import Viewpoints, views_from

#: Bins of the vote on headings, over half a turn.
_BINS = 360
#: A segment whose direction is this near the vertical (cosine) has no say.
_VERTICAL_COSINE = 0.1


@dataclass(frozen=True, slots=True)
class GlobalConfig:
    """How the floor is searched."""

    #: Spacing of the coarse grid, the kernel that bridges it, and how near to a wall a robot stands.
    grid_m: float = 0.25
    kernel_px: float = 16.0
    clearance_m: float = 0.15
    #: Headings with fewer votes than this share of the most are not tried.
    votes_share: float = 0.5
    #: How far votes scatter.
    votes_rad: float = math.radians(1.5)
    #: Where votes are flat, one in so many bins (half a degree) is tried.
    between_bins: int = 6
    #: Coarse hypotheses that are looked at more closely, and steps to either side then.
    kept: int = 400
    fine_steps: int = 1
    #: Hypotheses that are refined.
    refined: int = 24


def floor_views(projector: Projector, regions: ViewRegions | None, config: GlobalConfig) -> Viewpoints:
    """Look around from each node of a grid over the free floor; once for a map and a camera's height."""
    wire_map = projector.wire_map
    free = shapely.buffer(wire_map.floor, -config.clearance_m)
    west, south, east, north = shapely.bounds(free)
    x, y = np.meshgrid(np.arange(west, east, config.grid_m), np.arange(south, north, config.grid_m))
    places = np.column_stack([x.ravel(), y.ravel()])
    places = places[shapely.contains_xy(free, places[:, 0], places[:, 1])]
    every = np.arange(len(wire_map))
    rows = [_seen_by(regions, place, every) for place in places]
    return views_from(projector, places, rows)


def floor_hypotheses(
    projector: Projector,
    segments: ImageSegments,
    viewpoints: Viewpoints,
    coarse: FieldConfig,
    config: GlobalConfig,
) -> tuple[Array, Array]:
    """Return poses (H, 3) anywhere on the floor, and their support (H,), after the coarse and the fine grid."""
    headings = likely_headings(projector.camera, segments, projector.wire_map, config)
    places = viewpoints.places
    view = np.repeat(np.arange(len(places)), len(headings))
    poses = np.column_stack([places[view], np.tile(headings, len(places))])
    wide = line_field(segments, projector, config.kernel_px)
    scores = field_scores(wide, projector, viewpoints, poses, view, coarse)
    best = np.argsort(-scores, kind="stable")[: config.kept]
    steps = np.arange(-config.fine_steps, config.fine_steps + 1)
    moves = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    third = config.grid_m / (2 * config.fine_steps + 1)
    fine = (poses[best, None] + moves * [third, third, config.votes_rad]).reshape(-1, 3)
    fine_view = np.repeat(view[best], len(moves))
    sharp = line_field(segments, projector, coarse.kernel_px)
    return fine, field_scores(sharp, projector, viewpoints, fine, fine_view, coarse)


def likely_headings(
    camera: Camera, segments: ImageSegments, wire_map: WireMap, config: GlobalConfig
) -> Array:
    """Return the robot's headings (K,) under which many image lines run along directions of the building.

    All headings in steps of the votes' scatter where no line has a say.
    """
    normals = level_normals(camera, segments)
    upright = np.abs(normals[:, 2]) < _VERTICAL_COSINE
    # A horizontal line's direction in the level frame: in its interpretation plane, and level.
    seen = np.arctan2(-normals[:, 0], normals[:, 1])
    lines = _histogram(
        seen, np.where(upright, 0.0, segments.lengths_px * np.hypot(normals[:, 0], normals[:, 1]))
    )
    way = wire_map.endpoints[:, 1] - wire_map.endpoints[:, 0]
    length = np.hypot(way[:, 0], way[:, 1])
    building = _histogram(np.arctan2(way[:, 1], way[:, 0]), length)
    sharp = gaussian_filter1d(building, config.votes_rad / math.pi * _BINS, mode="wrap")
    # Correlation: how many lines run along the building if the camera is turned by so much.
    votes = np.fft.irfft(np.fft.rfft(sharp) * np.conj(np.fft.rfft(lines)), _BINS)
    if votes.max() <= 0.0:
        return np.arange(-math.pi, math.pi, config.votes_rad)
    likely = votes >= config.votes_share * votes.max()
    peaks = likely & (votes >= np.roll(votes, 1)) & (votes > np.roll(votes, -1))
    # Between the peaks, too, where they hardly stand out.
    between = likely & (np.arange(_BINS) % config.between_bins == 0)
    turn = np.flatnonzero(peaks | between) * math.pi / _BINS - camera.mount.yaw_rad
    result: Array = wrap_angle(np.concatenate([turn, turn + math.pi]))
    return result


def _histogram(angles: Array, weights: Array) -> Array:
    """Weights by direction, over half a turn, (360,)."""
    bins = np.floor(angles % math.pi / math.pi * _BINS).astype(np.int64) % _BINS
    return np.asarray(np.bincount(bins, weights, minlength=_BINS), np.float64)


def _seen_by(regions: ViewRegions | None, place: Array, every: NDArray[np.int64]) -> NDArray[np.int64]:
    if regions is None:
        return every
    return regions.visible((place[0], place[1]), 0.0, 0.0, math.pi)
