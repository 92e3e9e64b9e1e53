"""Which image lines may be images of vertical edges: l_v of section 3.2, by the paper's rule or exactly."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from vision.camera import Camera
from vision.lines import ImageSegments
from vision.paper.errors import LineErrors

#: How fuzzy the limits of the paper's rule are, beside the lines' own errors.
_FUZZY_RAD = math.radians(2.0)
#: The widest lean that the paper's rule allows, at any tilt.
_MOST_LEAN_RAD = math.radians(45.0)


class VerticalRule(StrEnum):
    """How lines that may be vertical edges are told."""

    #: A line passes through the vertical vanishing point.
    VANISHING_POINT = "vanishing_point"
    #: A line leans as section 3.2 says: to the side of its half of the image, within limits.
    SLOPE = "slope"


def vertical_lines(
    camera: Camera, segments: ImageSegments, errors: LineErrors, sigmas: float, rule: VerticalRule
) -> NDArray[np.int64]:
    """Return the lines (nv,) that may be images of vertical edges."""
    if rule is VerticalRule.SLOPE:
        return np.flatnonzero(leans_as_vertical(camera, segments, sigmas))
    return np.flatnonzero(through_vanishing_point(errors, sigmas))


def through_vanishing_point(errors: LineErrors, sigmas: float) -> NDArray[np.bool_]:
    """Return whether each line's interpretation plane is vertical within its error: n . e_z = 0, (M,)."""
    result: NDArray[np.bool_] = np.abs(errors.normals[:, 2]) <= sigmas * np.sqrt(errors.covariances[:, 2, 2])
    return result


def leans_as_vertical(camera: Camera, segments: ImageSegments, sigmas: float) -> NDArray[np.bool_]:
    """Return whether each line's slope is one that a vertical edge can have in its half of the image, (M,).

    Section 3.2, whose limits on the slope depend on the tilt in a way that is not said. The reading taken: if
    the camera looks up, vertical edges come together upwards, those on the right lean left; if it looks down,
    the reverse. The most that one can lean is what leads from the image's corner to the vanishing point. The
    limits are fuzzy. Roll, which the paper does not have, is left out.
    """
    ends = segments.ideal_px
    along = ends[:, 1] - ends[:, 0]
    along = np.where(along[:, 1:] > 0.0, -along, along)
    middle = ends.mean(axis=1)
    # The lean to the right, going up in the image; positive where it is towards the vanishing point.
    lean = np.arctan2(along[:, 0], -along[:, 1])
    looks_up = camera.mount.pitch_down_rad < 0.0
    inward = -np.sign(middle[:, 0]) * (1.0 if looks_up else -1.0) * lean
    corner = np.array([camera.width, camera.height]) * camera.focal_px / np.array([camera.fx, camera.fy])
    beyond = camera.focal_px / max(abs(math.tan(camera.mount.pitch_down_rad)), 1e-9) - 0.5 * corner[1]
    most = math.atan2(0.5 * corner[0], max(beyond, 0.0))
    slack = _FUZZY_RAD + sigmas * segments.sigma_angle_rad
    result: NDArray[np.bool_] = (inward >= -slack) & (inward <= min(most, _MOST_LEAN_RAD) + slack)
    return result
