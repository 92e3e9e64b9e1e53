"""The command line's `calibrate` command; what it needs is imported when it runs."""

from __future__ import annotations

import json
import math
import re
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maps.documents import read_yaml
from maps.errors import InputError
from runs.progress import progress_bar

if TYPE_CHECKING:
    from maps.poses import Array
    from vision.boards import Board
    from vision.calibration import Calibration
    from vision.camera import Camera

#: OpenCV looks for three corners and more in each direction; more than this nobody prints.
FEWEST, MOST = 3, 100

#: Why a board is mostly not found.
COUNTED = "; --board counts a chessboard's inner corners, but a ChArUco board's squares"


class Lens(StrEnum):
    """The lens models by their short names."""

    PINHOLE = "pinhole"
    FISHEYE = "fisheye"


def calibrate_camera(
    images: Annotated[
        list[Path] | None, typer.Argument(metavar="IMAGES...", help="Views of the board.", show_default=False)
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(metavar="COLSxROWS", help="Inner corners of a chessboard; with --charuco its squares."),
    ] = None,
    square: Annotated[float | None, typer.Option(metavar="M", help="Side of a square.")] = None,
    charuco: Annotated[
        str | None, typer.Option(metavar="DICT", help="Markers in the light squares, such as 5X5_100.")
    ] = None,
    marker: Annotated[float | None, typer.Option(metavar="M", help="Side of a marker.")] = None,
    model: Annotated[Lens, typer.Option(help="Radial-tangential distortion, or fisheye.")] = Lens.PINHOLE,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="robot.yaml; the rest of one that is there is kept."),
    ] = None,
    robot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Another robot.yaml to copy the rest from.")
    ] = None,
    camera_info: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write ROS's camera_info (YAML), too.")
    ] = None,
    from_camera_info: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Take a camera from ROS's camera_info instead.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Residuals and coverage (.png), if not beside --out.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Parameters that differ (YAML).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """Calibrate a camera from views of a chessboard or ChArUco board; ends with 1 where they do not suffice."""
    source = _source(out, robot)
    if from_camera_info is not None:
        if images or out is None:
            raise InputError("--from-camera-info", "", "goes with --out, and without images")
        written = _write(_from_ros(from_camera_info), None, source, out, camera_info)
    else:
        if not images or board is None or square is None:
            raise InputError("calibrate", "", "needs images, --board and --square, or --from-camera-info")
        pattern, drawing = _pattern(board, square, charuco, marker), _drawing(picture, out)
        result = _calibrated(images, pattern, model, config, as_json)
        written = _write(result.camera, result.deviations, source, out, camera_info)
        written += [] if drawing is None else [_draw(result, drawing)]
    if written and not as_json:
        typer.echo("\n".join(written))


def _calibrated(
    images: list[Path], pattern: Board, lens: Lens, config: Path | None, as_json: bool
) -> Calibration:
    """Calibrate and tell what came of it; ends the command where that is nothing."""
    from runs.calibrating import CalibrateConfig, calibrate_images, content_of, read_calibrate_config
    from runs.cli_calibration import print_result
    from vision.calibration import Unconstrained, ViewFault
    from vision.camera import CameraModel

    model = CameraModel.FISHEYE if lens is Lens.FISHEYE else CameraModel.PINHOLE_RADTAN
    parameters = read_calibrate_config(config) if config else CalibrateConfig()
    with progress_bar("looking for the board") as progress:
        result = calibrate_images(images, pattern, model, parameters, progress)
    if as_json:
        typer.echo(json.dumps(content_of(result), indent=2))
    else:
        print_result(result)
    if isinstance(result, Unconstrained):
        hint = COUNTED if set(result.rejected.values()) == {ViewFault.NO_BOARD} else ""
        typer.echo(f"wireloc: not calibrated: {result.why}{hint}", err=True)
        raise typer.Exit(1)
    return result


def _from_ros(path: Path) -> Camera:
    from runs.camerainfo import read_camera_info

    return read_camera_info(path)


def _source(out: Path | None, robot: Path | None) -> Path | None:
    """Return the robot file whose other keys are kept."""
    if out is None:
        if robot is not None:
            raise InputError("--robot", "", "says nothing without --out")
        return None
    if robot is not None and out.exists() and not out.samefile(robot):
        raise InputError(out, "", "is there already; it keeps its own keys, so leave --robot out")
    source = robot or (out if out.exists() else None)
    if source is not None:
        # A file that cannot be kept is told of before the work, not after.
        read_yaml(source)
    return source


def _pattern(board: str, square_m: float, charuco: str | None, marker_m: float | None) -> Board:
    """Return the board that the options describe."""
    from vision.boards import DICTIONARIES, Charuco, Chessboard, markers_in

    size = re.fullmatch(r"(\d{1,4})[xX](\d{1,4})", board.strip())
    columns, rows = (int(count) for count in size.groups()) if size else (0, 0)
    if not (FEWEST <= columns <= MOST and FEWEST <= rows <= MOST):
        raise InputError("--board", "", f"expected COLSxROWS, from {FEWEST} to {MOST} each, not {board!r}")
    if not (math.isfinite(square_m) and square_m > 0.0):
        raise InputError("--square", "", "expected metres, above zero")
    if charuco is None:
        if marker_m is not None:
            raise InputError("--marker", "", "says nothing without --charuco")
        return Chessboard(columns, rows, square_m)
    dictionary = charuco.upper().removeprefix("DICT_")
    if dictionary not in DICTIONARIES:
        raise InputError("--charuco", "", f"{charuco!r} is none of {', '.join(DICTIONARIES)}")
    if marker_m is None or not 0.0 < marker_m < square_m:
        raise InputError("--marker", "", "expected metres, above zero and below --square")
    if columns * rows // 2 > markers_in(dictionary):
        raise InputError("--charuco", "", f"{dictionary} has too few markers for {columns}x{rows} squares")
    return Charuco(columns, rows, square_m, marker_m, dictionary)


def _drawing(picture: Path | None, out: Path | None) -> Path | None:
    """Return where the picture goes: where it is asked for, else beside the robot file."""
    if picture is not None and picture.suffix != ".png":
        raise InputError("--picture", "", f"expected .png, not {picture.suffix!r}")
    return picture or (out and out.with_name(f"{out.stem}_calibration.png"))


def _draw(calibration: Calibration, path: Path) -> str:
    from maps.mapdocument import write_whole
    from runs.calibrationplot import draw_calibration
    from runs.plots import png

    write_whole(path, png(draw_calibration(calibration), dots_per_inch=110))
    return str(path)


def _write(
    camera: Camera, deviations: Array | None, source: Path | None, out: Path | None, camera_info: Path | None
) -> list[str]:
    """Write robot.yaml and camera_info where they are asked for; returns what to say of it."""
    from maps.mapdocument import write_whole
    from runs.calibrating import camera_keys
    from runs.camerainfo import write_camera_info
    from runs.robotfile import MOUNT, with_camera

    said = []
    if out is not None:
        text = with_camera(source, camera_keys(camera, deviations))
        write_whole(out, text.encode())
        missing = ": the camera's mount is left for you to fill in" if MOUNT in text else ""
        said.append(f"{out}{missing}")
    if camera_info is not None:
        write_camera_info(camera_info, camera)
        said.append(str(camera_info))
    return said
