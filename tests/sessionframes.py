"""Frames of rendered sessions with their truth, and matchers' answers judged against it."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maps.mapfile import read_map
from maps.outcomes import Ambiguous, Fix, Outcome, SearchWindow
from maps.poses import Pose2, wrap_angle
from maps.regioncache import cached_regions
from maps.regions import ViewRegions
from maps.wiremap import WireMap
from runs.robot import read_robot
from vision.camera import Camera
from vision.images import GreyImage, read_image

RENDERED = ("building_a", "building_b", "building_0001", "building_0001_return", "building_0002")
#: A fix that is farther off than this is wrong.
WRONG_M, WRONG_RAD = 0.30, math.radians(5.0)
#: Half sizes of windows: while tracking, and the paper's uncertainties QI 1 and QI 3.
TRACKING, QI1, QI3 = (0.15, math.radians(3.0)), (0.30, math.radians(10.0)), (0.75, math.radians(20.0))
#: Share of a window in which truth is drawn: no filter's window ends at the truth.
_DRAWN_SHARE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One image file, where it was taken, and how many map edges show in it."""

    path: Path
    truth: Pose2
    observable: int

    @property
    def image(self) -> GreyImage:
        """Grey levels (H, W)."""
        return read_image(self.path)


@dataclass(frozen=True, slots=True, eq=False)
class RenderedSession:
    """A session's camera, map, view regions and frames."""

    name: str
    camera: Camera
    wire_map: WireMap
    regions: ViewRegions
    frames: tuple[Frame, ...]


def rendered_session(folder: Path) -> RenderedSession:
    """Read a rendered session's folder; the regions come from the cache or go into it."""
    camera = read_robot(folder / "robot.yaml").camera
    assert camera is not None
    wire_map = read_map(folder / "map.yaml")
    tables = [_rows(folder / f"{name}.csv") for name in ("frames", "ground_truth", "observable")]
    frames = tuple(
        Frame(
            folder / frame["filename"],
            Pose2(float(at["x_m"]), float(at["y_m"]), float(at["phi_rad"])),
            int(seen["observable"]),
        )
        for frame, at, seen in zip(*tables, strict=True)
    )
    regions = cached_regions(wire_map, (camera.mount.height_m, camera.mount.height_m))
    return RenderedSession(folder.name, camera, wire_map, regions, frames)


def rendered_sessions(data: Path) -> Iterator[RenderedSession]:
    """The development data's rendered sessions, one at a time."""
    return (rendered_session(data / "rendered" / name) for name in RENDERED)


def drawn_window(truth: Pose2, size: tuple[float, float], rng: np.random.Generator) -> SearchWindow:
    """Return a window of half size (m, rad) with the truth uniformly inside."""
    away, bearing = _DRAWN_SHARE * size[0] * math.sqrt(rng.uniform()), rng.uniform(0.0, 2.0 * math.pi)
    turn = _DRAWN_SHARE * size[1] * rng.uniform(-1.0, 1.0)
    x, y = truth.x + away * math.cos(bearing), truth.y + away * math.sin(bearing)
    return SearchWindow(Pose2(x, y, truth.phi + turn), *size)


def is_right(pose: Pose2, truth: Pose2) -> bool:
    """Whether a pose is within 0.30 m and 5 degrees of the truth."""
    near = math.hypot(pose.x - truth.x, pose.y - truth.y) <= WRONG_M
    return near and abs(wrap_angle(pose.phi - truth.phi)) <= WRONG_RAD


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a matcher made of one frame; errors are NaN where there is no whole fix.

    `nees`: squared error over the stated covariance, per degree of freedom. `offered`: whether an ambiguous
    answer holds the truth.
    """

    session: str
    number: int
    observable: int
    outcome: str
    right: bool = False
    offered: bool = False
    error_m: float = math.nan
    error_rad: float = math.nan
    nees: float = math.nan

    @property
    def fixed(self) -> bool:
        """Whether there is a whole fix."""
        return not math.isnan(self.error_m)

    @property
    def wrong(self) -> bool:
        """Whether there is a whole fix, elsewhere."""
        return self.fixed and not self.right


def judged(session: RenderedSession, number: int, outcome: Outcome) -> Verdict:
    """Weigh an outcome on a session's frame; a partial fix is none."""
    frame = session.frames[number]
    kind = type(outcome).__name__
    if isinstance(outcome, Fix):
        if outcome.partial:
            return Verdict(session.name, number, frame.observable, "Partial")
        belief = outcome.belief
        away = belief.pose.minus(frame.truth)
        return Verdict(
            session.name,
            number,
            frame.observable,
            kind,
            right=is_right(belief.pose, frame.truth),
            error_m=math.hypot(away[0], away[1]),
            error_rad=abs(float(away[2])),
            nees=float(away @ np.linalg.solve(belief.covariance, away)) / 3.0,
        )
    if isinstance(outcome, Ambiguous):
        offered = any(is_right(belief.pose, frame.truth) for belief in outcome.beliefs)
        return Verdict(session.name, number, frame.observable, kind, offered=offered)
    return Verdict(session.name, number, frame.observable, outcome.reason.value)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))
