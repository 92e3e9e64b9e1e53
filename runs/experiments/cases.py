"""What the synthetic images of an experiment are like: the paper's section 4.1, and what goes beyond it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from maps.errors import InputError

#: Table 1: relative error of the scale, error of the principal point (f / 500), of a line's direction and offset.
STD_SCALE = 0.02
STD_CENTRE_PX = 2.0
STD_ANGLE_RAD = math.radians(1.0)
STD_OFFSET_PX = 3.0

#: Table 2: the quality of the initial estimate, metres and degrees.
QUALITIES = {"qi1": (0.30, 10.0), "qi2": (0.50, 15.0), "qi3": (0.75, 20.0)}

#: Viewed segments, and added lines, of one image.
FEWEST, MOST = 5, 12
CLUTTER_COUNTS = (5, 10, 20, 40, 60)


@dataclass(frozen=True, slots=True)
class Case:
    """One kind of images and initial estimates; the defaults are the paper's, at its worst estimate.

    `dt_m`, `dphi_rad`: the estimate is uniform in a disc and in a range about the truth; infinite where there
    is none, and the whole floor is searched. `noise`: factor on table 1. `per_point`: calibration errors drawn
    for each end point instead of once an image. `clutter`: added lines, None for 5 to 12. `missed`: share of the
    viewed segments that is not extracted. `fragments`: long segments are broken. `std_tilt_rad`: error of the
    camera's pitch, which the methods are told.
    """

    name: str
    title: str
    dt_m: float = QUALITIES["qi3"][0]
    dphi_rad: float = math.radians(QUALITIES["qi3"][1])
    noise: float = 1.0
    per_point: bool = False
    clutter: int | None = None
    missed: float = 0.0
    fragments: bool = False
    std_tilt_rad: float = 0.0


def _cases() -> tuple[Case, ...]:
    found = [
        Case(name, f"QI {name[-1]}: {metres:.2f} m, {degrees:.0f}°", metres, math.radians(degrees))
        for name, (metres, degrees) in QUALITIES.items()
    ]
    found += [
        Case("far", "1.5 m, 40°", 1.5, math.radians(40.0)),
        Case("global", "no initial estimate", math.inf, math.pi),
        Case("point_noise", "calibration errors per end point", per_point=True),
        Case("low_noise", "a tenth of the noise", noise=0.1),
        Case("no_noise", "no noise", noise=0.0),
        Case("missed", "30 % of the segments missed", missed=0.3),
        Case("fragments", "segments in fragments", fragments=True),
        Case("tilt", "tilt off by 1° rms", std_tilt_rad=math.radians(1.0)),
    ]
    return (*found, *(Case(f"clutter{n}", f"{n} added lines", clutter=n) for n in CLUTTER_COUNTS))


#: By name, in the order of every table.
CASES = {case.name: case for case in _cases()}


def chosen_cases(names: str) -> tuple[Case, ...]:
    """Return cases by their names, separated by commas; InputError for a name that is none."""
    wanted = [name.strip() for name in names.split(",") if name.strip()]
    unknown = [name for name in wanted if name not in CASES]
    if unknown or not wanted:
        raise InputError("--cases", "", f"{', '.join(unknown) or 'none'} is not among {', '.join(CASES)}")
    return tuple(CASES[name] for name in dict.fromkeys(wanted))
