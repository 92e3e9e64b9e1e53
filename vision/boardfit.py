"""Least squares over a camera's parameters and the poses of a board in V views.

A corner `X` on the board is seen at `distort(R X + t)`; parameters and poses make the sum of squared distances
from where corners were found least (Zhang 2000, section 3.3). OpenCV gives the start, the projection and its
derivatives; poses are eliminated view by view (Schur complement), which leaves a small system, and in it what
each view says of the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from maps.poses import Array, frozen
from vision.boards import Corners
from vision.camera import CameraModel

#: Distortion coefficients of each model.
COEFFICIENTS = {CameraModel.PINHOLE_RADTAN: 5, CameraModel.FISHEYE: 4}

#: Focal lengths to start a fisheye from, in lengths of the image: it sees 30 to 220 degrees.
_FISHEYE_STARTS = np.geomspace(0.26, 1.9, 12)
#: Steeper rays are not looked at before the lens is known: their place on a plane runs to infinity.
_STEEPEST_RAD = 1.45

_STEPS = 60
_SETTLED = 1e-10
_MOST_DAMPING = 1e10
#: Below this share of the largest, an eigenvalue of the scaled information is zero.
_SINGULAR = 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class BoardFit:
    """Where the least squares ended.

    `parameters`: (4 + C,) fx, fy, cx, cy [px] and the C distortion coefficients; `deviations`: (4 + C,) their
    standard deviations, zero for what was held. `residuals_px`: V arrays (N, 2), found less expected.
    """

    parameters: Array
    deviations: Array
    residuals_px: tuple[Array, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", frozen(self.parameters))
        object.__setattr__(self, "deviations", frozen(self.deviations))


def fit_boards(
    views: Sequence[Corners], size: tuple[int, int], model: CameraModel, basis: Array
) -> BoardFit | None:
    """Fit parameters and poses (Levenberg-Marquardt); None where the views leave them open.

    `size`: width and height. `basis`: (4 + C, Q), the parameters are `basis` times Q free ones.
    """
    try:
        parameters, poses = _start(views, size, model)
        parameters = basis @ np.linalg.lstsq(basis, parameters)[0]
        best, damping = _normal(views, model, basis, parameters, poses), 1e-3
        for _ in range(_STEPS):
            by_free, by_pose = best.step(damping)
            trial = _normal(views, model, basis, parameters + basis @ by_free, poses + by_pose)
            gain = best.cost - trial.cost
            if gain >= 0.0:
                parameters, poses, best = parameters + basis @ by_free, poses + by_pose, trial
            damping = max(0.1 * damping, 1e-12) if gain >= 0.0 else 10.0 * damping
            if 0.0 <= gain <= _SETTLED * best.cost or damping > _MOST_DAMPING:
                break
        variances = best.variances(basis)
    except (cv2.error, np.linalg.LinAlgError):
        return None
    if not (np.isfinite(parameters).all() and np.isfinite(variances).all()):
        return None
    return BoardFit(parameters, np.sqrt(variances), best.residuals_px)


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """The normal equations, a block for each of V views: `free` Q parameters, 6 of a `pose`, and `mixed`."""

    free: Array
    mixed: Array
    pose: Array
    free_gradient: Array
    pose_gradient: Array
    residuals_px: tuple[Array, ...]

    @property
    def cost(self) -> float:
        """The sum of squared residuals; infinite where a projection failed."""
        cost = float(sum((residuals**2).sum() for residuals in self.residuals_px))
        return cost if np.isfinite(cost) else np.inf

    def reduced(self, damping: float) -> tuple[Array, Array, Array]:
        """Eliminate the poses: information (V, Q, Q), gradients (V, Q), poses (V, 6, Q + 1) by them."""
        right = np.concatenate([self.mixed.transpose(0, 2, 1), self.pose_gradient[..., None]], axis=2)
        back = np.linalg.solve(_damped(self.pose, damping), right)
        information = _damped(self.free, damping) - self.mixed @ back[..., :-1]
        gradients = self.free_gradient - (self.mixed @ back[..., -1:])[..., 0]
        return information, gradients, back

    def step(self, damping: float) -> tuple[Array, Array]:
        """Return the step of the free parameters (Q,) and of the poses (V, 6)."""
        information, gradients, back = self.reduced(damping)
        free = np.linalg.solve(information.sum(axis=0), gradients.sum(axis=0))
        return free, back[..., -1] - back[..., :-1] @ free

    def variances(self, basis: Array) -> Array:
        """Return the variances of all parameters (4 + C,); LinAlgError where the views leave one open.

        The larger of two: what independent errors of the corners give, and what leaving out one view after
        the other does to the result (jackknife, Efron 1982; here each by one linear step). The first is too
        small on photographs, where a view's errors have one cause: a board that is not quite flat, blur.
        """
        information, gradients, _ = self.reduced(0.0)
        count, total = len(information), information.sum(axis=0)
        scale = 1.0 / np.sqrt(np.diag(total))
        weakest, *_, strongest = np.linalg.eigvalsh(scale[:, None] * total * scale)
        freedom = 2 * sum(len(part) for part in self.residuals_px) - basis.shape[1] - 6 * count
        if freedom <= 0 or not weakest > _SINGULAR * strongest:
            raise np.linalg.LinAlgError
        independent = self.cost / freedom * np.linalg.inv(total)
        shifts = np.linalg.solve(total - information, gradients[..., None])[..., 0]
        by_view = (count - 1) / count * shifts.T @ shifts
        both = [np.einsum("ij,jk,ik->i", basis, part, basis) for part in (independent, by_view)]
        result: Array = np.maximum(*both)
        return result


def _damped(blocks: Array, damping: float) -> Array:
    diagonal = np.eye(blocks.shape[-1], dtype=np.bool_)
    result: Array = np.where(diagonal, (1.0 + damping) * blocks, blocks)
    return result


def _normal(
    views: Sequence[Corners], model: CameraModel, basis: Array, parameters: Array, poses: Array
) -> _Normal:
    blocks, residuals = [], []
    for view, pose in zip(views, poses, strict=True):
        expected, by_parameters, by_pose = project(view.board_m, parameters, pose, model)
        left = view.image_px - expected
        jacobian = np.hstack([by_parameters @ basis, by_pose])
        blocks.append(np.column_stack([jacobian.T @ jacobian, jacobian.T @ left.ravel()]))
        residuals.append(left)
    all_blocks, q = np.array(blocks), basis.shape[1]
    return _Normal(
        free=all_blocks[:, :q, :q],
        mixed=all_blocks[:, :q, q:-1],
        pose=all_blocks[:, q:, q:-1],
        free_gradient=all_blocks[:, :q, -1],
        pose_gradient=all_blocks[:, q:, -1],
        residuals_px=tuple(residuals),
    )


def project(board_m: Array, parameters: Array, pose: Array, model: CameraModel) -> tuple[Array, Array, Array]:
    """Return pixels (N, 2), and their derivatives by the parameters (2N, 4 + C) and by the pose (2N, 6).

    `pose`: (6,) rotation vector and translation of optical_from_board.
    """
    fx, fy, cx, cy = parameters[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    points = board_m.reshape(-1, 1, 3)
    if model is CameraModel.FISHEYE:
        pixels, slopes = cv2.fisheye.projectPoints(points, pose[:3], pose[3:], matrix, parameters[4:])
        first, places = 0, slice(8, 14)
    else:
        pixels, slopes = cv2.projectPoints(points, pose[:3], pose[3:], matrix, parameters[4:])[:2]
        first, places = 6, slice(0, 6)
    jacobian = np.asarray(slopes, np.float64)
    by_parameters = jacobian[:, first : first + len(parameters)]
    return np.asarray(pixels, np.float64).reshape(-1, 2), by_parameters, jacobian[:, places]


def _start(views: Sequence[Corners], size: tuple[int, int], model: CameraModel) -> tuple[Array, Array]:
    """Return parameters (4 + C,) and poses (V, 6) to begin with."""
    if model is CameraModel.FISHEYE:
        return _fisheye_start(views, size)
    boards = [view.board_m.astype(np.float32) for view in views]
    images = [view.image_px.astype(np.float32) for view in views]
    # The two arrays are outputs; OpenCV fills in its own.
    guess, none = np.eye(3), np.zeros(5)
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(boards, images, size, guess, none)
    intrinsics = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    poses = np.column_stack([np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))]).astype(np.float64)
    return np.concatenate([intrinsics, distortion.ravel()]), poses


def _fisheye_start(views: Sequence[Corners], size: tuple[int, int]) -> tuple[Array, Array]:
    """Try focal lengths of a lens without distortion, and take the one that explains the views best.

    OpenCV's own start assumes 180 degrees across the image, from where wide lenses do not converge.
    """
    starts = []
    for focal_px in _FISHEYE_STARTS * max(size):
        centre = (np.array(size) - 1.0) / 2.0
        parameters = np.concatenate([[focal_px, focal_px], centre, np.zeros(4)])
        poses = np.array([_board_pose(view, focal_px, centre) for view in views])
        basis = np.eye(len(parameters))
        cost = _normal(views, CameraModel.FISHEYE, basis, parameters, poses).cost
        starts.append((cost, parameters, poses))
    _, parameters, poses = min(starts, key=lambda start: start[0])
    return parameters, poses


def _board_pose(view: Corners, focal_px: float, centre: Array) -> Array:
    """Return the pose (6,) of a board that an equidistant lens sees (Collins and Bartoli 2014)."""
    offset = view.image_px - centre
    radius = np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-9)
    flat = offset * np.tan(np.minimum(radius / focal_px, _STEEPEST_RAD)) / radius
    points = view.board_m.reshape(-1, 1, 3)
    _, turn, shift = cv2.solvePnP(points, flat.reshape(-1, 1, 2), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    return np.concatenate([turn.ravel(), shift.ravel()])
