"""What a run does, written down step by step; most of it on disk, so that hours cost no more memory than minutes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from localization.fixedlag import FixedLagSmoother
from localization.localizer import Localizer
from localization.odometry import PARAMETERS, OdometryStep, advance
from localization.states import State
from localization.verdicts import Fused, Relocalized, Verdict
from maps.outcomes import Fix, NoFix, Outcome, PoseBelief, Reason, SearchWindow
from maps.poses import Pose2
from runs.config import RunConfig
from runs.hindsight import Account, smoothed_in_parts
from runs.records import Passage
from runs.runlog import RunLog, StepRecord, Trajectories, Trajectory
from runs.secondpass import Look, SecondPass
from runs.session import Frame, RecordedFix
from runs.spool import Layout, Rows, Shelf


@dataclass(frozen=True, slots=True)
class StateSpan:
    """The localizer's state after an odometry step, held for the step's time."""

    start_ns: int
    stamp_ns: int
    state: State


_STATES = tuple(State)

SPAN: Layout[StateSpan] = Layout(
    np.dtype([("start_ns", "i8"), ("stamp_ns", "i8"), ("state", "u1")]),
    lambda span: (span.start_ns, span.stamp_ns, _STATES.index(span.state)),
    lambda row: StateSpan(int(row["start_ns"]), int(row["stamp_ns"]), _STATES[row["state"]]),
)
BELIEF: Layout[PoseBelief] = Layout(
    np.dtype([("stamp_ns", "i8"), ("pose", "f8", (3,)), ("covariance", "f8", (3, 3))]),
    lambda belief: (belief.stamp_ns, (belief.pose.x, belief.pose.y, belief.pose.phi), belief.covariance),
    lambda row: PoseBelief(int(row["stamp_ns"]), Pose2.from_array(row["pose"]), row["covariance"]),
)
STEP: Layout[OdometryStep] = Layout(
    np.dtype(
        [
            ("start_ns", "i8"),
            ("stamp_ns", "i8"),
            ("forward_m", "f8"),
            ("turn_rad", "f8"),
            ("covariance", "f8", (2, 2)),
            ("sideways_m2", "f8"),
            ("systematic", "f8", (3, PARAMETERS)),
            ("forgetting", "f8"),
            ("slip", "f8"),
        ]
    ),
    lambda step: (
        step.start_ns,
        step.stamp_ns,
        step.forward_m,
        step.turn_rad,
        step.covariance,
        step.sideways_m2,
        step.systematic,
        step.forgetting,
        step.slip,
    ),
    lambda row: OdometryStep(
        int(row["start_ns"]),
        int(row["stamp_ns"]),
        float(row["forward_m"]),
        float(row["turn_rad"]),
        row["covariance"],
        float(row["sideways_m2"]),
        row["systematic"],
        float(row["forgetting"]),
        float(row["slip"]),
    ),
)
MILLISECONDS: Layout[float] = Layout(np.dtype([("ms", "f8")]), lambda ms: (ms,), lambda row: float(row["ms"]))


@dataclass(frozen=True, slots=True, eq=False)
class Diary:
    """What the localizer did, step by step, told to the log as it goes.

    `missed`: frames without a fix, which are the session's own. `relocalized`: the beliefs just after the robot
    found itself at another place than it believed.
    """

    log: RunLog
    lag: FixedLagSmoother | None
    steps: Rows[OdometryStep] = field(default_factory=lambda: Rows(STEP))
    spans: Rows[StateSpan] = field(default_factory=lambda: Rows(SPAN))
    predict_ms: Rows[float] = field(default_factory=lambda: Rows(MILLISECONDS))
    published: Rows[PoseBelief] = field(default_factory=lambda: Rows(BELIEF))
    lagged: Rows[PoseBelief] = field(default_factory=lambda: Rows(BELIEF))
    records: Shelf[StepRecord] = field(default_factory=Shelf)
    outcomes: Shelf[Outcome] = field(default_factory=Shelf)
    missed: list[Frame] = field(default_factory=list)
    relocalized: list[PoseBelief] = field(default_factory=list)

    def move(self, localizer: Localizer, step: OdometryStep) -> None:
        """Let the localizer predict, and publish its belief at the step's end."""
        began = perf_counter()
        step = localizer.predict(step)
        self.predict_ms.append(_ms_since(began))
        self.steps.append(step)
        self.spans.append(StateSpan(step.start_ns, step.stamp_ns, localizer.state))
        estimate = localizer.estimate_at(step.stamp_ns)
        if estimate is not None:
            belief = estimate.belief
            self.published.append(belief)
            self.log.belief(belief)
        if self.lag is not None:
            self.lagged.extend(self.lag.move(step, estimate))

    def fuse(
        self,
        localizer: Localizer,
        event: Frame | RecordedFix,
        outcome: Outcome,
        window: SearchWindow | None = None,
        look_ms: Mapping[str, float] | None = None,
    ) -> None:
        """Let the localizer fuse an outcome, and write down what became of it."""
        prior = localizer.belief_at(event.stamp_ns)
        began = perf_counter()
        verdict = localizer.fuse(outcome, window, event.stamp_ns)
        update_ms = _ms_since(began)
        posterior = localizer.belief_at(event.stamp_ns)
        passage = Passage(
            event, window, outcome, look_ms or {}, prior, verdict, update_ms, posterior, localizer.state
        )
        record = passage.record()
        self.records.append(record)
        self.outcomes.append(outcome)
        self._remember(event, outcome, verdict, posterior)
        self.log.step(record, event if isinstance(event, Frame) else None, outcome, window)

    def _remember(
        self, event: Frame | RecordedFix, outcome: Outcome, verdict: Verdict, posterior: PoseBelief | None
    ) -> None:
        """Keep what smoothing needs."""
        if isinstance(verdict, Relocalized) and posterior is not None:
            self.relocalized.append(posterior)
            if self.lag is not None:
                self.lagged.extend(self.lag.rest())
        elif isinstance(verdict, Fused) and isinstance(outcome, Fix) and self.lag is not None:
            self.lag.fuse(outcome.belief)
        unreadable = isinstance(outcome, NoFix) and outcome.reason is Reason.UNREADABLE_IMAGE
        if isinstance(event, Frame) and not isinstance(outcome, Fix) and not unreadable:
            self.missed.append(event)

    def trajectories(
        self,
        initial: PoseBelief | None,
        config: RunConfig,
        look: Look | None,
        progress: Callable[[int, int], None],
    ) -> tuple[Trajectories, SecondPass]:
        """Smooth, look again, and gather everything.

        Dead reckoning and smoothing begin at the initial pose, or at the first trusted one.
        """
        if self.lag is not None:
            self.lagged.extend(self.lag.rest())
        fixes = sorted((o.belief for o in self.outcomes if isinstance(o, Fix)), key=lambda fix: fix.stamp_ns)
        known = initial is not None and initial.measured.all()
        start = initial if known else next(iter(self.published), None)
        nothing = Trajectory.of_beliefs([])
        if start is None:
            return Trajectories(nothing, Trajectory.of_beliefs(fixes), nothing, nothing), SecondPass()
        fused_ns = [record.stamp_ns for record in self.records if record.accepted]
        account = Account(start, self.steps, fixes, self.published, fused_ns, self.relocalized)
        smoothed, again = Rows(BELIEF), SecondPass()
        for beliefs, brought in smoothed_in_parts(account, self.missed, look, config, progress):
            smoothed.extend(beliefs)
            again = again.and_then(brought)
        published_ns = self.published.table()["stamp_ns"]
        tracks = Trajectories(
            odometry=self._reckoned(start),
            vision=Trajectory.of_beliefs(fixes),
            filtered=_track(self.published, published_ns),
            smoothed=_track(smoothed, published_ns),
            fixed_lag=_track(self.lagged, published_ns),
        )
        return tracks, again

    def _reckoned(self, start: PoseBelief) -> Trajectory:
        """Dead-reckon from a belief on."""
        table = self.steps.table()
        table = table[np.searchsorted(table["start_ns"], start.stamp_ns) :]
        poses = accumulate(map(STEP.value, table), advance, initial=start.pose)
        values = np.fromiter((value for pose in poses for value in (pose.x, pose.y, pose.phi)), np.float64)
        return Trajectory(np.append(start.stamp_ns, table["stamp_ns"]), values)


def _track(beliefs: Rows[PoseBelief], stamps_ns: NDArray[np.int64]) -> Trajectory:
    """Return those of the beliefs that are at these stamps."""
    table = beliefs.table()
    table = table[np.isin(table["stamp_ns"], stamps_ns)]
    return Trajectory(table["stamp_ns"], table["pose"], table["covariance"])


def _ms_since(began: float) -> float:
    return (perf_counter() - began) * 1e3
