"""Straight edges drawn with known truth, and how far the segments found in such pictures are off."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from maps.poses import Array
from vision.images import GreyImage

WIDTH, HEIGHT = 640, 480
BLUR_PX, NOISE = 0.6, 3.0
#: How far the bright side reaches away from the edge, and samples per pixel in each direction.
_DEEP_PX, _FINE = 60.0, 8


@dataclass(frozen=True, slots=True, eq=False)
class DrawnEdge:
    """An edge through `middle` (2,) along the unit vector `along` (2,), brighter on its right-hand side."""

    image: GreyImage
    middle: Array
    along: Array
    length_px: float
    contrast: float

    @property
    def right(self) -> Array:
        return self.along[::-1] * [-1.0, 1.0]


@dataclass(frozen=True, slots=True)
class Miss:
    """How the longest segment on an edge differs from it: `row` of the segment, offset of its middle to the
    right, angle, and its polarity, seen along the edge."""

    row: int
    offset_px: float
    angle_rad: float
    sense: float


def draw_edge(rng: np.random.Generator) -> DrawnEdge:
    """Draw one side of a bright rectangle: any angle, 30 to 400 px, 20 to 120 grey levels."""
    length, contrast = rng.uniform(30.0, 400.0), rng.uniform(20.0, 120.0)
    angle, middle = rng.uniform(-np.pi, np.pi), np.array([320.0, 240.0]) + rng.uniform(-15.0, 15.0, 2)
    along = np.array([np.cos(angle), np.sin(angle)])
    right = np.array([-along[1], along[0]])
    ends = middle + 0.5 * length * along * [[-1.0], [1.0]]
    corners = np.concatenate([ends, ends + _DEEP_PX * right])
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, [WIDTH, HEIGHT])
    u, v = ((np.arange((b - a) * _FINE) + 0.5) / _FINE - 0.5 + a for a, b in zip(low, high, strict=True))
    inside = np.abs((u - middle[0]) * along[0] + ((v - middle[1]) * along[1])[:, None]) < 0.5 * length
    depth = (u - middle[0]) * right[0] + ((v - middle[1]) * right[1])[:, None]
    bright = (inside & (depth > 0.0) & (depth < _DEEP_PX)).astype(np.float32)
    share = np.zeros((HEIGHT, WIDTH), np.float32)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    share[low[1] : high[1], low[0] : high[0]] = cv2.resize(bright, size, interpolation=cv2.INTER_AREA)
    levels = cv2.GaussianBlur(rng.uniform(20.0, 235.0 - contrast) + contrast * share, (0, 0), BLUR_PX)
    noisy = levels + rng.normal(0.0, NOISE, levels.shape)
    image: GreyImage = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return DrawnEdge(image, middle, along, length, contrast)


def miss_of(edge: DrawnEdge, raw: Array) -> Miss | None:
    """Compare the longest of the segments (M, 2, 2) that lie on an edge with it; None where none does."""
    way = raw[:, 1] - raw[:, 0]
    length = np.linalg.norm(way, axis=1)
    away = raw.mean(axis=1) - edge.middle
    offset, cosine = away @ edge.right, way @ edge.along / length
    on = (np.abs(offset) < 2.0) & (np.abs(cosine) > 0.99) & (np.abs(away @ edge.along) < 0.5 * edge.length_px)
    if not on.any():
        return None
    row = int(np.where(on, length, 0.0).argmax())
    sense = float(np.sign(cosine[row]))
    angle = float(np.arcsin(sense * (way[row] @ edge.right) / length[row]))
    return Miss(row, float(offset[row]), angle, sense)


def covered_px(
    labels: Array, found: Array, aside_px: float = 2.0, turn_deg: float = 5.0
) -> tuple[float, float]:
    """Return the length of labelled segments (L, 2, 2), and of that part with a found one (M, 2, 2) beside it."""
    way = found[:, 1] - found[:, 0]
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    way = way / length[:, None]
    total = hit = 0.0
    for start, end in labels:
        size = float(np.linalg.norm(end - start))
        count = max(int(np.ceil(size)), 1)
        places = start + (np.arange(count)[:, None] + 0.5) / count * (end - start)
        parallel = np.abs(way @ (end - start)) > size * np.cos(np.radians(turn_deg))
        off = places[:, None] - found[parallel, 0]
        along = (off * way[parallel]).sum(axis=2)
        across = np.abs(off[..., 0] * way[parallel, 1] - off[..., 1] * way[parallel, 0])
        beside = (across <= aside_px) & (along >= 0.0) & (along <= length[parallel])
        total, hit = total + size, hit + size * float(beside.any(axis=1).mean())
    return total, hit
