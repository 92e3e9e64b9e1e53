"""Camera calibration from views of a board: which views count, what they determine, and what to distrust."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from maps.poses import Array
from vision.boardfit import COEFFICIENTS, BoardFit, fit_boards
from vision.boards import Corners
from vision.camera import Camera, CameraModel, CameraMount

PARAMETERS = ("fx", "fy", "cx", "cy")
#: Distortion coefficients that views rarely show, the highest power first. On photographs, k3 at zero foretells
#: views left out better than k3 estimated, and k2 estimated better than k2 at zero.
_OPTIONAL = {CameraModel.PINHOLE_RADTAN: (4,), CameraModel.FISHEYE: (3, 2)}

FEWEST_VIEWS = 3
_ADVICE = "tilt the board by 20 to 45 degrees, in several directions"


class ViewFault(StrEnum):
    """Why a view was not used."""

    UNREADABLE = "not an image that can be read"
    OTHER_SIZE = "not of the other images' size"
    NO_BOARD = "board not found"
    FEW_CORNERS = "too few corners, or all in one row"
    REPEATED = "the same view as another one"
    LARGE_RESIDUALS = "residuals far above the other views'"


@dataclass(frozen=True, slots=True)
class CalibrationConfig:
    """What is estimated, which views are left out, and when a result is none."""

    #: fx = fy: one thing less to learn, where pixels are known to be square.
    square_pixels: bool = False
    #: Distortion coefficients of high powers are held at zero while they are not this many standard deviations
    #: from it: noise would bend the image where there were no corners. 0 estimates them all.
    significance: float = 3.0
    #: A view of fewer corners says little; four are needed to place the board.
    min_corners: int = 8
    #: Views whose corners differ by less are one: a board on its stand, photographed twice.
    repeated_px: float = 2.0
    #: A view's residuals may be this many times the median view's, and are never too large below `fine_px`.
    outlier_ratio: float = 3.0
    fine_px: float = 0.3
    #: Largest standard deviation of the focal length, as a share of it, and of the principal point, as a share
    #: of the image's width: 1 % moves an edge at the border of a 640 px image by 3 px, and 6 px.
    max_focal_share: float = 0.01
    max_centre_share: float = 0.01
    #: Share of the image at any border that may be without corners before that is worth a warning.
    max_border_share: float = 0.15
    #: Residuals above this share of the image's width mean another lens, or a board that is not flat.
    max_rms_share: float = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A camera that explains V views, by name.

    `camera`: its mount is not known, and that of a `CameraMount()`. `deviations`: (4 + C,) standard deviations
    of fx, fy, cx, cy [px] and the distortion coefficients, zero for what was held. `residuals_px`: arrays
    (N, 2) of each view used, found less expected.
    """

    camera: Camera
    deviations: Array
    used: Mapping[str, Corners]
    residuals_px: Mapping[str, Array]
    rejected: Mapping[str, ViewFault]
    warnings: tuple[str, ...]

    @property
    def rms_px(self) -> float:
        """The root mean square distance of all corners from where they should be."""
        return rms_px(np.concatenate(list(self.residuals_px.values())))


@dataclass(frozen=True, slots=True)
class Unconstrained:
    """No result: what the views leave open, and what to do about it."""

    why: str
    rejected: Mapping[str, ViewFault]


def rms_px(residuals_px: Array) -> float:
    """Return the root mean square length of residuals (N, 2)."""
    return float(np.sqrt((residuals_px**2).sum(axis=1).mean()))


def calibrate(
    views: Mapping[str, Corners], size: tuple[int, int], model: CameraModel, config: CalibrationConfig
) -> Calibration | Unconstrained:
    """Calibrate a camera of `size` (width, height) from views of a board.

    Zhang (2000) for the pinhole model; for the fisheye (Kannala and Brandt 2006, OpenCV's form) the same least
    squares. Views that do not fit are taken out one by one, the worst first.
    """
    rejected = dict(_useless(views, config))
    while True:
        used = {name: corners for name, corners in views.items() if name not in rejected}
        if len(used) < FEWEST_VIEWS:
            return Unconstrained(
                f"usable views: {len(used)}, and at least {FEWEST_VIEWS} are needed", rejected
            )
        fit = _fit(list(used.values()), size, model, config)
        if fit is None:
            return Unconstrained(f"the views leave the camera open; {_ADVICE}", rejected)
        worst = _outlier(fit, list(used), config)
        if worst is None:
            break
        rejected[worst] = ViewFault.LARGE_RESIDUALS
    why = _left_open(fit, size, config)
    if why is not None:
        return Unconstrained(why, rejected)
    fx, fy, cx, cy = fit.parameters[:4].tolist()
    camera = Camera(model, *size, fx, fy, cx, cy, fit.parameters[4:], CameraMount())
    residuals = dict(zip(used, fit.residuals_px, strict=True))
    warnings = tuple(_warnings(camera, used, fit, config))
    return Calibration(camera, fit.deviations, used, residuals, rejected, warnings)


def _useless(views: Mapping[str, Corners], config: CalibrationConfig) -> Iterator[tuple[str, ViewFault]]:
    """Tell which views say nothing, or nothing new."""
    kept: list[Corners] = []
    for name, corners in views.items():
        plan = corners.board_m[:, :2] - corners.board_m[:, :2].mean(axis=0)
        if len(corners) < config.min_corners or np.linalg.matrix_rank(plan, tol=1e-9) < 2:
            yield name, ViewFault.FEW_CORNERS
        elif any(_same(corners, other, config.repeated_px) for other in kept):
            yield name, ViewFault.REPEATED
        else:
            kept.append(corners)


def _same(corners: Corners, other: Corners, within_px: float) -> bool:
    if not np.array_equal(corners.board_m, other.board_m):
        return False
    return rms_px(corners.image_px - other.image_px) < within_px


def _fit(
    views: list[Corners], size: tuple[int, int], model: CameraModel, config: CalibrationConfig
) -> BoardFit | None:
    """Fit with as many distortion coefficients as the views show.

    The deviations are the largest of all the fits tried: zero was chosen, not known, and what else the views
    leave open goes with it.
    """
    held: list[int] = []
    fit = fit_boards(views, size, model, _basis(model, config, held))
    tried = [fit]
    for index in _OPTIONAL[model]:
        place = len(PARAMETERS) + index
        if fit is not None and abs(fit.parameters[place]) >= config.significance * fit.deviations[place]:
            break
        held.append(place)
        fit = fit_boards(views, size, model, _basis(model, config, held))
        tried.append(fit)
    deviations = [each.deviations for each in tried if each is not None]
    return None if fit is None else replace(fit, deviations=np.max(deviations, axis=0))


def _basis(model: CameraModel, config: CalibrationConfig, held: list[int]) -> Array:
    """Return the directions in which parameters are free, (4 + C, Q)."""
    every = np.eye(len(PARAMETERS) + COEFFICIENTS[model])
    if config.square_pixels:
        every[1, 0] = 1.0
        held = [1, *held]
    return np.delete(every, held, axis=1)


def _outlier(fit: BoardFit, names: list[str], config: CalibrationConfig) -> str | None:
    """Return the worst view, where it does not belong to the others."""
    sizes = np.array([rms_px(part) for part in fit.residuals_px])
    worst = int(sizes.argmax())
    most = max(config.outlier_ratio * float(np.median(sizes)), config.fine_px)
    return names[worst] if sizes[worst] > most else None


def _left_open(fit: BoardFit, size: tuple[int, int], config: CalibrationConfig) -> str | None:
    """Say what is not determined well enough to be of use."""
    for index, name in enumerate(PARAMETERS):
        value, deviation = fit.parameters[index], fit.deviations[index]
        scale, most = (value, config.max_focal_share) if index < 2 else (size[0], config.max_centre_share)
        if not 0.0 < deviation <= most * scale:
            return f"the views leave {name} open: {value:.1f} +- {deviation:.1f} px; {_ADVICE}"
    if not (0.0 < fit.parameters[2] < size[0] and 0.0 < fit.parameters[3] < size[1]):
        return f"the principal point lies outside the image; {_ADVICE}"
    return None


def _warnings(
    camera: Camera, used: Mapping[str, Corners], fit: BoardFit, config: CalibrationConfig
) -> Iterator[str]:
    """Tell where the result is not to be trusted."""
    corners = np.concatenate([view.image_px for view in used.values()]) / [camera.width, camera.height]
    low, high = corners.min(axis=0), 1.0 - corners.max(axis=0)
    borders = {"left": low[0], "right": high[0], "upper": low[1], "lower": high[1]}
    for border, share in borders.items():
        if share > config.max_border_share:
            yield f"no corner in {share:.0%} of the image at its {border} border: distortion is a guess there"
    rms = rms_px(np.concatenate(fit.residuals_px))
    if rms > config.max_rms_share * camera.width:
        yield f"residuals of {rms:.2f} px: is it the other lens model, or is the board not flat?"
    blind = _blind_share(camera)
    if blind > 0.0:
        share = f"{max(blind, 0.01):.0%} of the image cannot be undistorted"
        yield f"{share}: it looks beyond 90 degrees there, or the lens model folds over"


def _blind_share(camera: Camera) -> float:
    """Return the share of the image where undistorting and distorting again leads elsewhere."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 41), np.linspace(0, camera.height - 1, 31))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    back = camera.distort(camera.undistort(pixels))
    away: Array = np.linalg.norm(back - pixels, axis=1)
    return float(np.mean(~(away < 0.5)))
