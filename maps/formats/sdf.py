"""Gazebo worlds and models (SDF): boxes of static links are walls and the parts over doors and windows."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from maps.documents import read_text
from maps.errors import InputError
from maps.formats.arrangement import MAX_SOLIDS, MAX_STEP_M, Solid, plan_of_solids
from maps.formats.assembly import map_of_plan
from maps.formats.imported import Imported, ImportOptions, Report, imported
from maps.poses import Array

#: A box may lean by this much and still be an upright wall: a rounding error in a file.
_UPRIGHT = math.cos(math.radians(0.5))
_DECLARATION = re.compile(r"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class _Placed:
    """An element of the file, where it is (4, 4), map frame, and what it is called."""

    element: ET.Element
    pose: Array
    name: str


def import_sdf(path: Path, options: ImportOptions) -> Imported:
    """Import a Gazebo model or world.

    Walls are the boxes of the collisions of static models' own links (of the visuals where a link has no
    collision), upright ones. Poses nest: model, link, collision. InputError names what is no SDF.
    """
    root = _read(path)
    models, dropped = _models(root, path)
    solids: list[Solid] = []
    links = 0
    for model in models:
        for link in model.element.findall("link"):
            placed = _inside(model, link, path)
            boxes, left_out = _boxes(placed, path)
            solids += boxes
            dropped += left_out
            links += bool(boxes)
    if not solids:
        raise InputError(path, "", "no upright box of a static link: no walls")
    if len(solids) > MAX_SOLIDS:
        raise InputError(path, "", f"more than {MAX_SOLIDS} boxes")
    height_m = options.wall_height_m or max(solid.top_m for solid in solids)
    plan, planned = plan_of_solids(solids, height_m)
    content, mapped = map_of_plan(plan)
    standing = sum(solid.bottom_m < MAX_STEP_M for solid in solids)
    counts: dict[str, int | float] = {
        "wall_links": links,
        "boxes": len(solids),
        "boxes_from_floor_up": standing,
        "wall_height_m": round(height_m, 4),
    }
    told = [f"{what}: {number}" for what, number in sorted(dropped.items())]
    return imported(content, Report(counts, tuple(told)) + planned + mapped, path)


def _read(path: Path) -> ET.Element:
    text = read_text(path)
    if _DECLARATION.search(text):
        raise InputError(path, "", "XML declarations of types or entities are not supported")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, RecursionError) as error:
        line = f"line {error.position[0]}" if isinstance(error, ET.ParseError) else ""
        raise InputError(path, line, f"not XML: {error}") from None
    if root.tag != "sdf":
        raise InputError(path, "", f"<{root.tag}> is no <sdf>")
    return root


def _models(root: ET.Element, path: Path) -> tuple[list[_Placed], Counter[str]]:
    """Return the static models, and what is left out by kind."""
    holders = [root, *root.findall("world")]
    top = [model for holder in holders for model in holder.findall("model")]
    if not top:
        raise InputError(path, "", "no model")
    # A lone model without the word is taken for the building.
    static = [m for m in top if (m.findtext("static") or "").strip() in ("1", "true") or len(top) == 1]
    dropped: Counter[str] = Counter()
    dropped["models that are not static"] = len(top) - len(static)
    dropped["models inside another one (furniture)"] = sum(len(model.findall("model")) for model in static)
    dropped["includes of other files"] = sum(1 for _ in root.iter("include"))
    world = _Placed(root, np.eye(4), "")
    return [_inside(world, model, path) for model in static], +dropped


def _inside(parent: _Placed, element: ET.Element, path: Path) -> _Placed:
    name = element.get("name") or element.tag
    return _Placed(element, parent.pose @ _pose(element.find("pose"), path, name), name)


def _boxes(link: _Placed, path: Path) -> tuple[list[Solid], Counter[str]]:
    """Return a link's upright boxes, and what else it has by kind."""
    shapes = link.element.findall("collision") or link.element.findall("visual")
    solids: list[Solid] = []
    dropped: Counter[str] = Counter()
    for shape in shapes:
        placed = _inside(link, shape, path)
        size = shape.find("geometry/box/size")
        if size is None:
            geometry = shape.find("geometry")
            kind = geometry[0].tag if geometry is not None and len(geometry) else "shape"
            dropped[f"shapes that are no box ({kind})"] += 1
        elif placed.pose[2, 2] < _UPRIGHT:
            dropped["tilted boxes"] += 1
        else:
            solids.append(_solid(link.name, placed.pose, _numbers(size, 3, path, placed.name)))
    return solids, dropped


def _solid(name: str, pose: Array, size: Array) -> Solid:
    half = 0.5 * size
    corners = [(-half[0], -half[1]), (half[0], -half[1]), (half[0], half[1]), (-half[0], half[1])]
    plan = np.array(corners) @ pose[:2, :2].T + pose[:2, 3]
    return Solid(name, Polygon(plan), float(pose[2, 3] - half[2]), float(pose[2, 3] + half[2]))


def _pose(element: ET.Element | None, path: Path, name: str) -> Array:
    """Return a pose element `x y z roll pitch yaw` as a matrix (4, 4)."""
    if element is None:
        return np.eye(4)
    if element.get("relative_to") or element.get("rotation_format", "euler_rpy") != "euler_rpy":
        raise InputError(path, name, "poses relative to other frames, or as quaternions, are not supported")
    values = _numbers(element, 6, path, name)
    angles = np.radians(values[3:]) if element.get("degrees") in ("true", "1") else values[3:]
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    pose = np.eye(4)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = values[:3]
    return pose


def _numbers(element: ET.Element, count: int, path: Path, name: str) -> Array:
    words = (element.text or "").split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all() or np.abs(values).max() > 1e5:
        raise InputError(path, name, f"<{element.tag}> is not {count} numbers")
    if element.tag == "size" and values.min() <= 0.0:
        raise InputError(path, name, "<size> is not above zero")
    return values
