"""The faults by name: what each does, for how long, and to what; one call does it to a recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maps.errors import InputError
from maps.mapdocument import MapDocument
from runs.faults import mapfaults, pictures, timing, wheels
from runs.faults.recording import Recording, Span
from runs.simulation.mishaps import Block, Bump, Flicker, Mishaps, Slip

#: Where a fault begins, at the earliest and at the latest, unless somebody says: shares of the session.
BEGINS, LAST = 0.3, 0.7
#: The fault that can be given a map.
WRONG_MAP = "wrong-map"


#: Adds a fault to what goes wrong while a robot drives.
Happening = Callable[[Mishaps, Span, np.random.Generator], Mishaps]


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault.

    `apply` changes a recording. `lasts_s`: unless somebody says; infinite: to the end. `needs`: images or map, what
    the session must have for it. `driving`: begins where the robot drives most, unless somebody says. `obscures`:
    less can be seen in its pictures. `happening`: how it comes about in a simulated drive; None where a simulated
    session that is changed afterwards is no different.
    """

    apply: Callable[[Recording, Span, np.random.Generator], Recording]
    about: str
    lasts_s: float = math.inf
    needs: str = ""
    driving: bool = False
    obscures: bool = False
    happening: Happening | None = None


def _bump(mishaps: Mishaps, span: Span, rng: np.random.Generator) -> Mishaps:
    x, y, z = pictures.bump_turn(rng).tolist()
    return replace(mishaps, bumps=(*mishaps.bumps, Bump(span.start_ns, span.end_ns, (x, y, z))))


def _flicker(mishaps: Mishaps, span: Span, rng: np.random.Generator) -> Mishaps:
    one = Flicker(span.start_ns, span.end_ns, pictures.band_phase(rng), pictures.STOPS)
    return replace(mishaps, flickers=(*mishaps.flickers, one))


def _slip(mishaps: Mishaps, span: Span, rng: np.random.Generator) -> Mishaps:  # noqa: ARG001
    return replace(mishaps, slips=(*mishaps.slips, Slip(span.start_ns, span.end_ns, wheels.SLIP_M)))


def _block(mishaps: Mishaps, span: Span, rng: np.random.Generator) -> Mishaps:
    one = Block(span.start_ns, span.end_ns, wheels.blocked_side(rng))
    return replace(mishaps, blocks=(*mishaps.blocks, one))


FAULTS: dict[str, Fault] = {
    "blackout": Fault(pictures.blackout, "pictures black", 10.0, "images", obscures=True),
    "whiteout": Fault(pictures.whiteout, "pictures white", 10.0, "images", obscures=True),
    "blur": Fault(
        pictures.blur, "pictures out of focus, by 1 % of their width", 10.0, "images", obscures=True
    ),
    "occluder": Fault(pictures.occluder, "half of the picture covered", 20.0, "images", obscures=True),
    "rolling-exposure": Fault(
        pictures.rolling_exposure,
        "bands of exposure 3 stops apart roll over the pictures",
        20.0,
        "images",
        happening=_flicker,
    ),
    "bumped": Fault(
        pictures.bumped, "camera turned by 1° on its mount, to the end", math.inf, "images", happening=_bump
    ),
    "dropped": Fault(timing.dropped, "half of the frames lost", 20.0),
    "doubled": Fault(timing.doubled, "a third of the frames show the picture before", 20.0),
    "late": Fault(timing.late, "frames arrive up to 3 s late, out of order"),
    "clock-offset": Fault(timing.clock_offset, "the camera's clock is off by 0.1 s"),
    "clock-drift": Fault(timing.clock_drift, "the camera's clock gains or loses 1 ms a second"),
    "odometry-dropout": Fault(wheels.dropout, "odometry's rows lost", 5.0),
    "slip": Fault(wheels.slip, "both wheels roll 0.5 m more than the robot drives", 1.0, happening=_slip),
    "blocked": Fault(wheels.blocked, "one wheel drags without turning", 2.0, driving=True, happening=_block),
    "jump": Fault(wheels.jump, "one encoder jumps by 10 rad between two rows", 0.02),
    "map-missing": Fault(mapfaults.missing, "20 % of the map's edges missing", needs="map"),
    "map-extra": Fault(mapfaults.extra, "20 % of edges more that do not exist", needs="map"),
    "map-moved": Fault(mapfaults.moved, "each edge of the map moved by 5 cm", needs="map"),
    "door-moved": Fault(mapfaults.door_moved, "one door moved by 0.5 m along its wall", needs="map"),
    WRONG_MAP: Fault(mapfaults.wrong, "the map of another building", needs="map"),
}


def chosen_fault(kind: str) -> Fault:
    """Return a fault by its name; InputError lists the names."""
    if kind not in FAULTS:
        raise InputError("--fault", kind, f"is none of {', '.join(FAULTS)}")
    return FAULTS[kind]


def fault_span(
    recording: Recording, fault: Fault, at_s: float | None = None, for_s: float | None = None
) -> Span:
    """Return when a fault holds; `at_s` counts from the session's first event. InputError where that is past its end.

    A fault of the map holds from the beginning, whatever is asked.
    """
    whole = recording.span
    if fault.needs == "map":
        return whole
    lasts_s = fault.lasts_s if for_s is None else for_s
    if at_s is not None:
        start_ns = whole.start_ns + round(at_s * 1e9)
    else:
        start_ns = whole.start_ns + round(BEGINS * (whole.end_ns - whole.start_ns))
        if fault.driving:
            # Early enough to see what comes after.
            last_ns = whole.start_ns + round(LAST * (whole.end_ns - whole.start_ns))
            start_ns = wheels.busiest(recording.session.odometry, lasts_s, start_ns, last_ns)
    if start_ns >= whole.end_ns:
        seconds = (whole.end_ns - whole.start_ns) / 1e9
        raise InputError("--at", f"{at_s}", f"is past the session's end at {seconds:.1f} s")
    end_ns = whole.end_ns if math.isinf(lasts_s) else min(start_ns + round(lasts_s * 1e9), whole.end_ns)
    return Span(start_ns, end_ns)


def corrupted(
    recording: Recording, kind: str, span: Span, seed: int, other: MapDocument | None = None
) -> Recording:
    """Return the recording with a fault; the same seed does the same. `other`: the wrong map, if one is at hand.

    InputError where the session lacks what the fault is done to.
    """
    fault = chosen_fault(kind)
    check_possible(recording, kind)
    if kind == WRONG_MAP and other is not None:
        return replace(recording, document=other)
    changed = fault.apply(recording, span, fault_rng(kind, seed))
    if changed is recording:
        raise InputError(recording.session.folder, "", f"{kind}: there is nothing of that kind in it")
    return changed


def check_possible(recording: Recording, kind: str) -> None:
    """Raise InputError where the session lacks what a fault is done to."""
    needs, folder = chosen_fault(kind).needs, recording.session.folder
    if needs == "images" and not recording.session.frames:
        raise InputError(folder / "frames.csv", "", f"no such file: {kind} is a fault of images")
    if needs == "map" and recording.document is None:
        raise InputError(folder / "map.yaml", "", f"no such file: {kind} is a fault of the map")


def fault_rng(kind: str, seed: int) -> np.random.Generator:
    """Return what a fault draws from: each kind from its own numbers."""
    return np.random.default_rng((seed, list(FAULTS).index(kind)))


def told_of(kind: str, seed: int, span: Span) -> dict[str, object]:
    """Return what is written down of a fault."""
    return {"kind": kind, "seed": seed, "start_s": span.start_ns / 1e9, "end_s": span.end_ns / 1e9}
