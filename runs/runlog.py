"""What a run tells those who watch or record it: the log protocol, its records, a log that is silent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from maps.outcomes import Outcome, PoseBelief, SearchWindow
from maps.poses import Array, Pose2, frozen
from runs.config import RunConfig
from runs.session import Frame, Session

#: The verdicts by which a fix went into the belief, as in steps.csv.
ACCEPTED = ("FUSED", "RELOCALIZED")


@dataclass(frozen=True, slots=True)
class StepRecord:
    """One row of steps.csv: a frame or a recorded fix, from the prior to the belief after it.

    The fields are the columns, in order and by name, but for the two times: integer nanoseconds here,
    `timestamp_s` and `arrival_s` in the file. Prior and belief are at the stamp, `s..` are covariances
    [m^2, m rad, rad^2]; None, an empty cell, is what there was not.
    """

    stamp_ns: int
    arrival_ns: int
    filename: str
    state: str
    prior_x_m: float | None
    prior_y_m: float | None
    prior_phi_rad: float | None
    window_dt_m: float | None
    window_dphi_rad: float | None
    segments: int | None
    selected: int | None
    hypotheses: int | None
    matches: int | None
    outcome: str
    reason: str
    fix_x_m: float | None
    fix_y_m: float | None
    fix_phi_rad: float | None
    fix_sxx: float | None
    fix_sxy: float | None
    fix_sxp: float | None
    fix_syy: float | None
    fix_syp: float | None
    fix_spp: float | None
    verdict: str
    nis: float | None
    x_m: float | None
    y_m: float | None
    phi_rad: float | None
    sxx: float | None
    sxy: float | None
    sxp: float | None
    syy: float | None
    syp: float | None
    spp: float | None
    extract_ms: float | None
    match_ms: float | None
    update_ms: float

    @property
    def accepted(self) -> bool:
        """Whether a fix went into the belief."""
        return self.verdict in ACCEPTED


#: The header of steps.csv.
COLUMNS = ("timestamp_s", "arrival_s", *(field.name for field in fields(StepRecord)[2:]))


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses in order of time: `stamps_ns` (N,), `poses` (N, 3) of x, y [m] and phi [rad], map frame.

    `covariances`: (N, 3, 3), infinite where a component was not measured; None for dead reckoning.
    """

    stamps_ns: NDArray[np.int64]
    poses: Array
    covariances: Array | None = None

    def __post_init__(self) -> None:
        stamps_ns = np.array(self.stamps_ns, np.int64)
        stamps_ns.setflags(write=False)
        object.__setattr__(self, "stamps_ns", stamps_ns)
        object.__setattr__(self, "poses", frozen(np.reshape(self.poses, (-1, 3))))
        if self.covariances is not None:
            object.__setattr__(self, "covariances", frozen(np.reshape(self.covariances, (-1, 3, 3))))

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @classmethod
    def of_beliefs(cls, beliefs: Sequence[PoseBelief]) -> Trajectory:
        """Stack beliefs."""
        return cls(
            np.array([belief.stamp_ns for belief in beliefs], np.int64),
            np.array([belief.pose.as_array() for belief in beliefs]),
            np.array([belief.covariance for belief in beliefs]),
        )

    @classmethod
    def of_poses(cls, poses: Sequence[tuple[int, Pose2]]) -> Trajectory:
        """Stack (stamp_ns, pose) pairs, poses without covariance."""
        return cls(
            np.array([stamp_ns for stamp_ns, _ in poses], np.int64),
            np.array([pose.as_array() for _, pose in poses]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories:
    """The run's own, each in order of its stamps.

    `odometry`: dead reckoning from the initial pose, or from the first one published. `vision`: every
    fix, accepted or not, at its image's time. `filtered`: the belief as published at every odometry step,
    none while lost. `smoothed`: at the same stamps, knowing everything. `fixed_lag`: at the same stamps, as
    known a few seconds later; empty where the fixed-lag smoother did not run.
    """

    odometry: Trajectory
    vision: Trajectory
    filtered: Trajectory
    smoothed: Trajectory
    fixed_lag: Trajectory = field(default_factory=lambda: Trajectory.of_beliefs([]))

    def by_name(self) -> dict[str, Trajectory]:
        """Return those that there are by their names, in order."""
        every = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: track for name, track in every.items() if name != "fixed_lag" or len(track)}


class RunLog(Protocol):
    """What watches a run; the run never asks whether somebody does."""

    def begin(self, session: Session, config: RunConfig) -> None:
        """Take the session and the configuration, before the first event."""

    def step(
        self, record: StepRecord, frame: Frame | None, outcome: Outcome, window: SearchWindow | None
    ) -> None:
        """Take a frame's outcome with the window it was searched in, or (both None) a recorded fix."""

    def belief(self, belief: PoseBelief) -> None:
        """Take the published belief, after every odometry step but while lost."""

    def finish(self, trajectories: Trajectories) -> None:
        """Take the trajectories, after the last event."""


class NullLog:
    """A log that keeps nothing."""

    def begin(self, session: Session, config: RunConfig) -> None:
        """Ignore."""

    def step(
        self, record: StepRecord, frame: Frame | None, outcome: Outcome, window: SearchWindow | None
    ) -> None:
        """Ignore."""

    def belief(self, belief: PoseBelief) -> None:
        """Ignore."""

    def finish(self, trajectories: Trajectories) -> None:
        """Ignore."""


@dataclass(frozen=True, slots=True)
class LogGroup:
    """Several logs as one; each hears everything, in the order given."""

    logs: tuple[RunLog, ...]

    def begin(self, session: Session, config: RunConfig) -> None:
        """Pass on."""
        for log in self.logs:
            log.begin(session, config)

    def step(
        self, record: StepRecord, frame: Frame | None, outcome: Outcome, window: SearchWindow | None
    ) -> None:
        """Pass on."""
        for log in self.logs:
            log.step(record, frame, outcome, window)

    def belief(self, belief: PoseBelief) -> None:
        """Pass on."""
        for log in self.logs:
            log.belief(belief)

    def finish(self, trajectories: Trajectories) -> None:
        """Pass on."""
        for log in self.logs:
            log.finish(trajectories)
