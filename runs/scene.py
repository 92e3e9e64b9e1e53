"""What a recording shows in space: the map, the robot with its camera, beliefs and fixes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import rerun as rr

from maps.outcomes import PoseBelief
from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from runs.palette import AMBIGUOUS, FILTERED, REJECTED, STATES, TRUTH, VISION, kind_colours, rgb, rgba
from runs.rowbatch import RowBatch
from runs.runlog import StepRecord
from runs.shapes import disc, ellipse, floor_rings
from vision.camera import Camera

#: Layers drawn on the floor lie at these heights, so that they do not flicker into each other.
LIFT_M = {"region": 0.005, "fix": 0.01, "window": 0.02, "track": 0.03}

#: What became of fixes, and the colours of their layers.
LAYERS = {"accepted": VISION, "rejected": REJECTED, "ambiguous": AMBIGUOUS}

#: The robot's drawn size; sessions do not give one.
ROBOT_RADIUS_M = 0.2


def log_map(recording: rr.RecordingStream, wire_map: WireMap, root: str = "") -> None:
    """Draw the map once below an entity, an entity for each kind of segment, named on hover."""
    kinds = np.array(wire_map.kinds)
    for kind, colour in kind_colours(wire_map.kinds).items():
        rows = np.flatnonzero(kinds == kind)
        strips = rr.LineStrips3D(
            wire_map.endpoints[rows].astype(np.float32),
            colors=rgba(colour, 0.7),
            radii=rr.Radius.ui_points(0.8),
            labels=[wire_map.names[row] for row in rows],
            show_labels=False,
        )
        recording.log(f"{root}world/map/segments/{kind}", strips, static=True)
    recording.log(
        f"{root}world/map/floor", flat_lines(floor_rings(wire_map.floor), 0.0, rgb(TRUTH), 1.5), static=True
    )
    if len(wire_map.lintels):
        tops = np.repeat(wire_map.lintel_bottoms_m[:, None, None], 2, axis=1)
        strips = rr.LineStrips3D(
            list(np.concatenate([wire_map.lintels, tops], axis=2)),
            colors=rgb(AMBIGUOUS),
            radii=rr.Radius.ui_points(1.0),
        )
        recording.log(f"{root}world/map/lintels", strips, static=True)


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


def log_body(recording: rr.RecordingStream, state: str, root: str = "") -> None:
    """Draw the robot in the colour of its state, nose forward; below an entity of its own once and for all."""
    rim = np.column_stack([disc(np.zeros(2), ROBOT_RADIUS_M), np.zeros(25)])
    nose = [[0.0, 0.0, 0.0], [2.5 * ROBOT_RADIUS_M, 0.0, 0.0]]
    body = rr.LineStrips3D([rim, nose], colors=rgb(STATES[state]), radii=rr.Radius.ui_points(2.5))
    recording.log(f"{root}world/robot/body", body, static=bool(root))


def style_fixes(recording: rr.RecordingStream) -> None:
    """Say once how fixes and beliefs are drawn."""
    for layer, colour in LAYERS.items():
        lines = rr.LineStrips3D.from_fields(colors=rgb(colour), radii=rr.Radius.ui_points(0.5))
        recording.log(f"world/fixes/{layer}/outlines", lines, static=True)
        points = rr.Points3D.from_fields(
            colors=rgb(colour), radii=rr.Radius.ui_points(2.5), show_labels=False
        )
        recording.log(f"world/fixes/{layer}/positions", points, static=True)
    beliefs = rr.LineStrips3D.from_fields(colors=rgb(FILTERED), radii=rr.Radius.ui_points(0.5))
    recording.log("world/beliefs", beliefs, static=True)


def log_fix(batch: RowBatch, layer: str, beliefs: Sequence[PoseBelief], labels: Sequence[str]) -> None:
    """Draw one look's poses with 95 % ellipse and heading, named on hover; a layer is one of `LAYERS`."""
    lines = []
    for belief in beliefs:
        centre = belief.pose.as_array()[:2]
        lines.append(ellipse(centre, belief.covariance[:2, :2]))
        if belief.measured[2]:
            direction = np.array([math.cos(belief.pose.phi), math.sin(belief.pose.phi)])
            lines.append(np.array([centre, centre + 1.5 * ROBOT_RADIUS_M * direction]))
    strips = at_height(lines, LIFT_M["fix"])
    batch.add(f"world/fixes/{layer}/outlines", rr.LineStrips3D, strips=strips)
    centres = [[belief.pose.x, belief.pose.y, LIFT_M["fix"]] for belief in beliefs]
    batch.add(f"world/fixes/{layer}/positions", rr.Points3D, positions=centres, labels=labels)


def log_estimate(batch: RowBatch, record: StepRecord) -> None:
    """Draw the 95 % ellipse of the belief after a look."""
    if record.x_m is None or record.y_m is None or record.sxx is None:
        return
    covariance = np.array([[record.sxx, record.sxy], [record.sxy, record.syy]], float)
    outline = ellipse(np.array([record.x_m, record.y_m]), covariance)
    batch.add("world/beliefs", rr.LineStrips3D, strips=at_height([outline], LIFT_M["fix"]))


def at_height(outlines: Sequence[Array], height_m: float) -> list[Array]:
    """Return outlines (K, 2) in plan as lines (K, 3) at one height, without empty ones."""
    return [np.column_stack([line, np.full(len(line), height_m)]) for line in outlines if len(line)]


def flat_lines(
    outlines: Sequence[Array], height_m: float, colour: tuple[int, ...], width: float
) -> rr.LineStrips3D:
    """Return outlines (K, 2) in plan as lines at one height, `width` in points."""
    strips = at_height(outlines, height_m)
    return rr.LineStrips3D(strips, colors=colour, radii=rr.Radius.ui_points(width))
