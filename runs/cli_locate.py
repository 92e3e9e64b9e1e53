"""The command line's `locate` command: one photograph, one pose; what it needs is imported when it runs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maps.errors import InputError
from runs.cli_camera import camera_of, check_size
from runs.options import numbers
from runs.progress import busy_with

if TYPE_CHECKING:
    from maps.outcomes import Outcome, PoseBelief, SearchWindow
    from vision.camera import Camera
    from vision.matcher import LineMatcher, MatcherConfig

#: How far off --near may be, where nobody says.
WITHIN = "0.75,20"


def locate_image(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="A photograph.")],
    map_: Annotated[Path, typer.Option("--map", metavar="FILE", help="Map (map.yaml).")],
    robot: Annotated[Path, typer.Option(metavar="FILE", help="robot.yaml, for the camera and its mount.")],
    near: Annotated[
        str | None, typer.Option(metavar="X,Y,PHI", help="About where: metres, radians. Else anywhere.")
    ] = None,
    within: Annotated[
        str | None,
        typer.Option(metavar="DT_M,DPHI_DEG", help=f"How far off it may be; {WITHIN} unless told."),
    ] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Picture (.png); results/<image>-located.png unless told."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Parameters that differ (YAML).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")] = False,
) -> None:
    """Tell from one photograph where the robot stood, or the places that it cannot tell apart."""
    from maps.mapdocument import write_whole
    from maps.outcomes import NoFix
    from runs.config import RunConfig, read_config
    from vision.images import read_image
    from vision.overlay import matched_png

    window = _window(near, within)
    if overlay is not None and overlay.suffix != ".png":
        raise InputError("--overlay", "", "draws into a .png")
    parameters = (read_config(config) if config else RunConfig()).matcher
    camera = camera_of(robot)
    grey = read_image(image)
    check_size(grey, camera, image)
    with busy_with("working out what can be seen from where; kept for later pictures"):
        matcher = _matcher(map_, camera, parameters)
    with busy_with("looking; the first picture after an installation takes a minute, for compiling"):
        outcome = matcher.match(grey, 0, window)
    picture = overlay or Path("results") / f"{image.stem}-located.png"
    write_whole(picture, matched_png(grey, outcome.look))
    answer = _answer(outcome) | {"overlay": str(picture), "ms": matcher.timing_ms}
    typer.echo(json.dumps(answer) if as_json else _told(answer))
    if isinstance(outcome, NoFix):
        if near is not None:
            hint = f"searched within {within or WITHIN} (m, degrees) of --near; without --near, everywhere"
            typer.echo(hint, err=True)
        raise typer.Exit(1)


def _window(near: str | None, within: str | None) -> SearchWindow:
    from maps.outcomes import SearchWindow
    from maps.poses import Pose2

    if near is None:
        if within is not None:
            raise InputError("--within", "", "says nothing without --near")
        return SearchWindow.everywhere()
    x, y, phi = numbers("--near", near, "X,Y,PHI", (3,))
    dt_m, dphi_deg = numbers("--within", within or WITHIN, "DT_M,DPHI_DEG", (2,))
    if dt_m <= 0.0 or dphi_deg <= 0.0:
        raise InputError("--within", "", "not above zero")
    return SearchWindow(Pose2(x, y, phi), dt_m, min(math.radians(dphi_deg), math.pi))


def _matcher(path: Path, camera: Camera, parameters: MatcherConfig) -> LineMatcher:
    from maps.mapfile import read_map
    from maps.regioncache import cached_regions
    from vision.matcher import LineMatcher

    wire_map = read_map(path)
    height = camera.mount.height_m
    return LineMatcher(camera, wire_map, parameters, cached_regions(wire_map, (height, height)))


def _answer(outcome: Outcome) -> dict[str, Any]:
    """The outcome as a program reads it; poses the likeliest first."""
    from maps.outcomes import Ambiguous, Fix

    look = outcome.look
    seen = {"matches": len(set(look.matched_map.tolist())), "lines": len(look.lines_px), "score": look.score}
    match outcome:
        case Fix(belief=belief):
            kind = "PARTIAL" if outcome.partial else "FIX"
            return {"outcome": kind, "reason": None, "poses": [_pose(belief, 1.0)], **seen}
        case Ambiguous(beliefs=beliefs, odds=odds):
            poses = [_pose(belief, share) for belief, share in zip(beliefs, odds, strict=True)]
            return {"outcome": "AMBIGUOUS", "reason": None, "poses": poses, **seen}
        case _:
            return {"outcome": "NO_FIX", "reason": outcome.reason.value, "poses": [], **seen}


def _pose(belief: PoseBelief, odds: float) -> dict[str, Any]:
    return {
        "x_m": belief.pose.x,
        "y_m": belief.pose.y,
        "phi_rad": belief.pose.phi,
        "position_std_m": belief.position_std_m,
        "heading_std_rad": belief.heading_std_rad,
        "covariance": belief.covariance.tolist(),
        "odds": odds,
    }


def _told(answer: dict[str, Any]) -> str:
    """The answer in a few lines."""
    if answer["outcome"] == "NO_FIX":
        from runs.worst import BEHIND

        lines = [f"no fix: {answer['reason']}, {BEHIND[answer['reason']]}"]
    else:
        lines = [
            f"x {pose['x_m']:.3f} m, y {pose['y_m']:.3f} m, phi {pose['phi_rad']:.4f} rad"
            f" ({math.degrees(pose['phi_rad']):.1f}°), ± {pose['position_std_m']:.3f} m,"
            f" {math.degrees(pose['heading_std_rad']):.2f}°"
            + ("" if pose["odds"] == 1.0 else f"; odds {100.0 * pose['odds']:.0f} %")
            for pose in answer["poses"]
        ]
    if answer["outcome"] in ("AMBIGUOUS", "PARTIAL"):
        lines.insert(0, answer["outcome"].lower())
    lines.append(
        f"{answer['matches']} edges of the map matched among {answer['lines']} lines; {answer['overlay']}"
    )
    return "\n".join(lines)
