"""The command line's `map` commands; what they need is imported when they run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from maps.errors import InputError
from runs.cli_mapcoverage import map_coverage
from runs.cli_maplearn import learn_map

#: A camera's usual height above the floor [m], where nobody says.
CAMERA_HEIGHT_M = 1.0
#: No robot's camera is higher.
HIGHEST_M = 20.0

#: What `map show` can write.
PICTURES = (".png", ".svg")
RECORDING = ".rrd"

map_app = typer.Typer(help="Check, show, import and export maps.", no_args_is_help=True)
map_app.command("coverage")(map_coverage)
map_app.command("learn")(learn_map)


@map_app.command("check")
def check_a_map(
    map_: Annotated[Path, typer.Argument(metavar="MAP", help="Map file.")],
    height: Annotated[float, typer.Option(metavar="M", help="Camera height.")] = CAMERA_HEIGHT_M,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """Find everything wrong with a map; ends with 1 where there are errors."""
    from maps.check import check_map
    from maps.findings import Severity
    from runs.cli_mapcheck import content_of, print_check

    with Console(stderr=True).status("building view regions"):
        check = check_map(map_, _heights(height))
    if as_json:
        typer.echo(json.dumps(content_of(check, map_), indent=2))
    else:
        print_check(check)
    if check.count(Severity.ERROR):
        raise typer.Exit(1)


@map_app.command("show")
def show_a_map(
    map_: Annotated[Path, typer.Argument(metavar="MAP", help="Map file.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Picture (.png, .svg) or recording (.rrd).")
    ] = None,
    height: Annotated[float, typer.Option(metavar="M", help="Camera height.")] = CAMERA_HEIGHT_M,
) -> None:
    """Draw a map with its view regions, coloured by what can be seen from them."""
    from maps.mapfile import read_map
    from maps.regioncache import cached_regions

    out = out or Path(f"{map_.stem}.png")
    if out.suffix not in (*PICTURES, RECORDING):
        raise InputError("--out", "", f"expected .png, .svg or .rrd, not {out.suffix!r}")
    if not out.absolute().parent.is_dir():
        raise InputError(out, "", "no such folder to write to")
    wire_map = read_map(map_)
    with Console(stderr=True).status("building view regions"):
        regions = cached_regions(wire_map, _heights(height))
    if out.suffix == RECORDING:
        from runs.maprecording import record_map

        record_map(out, wire_map, regions, map_.stem)
    else:
        from maps.mapdocument import write_whole
        from runs.mapplan import draw_map, picture

        write_whole(out, picture(draw_map(wire_map, regions, map_.stem), out.suffix))
    typer.echo(str(out))


@map_app.command("visible")
def visible_in_a_map(
    map_: Annotated[Path, typer.Argument(metavar="MAP", help="Map file.")],
    at: Annotated[str, typer.Option(metavar="X,Y", help="Place on the floor, metres.")],
    height: Annotated[float, typer.Option(metavar="M", help="Camera height.")] = CAMERA_HEIGHT_M,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """Tell the view region of a place, what can be seen from it, and in which directions."""
    from maps.mapfile import read_map
    from maps.regioncache import cached_regions
    from runs import cli_mapvisible

    point = cli_mapvisible.place(at)
    wire_map = read_map(map_)
    with Console(stderr=True).status("building view regions"):
        regions = cached_regions(wire_map, _heights(height))
    number = regions.at(point)
    if number is None:
        raise InputError("--at", "", f"{at} is not on the floor of {map_}")
    content = cli_mapvisible.content_of(wire_map, regions, number, point)
    if as_json:
        typer.echo(json.dumps(content, indent=2))
    else:
        cli_mapvisible.print_visible(content)


@map_app.command("import")
def import_a_map(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="SDF, DXF, IFC, ROS map (YAML) or line list.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The map to write.")] = Path("map.yaml"),
    wall_height: Annotated[float | None, typer.Option(metavar="M", help="Height of the walls.")] = None,
    layer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=KIND[,BOTTOM,TOP]",
            help="DXF: a layer holds wall, door, window or ignore; its heights.",
        ),
    ] = None,
    storey: Annotated[str | None, typer.Option(metavar="NAME", help="IFC: the storey.")] = None,
    unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="DXF, lines: m, dm, cm, mm, in, ft.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the map.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """Make a map of another format's building; tells what was found, left out and guessed."""
    from maps.formats.imported import ImportOptions
    from maps.formats.importing import import_map
    from maps.mapdocument import write_map
    from runs import cli_maptransfer as transfer

    if out.exists() and not force:
        raise InputError(out, "", "is there already; --force overwrites it")
    height_m = transfer.wall_height(wall_height)
    options = ImportOptions(height_m, transfer.layer_rules(layer or []), storey, transfer.unit_m(unit))
    result = import_map(file, options)
    write_map(out, result.document)
    if as_json:
        typer.echo(json.dumps(transfer.content_of(result, out), indent=2))
    else:
        transfer.print_import(result, out)


@map_app.command("export")
def export_a_map(
    map_: Annotated[Path, typer.Argument(metavar="MAP", help="Map file.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Plan (.svg), ROS map (.pgm) or native (.yaml).")],
) -> None:
    """Write a map for other programs; tells what the format leaves out."""
    from maps.formats.exporting import export_map
    from maps.mapdocument import read_document

    if out.exists() and out.samefile(map_):
        raise InputError(out, "", "is the map itself")
    for sentence in export_map(read_document(map_), out, map_):
        typer.echo(sentence)
    typer.echo(str(out))


def _heights(height_m: float) -> tuple[float, float]:
    """Return the range of camera heights that one height on the command line stands for."""
    if not 0.0 < height_m < HIGHEST_M:
        raise InputError("--height", "", f"expected metres above the floor, up to {HIGHEST_M:g}")
    return height_m, height_m
