"""Pairing predicted map segments with image lines at a given pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array
from vision.camera import Camera
from vision.lines import ImageSegments
from vision.projection import Prediction

#: Share of an image line that must lie alongside the predicted piece.
_MIN_OVERLAP = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """K image lines, each claimed by one predicted piece.

    `pieces`: (K,) rows of the prediction, `lines`: (K,) of the image segments. `spans_px`: (K, 2) where the
    line lies along the piece, pixels from the piece's start. `distances_px`: (K, 2) signed distances of the
    line's end points from the predicted line.
    """

    pieces: NDArray[np.int64]
    lines: NDArray[np.int64]
    spans_px: Array
    distances_px: Array

    def __len__(self) -> int:
        return len(self.pieces)

    @property
    def rms_px(self) -> Array:
        """Root mean square distance of each line from its piece, (K,)."""
        result: Array = np.sqrt((self.distances_px**2).mean(axis=1))
        return result


def associate(camera: Camera, predicted: Prediction, segments: ImageSegments, gate_px: float) -> Matches:
    """Pair each image line with the nearest predicted piece, within `gate_px` at both its ends.

    A piece may claim several lines (fragments), but not two that run beside each other: the nearer wins.
    """
    ends = segments.ideal_px
    distances = (
        np.einsum("pi,mei->pme", predicted.normals[:, :2], ends)
        + camera.focal_px * predicted.normals[:, 2, None, None]
    )
    start = predicted.ideal_px[:, 0]
    along = (predicted.ideal_px[:, 1] - start) / predicted.lengths_px[:, None]
    spans = np.einsum("pi,mei->pme", along, ends) - (start * along).sum(axis=1)[:, None, None]
    low, high = spans.min(axis=2), spans.max(axis=2)
    shared = np.minimum(high, predicted.lengths_px[:, None]) - np.maximum(low, 0.0)
    near = (np.abs(distances).max(axis=2) <= gate_px) & (
        shared >= np.maximum(_MIN_OVERLAP * segments.lengths_px, 5.0)
    )
    rms = np.where(near, np.sqrt((distances**2).mean(axis=2)), np.inf)
    if not rms.size:
        rms = np.full((1, len(segments)), np.inf)
    best = rms.argmin(axis=0)
    lines = np.flatnonzero(np.isfinite(rms[best, np.arange(len(segments))]))
    pieces = best[lines]
    order = np.argsort(rms[pieces, lines], kind="stable")
    pieces, lines = pieces[order], lines[order]
    spans_sorted = np.column_stack([low[pieces, lines], high[pieces, lines]])
    kept = _without_parallels(pieces, spans_sorted)
    pieces, lines = pieces[kept], lines[kept]
    return Matches(pieces, lines, spans_sorted[kept], distances[pieces, lines])


def _without_parallels(pieces: NDArray[np.int64], spans: Array) -> NDArray[np.int64]:
    """Rows to keep, best first: a line that overlaps an already kept line of its piece is dropped."""
    kept: list[int] = []
    taken: dict[int, list[tuple[float, float]]] = {}
    for row, (piece, (low, high)) in enumerate(zip(pieces.tolist(), spans.tolist(), strict=True)):
        others = taken.setdefault(piece, [])
        if all(min(high, b) - max(low, a) < 0.3 * min(high - low, b - a) for a, b in others):
            others.append((low, high))
            kept.append(row)
    return np.array(kept, np.int64)
