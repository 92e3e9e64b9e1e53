"""What a recording shows of a search: the window, the view regions it touches, the segments seen from them."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr

from maps.outcomes import SearchWindow
from maps.poses import Array, Pose2
from maps.regions import ViewRegions
from maps.wiremap import WireMap
from runs.palette import AMBIGUOUS, COUNTS, FILTERED, rgb, rgba
from runs.rowbatch import RowBatch
from runs.scene import LIFT_M, at_height
from runs.shapes import disc, floor_rings, heading_wedge, window_ellipse
from vision.camera import Camera

#: Beyond this a window is the whole floor to the matcher, and its regions and segments are all there are.
WIDE_M = 2.0

#: Colours and widths of outline, regions and segments.
_STYLES = {
    "outline": (rgb(AMBIGUOUS), 1.5),
    "regions": (rgb(COUNTS[1]), 0.5),
    "segments": (rgba(FILTERED, 0.9), 2.0),
}


def style_windows(recording: rr.RecordingStream) -> None:
    """Say once how windows are drawn."""
    for name, (colour, width) in _STYLES.items():
        style = rr.LineStrips3D.from_fields(
            colors=colour, radii=rr.Radius.ui_points(width), show_labels=False
        )
        recording.log(f"world/window/{name}", style, static=True)


class WindowScene:
    """Draws one search after the other."""

    def __init__(self, wire_map: WireMap, camera: Camera, regions: ViewRegions) -> None:
        """Take the map, the camera that looks at it, and the map's regions at the camera's height."""
        self._map, self._camera, self._regions = wire_map, camera, regions
        self._floor = floor_rings(wire_map.floor)
        self._half_view = half_view_rad(camera)

    def log(self, batch: RowBatch, window: SearchWindow | None) -> None:
        """Draw where the matcher was told to look, and what it could expect to see from there."""
        regions: list[Array] = []
        labels: list[str] = []
        segments: Array = np.zeros((0, 2, 3))
        if window is None or window.dt_m > WIDE_M:
            log_outline(batch, window, self._floor)
        else:
            log_outline(batch, window)
            mount = self._camera.mount
            eye = window.centre @ Pose2(mount.x_m, mount.y_m, mount.yaw_rad)
            spread_rad = min(window.dphi_rad + self._half_view, math.pi)
            segments = self._map.endpoints[
                self._regions.visible((eye.x, eye.y), window.dt_m, eye.phi, spread_rad)
            ]
            for number in self._regions.touching((eye.x, eye.y), window.dt_m).tolist():
                region = self._regions.region(number)
                regions.append(np.vstack([region.corners, region.corners[:1]]))
                labels.append(f"region {number}: {len(region.rows)} segments")
        rings = at_height(regions, LIFT_M["region"])
        batch.add("world/window/regions", rr.LineStrips3D, strips=rings, labels=labels)
        batch.add("world/window/segments", rr.LineStrips3D, strips=segments.astype(np.float32))


def log_outline(batch: RowBatch, window: SearchWindow | None, floor: list[Array] | None = None) -> None:
    """Draw a window's disc, its slice of headings and its ellipse; the whole floor (rings) where it is that wide."""
    outline: list[Array] = []
    if window is not None and window.dt_m > WIDE_M and floor is not None:
        outline = floor
    elif window is not None and math.isfinite(window.dt_m):
        outline = [disc(np.array([window.centre.x, window.centre.y]), window.dt_m), heading_wedge(window)]
        if window.ellipsoid is not None:
            outline.append(window_ellipse(window.ellipsoid))
    strips = at_height(outline, LIFT_M["window"])
    batch.add("world/window/outline", rr.LineStrips3D, strips=strips)


def half_view_rad(camera: Camera) -> float:
    """Return half the angle that a camera's image is wide, lens included."""
    ends = np.array([[0.0, camera.cy], [camera.width - 1.0, camera.cy]])
    return float(np.arctan(np.abs(camera.undistort(ends)[:, 0])).max())
