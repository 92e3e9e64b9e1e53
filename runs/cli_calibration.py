"""What `wireloc calibrate` says: the parameters, each image's residuals, and what to distrust."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from runs.calibrating import DISTORTION_KEYS, largest_px
from vision.calibration import PARAMETERS, Calibration, Unconstrained, rms_px


def print_result(result: Calibration | Unconstrained) -> None:
    """Print a calibration, or which views were of no use; plain and unbroken lines in a pipe."""
    console = Console()
    if not console.is_terminal:
        # Names must not be folded away where a program may search for them.
        console.width = 10_000
    if isinstance(result, Calibration):
        console.print(_parameters(result))
    console.print(_views(result))
    if isinstance(result, Calibration):
        views = f"{len(result.used)} views, {len(result.rejected)} left out"
        console.print(f"rms {result.rms_px:.4f} px over {views}", highlight=False)
        for warning in result.warnings:
            console.print(Text(f"warning: {warning}", style="yellow"))


def _parameters(calibration: Calibration) -> Table:
    camera = calibration.camera
    table = Table("", str(camera.model), "standard deviation", box=SIMPLE_HEAD)
    names = [*PARAMETERS, *DISTORTION_KEYS[camera.model].split("_")[1:]]
    values = [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion.tolist()]
    for index, (name, value, deviation) in enumerate(
        zip(names, values, calibration.deviations.tolist(), strict=True)
    ):
        digits, unit = (2, " px") if index < len(PARAMETERS) else (5, "")
        table.add_row(name, f"{value:.{digits}f}{unit}", f"{deviation:.{digits}f}{unit}")
    return table


def _views(result: Calibration | Unconstrained) -> Table:
    table = Table("image", "corners", "rms, px", "max, px", "", box=SIMPLE_HEAD)
    if isinstance(result, Calibration):
        for name, residuals in result.residuals_px.items():
            sizes = f"{rms_px(residuals):.3f}", f"{largest_px(residuals):.3f}"
            table.add_row(Text(name), str(len(residuals)), *sizes, "")
    for name, fault in result.rejected.items():
        table.add_row(Text(name), "-", "-", "-", Text(f"left out: {fault}", style="yellow"))
    return table
