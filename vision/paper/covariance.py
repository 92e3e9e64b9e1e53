"""How well the chosen pose is known: the errors of lines, camera and map through the least squares.

The paper gives no covariance. The estimator minimises (1.a)^2 + (1.b)^2 unweighted, so its covariance is not the
inverse of its normal matrix: each source of error moves the equations, and the equations move the pose.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from maps.poses import Array, Pose2
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import segment_lines
from vision.paper.errors import LineErrors
from vision.paper.leastsquares import equations, residuals_and_jacobian

#: Normal matrices worse conditioned than this leave a direction of the pose open.
_MOST_CONDITION = 1e10


def robot_pose(camera: Camera, psi: float, x: float, y: float) -> Pose2:
    """Return the robot's pose from its camera's heading and plan position."""
    phi = psi - camera.mount.yaw_rad
    turned = Pose2(0.0, 0.0, phi) @ Pose2(camera.mount.x_m, camera.mount.y_m, 0.0)
    return Pose2(x - turned.x, y - turned.y, phi)


def pose_covariance(
    camera: Camera,
    wire_map: WireMap,
    errors: LineErrors,
    rows: NDArray[np.int64],
    lines: NDArray[np.int64],
    state: Array,
) -> Array | None:
    """Return the covariance (3, 3) of the robot's (x, y, phi); None where a direction is open.

    `rows`, `lines`: (K,) the pairs; `state`: (3,) psi, x, y of the camera where they fit best.
    """
    system = equations(camera, wire_map, errors, rows, lines)
    _, jacobian = residuals_and_jacobian(state, system)
    jacobian = jacobian.reshape(-1, 3)
    normal = jacobian.T @ jacobian
    if not np.isfinite(normal).all() or np.linalg.cond(normal) > _MOST_CONDITION:
        return None
    moves = _moves(camera, wire_map, errors, rows, lines, state)
    gains = np.linalg.solve(normal, jacobian.T @ moves)
    mount = camera.mount
    psi, x, y = state
    robot = robot_pose(camera, psi, x, y)
    # The robot turns about itself, the camera is ahead of it: x_robot = x_camera - lever(phi).
    lever = Pose2(0.0, 0.0, robot.phi) @ Pose2(mount.x_m, mount.y_m, 0.0)
    from_camera = np.array([[lever.y, 1.0, 0.0], [-lever.x, 0.0, 1.0], [1.0, 0.0, 0.0]])
    yaw = mount.std_yaw_rad * np.array([-lever.y, lever.x, -1.0])
    spread = np.column_stack([from_camera @ gains, yaw])
    covariance: Array = spread @ spread.T
    return covariance


def _moves(
    camera: Camera,
    wire_map: WireMap,
    errors: LineErrors,
    rows: NDArray[np.int64],
    lines: NDArray[np.int64],
    state: Array,
) -> Array:
    """What one standard deviation of each source adds to (1.a) and (1.b) of each pair, (2 K, sources)."""
    direction, points = segment_lines(wire_map, rows)
    cos, sin = math.cos(state[0]), math.sin(state[0])
    level_from_map = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    offset = (points - [state[1], state[2], camera.mount.height_m]) @ level_from_map.T
    vectors = np.stack([direction @ level_from_map.T, offset], axis=1)
    count = len(rows)
    own = np.einsum("ksi,kei->kes", errors.own[lines], vectors)
    shared = np.einsum("ksi,kei->kes", errors.shared[lines], vectors)
    sigma = wire_map.sigma_m[rows]
    length = np.linalg.norm(wire_map.endpoints[rows, 1] - wire_map.endpoints[rows, 0], axis=1)
    # Both ends of a segment err: its direction, and its middle.
    of_map = np.zeros((count, 2, 2))
    of_map[:, 0, 0], of_map[:, 1, 1] = math.sqrt(2.0) * sigma / length, math.sqrt(0.5) * sigma
    single = np.concatenate([own, of_map], axis=2)
    apart = np.zeros((count, 2, count, 4))
    apart[np.arange(count), :, np.arange(count)] = single
    height = np.zeros((count, 2, 1))
    height[:, 1, 0] = -camera.mount.std_height_m * errors.normals[lines, 2]
    return np.concatenate(
        [apart.reshape(2 * count, -1), shared.reshape(2 * count, -1), height.reshape(2 * count, 1)], axis=1
    )
