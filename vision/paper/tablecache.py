"""Tolerance tables kept from run to run, beside the map's regions.

The key is all that a table depends on: camera, rounded tilt, noise and the slopes of the map's segments. A file
is written aside and renamed; one that cannot be read is made anew.
"""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
import zipfile
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from maps.regioncache import cache_folder
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.constraints import level_from_optical, segment_lines
from vision.paper.selection import half_field_of_view
from vision.paper.tables import TableConfig, ToleranceTable, build_table, slopes_of

#: Raised whenever the same input would give another table.
_VERSION = 1
_GRIDS = ("slopes", "heading_std", "line_covariance", "circle_covariance")
_NUMBERS = ("reach_px", "reach_rad", "focal_px")

_log = logging.getLogger(__name__)


def cached_table(camera: Camera, wire_map: WireMap, config: TableConfig) -> ToleranceTable:
    """Return the tolerances of a map's segments from the cache, or make and keep them."""
    pitch = round(camera.mount.pitch_down_rad / config.tilt_step_rad) * config.tilt_step_rad
    rounded = replace(camera, mount=replace(camera.mount, pitch_down_rad=pitch))
    directions, _ = segment_lines(wire_map, np.arange(len(wire_map)))
    slopes = slopes_of(directions, config.slope_step_rad)
    key = (_VERSION, *_camera_values(rounded), astuple(config), slopes.tolist())
    path = cache_folder() / f"tolerances-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}.npz"
    table = _load(path, rounded)
    if table is None:
        table = build_table(rounded, slopes, half_field_of_view(rounded), config)
        _save(path, table)
    # The tilt as it is turns image lines into the level frame; only the spreads are those of the rounded one.
    return replace(table, optical_from_level=level_from_optical(camera).T)


def _camera_values(camera: Camera) -> tuple[object, ...]:
    """What of a camera the spreads depend on."""
    mount = camera.mount
    return (
        *(camera.model.value, camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy),
        *(camera.distortion.tolist(), camera.std_focal, camera.std_centre_px),
        *(mount.pitch_down_rad, mount.roll_rad, mount.std_pitch_down_rad, mount.std_roll_rad),
    )


def _load(path: Path, camera: Camera) -> ToleranceTable | None:
    """Read a table; None where there is none, or where the file is not whole."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            values = {name: stored[name] for name in (*_GRIDS, *_NUMBERS)}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        _log.warning("%s: not readable (%s), made anew", path, error)
        return None
    slopes, heading, line, circle = (values[name] for name in _GRIDS)
    reach_px, reach_rad, focal_px = (float(values[name]) for name in _NUMBERS)
    inverse = level_from_optical(camera).T
    return ToleranceTable(slopes, heading, line, circle, reach_px, reach_rad, focal_px, inverse)


def _save(path: Path, table: ToleranceTable) -> None:
    """Write a table aside and rename; a full or read-only disk only costs the next one."""
    aside = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, aside = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
        with os.fdopen(handle, "wb") as file:
            fields = {name: np.asarray(getattr(table, name)) for name in (*_GRIDS, *_NUMBERS)}
            np.savez(file, allow_pickle=False, **fields)
        os.replace(aside, path)
    except OSError as error:
        _log.warning("%s: tolerances not kept: %s", path, error)
        if aside is not None:
            Path(aside).unlink(missing_ok=True)
