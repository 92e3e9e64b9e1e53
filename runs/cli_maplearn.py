"""The command line's `map learn`: what runs tell about a map; what it needs is imported when it runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from maps.errors import InputError
from runs.options import JointsOption, RobotOption, TopicOption
from runs.progress import progress_bar

if TYPE_CHECKING:
    from maps.wiremap import WireMap
    from runs.learning import Drive
    from vision.maplearning import LearntMap, Suspicion

#: Suspicious segments that the terminal tells.
SHOWN = 20


def learn_map(
    map_: Annotated[Path, typer.Argument(metavar="MAP", help="Map file.")],
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders in this building.")],
    out: Annotated[Path, typer.Option(metavar="MAP", help="The map to write.")],
    session: Annotated[
        list[Path] | None,
        typer.Option(metavar="PATH", help="The runs' sessions, in order, where they lie elsewhere by now."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Plan of what was learnt (.png, .svg).")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the map.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
    robot: RobotOption = None,
    topic: TopicOption = None,
    joints: JointsOption = None,
) -> None:
    """Learn from runs how often edges show, which side is bright, how well they are placed; tell what is amiss."""
    from maps.mapdocument import read_document, write_map
    from maps.mapfile import build_map
    from runs.learning import gather, read_drive, written
    from runs.opening import reading_of
    from vision.maplearning import LearningConfig, learn

    if out.exists() and not force:
        raise InputError(out, "", "is there already; --force overwrites it")
    if picture is not None and picture.suffix not in (".png", ".svg"):
        raise InputError("--picture", "", f"expected .png or .svg, not {picture.suffix!r}")
    if session and len(session) != len(runs):
        raise InputError("--session", "", f"{len(session)} sessions for {len(runs)} runs")
    document = read_document(map_)
    wire_map = build_map(document, map_)
    places: list[Path | None] = [*session] if session else [None] * len(runs)
    reading = reading_of(map_, robot, topic, joints)
    drives = [read_drive(run, map_, place, reading) for run, place in zip(runs, places, strict=True)]
    with progress_bar("frames") as progress:
        seen, used = gather(wire_map, drives, progress)
    if seen is None:
        typer.echo("wireloc: no frame of these runs agrees with the map", err=True)
        raise typer.Exit(1)
    learnt = learn(wire_map, seen, LearningConfig())
    write_map(out, written(document, learnt))
    if picture is not None:
        _draw(picture, wire_map, learnt, map_)
    content = content_of(wire_map, learnt, drives, used)
    if as_json:
        typer.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        print_learnt(content)
        typer.echo(str(out))


def content_of(wire_map: WireMap, learnt: LearntMap, drives: list[Drive], used: list[int]) -> dict[str, Any]:
    """Return what was learnt as plain data."""
    import numpy as np

    kinds = np.array(wire_map.kinds)
    return {
        "runs": [
            {
                "run": drive.name,
                "frames": len(drive.session.frames),
                "trusted": len(drive.frames),
                "used": count,
            }
            for drive, count in zip(drives, used, strict=True)
        ],
        "segments": len(wire_map),
        "looked_at": int((learnt.looks > 0).sum()),
        "kinds": [_kind(kind, kinds == kind, learnt) for kind in sorted(set(wire_map.kinds))],
        "suspicious": [_suspicious(wire_map, suspicion) for suspicion in learnt.suspicions],
    }


def _kind(kind: str, own: Any, learnt: LearntMap) -> dict[str, Any]:
    """Means and medians over a kind's segments that were looked at; null where there are none."""
    import numpy as np

    looked = own & (learnt.looks > 0)
    shares = learnt.polarity_share[own & (learnt.seen >= 4)]
    sigmas = learnt.sigma_m[own & np.isfinite(learnt.sigma_m)]
    return {
        "kind": kind,
        "segments": int(own.sum()),
        "looked_at": int(looked.sum()),
        "looks": int(learnt.looks[own].sum()),
        "seen": int(learnt.seen[own].sum()),
        "detection_rate": round(float(learnt.detection_rate[looked].mean()), 3) if looked.any() else None,
        "polarity_known": int(np.count_nonzero(learnt.polarity[own])),
        "polarity_share": round(float(shares.mean()), 3) if len(shares) else None,
        "sigma_m": round(float(np.median(sigmas)), 4) if len(sigmas) else None,
    }


def _suspicious(wire_map: WireMap, suspicion: Suspicion) -> dict[str, Any]:
    offset = suspicion.offset_m
    return {
        "name": wire_map.names[suspicion.row],
        "kind": wire_map.kinds[suspicion.row],
        "fault": suspicion.fault.value,
        "looks": suspicion.looks,
        "seen": suspicion.seen,
        "unseen_chance": float(f"{suspicion.unseen_chance:.3g}"),
        "offset_m": None if offset is None else [round(part, 3) for part in offset],
    }


def print_learnt(content: dict[str, Any]) -> None:
    """Print the kinds, and the segments that are suspicious."""
    console = Console()
    frames = "; ".join(f"{run['run']}: {run['used']} of {run['frames']} frames" for run in content["runs"])
    console.print(frames, soft_wrap=True, highlight=False, markup=False)
    console.print(f"{content['looked_at']} of {content['segments']} segments in view", highlight=False)
    table = Table("kind", box=SIMPLE_HEAD)
    names = ("segments", "looks", "seen", "rate", "sided", "majority", "sigma, m")
    for name in names:
        table.add_column(name, justify="right")
    for kind in content["kinds"]:
        table.add_row(
            kind["kind"],
            f"{kind['looked_at']} of {kind['segments']}",
            str(kind["looks"]),
            str(kind["seen"]),
            *(
                "-" if kind[key] is None else str(kind[key])
                for key in ("detection_rate", "polarity_known", "polarity_share", "sigma_m")
            ),
        )
    console.print(table)
    if not content["suspicious"]:
        return
    table = Table("suspicious", "", "looks", "what", box=SIMPLE_HEAD)
    for found in content["suspicious"][:SHOWN]:
        what = "never seen"
        if found["offset_m"] is not None:
            x, y, z = found["offset_m"]
            what = f"seen {found['seen']} times, off by ({x:+.2f}, {y:+.2f}, {z:+.2f}) m"
        table.add_row(found["name"], found["fault"], str(found["looks"]), what)
    if len(content["suspicious"]) > SHOWN:
        table.add_row(f"and {len(content['suspicious']) - SHOWN} more", "", "", "--json lists all")
    console.print(table)


def _draw(path: Path, wire_map: WireMap, learnt: LearntMap, map_: Path) -> None:
    from maps.mapdocument import write_whole
    from runs.learntplan import draw_learnt
    from runs.mapplan import picture

    name = map_.resolve().parent.name if map_.stem == "map" else map_.stem
    write_whole(path, picture(draw_learnt(wire_map, learnt, name), path.suffix))
