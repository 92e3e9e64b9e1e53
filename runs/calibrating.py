"""A calibration from image files to robot.yaml: what is read, what is written, what a program is told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import ConfigDict

from maps.documents import checked, read_yaml
from maps.errors import InputError
from maps.poses import Array
from vision.boards import Board, Corners, RefinementConfig, find_corners
from vision.calibration import (
    PARAMETERS,
    Calibration,
    CalibrationConfig,
    Unconstrained,
    ViewFault,
    calibrate,
    rms_px,
)
from vision.camera import Camera, CameraModel
from vision.images import read_image

Progress = Callable[[int, int], None]
"""Called with the images looked at and all there are."""

DISTORTION_KEYS = {
    CameraModel.PINHOLE_RADTAN: "distortion_k1_k2_p1_p2_k3",
    CameraModel.FISHEYE: "distortion_k1_k2_k3_k4",
}

#: Digits after the point of what is written: far finer than anything is known, short enough to read.
DECIMALS_PX, DECIMALS_DISTORTION = 4, 8


@dataclass(frozen=True, slots=True)
class CalibrateConfig:
    """Parameters of a calibration; see their own classes for units and reasons."""

    corners: RefinementConfig = field(default_factory=RefinementConfig)
    fit: CalibrationConfig = field(default_factory=CalibrationConfig)

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)


def read_calibrate_config(path: Path) -> CalibrateConfig:
    """Read parameters that differ; InputError names the key that does not fit."""
    return checked(CalibrateConfig, read_yaml(path), path)


def calibrate_images(
    paths: Sequence[Path],
    board: Board,
    model: CameraModel,
    config: CalibrateConfig,
    progress: Progress,
) -> Calibration | Unconstrained:
    """Calibrate from image files; those that cannot be used are among the rejected, by their paths.

    InputError where a file is missing, or none can be read.
    """
    for path in paths:
        if not path.is_file():
            raise InputError(path, "", "no such file")
    found, sizes, rejected = {}, {}, {}
    for done, path in enumerate(dict.fromkeys(paths), start=1):
        try:
            image = read_image(path)
        except InputError:
            rejected[str(path)] = ViewFault.UNREADABLE
            continue
        sizes[str(path)] = image.shape[1], image.shape[0]
        found[str(path)] = find_corners(image, board, config.corners)
        progress(done, len(paths))
    if not sizes:
        raise InputError(paths[0], "", "not an image that can be read, nor is any other")
    size = Counter(sizes.values()).most_common(1)[0][0]
    views: dict[str, Corners] = {}
    for name, corners in found.items():
        if sizes[name] != size:
            rejected[name] = ViewFault.OTHER_SIZE
        elif corners is None:
            rejected[name] = ViewFault.NO_BOARD
        else:
            views[name] = corners
    result = calibrate(views, size, model, config.fit)
    return replace(result, rejected={**rejected, **result.rejected})


def camera_keys(camera: Camera, deviations: Array | None = None) -> dict[str, Any]:
    """Return a camera as the keys of robot.yaml, without its mount; None for those that must not be there.

    `deviations`: (4 + C,) standard deviations of fx, fy, cx, cy and the distortion coefficients.
    """
    keys: dict[str, Any] = {"model": str(camera.model), "width": camera.width, "height": camera.height}
    for index, name in enumerate(PARAMETERS):
        keys[name] = round(getattr(camera, name), DECIMALS_PX)
        keys[f"std_{name}"] = None if deviations is None else round(float(deviations[index]), DECIMALS_PX)
    for model, name in DISTORTION_KEYS.items():
        mine = model is camera.model
        keys[name] = _rounded(camera.distortion) if mine else None
        keys[f"std_{name}"] = _rounded(deviations[4:]) if mine and deviations is not None else None
    return keys


def content_of(result: Calibration | Unconstrained) -> dict[str, Any]:
    """Return a calibration as plain values for a program."""
    rejected = {name: str(fault) for name, fault in result.rejected.items()}
    if isinstance(result, Unconstrained):
        return {"calibrated": False, "why": result.why, "rejected": rejected}
    camera = {
        key: value
        for key, value in camera_keys(result.camera, result.deviations).items()
        if value is not None
    }
    views = [
        {"image": name, "corners": len(part), "rms_px": rms_px(part), "max_px": largest_px(part)}
        for name, part in result.residuals_px.items()
    ]
    return {
        "calibrated": True,
        "rms_px": result.rms_px,
        "camera": camera,
        "views": views,
        "rejected": rejected,
        "warnings": list(result.warnings),
    }


def largest_px(residuals_px: Array) -> float:
    """Return the length of the longest of residuals (N, 2)."""
    return float(np.linalg.norm(residuals_px, axis=1).max())


def _rounded(values: Array) -> list[float]:
    return [round(value, DECIMALS_DISTORTION) + 0.0 for value in values.tolist()]
