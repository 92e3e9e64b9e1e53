"""What a recording shows of one image: the picture, its lines, and what the map says about them."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from maps.outcomes import Look
from maps.poses import Array
from runs.palette import AMBIGUOUS, IMAGE_LINE, ODOMETRY, REJECTED, SMOOTHED, VISION, rgb, rgba
from runs.rowbatch import RowBatch

CAMERA = "world/robot/camera"

#: An image line this far from its map edge, or farther, takes the last colour of the scale.
WORST_RESIDUAL_PX = 2.0

#: Lines that nothing claims, by the side that is brighter seen from first end to second: name, sign, colour.
SIDES = (
    ("brighter_right", 1.0, rgba(ODOMETRY, 0.55)),
    ("brighter_left", -1.0, rgba(VISION, 0.55)),
    ("either_side", 0.0, rgba(IMAGE_LINE, 0.7)),
)

_THIN, _WIDE = rr.Radius.ui_points(0.5), rr.Radius.ui_points(1.5)


def style_looks(recording: rr.RecordingStream) -> None:
    """Say once how lines are drawn: unclaimed ones below, then those not seen, matched ones on top."""
    lines = rr.LineStrips2D.from_fields
    for name, _, colour in SIDES:
        style = lines(colors=colour, radii=_THIN, draw_order=10.0)
        recording.log(f"{CAMERA}/lines/extracted/{name}", style, static=True)
    unseen = lines(colors=rgba(AMBIGUOUS, 0.8), radii=_THIN, show_labels=False, draw_order=20.0)
    recording.log(f"{CAMERA}/lines/predicted_unseen", unseen, static=True)
    matched = lines(radii=_WIDE, show_labels=False, draw_order=30.0)
    recording.log(f"{CAMERA}/lines/matched", matched, static=True)


def log_picture(recording: rr.RecordingStream, jpeg: bytes) -> None:
    """Store an image."""
    recording.log(f"{CAMERA}/image", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))


def log_look(batch: RowBatch, look: Look, names: tuple[str, ...]) -> None:
    """Draw what the matcher saw: lines, edges it expected and did not see, and pairs by residual."""
    _log_lines(batch, look)
    unseen = np.flatnonzero(~np.isin(look.predicted_map, look.matched_map))
    batch.add(
        f"{CAMERA}/lines/predicted_unseen",
        rr.LineStrips2D,
        strips=_rounded(look.predicted_px[unseen]),
        labels=[names[row] for row in look.predicted_map[unseen]],
    )
    pairs = zip(look.matched_map, look.residuals_px, strict=True)
    batch.add(
        f"{CAMERA}/lines/matched",
        rr.LineStrips2D,
        strips=_rounded(look.lines_px[look.matched_image]),
        colors=residual_colours(look.residuals_px),
        labels=[f"{names[row]}  {residual:.2f} px" for row, residual in pairs],
    )


def _log_lines(batch: RowBatch, look: Look) -> None:
    """Draw the lines that no edge claims, an entity for each polarity: hovering tells it."""
    free = np.setdiff1d(np.arange(len(look.lines_px)), look.matched_image)
    polarity = look.polarity if len(look.polarity) else np.zeros(len(look.lines_px))
    for name, sign, _ in SIDES:
        rows = free[np.sign(polarity[free]) == sign]
        batch.add(f"{CAMERA}/lines/extracted/{name}", rr.LineStrips2D, strips=_rounded(look.lines_px[rows]))


def residual_colours(residuals_px: Array) -> NDArray[np.uint8]:
    """Go from green, on the edge, to vermilion, `WORST_RESIDUAL_PX` or more away from it, (K, 3)."""
    shares = np.minimum(residuals_px / WORST_RESIDUAL_PX, 1.0)[:, None]
    near, far = np.array(rgb(SMOOTHED)), np.array(rgb(REJECTED))
    return np.asarray(np.rint(near + shares * (far - near)), np.uint8)


def _rounded(lines_px: Array) -> NDArray[np.float32]:
    """Return lines (N, 2, 2) to a quarter of a pixel: drawn the same, and packed smaller."""
    return np.asarray(np.rint(4.0 * lines_px) / 4.0, np.float32)
