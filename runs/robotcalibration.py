"""A robot's wheels, camera mount and clocks from one drive: run it, match, solve; match better, solve again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from maps.errors import InputError
from maps.poses import Array
from runs.config import RunConfig
from runs.robotparameters import Doubts, names_of, prior_of, unit_of, with_robot
from runs.robotproblem import NoiseModel, Prior, Problem, View
from runs.robotsolve import Solution, SolveConfig, solve, torn
from runs.robottilt import TiltConfig, with_best_tilt
from runs.robotviews import (
    Shot,
    ViewConfig,
    chosen_frames,
    record_of,
    taken,
    trusted_poses,
    views_of,
)
from runs.runlog import NullLog
from runs.runner import Progress, run_session
from runs.session import Session
from vision.projection import Projector
from vision.seenlines import MOUNT_PARAMETERS, MapLines

_MOUNT = len(MOUNT_PARAMETERS)
#: Floors are not flat: no camera's height is known better than this.
_LEAST_M = 0.001


@dataclass(frozen=True, slots=True)
class RobotCalibrationConfig:
    """Parameters of a calibration; see their own classes for units and reasons.

    `runs`: through the whole session, each with the robot that came of the one before. `shown`: a parameter is shown
    where its deviation is below this share of what it was before. `fewest_views`: fewer frames than this say
    nothing. `torn_chi2`: 99.9 % gate of the motion between two frames, for frames that odometry contradicts.
    """

    run: RunConfig = field(default_factory=RunConfig)
    views: ViewConfig = field(default_factory=ViewConfig)
    tilt: TiltConfig = field(default_factory=TiltConfig)
    doubts: Doubts = field(default_factory=Doubts)
    noise: NoiseModel = field(default_factory=NoiseModel)
    solve: SolveConfig = field(default_factory=SolveConfig)
    runs: int = 2
    shown: float = 0.5
    fewest_views: int = 8
    torn_chi2: float = 16.27

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True, slots=True, eq=False)
class RobotCalibration:
    """What a drive shows of a robot, by parameter, (10,) each, as `names` says.

    `estimates`: the prior's values where the drive does not show them. `std`: of the estimates; for what is not
    shown what is known beforehand. `frames`: used, of `offered`; `lines`: matched in them; `spreads`: of each kind
    of error, over what was expected.
    """

    names: tuple[str, ...]
    prior: Prior
    estimates: Array
    std: Array
    shown: NDArray[np.bool_]
    frames: int
    offered: int
    lines: int
    spreads: Mapping[str, float]

    @property
    def found(self) -> dict[str, float]:
        """The estimates of what is shown, by name."""
        return self._shown(self.estimates)

    @property
    def deviations(self) -> dict[str, float]:
        """Their standard deviations, by name."""
        return self._shown(self.std)

    def _shown(self, values: Array) -> dict[str, float]:
        columns = zip(self.names, values.tolist(), self.shown, strict=True)
        return {name: value for name, value, shown in columns if shown}


@dataclass(frozen=True, slots=True)
class Uncalibrated:
    """A drive that says nothing, and why."""

    why: str


def calibrate_robot(
    session: Session, config: RobotCalibrationConfig, progress: Progress
) -> RobotCalibration | Uncalibrated:
    """Calibrate from a session with images; the truth, where there is one, is not read.

    `progress`: told how many images are done, and of how many, each counted as often as it is looked at.
    InputError where the session has no images, or they do not fit the camera.
    """
    if not session.frames or session.camera is None or session.wire_map is None:
        raise InputError(session.folder, "", "no images, and a calibration needs them")
    by_wheels = session.odometry.wheels is not None
    prior, stated = prior_of(session.robot, by_wheels, config.doubts, config.run.odometry)
    frames = chosen_frames(session, config.views)
    each = len(session.frames) + len(session.fixes)
    total = len(frames) + config.runs * each
    shots = taken(session, frames, config.run.matcher, lambda done, _: progress(done, total))
    values, std = prior.values, prior.std[:_MOUNT]
    for number in range(config.runs):
        # What a run finds depends on the robot that it believes in.
        believed = with_robot(session, values, std)
        before = len(frames) + number * each
        result = run_session(believed, config.run, NullLog(), partial(_further, progress, before, total))
        poses = {} if not result.usable else trusted_poses(result, believed, shots)
        if number == 0 and poses:
            values = with_best_tilt(session, values, std, shots, poses, config.run.matcher, config.tilt)
        solved = _rounds(session, prior, values, std, shots, poses, config)
        if isinstance(solved, Uncalibrated):
            return solved
        solution, views = solved
        values, std = solution.state.robot, _loose(solution, config)
    return _told(names_of(by_wheels), prior, stated, solution, views, len(session.frames), config)


def _further(progress: Progress, before: int, total: int, done: int, _: int) -> None:
    progress(before + done, total)


def _rounds(
    session: Session,
    prior: Prior,
    values: Array,
    std: Array,
    shots: Sequence[Shot],
    poses: Mapping[int, Array],
    config: RobotCalibrationConfig,
) -> tuple[Solution, tuple[View, ...]] | Uncalibrated:
    """Match from the poses, solve for poses and robot, and again."""
    assert session.camera is not None
    assert session.wire_map is not None
    record, segments = record_of(session), MapLines.of(session.wire_map)
    for gate in zip(config.views.gate_m, config.views.gate_rad, strict=True):
        camera = with_robot(session, values, std).camera
        assert camera is not None
        seen = views_of(shots, poses, Projector(camera, session.wire_map), config.run.matcher, gate)
        if len(seen) < config.fewest_views:
            return Uncalibrated(f"only {len(seen)} of {len(shots)} frames match the map")
        problem = Problem(
            camera=session.camera,
            segments=segments,
            map_sigma_m=session.wire_map.sigma_m,
            record=record,
            odometry=config.run.odometry,
            prior=prior,
            views=tuple(seen.values()),
            noise=config.noise,
        )
        solution = solve(problem, problem.start(values), config.solve)
        wrong = torn(problem, solution, config.torn_chi2)
        if wrong.any():
            seen = {key: view for (key, view), bad in zip(seen.items(), wrong, strict=True) if not bad}
            problem = replace(problem, views=tuple(seen.values()))
            solution = solve(problem, problem.start(solution.state.robot), config.solve)
        values, std = solution.state.robot, _loose(solution, config)
        poses = dict(zip(seen, solution.state.frames[:, :3], strict=True))
    return solution, problem.views


def _loose(solution: Solution, config: RobotCalibrationConfig) -> Array:
    """Return what the mount (6,) may be off in one image: what sways from frame to frame stays unknown."""
    sway = config.noise.sway_rad * max(solution.spreads["sways"], 1.0)
    return np.hypot(solution.std[:_MOUNT], [0.0, 0.0, _LEAST_M, sway, sway, sway])


def _told(
    names: tuple[str, ...],
    prior: Prior,
    stated: Array,
    solution: Solution,
    views: Sequence[View],
    offered: int,
    config: RobotCalibrationConfig,
) -> RobotCalibration:
    """Keep the prior where the drive shows nothing, and what that means for the others."""
    shown = solution.std <= config.shown * prior.std
    estimates = conditioned(solution, prior, shown)
    std = solution.std.copy()
    sway = config.noise.sway_rad * solution.spreads["sways"]
    for name in ("pitch_down_rad", "roll_rad"):
        # One image's tilt is off by the sway, too, and that is what a deviation in robot.yaml is for.
        std[names.index(name)] = np.hypot(std[names.index(name)], sway)
    std = np.where(shown, std, np.where(np.isnan(stated), prior.std, stated))
    lines = sum(len(view.seen) for view in views)
    return RobotCalibration(
        names, prior, estimates, std, shown, len(views), offered, lines, dict(solution.spreads)
    )


def conditioned(solution: Solution, prior: Prior, shown: NDArray[np.bool_]) -> Array:
    """Return the likeliest values (10,) of the shown parameters, the others being what they were before."""
    values, hidden = solution.state.robot.copy(), ~shown
    if hidden.any():
        away = prior.values[hidden] - values[hidden]
        within, between = (
            solution.covariance[np.ix_(hidden, hidden)],
            solution.covariance[np.ix_(shown, hidden)],
        )
        values[shown] += between @ np.linalg.solve(within, away)
        values[hidden] = prior.values[hidden]
    return values


def content_of(result: RobotCalibration | Uncalibrated) -> dict[str, Any]:
    """Return a calibration as plain values for a program; metres, radians, seconds."""
    if isinstance(result, Uncalibrated):
        return {"calibrated": False, "why": result.why}
    columns = zip(
        result.names,
        result.prior.values,
        result.prior.std,
        result.estimates,
        result.std,
        result.shown,
        strict=True,
    )
    return {
        "calibrated": True,
        "parameters": {
            name: {
                "unit": unit_of(name),
                "prior": float(prior),
                "prior_std": float(prior_std),
                "estimate": float(estimate),
                "std": float(std),
                "shown": bool(shown),
            }
            for name, prior, prior_std, estimate, std, shown in columns
        },
        "frames": result.frames,
        "offered": result.offered,
        "lines": result.lines,
        "spreads": dict(result.spreads),
    }
