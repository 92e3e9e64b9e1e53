"""The command line's `map coverage`: where a robot will know where it is; what it needs is imported when it runs."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from maps.errors import InputError
from runs.progress import progress_bar

if TYPE_CHECKING:
    from maps.rooms import Room
    from maps.wiremap import WireMap
    from runs.coverage import Coverage

CELL_M, HEADINGS = 0.5, 16
#: Cells and headings beyond these are slips of the pen.
LEAST_CELL_M, MOST_CELL_M, MOST_HEADINGS = 0.05, 10.0, 360
#: Places, and pairs of rooms, that the terminal tells.
SHOWN = 8


def map_coverage(
    map_: Annotated[Path, typer.Argument(metavar="MAP", help="Map file.")],
    robot: Annotated[Path, typer.Option(metavar="FILE", help="robot.yaml, for its camera.")],
    cell: Annotated[float, typer.Option(metavar="M", help="Distance between places.")] = CELL_M,
    headings: Annotated[int, typer.Option(metavar="N", help="Headings at each place.")] = HEADINGS,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where figures, picture and recording go.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """Foretell how well a robot's fixes would be, and which places it would mistake, all over the floor."""
    from maps.mapfile import read_map
    from maps.rooms import rooms_of
    from runs.coverage import cover, places_on
    from runs.robot import read_robot

    if not LEAST_CELL_M <= cell <= MOST_CELL_M:
        raise InputError("--cell", "", f"expected {LEAST_CELL_M:g} to {MOST_CELL_M:g} m, not {cell:g}")
    if not 1 <= headings <= MOST_HEADINGS:
        raise InputError("--headings", "", f"expected 1 to {MOST_HEADINGS}, not {headings}")
    if out is not None and out.exists() and not out.is_dir():
        raise InputError(out, "", "is there already, and is not a folder")
    wire_map, camera = read_map(map_), read_robot(robot).camera
    if camera is None:
        raise InputError(robot, "camera", "missing")
    places = places_on(wire_map, cell)
    if not len(places):
        raise InputError("--cell", "", f"{cell:g} m is too coarse: no cell's centre lies on the floor")
    with progress_bar("places") as progress:
        coverage = cover(wire_map, camera, places, cell, headings, progress)
    content = content_of(coverage)
    if out is not None:
        name = map_.resolve().parent.name if map_.stem == "map" else map_.stem
        _write(out, name, wire_map, coverage, content)
    if as_json:
        typer.echo(json.dumps(content, allow_nan=False))
        return
    print_coverage(coverage, rooms_of(wire_map))
    if out is not None:
        typer.echo(str(out))


def content_of(coverage: Coverage) -> dict[str, Any]:
    """Return a coverage as plain data; null where nothing constrains, or there is too little to compare."""
    cells = []
    for place, (x, y) in enumerate(coverage.places.tolist()):
        headings = [
            {
                "phi": round(phi, 6),
                "segments": int(coverage.segments[place, row]),
                "sigma_m": [_figure(value) for value in coverage.sigma_m[place, row]],
                "sigma_phi": _figure(coverage.sigma_phi[place, row]),
                "lookalikes": None if math.isnan(twins := coverage.twins[place, row]) else int(twins),
            }
            for row, phi in enumerate(coverage.headings.tolist())
        ]
        cells.append({"x": round(x, 4), "y": round(y, 4), "headings": headings})
    return {"cell_m": coverage.cell_m, "cells": cells}


def print_coverage(coverage: Coverage, rooms: tuple[Room, ...]) -> None:
    """Print shares, the worst places, and the rooms with look-alikes."""
    from runs.coverage import FIX_M, GOOD_M

    console = Console()
    count = f"{len(coverage.places)} places x {len(coverage.headings)} headings"
    console.print(f"{count}, {coverage.cell_m:g} m apart", highlight=False)
    table = Table(box=None, show_header=False, pad_edge=False)
    for name, share in (
        (f"position better than {GOOD_M:g} m", coverage.share(GOOD_M)),
        (f"position better than {FIX_M:g} m", coverage.share(FIX_M)),
        ("some direction unconstrained", 1.0 - coverage.share(math.inf)),
        ("look-alikes elsewhere", float(coverage.mistakable.mean())),
    ):
        table.add_row(name, f"{share:.1%}")
    console.print(table, highlight=False)
    _print_worst(console, coverage)
    _print_rooms(console, coverage, rooms)


def _print_worst(console: Console, coverage: Coverage) -> None:
    """The places where fewest headings give a fix: there, more edges in the map would help."""
    import numpy as np

    from runs.coverage import FIX_M

    fixes = coverage.worst_sigma_m < FIX_M
    best = coverage.worst_sigma_m.min(axis=1)
    order = np.lexsort([-best, fixes.mean(axis=1)])[:SHOWN]
    table = Table("worst places", box=SIMPLE_HEAD)
    for heading in ("headings with a fix", "best, m", "segments in view", "look-alikes"):
        table.add_column(heading, justify="right")
    for place in order.tolist():
        x, y = coverage.places[place]
        table.add_row(
            f"({x:.2f}, {y:.2f})",
            f"{fixes[place].sum()} of {len(coverage.headings)}",
            f"{best[place]:.3f}" if math.isfinite(best[place]) else "-",
            f"{coverage.segments[place].min()} to {coverage.segments[place].max()}",
            f"{coverage.mistakable[place].mean():.0%}",
        )
    console.print(table)


def _print_rooms(console: Console, coverage: Coverage, rooms: tuple[Room, ...]) -> None:
    """Which room is taken for which, by the share of its places and headings."""
    from runs.coverage import rooms_at

    here = rooms_at(rooms, coverage.places)
    there = rooms_at(rooms, coverage.twin_poses[:, :2])
    looks: Counter[tuple[int, int]] = Counter()
    seen: set[tuple[int, int, int]] = set()
    for (place, heading), other in zip(coverage.twin_of.tolist(), there.tolist(), strict=True):
        if here[place] >= 0 and other >= 0 and (place, heading, other) not in seen:
            seen.add((place, heading, other))
            looks[int(here[place]), other] += 1
    if not looks:
        return
    table = Table("room", "looks like", box=SIMPLE_HEAD)
    table.add_column("looks", justify="right")
    table.add_column("of the room's", justify="right")
    for (room, other), count in looks.most_common(SHOWN):
        alike = "itself, elsewhere" if room == other else rooms[other].name
        all_looks = int((here == room).sum()) * len(coverage.headings)
        table.add_row(rooms[room].name, alike, str(count), f"{count / all_looks:.0%}")
    console.print(table)


def _write(out: Path, name: str, wire_map: WireMap, coverage: Coverage, content: dict[str, Any]) -> None:
    """Write coverage.json, coverage.png and coverage.rrd."""
    from maps.mapdocument import write_whole
    from runs.coverageplan import draw_coverage
    from runs.coveragerecording import record_coverage
    from runs.mapplan import picture

    write_whole(out / "coverage.json", json.dumps(content, allow_nan=False).encode())
    write_whole(out / "coverage.png", picture(draw_coverage(wire_map, coverage, name), ".png"))
    record_coverage(out / "coverage.rrd", wire_map, coverage, name)


def _figure(value: float) -> float | None:
    """A figure to four digits behind the point of its size; None for what is infinite."""
    return float(f"{value:.4g}") if math.isfinite(value) else None
