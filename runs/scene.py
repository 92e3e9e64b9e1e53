"""What a recording shows in space: the map, the robot with its camera, fixes, windows, image lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from maps.outcomes import Look, PoseBelief, SearchWindow
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from runs.palette import (
    AMBIGUOUS,
    IMAGE_LINE,
    REJECTED,
    SMOOTHED,
    STATES,
    TRUTH,
    VISION,
    kind_colours,
    rgb,
    rgba,
)
from runs.shapes import disc, ellipse, floor_rings, heading_wedge
from vision.camera import Camera

#: Layers drawn on the floor lie at these heights, so that they do not flicker into each other.
LIFT_M = {"fix": 0.01, "window": 0.02, "track": 0.03}

#: The robot's drawn size; sessions do not give one.
ROBOT_RADIUS_M = 0.2

#: An image line this far from its map edge, or farther, takes the last colour of the scale.
WORST_RESIDUAL_PX = 2.0


def log_map(recording: rr.RecordingStream, wire_map: WireMap) -> None:
    """Draw the map once, an entity for each kind of segment, named on hover."""
    kinds = np.array(wire_map.kinds)
    for kind, colour in kind_colours(wire_map.kinds).items():
        rows = np.flatnonzero(kinds == kind)
        strips = rr.LineStrips3D(
            list(wire_map.endpoints[rows]),
            colors=rgba(colour, 0.7),
            radii=rr.Radius.ui_points(0.8),
            labels=[wire_map.names[row] for row in rows],
            show_labels=False,
        )
        recording.log(f"world/map/segments/{kind}", strips, static=True)
    recording.log("world/map/floor", _lines(floor_rings(wire_map.floor), 0.0, TRUTH, 1.5), static=True)
    if len(wire_map.lintels):
        tops = np.repeat(wire_map.lintel_bottoms_m[:, None, None], 2, axis=1)
        strips = rr.LineStrips3D(
            list(np.concatenate([wire_map.lintels, tops], axis=2)),
            colors=rgb(AMBIGUOUS),
            radii=rr.Radius.ui_points(1.0),
        )
        recording.log("world/map/lintels", strips, static=True)


def log_camera(recording: rr.RecordingStream, camera: Camera) -> None:
    """Mount the camera's frustum on the robot; its picture keeps the lens's distortion."""
    rotation, centre = camera.map_from_optical(Pose2(0.0, 0.0, 0.0))
    recording.log("world/robot/camera", rr.Transform3D(translation=centre, mat3x3=rotation), static=True)
    pinhole = rr.Pinhole(
        image_from_camera=camera.matrix,
        resolution=[camera.width, camera.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.6,
        color=rgb(TRUTH),
    )
    recording.log("world/robot/camera", pinhole, static=True)


def log_body(recording: rr.RecordingStream, state: str) -> None:
    """Draw the robot in the colour of its state, nose forward."""
    rim = np.column_stack([disc(np.zeros(2), ROBOT_RADIUS_M), np.zeros(25)])
    nose = [[0.0, 0.0, 0.0], [2.5 * ROBOT_RADIUS_M, 0.0, 0.0]]
    body = rr.LineStrips3D([rim, nose], colors=rgb(STATES[state]), radii=rr.Radius.ui_points(2.5))
    recording.log("world/robot/body", body)


def log_window(recording: rr.RecordingStream, window: SearchWindow | None) -> None:
    """Draw where the matcher was told to look: a disc, and in it the slice of headings."""
    if window is None or not math.isfinite(window.dt_m):
        recording.log("world/window", rr.Clear(recursive=False))
        return
    centre = np.array([window.centre.x, window.centre.y])
    outline = [disc(centre, window.dt_m), heading_wedge(window)]
    recording.log("world/window", _lines(outline, LIFT_M["window"], AMBIGUOUS, 1.0))


def log_fix(recording: rr.RecordingStream, layer: str, beliefs: Sequence[PoseBelief]) -> None:
    """Draw one look's poses with 95 % ellipse and heading; layers: accepted, rejected, ambiguous."""
    colour = {"accepted": VISION, "rejected": REJECTED, "ambiguous": AMBIGUOUS}[layer]
    lines = []
    for belief in beliefs:
        centre = belief.pose.as_array()[:2]
        lines.append(ellipse(centre, belief.covariance[:2, :2]))
        if belief.measured[2]:
            direction = np.array([math.cos(belief.pose.phi), math.sin(belief.pose.phi)])
            lines.append(np.array([centre, centre + 1.5 * ROBOT_RADIUS_M * direction]))
    recording.log(f"world/fixes/{layer}/outlines", _lines(lines, LIFT_M["fix"], colour, 0.5))
    centres = [[belief.pose.x, belief.pose.y, LIFT_M["fix"]] for belief in beliefs]
    points = rr.Points3D(centres, colors=rgb(colour), radii=rr.Radius.ui_points(2.5))
    recording.log(f"world/fixes/{layer}/positions", points)


def log_image(recording: rr.RecordingStream, path: Path) -> None:
    """Store an image as its file has it, bytes untouched."""
    recording.log("world/robot/camera/image", rr.EncodedImage(path=path))


def log_look(recording: rr.RecordingStream, look: Look, names: tuple[str, ...]) -> None:
    """Draw what the matcher saw: lines, edges it expected and did not see, and pairs by residual."""
    at = "world/robot/camera/lines"
    thin, wide = rr.Radius.ui_points(0.5), rr.Radius.ui_points(1.5)
    free = np.setdiff1d(np.arange(len(look.lines_px)), look.matched_image)
    lines = rr.LineStrips2D(
        list(look.lines_px[free]), colors=rgba(IMAGE_LINE, 0.9), radii=thin, draw_order=10.0
    )
    recording.log(f"{at}/extracted", lines)

    unseen = np.flatnonzero(~np.isin(look.predicted_map, look.matched_map))
    predicted = rr.LineStrips2D(
        list(look.predicted_px[unseen]),
        colors=rgba(AMBIGUOUS, 0.8),
        radii=thin,
        labels=[names[row] for row in look.predicted_map[unseen]],
        show_labels=False,
        draw_order=20.0,
    )
    recording.log(f"{at}/predicted_unseen", predicted)

    pairs = zip(look.matched_map, look.residuals_px, strict=True)
    matched = rr.LineStrips2D(
        list(look.lines_px[look.matched_image]),
        colors=[_residual_colour(residual) for residual in look.residuals_px],
        radii=wide,
        labels=[f"{names[row]}  {residual:.2f} px" for row, residual in pairs],
        show_labels=False,
        draw_order=30.0,
    )
    recording.log(f"{at}/matched", matched)


def _residual_colour(residual_px: float) -> tuple[int, int, int]:
    """Go from green, on the edge, to vermilion, `WORST_RESIDUAL_PX` or more away from it."""
    share = min(residual_px / WORST_RESIDUAL_PX, 1.0)
    near, far = np.array(rgb(SMOOTHED)), np.array(rgb(REJECTED))
    red, green, blue = (int(value) for value in np.rint(near + share * (far - near)))
    return red, green, blue


def _lines(outlines: list[Array], height_m: float, colour: str, width: float) -> rr.LineStrips3D:
    strips = [np.column_stack([line, np.full(len(line), height_m)]) for line in outlines if len(line)]
    return rr.LineStrips3D(strips, colors=rgb(colour), radii=rr.Radius.ui_points(width))
