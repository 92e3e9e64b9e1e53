"""What `map visible` prints."""

from __future__ import annotations

import math
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from maps.errors import InputError
from maps.regions import ViewRegions
from maps.wiremap import WireMap


def place(text: str) -> tuple[float, float]:
    """Read X,Y in metres."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError("--at", "", f"expected X,Y in numbers, not {text!r}")
    return x, y


def content_of(
    wire_map: WireMap, regions: ViewRegions, number: int, point: tuple[float, float]
) -> dict[str, Any]:
    """Return a region as plain data; ranges are bearings in the map frame, radians, least and largest."""
    region = regions.region(number)
    segments = [
        {
            "row": row,
            "name": wire_map.names[row],
            "kind": wire_map.kinds[row],
            "range_rad": [round(low, 6), round(high, 6)],
        }
        for row, (low, high) in zip(region.rows.tolist(), region.ranges.tolist(), strict=True)
    ]
    return {
        "at": list(point),
        "height_m": regions.heights_m[0],
        "region": number,
        "regions": len(regions),
        "corners": region.corners.round(4).tolist(),
        "segments": segments,
    }


def print_visible(content: dict[str, Any]) -> None:
    """Print the region and a row a segment, by direction."""
    console = Console()
    corners = " ".join(f"({x:.2f}, {y:.2f})" for x, y in content["corners"])
    said = (
        f"region {content['region']} of {content['regions']}, corners {corners}; "
        f"{len(content['segments'])} segments visible from {content['height_m']:.2f} m"
    )
    console.print(said, soft_wrap=True, highlight=False, markup=False)
    table = Table("segment", "kind", box=SIMPLE_HEAD)
    table.add_column("from, deg", justify="right")
    table.add_column("to, deg", justify="right")
    for segment in sorted(content["segments"], key=lambda segment: segment["range_rad"]):
        low, high = (f"{math.degrees(angle):.1f}" for angle in segment["range_rad"])
        table.add_row(segment["name"], segment["kind"], low, high)
    console.print(table, markup=False)
