"""The picture of a calibration: where residuals are large, where corners were seen, how each view fits."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from maps.poses import Array
from runs.palette import COUNTS, FILTERED, REJECTED, TRUTH, VISION
from runs.plots import INK, STYLE
from vision.calibration import Calibration, rms_px
from vision.camera import Camera

#: Cells of the coverage map along the image's longer side.
_CELLS = 16
#: How long the longest arrows are drawn, as a share of the image's width.
_ARROW = 0.06
#: Labels of more bars than this would overlap.
_LABELS = 30

_COUNTS = LinearSegmentedColormap.from_list("counts", COUNTS)
_LENGTHS = LinearSegmentedColormap.from_list("lengths", (VISION, FILTERED, REJECTED))


@matplotlib.rc_context(STYLE)
def draw_calibration(calibration: Calibration) -> Figure:
    """Draw residual vectors over the image, the share of views that saw each part of it, and every view's rms."""
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplot_mosaic([["arrows", "coverage"], ["views", "views"]], height_ratios=(3.0, 2.0))
    _draw_residuals(panels["arrows"], calibration)
    _draw_coverage(panels["coverage"], calibration)
    _draw_views(panels["views"], calibration.residuals_px)
    return figure


def _draw_residuals(axes: Axes, calibration: Calibration) -> None:
    places = np.concatenate([corners.image_px for corners in calibration.used.values()])
    residuals = np.concatenate(list(calibration.residuals_px.values()))
    lengths = np.linalg.norm(residuals, axis=1)
    longest = float(lengths.max())
    scale = _magnification(longest, _ARROW * calibration.camera.width)
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / scale, "width": 0.004}
    arrows = axes.quiver(*places.T, *residuals.T, lengths, cmap=_LENGTHS, clim=(0.0, longest), **style)
    axes.figure.colorbar(arrows, ax=axes, label="residual, px", shrink=0.8)
    axes.set_title(f"residuals x {scale:g}: rms {calibration.rms_px:.3f} px", fontsize=10.0)
    _frame(axes, calibration.camera)


def _draw_coverage(axes: Axes, calibration: Calibration) -> None:
    camera = calibration.camera
    cell = max(camera.width, camera.height) / _CELLS
    columns, rows = int(np.ceil(camera.width / cell)), int(np.ceil(camera.height / cell))
    counts = np.zeros((rows, columns))
    for corners in calibration.used.values():
        cells = np.clip(((corners.image_px + 0.5) / cell).astype(int), 0, [columns - 1, rows - 1])
        x, y = np.unique(cells, axis=0).T
        counts[y, x] += 1.0
    extent = (-0.5, columns * cell - 0.5, rows * cell - 0.5, -0.5)
    drawn = axes.imshow(counts, cmap=_COUNTS, extent=extent, vmin=0.0)
    axes.figure.colorbar(drawn, ax=axes, label="views with corners here", shrink=0.8)
    for corners in calibration.used.values():
        axes.plot(*corners.image_px.T, ".", color=INK, markersize=1.5)
    axes.set_title(
        f"coverage: {len(calibration.used)} views, {len(calibration.rejected)} left out", fontsize=10.0
    )
    _frame(axes, camera)


def _draw_views(axes: Axes, residuals_px: Mapping[str, Array]) -> None:
    sizes = np.array([rms_px(part) for part in residuals_px.values()])
    middle = float(np.median(sizes))
    axes.bar(range(len(sizes)), sizes, color=[REJECTED if size > 2.0 * middle else VISION for size in sizes])
    axes.axhline(middle, color=TRUTH, linestyle="--", linewidth=1.0)
    axes.set_ylabel("rms, px")
    axes.set_title("each view, and the median", fontsize=10.0)
    axes.set_xlim(-0.6, len(sizes) - 0.4)
    step = len(sizes) // _LABELS + 1
    labels = [Path(name).name for name in residuals_px][::step]
    axes.set_xticks(range(0, len(sizes), step), labels, rotation=45.0, ha="right", fontsize=8.0)


def _frame(axes: Axes, camera: Camera) -> None:
    axes.set_xlim(-0.5, camera.width - 0.5)
    axes.set_ylim(camera.height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel("u, px")
    axes.set_ylabel("v, px")
    for spine in axes.spines.values():
        spine.set_visible(True)


def _magnification(longest_px: float, drawn_px: float) -> float:
    """Return 1, 2 or 5 times a power of ten that brings the longest to what is drawn, or just below."""
    ratio = drawn_px / max(longest_px, 1e-9)
    power = 10.0 ** np.floor(np.log10(ratio))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= ratio))
