"""ROS maps: an occupancy grid (PGM) with its YAML, whose free space becomes a floor with straight walls."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from scipy import ndimage
from shapely.geometry import MultiPolygon, Polygon

from maps.documents import checked, read_yaml
from maps.errors import InputError
from maps.formats.assembly import map_of_plan
from maps.formats.floors import polygons_of
from maps.formats.imported import GUESSED_WALL_HEIGHT_M, Imported, ImportOptions, Report, counted, imported
from maps.formats.pgm import read_pgm
from maps.formats.plan import Plan
from maps.formats.straight import straightened
from maps.mapdocument import Metres
from maps.poses import Array, Pose2

Mask = NDArray[np.bool_]
Share = Annotated[float, Field(ge=0.0, le=1.0)]

#: Passages narrower than this are gaps in a scan, through which beams leak out.
MIN_PASSAGE_M = 0.3
#: Fewer cells than this on free ground are noise.
MIN_SPECK = 4
#: What map_saver writes where it knows nothing: this share of white.
UNKNOWN_GREY = 205.0 / 255.0


class _Grid(BaseModel):
    image: str
    #: Finer than any scanner: what is below is another unit, and passages would have too many cells.
    resolution: Annotated[float, Field(ge=0.002, le=10.0, allow_inf_nan=False)]
    origin: tuple[Metres, Metres, Metres]
    negate: Literal[0, 1] = 0
    occupied_thresh: Share
    free_thresh: Share
    mode: Literal["trinary", "scale"] = "trinary"


def import_ros(path: Path, options: ImportOptions) -> Imported:
    """Import the free space of an occupancy grid.

    The grid's largest free area becomes the floor, its outline straight lines through the middles of the
    occupied cells beside it. Heights are told by the options or guessed. The map frame stays that of the
    grid. InputError names the key, or the picture, that does not fit.
    """
    grid = checked(_Grid, read_yaml(path), path)
    picture = path.parent / grid.image
    grey = read_pgm(picture)
    free, occupied, report = _cells(grid, grey)
    floor_cells, cleaned = _floor(free, grid.resolution)
    if not floor_cells.any():
        raise InputError(picture, "", "no free area that is wide enough to drive in")
    outline, direction = straightened(_outline(floor_cells, grid.resolution), grid.resolution)
    # Beams end on the walls' faces: on average in the middle of the cells that they mark.
    floor = outline.buffer(0.5 * grid.resolution, join_style="mitre", mitre_limit=2.0)
    height_m = options.wall_height_m or GUESSED_WALL_HEIGHT_M
    plan = Plan(_in_map(floor, grid), height_m, guessed_ceiling=options.wall_height_m is None)
    content, mapped = map_of_plan(plan)
    content = {"sigma_m": min(max(grid.resolution, 1e-3), 10.0), **content}
    guessed: tuple[str, ...] = (
        () if options.wall_height_m else (f"the wall height, {height_m} m: tell it with --wall-height",)
    )
    guessed += (
        f"edges are known to one cell, {grid.resolution} m",
        "obstacles reach up to the ceiling: a grid does not tell",
    )
    counts: dict[str, int | float] = {
        "width": grey.shape[1],
        "height": grey.shape[0],
        "occupied_cells": int(occupied.sum()),
        "floor_area_m2": round(plan.floor.area, 3),
        "building_direction_deg": round(math.degrees(direction + grid.origin[2]), 2),
    }
    return imported(content, report + cleaned + Report(counts, (), guessed) + mapped, path)


def _cells(grid: _Grid, grey: Array) -> tuple[Mask, Mask, Report]:
    """Return which cells are free and which occupied, by the thresholds of map_server."""
    share = grey if grid.negate else 1.0 - grey
    occupied = share > grid.occupied_thresh
    free = share < grid.free_thresh
    counts: dict[str, int | float] = {
        "free_cells": int(free.sum()),
        "unknown_cells": int((~free & ~occupied).sum()),
    }
    guessed: tuple[str, ...] = ()
    levels = np.unique(grey)
    unknown = np.abs(grey - UNKNOWN_GREY) < 1e-6
    if len(levels) == 3 and (free & unknown).any() and not grid.negate:
        # With the thresholds that newer tools write, unknown cells of older grids read as free.
        guessed = (f"{int(unknown.sum())} cells of grey 205, map_saver's unknown, are not floor",)
        free = free & ~unknown
    return free, occupied, Report(counts, (), guessed)


def _floor(free: Mask, resolution: float) -> tuple[Mask, Report]:
    """Return the largest free area that is wide enough, without specks of noise, and what was left out."""
    dropped: list[str] = []
    labels, count = ndimage.label(~free, structure=np.ones((3, 3)))
    small = np.flatnonzero(np.bincount(labels.ravel(), minlength=count + 1) < MIN_SPECK)
    specks = np.isin(labels, small[small > 0])
    if specks.any():
        dropped.append(
            f"{counted(len(small[small > 0]), 'speck')} of fewer than {MIN_SPECK} cells on free ground"
        )
    radius = max(1, round(0.5 * MIN_PASSAGE_M / resolution))
    reach = np.arange(-radius, radius + 1)
    disk = reach[:, None] ** 2 + reach[None] ** 2 <= radius**2 + 0.5
    wide = ndimage.binary_opening(free | specks, disk)
    labels, count = ndimage.label(wide)
    if not count:
        return wide, Report()
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    largest = labels == int(np.argmax(sizes)) + 1
    lost = int((free & ~largest).sum())
    if lost:
        area = lost * resolution**2
        dropped.append(
            f"{lost} free cells ({area:.1f} m2) beside the largest area, or in gaps under {MIN_PASSAGE_M} m"
        )
    return largest, Report({}, tuple(dropped))


def _outline(cells: Mask, resolution: float) -> Polygon:
    """Return the outline of connected cells: metres, x right, y up from the picture's lower left corner."""
    rows = len(cells)
    padded = np.pad(cells, ((0, 0), (1, 1))).astype(np.int8)
    row, start = np.nonzero(np.diff(padded, axis=1) == 1)
    _, stop = np.nonzero(np.diff(padded, axis=1) == -1)
    runs = shapely.box(start, rows - 1 - row, stop, rows - row)
    largest = max(polygons_of(shapely.unary_union(runs)), key=lambda part: part.area)
    return shapely.transform(largest, lambda points: points * resolution)


def _in_map(floor: Polygon | MultiPolygon, grid: _Grid) -> MultiPolygon:
    """Move a floor from the picture's lower left corner to the map frame."""
    map_from_grid = Pose2(*grid.origin)
    cos, sin = math.cos(map_from_grid.phi), math.sin(map_from_grid.phi)
    turn = np.array([[cos, sin], [-sin, cos]])
    moved = shapely.transform(floor, lambda points: points @ turn + [map_from_grid.x, map_from_grid.y])
    return MultiPolygon(polygons_of(moved))
