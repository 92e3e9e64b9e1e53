"""The real test: the frames of a recorded session one by one, with estimates about the truth (paper, section 4.2).

As with the synthetic images, the estimate of each frame is uniform in the disc and the range of QI 3 about the
true pose: the question is what a look at one image gives, whatever the odometry was like. The truth serves for
drawing that estimate and for judging; a method sees neither.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from maps.errors import InputError
from maps.outcomes import Fix, SearchWindow
from maps.poses import Pose2
from runs.evaluation import WRONG_FIX_M, WRONG_FIX_RAD, read_truth
from runs.experiments.cases import QUALITIES
from runs.experiments.methods import Method
from runs.records import outcome_name
from runs.session import Frame, Session
from runs.tracks import interpolate, spread
from vision.camera import Camera
from vision.lines import LineConfig, extract_segments


@dataclass(frozen=True, slots=True)
class Look:
    """One method on one frame: a row of table 4, and how long it took.

    `outcome`: FIX, PARTIAL, AMBIGUOUS or NO_FIX. `heading_deg`, `position_m`: errors, None without a fix.
    """

    filename: str
    method: str
    outcome: str
    heading_deg: float | None
    position_m: float | None
    lines: int
    hypotheses: int
    correspondences: int
    exhausted: bool
    ms: float

    @property
    def wrong(self) -> bool:
        """Whether it is a whole fix that is far from the truth."""
        if self.outcome != "FIX" or self.position_m is None or self.heading_deg is None:
            return False
        return self.position_m > WRONG_FIX_M or self.heading_deg > math.degrees(WRONG_FIX_RAD)


@dataclass(frozen=True, slots=True, eq=False)
class SessionStudy:
    """All methods on a frame; called with the frame's number, anywhere and in any order."""

    camera: Camera
    frames: tuple[Frame, ...]
    truths: tuple[Pose2, ...]
    methods: tuple[Method, ...]
    lines: LineConfig
    seed: int

    def __call__(self, number: int) -> list[Look]:
        """Extract the frame's lines once and let every method look at them."""
        frame, truth = self.frames[number], self.truths[number]
        image = frame.image()
        if image.shape != (self.camera.height, self.camera.width):
            size = f"{image.shape[1]} x {image.shape[0]} px"
            raise InputError(
                frame.path, "", f"{size}, by robot.yaml {self.camera.width} x {self.camera.height}"
            )
        segments = extract_segments(image, self.camera, self.lines)
        window = self._estimate(number, truth)
        looks = []
        for method in self.methods:
            answer = method.match_segments(self.camera, segments, window)
            outcome = answer.outcome
            error = outcome.belief.pose.minus(truth) if isinstance(outcome, Fix) else None
            looks.append(
                Look(
                    filename=frame.filename,
                    method=method.name,
                    outcome=outcome_name(outcome),
                    heading_deg=None if error is None else abs(math.degrees(error[2])),
                    position_m=None if error is None else math.hypot(error[0], error[1]),
                    lines=len(segments),
                    hypotheses=outcome.look.hypotheses,
                    correspondences=len(outcome.look.matched_map),
                    exhausted=answer.exhausted,
                    ms=answer.total_ms,
                )
            )
        return looks

    def _estimate(self, number: int, truth: Pose2) -> SearchWindow:
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(number,)))
        dt_m, dphi_deg = QUALITIES["qi3"]
        dphi_rad = math.radians(dphi_deg)
        shift, bearing = dt_m * math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi)
        centre = Pose2(
            truth.x + shift * math.cos(bearing),
            truth.y + shift * math.sin(bearing),
            truth.phi + rng.uniform(-dphi_rad, dphi_rad),
        )
        return SearchWindow(centre, dt_m, dphi_rad)


def session_study(
    session: Session, methods: tuple[Method, ...], lines: LineConfig, images: int, seed: int
) -> SessionStudy:
    """Choose frames with a known pose, evenly over the session; InputError where there are none."""
    truth = read_truth(session.folder)
    if truth is None:
        raise InputError(session.folder, "", "no ground_truth.csv in it: nothing to judge poses by")
    if not session.frames or session.camera is None:
        raise InputError(session.folder, "", "no images to match")
    poses = interpolate(np.array([frame.stamp_ns for frame in session.frames]), truth)
    known = np.flatnonzero(np.isfinite(poses).all(axis=1))
    if not len(known):
        raise InputError(session.folder / "ground_truth.csv", "", "no frame's pose and heading are in it")
    chosen = known[np.unique(np.linspace(0, len(known) - 1, min(images, len(known))).round().astype(int))]
    return SessionStudy(
        camera=session.camera,
        frames=tuple(session.frames[number] for number in chosen),
        truths=tuple(Pose2.from_array(poses[number]) for number in chosen),
        methods=methods,
        lines=lines,
        seed=seed,
    )


def session_summary(looks: Sequence[Look], name: str, seed: int) -> dict[str, Any]:
    """Return each method's counts and errors, and every row; errors are of whole fixes, wrong ones included."""
    methods = dict.fromkeys(look.method for look in looks)
    return {
        "session": name,
        "images": len(looks) // max(len(methods), 1),
        "seed": seed,
        "results": [
            _figures(method, [look for look in looks if look.method == method]) for method in methods
        ],
        "rows": [asdict(look) for look in looks],
    }


def _figures(method: str, looks: Sequence[Look]) -> dict[str, Any]:
    fixes = [look for look in looks if look.outcome == "FIX"]
    counts = {
        key: sum(look.outcome == outcome for look in looks)
        for key, outcome in (
            ("fixes", "FIX"),
            ("partial", "PARTIAL"),
            ("ambiguous", "AMBIGUOUS"),
            ("no_fix", "NO_FIX"),
        )
    }
    return {
        "method": method,
        **counts,
        "wrong": sum(look.wrong for look in looks),
        "exhausted": sum(look.exhausted for look in looks),
        "heading_error_deg": asdict(spread(np.array([look.heading_deg for look in fixes], float))),
        "position_error_m": asdict(spread(np.array([look.position_m for look in fixes], float))),
        "hypotheses": float(np.median([look.hypotheses for look in looks])),
        "correspondences": float(np.median([look.correspondences for look in looks])),
        "ms": float(np.median([look.ms for look in looks])),
    }
