"""How well an image supports a pose: a quick score for many poses, a log-likelihood ratio for a few.

Both look at all predicted segments, seen and not seen: four accidental pairs must not beat eight right
ones, and an edge that should be in the image but is not counts against the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from maps.wiremap import WireMap
from vision.association import Matches
from vision.camera import BASE_FROM_OPTICAL, Camera, rotation_x, rotation_y
from vision.constraints import Correspondences
from vision.lines import ImageSegments
from vision.pose import student_log_density
from vision.projection import Prediction

#: Poses scored at once, so that the arrays stay in the cache.
_CHUNK = 128


@dataclass(frozen=True, slots=True)
class EvidenceConfig:
    """What a seen and an unseen edge are worth."""

    #: Share of a visible edge that shows in an image, where the map has not learnt it.
    detection_rate: float = 0.4
    #: Image length that counts as one independent look at an edge; clutter is correlated along a line.
    unit_px: float = 30.0
    #: No edge is worth more looks than this, however long.
    max_units: float = 5.0
    #: No image is so empty that an accidental line is less likely than this.
    min_chance: float = 0.03


def quick_scores(
    camera: Camera,
    wire_map: WireMap,
    segments: ImageSegments,
    pairs: Correspondences,
    predicted: Prediction,
    poses: Array,
    kernel_px: float,
) -> Array:
    """Return for each pose (H, 3) the length in pixels of predicted segments that compatible lines cover.

    Each correspondence adds its line's length, weighted by a Gaussian kernel of its distance; a segment
    cannot be covered beyond its predicted length.
    """
    rows, segment = np.unique(pairs.rows, return_inverse=True)
    room = np.bincount(
        np.searchsorted(rows, predicted.rows[np.isin(predicted.rows, rows)]),
        predicted.lengths_px[np.isin(predicted.rows, rows)],
        minlength=len(rows),
    )
    members = np.zeros((len(pairs), len(rows)))
    members[np.arange(len(pairs)), segment] = segments.lengths_px[pairs.lines]
    focal = np.full((len(pairs), 2, 1), camera.focal_px)
    rays = np.concatenate([segments.ideal_px[pairs.lines], focal], axis=2)
    chunks = [
        _squared_distances(camera, wire_map, rows, segment, rays, poses[first : first + _CHUNK])
        for first in range(0, len(poses), _CHUNK)
    ]
    scores = [
        np.minimum(np.exp(-0.5 * square / kernel_px**2) @ members, room).sum(axis=1) for square in chunks
    ]
    return np.concatenate(scores) if scores else np.zeros(0)


def _squared_distances(
    camera: Camera,
    wire_map: WireMap,
    rows: NDArray[np.int64],
    segment: NDArray[np.int64],
    rays: Array,
    poses: Array,
) -> Array:
    """Mean squared distance in pixels of each pair's line ends from its segment, per pose: (H, C)."""
    mount = camera.mount
    fixed = rotation_y(mount.pitch_down_rad) @ rotation_x(mount.roll_rad) @ BASE_FROM_OPTICAL
    p, q = wire_map.endpoints[rows, 0], wire_map.endpoints[rows, 1]
    direction = (q - p) / np.linalg.norm(q - p, axis=1)[:, None]
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    centre = np.column_stack(
        [
            poses[:, 0] + cos * mount.x_m - sin * mount.y_m,
            poses[:, 1] + sin * mount.x_m + cos * mount.y_m,
            np.full(len(poses), mount.height_m),
        ]
    )
    normal = np.cross(p, direction)[None] - np.cross(centre[:, None], direction[None])
    cos, sin = np.cos(poses[:, 2] + mount.yaw_rad)[:, None], np.sin(poses[:, 2] + mount.yaw_rad)[:, None]
    level = np.stack(
        [
            cos * normal[..., 0] + sin * normal[..., 1],
            cos * normal[..., 1] - sin * normal[..., 0],
            normal[..., 2],
        ],
        axis=2,
    )
    optical = level @ fixed
    optical /= np.maximum(np.linalg.norm(optical[..., :2], axis=2), 1e-9)[..., None]
    gathered = optical[:, segment]
    first = np.einsum("hci,ci->hc", gathered, rays[:, 0])
    second = np.einsum("hci,ci->hc", gathered, rays[:, 1])
    result: Array = 0.5 * (first**2 + second**2)
    return result


def log_likelihood_ratio(
    wire_map: WireMap,
    predicted: Prediction,
    matches: Matches,
    segments: ImageSegments,
    camera: Camera,
    gate_px: float,
    sigma_px: Array,
    config: EvidenceConfig,
) -> float:
    """Return the evidence for a pose over chance, in nats.

    Each predicted piece is a few looks at an edge, of which the covered share are hits. A hit is worth how
    much likelier it is at the edge's detection rate than by accident, and how close it lies (`sigma_px`:
    (K,) expected distance of each match) against anywhere inside the gate.
    """
    if not len(predicted):
        return 0.0
    lengths = predicted.lengths_px
    covered = np.minimum(_covered_px(matches, len(predicted), lengths) / lengths, 1.0)
    units = np.minimum(lengths / config.unit_px, config.max_units)
    rate = wire_map.detection_rate[predicted.rows]
    rate = np.clip(np.where(np.isnan(rate), config.detection_rate, rate), 0.05, 0.95)
    chance = _chance_of_a_line(predicted, segments, camera, gate_px, config)
    hit, miss = np.log(rate / chance), np.log((1.0 - rate) / (1.0 - chance))
    total = float((units * (covered * hit + (1.0 - covered) * np.minimum(miss, 0.0))).sum())
    # Density of the distance under the estimator's noise against uniform over the gate.
    closeness = np.log(2.0 * gate_px) + student_log_density(matches.distances_px.mean(axis=1), sigma_px)
    claimed = np.minimum(np.diff(matches.spans_px, axis=1)[:, 0] / config.unit_px, 1.0)
    return total + float((claimed * closeness).sum())


def _covered_px(matches: Matches, pieces: int, lengths: Array) -> Array:
    """Pixels of each predicted piece with a matched line alongside, (P,); kept lines hardly overlap."""
    if not len(matches):
        return np.zeros(pieces)
    ends = np.clip(matches.spans_px, 0.0, lengths[matches.pieces, None])
    return np.asarray(np.bincount(matches.pieces, ends[:, 1] - ends[:, 0], minlength=pieces), np.float64)


def _chance_of_a_line(
    predicted: Prediction,
    segments: ImageSegments,
    camera: Camera,
    gate_px: float,
    config: EvidenceConfig,
) -> Array:
    """The share of the image where a line of the piece's slope would be found by accident, (P,)."""
    along = (predicted.ideal_px[:, 1] - predicted.ideal_px[:, 0]) / predicted.lengths_px[:, None]
    direction = (segments.ideal_px[:, 1] - segments.ideal_px[:, 0]) / segments.lengths_px[:, None]
    # A line passes the gate at both ends only if its slope is that close, too.
    slack = np.arctan2(2.0 * gate_px, np.maximum(segments.lengths_px, 1.0))
    parallel = np.abs(along @ direction.T) >= np.cos(slack)
    area = float(camera.width * camera.height)
    chance = (parallel * segments.lengths_px).sum(axis=1) * 2.0 * gate_px / area
    return np.asarray(np.clip(chance, config.min_chance, 0.5))
