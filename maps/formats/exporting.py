"""A map for other programs: a plan as a picture (SVG), an occupancy grid (ROS)."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import shapely
import yaml
from numpy.typing import NDArray

from maps.errors import InputError
from maps.formats.pgm import MAX_PIXELS, pgm_bytes
from maps.mapdocument import MapDocument, write_map, write_whole
from maps.mapfile import build_map
from maps.poses import Array
from maps.wiremap import WireMap

Indices = NDArray[np.int64]

#: Of grids; ROS's own default.
RESOLUTION_M = 0.05
#: Around the floor, so that its walls are inside of the picture.
MARGIN_M = 0.5
#: The plan's scale: one to a hundred on screens of 96 dots an inch.
PIXELS_PER_METRE = 37.8
#: As map_saver writes them.
FREE, OCCUPIED, UNKNOWN = 254, 0, 205
COLOURS = {"floor": "#555", "door": "#c60", "window": "#08a", "corner": "#c00", "ceiling": "none"}


def export_map(document: MapDocument, path: Path, source: Path) -> tuple[str, ...]:
    """Write a map as `path`'s extension says; return sentences on what this format leaves out.

    `.svg`: a plan. `.pgm`: a ROS map, with its YAML beside it. `.yaml`: the native format; everything else
    is refused with InputError. `source`: the map's own path, for errors.
    """
    exporters: dict[str, Callable[[], tuple[str, ...]]] = {
        ".yaml": lambda: _native(document, path),
        ".yml": lambda: _native(document, path),
        ".svg": lambda: _svg(build_map(document, source), path),
        ".pgm": lambda: _ros(build_map(document, source), path),
    }
    exporter = exporters.get(path.suffix.lower())
    if exporter is None:
        raise InputError(path, "", f"format not known; by extension: {', '.join(exporters)}")
    return exporter()


def _native(document: MapDocument, path: Path) -> tuple[str, ...]:
    write_map(path, document)
    return ()


def _svg(wire_map: WireMap, path: Path) -> tuple[str, ...]:
    """Write a plan to scale: floor, edges in plan by kind, uprights as dots, names as tooltips."""
    low_x, low_y, high_x, high_y = _bounds(wire_map)
    width, height = high_x - low_x, high_y - low_y
    rings = [
        "M" + "L".join(f"{x:.3f} {-y:.3f}" for x, y in np.asarray(ring.coords)[:-1].tolist()) + "Z"
        for part in wire_map.floor.geoms
        for ring in (part.exterior, *part.interiors)
    ]
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width * PIXELS_PER_METRE:.0f}" '
        f'height="{height * PIXELS_PER_METRE:.0f}" '
        f'viewBox="{low_x:.3f} {-high_y:.3f} {width:.3f} {height:.3f}">',
        f'<path d="{"".join(rings)}" fill="#e8efe8" stroke="#333" stroke-width="0.02" fill-rule="evenodd"/>',
    ]
    for ends, name, kind in zip(wire_map.endpoints.tolist(), wire_map.names, wire_map.kinds, strict=True):
        rows.append(_svg_edge(ends, escape(name), COLOURS.get(kind, "#777")))
    rows.append("</svg>\n")
    write_whole(path, "\n".join(rows).encode())
    return ("heights are not shown; ceiling lines, which would cover the floor's, are not drawn",)


def _svg_edge(ends: list[list[float]], name: str, colour: str) -> str:
    (x0, y0, _), (x1, y1, _) = ends
    if math.hypot(x1 - x0, y1 - y0) < MARGIN_M * 1e-2:
        return f'<circle cx="{x0:.3f}" cy="{-y0:.3f}" r="0.04" fill="{colour}"><title>{name}</title></circle>'
    return (
        f'<line x1="{x0:.3f}" y1="{-y0:.3f}" x2="{x1:.3f}" y2="{-y1:.3f}" stroke="{colour}" '
        f'stroke-width="0.03"><title>{name}</title></line>'
    )


def _ros(wire_map: WireMap, path: Path) -> tuple[str, ...]:
    """Write the floor as an occupancy grid: free inside, walls occupied, outside unknown."""
    low_x, low_y, high_x, high_y = _bounds(wire_map)
    columns, rows = (math.ceil(size / RESOLUTION_M) for size in (high_x - low_x, high_y - low_y))
    if columns * rows > MAX_PIXELS:
        raise InputError(path, "", f"{columns} x {rows} cells of {RESOLUTION_M} m are too many")
    x = low_x + RESOLUTION_M * (np.arange(columns) + 0.5)
    y = low_y + RESOLUTION_M * (np.arange(rows)[::-1] + 0.5)
    grid_x, grid_y = np.meshgrid(x, y)
    shapely.prepare(wire_map.floor)
    grey = np.where(shapely.contains_xy(wire_map.floor, grid_x, grid_y), FREE, UNKNOWN).astype(np.uint8)
    row, column = _wall_cells(wire_map.walls, np.array([low_x, low_y]), rows)
    grey[row, column] = OCCUPIED
    description = {
        "image": path.name,
        "resolution": RESOLUTION_M,
        "origin": [round(low_x, 4), round(low_y, 4), 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        # Grey 205 must stay unknown.
        "free_thresh": 0.196,
    }
    write_whole(path, pgm_bytes(grey))
    write_whole(path.with_suffix(".yaml"), yaml.safe_dump(description, sort_keys=False).encode())
    edges = f"{len(wire_map)} edges with their names, kinds and heights"
    return (f"a grid holds the floor alone: {edges}, and lintels, are left out",)


def _wall_cells(walls: Array, origin: Array, rows: int) -> tuple[Indices, Indices]:
    """Return the rows and columns of the cells that walls (W, 2, 2) run through."""
    points = [
        start
        + np.linspace(0.0, 1.0, max(2, math.ceil(4.0 * np.linalg.norm(stop - start) / RESOLUTION_M)))[:, None]
        * (stop - start)
        for start, stop in walls
    ]
    cells = np.floor((np.concatenate(points) - origin) / RESOLUTION_M).astype(np.int64)
    return rows - 1 - cells[:, 1], cells[:, 0]


def _bounds(wire_map: WireMap) -> tuple[float, float, float, float]:
    low_x, low_y, high_x, high_y = wire_map.floor.bounds
    return low_x - MARGIN_M, low_y - MARGIN_M, high_x + MARGIN_M, high_y + MARGIN_M
