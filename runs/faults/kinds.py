"""The faults by name: what each does, for how long, and to what; one call does it to a recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maps.errors import InputError
from runs.faults import mapfaults, pictures, timing, wheels
from runs.faults.recording import Recording, Span

#: Where a fault begins, at the earliest and at the latest, unless somebody says: shares of the session.
BEGINS, LAST = 0.3, 0.7


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault.

    `apply` changes a recording. `lasts_s`: unless somebody says; infinite: to the end. `needs`: images or map, what
    the session must have for it. `driving`: begins where the robot drives most, unless somebody says.
    """

    apply: Callable[[Recording, Span, np.random.Generator], Recording]
    about: str
    lasts_s: float = math.inf
    needs: str = ""
    driving: bool = False


FAULTS: dict[str, Fault] = {
    "blackout": Fault(pictures.blackout, "pictures black", 10.0, "images"),
    "whiteout": Fault(pictures.whiteout, "pictures white", 10.0, "images"),
    "blur": Fault(pictures.blur, "pictures out of focus, by 1 % of their width", 10.0, "images"),
    "occluder": Fault(pictures.occluder, "half of the picture covered", 20.0, "images"),
    "rolling-exposure": Fault(
        pictures.rolling_exposure, "bands of exposure 3 stops apart roll over the pictures", 20.0, "images"
    ),
    "bumped": Fault(pictures.bumped, "camera turned by 1° on its mount, to the end", math.inf, "images"),
    "dropped": Fault(timing.dropped, "half of the frames lost", 20.0),
    "doubled": Fault(timing.doubled, "a third of the frames show the picture before", 20.0),
    "late": Fault(timing.late, "frames arrive up to 3 s late, out of order"),
    "clock-offset": Fault(timing.clock_offset, "the camera's clock is off by 0.1 s"),
    "clock-drift": Fault(timing.clock_drift, "the camera's clock gains or loses 1 ms a second"),
    "odometry-dropout": Fault(wheels.dropout, "odometry's rows lost", 5.0),
    "slip": Fault(wheels.slip, "both wheels roll 0.5 m more than the robot drives", 1.0),
    "blocked": Fault(wheels.blocked, "one wheel drags without turning", 2.0, driving=True),
    "jump": Fault(wheels.jump, "one encoder jumps by 10 rad between two rows", 0.02),
    "map-missing": Fault(mapfaults.missing, "20 % of the map's edges missing", needs="map"),
    "map-extra": Fault(mapfaults.extra, "20 % of edges more that do not exist", needs="map"),
    "map-moved": Fault(mapfaults.moved, "each edge of the map moved by 5 cm", needs="map"),
    "door-moved": Fault(mapfaults.door_moved, "one door moved by 0.5 m along its wall", needs="map"),
    "wrong-map": Fault(mapfaults.wrong, "the map of another building", needs="map"),
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


def corrupted(recording: Recording, kind: str, span: Span, seed: int) -> Recording:
    """Return the recording with a fault; the same seed does the same.

    InputError where the session lacks what the fault is done to.
    """
    fault = chosen_fault(kind)
    folder = recording.session.folder
    if fault.needs == "images" and not recording.session.frames:
        raise InputError(folder / "frames.csv", "", f"no such file: {kind} is a fault of images")
    if fault.needs == "map" and recording.document is None:
        raise InputError(folder / "map.yaml", "", f"no such file: {kind} is a fault of the map")
    number = list(FAULTS).index(kind)
    changed = fault.apply(recording, span, np.random.default_rng((seed, number)))
    if changed is recording:
        raise InputError(folder, "", f"{kind}: there is nothing of that kind in it")
    return changed
