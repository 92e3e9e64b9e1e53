"""The command line's `lines` command; what it needs is imported when it runs."""

from __future__ import annotations

import csv
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maps.errors import InputError
from runs.cli_camera import camera_of, check_size

if TYPE_CHECKING:
    from vision.camera import Camera
    from vision.images import GreyImage
    from vision.lines import ImageSegments

HEADER = ("image", "x1", "y1", "x2", "y2", "sigma_px", "polarity", "contrast")


def extract_lines(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="Image files.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Table of the lines (.csv), raw pixels.")],
    camera: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="robot.yaml, for what is straight through its lens."),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Picture (.png) of one image's lines.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Parameters that differ (YAML).")
    ] = None,
) -> None:
    """Find straight edges in images: end points, deviation of the middle, brighter side (+1: right), contrast."""
    from maps.mapdocument import write_whole
    from runs.config import RunConfig, read_config
    from vision.images import read_image
    from vision.lines import extract_segments

    if overlay is not None and (len(images) > 1 or overlay.suffix != ".png"):
        raise InputError("--overlay", "", "draws one image, into a .png")
    parameters = (read_config(config) if config else RunConfig()).matcher.lines
    through = camera_of(camera) if camera else None
    rows: list[tuple[object, ...]] = []
    for path in images:
        image = read_image(path)
        segments = extract_segments(image, _fitting(through, image, path), parameters)
        rows += _rows(path, segments)
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEADER, *rows])
    write_whole(out, text.getvalue().encode())
    typer.echo(str(out))
    if overlay is not None:
        from vision.overlay import overlay_png

        write_whole(overlay, overlay_png(image, segments))
        typer.echo(str(overlay))


def _fitting(camera: Camera | None, image: GreyImage, path: Path) -> Camera:
    """Return the camera, or an ideal one for the image; InputError where the image is not of its size."""
    import numpy as np

    from vision.camera import Camera, CameraModel, CameraMount

    height, width = image.shape
    if camera is None:
        model, centre, focal = CameraModel.PINHOLE_RADTAN, ((width - 1) / 2, (height - 1) / 2), float(width)
        return Camera(model, width, height, focal, focal, *centre, np.zeros(5), CameraMount())
    check_size(image, camera, path)
    return camera


def _rows(path: Path, segments: ImageSegments) -> list[tuple[object, ...]]:
    return [
        (path, *(f"{value:.3f}" for value in ends), f"{sigma:.4f}", f"{polarity:+.0f}", f"{contrast:.1f}")
        for ends, sigma, polarity, contrast in zip(
            segments.raw_px.reshape(-1, 4).tolist(),
            segments.sigma_middle_px.tolist(),
            segments.polarity.tolist(),
            segments.contrast.tolist(),
            strict=True,
        )
    ]
