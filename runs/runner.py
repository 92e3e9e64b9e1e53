"""The main loop: a session's events, in the order of their arrival, through matcher and localizer."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from time import perf_counter

from localization.fixedlag import FixedLagSmoother
from localization.localizer import Localizer
from localization.odometry import OdometryStep, advance
from localization.states import State
from localization.verdicts import Fused, Relocalized, Verdict
from maps.errors import InputError
from maps.outcomes import Fix, NoFix, Outcome, PoseBelief, Reason, SearchWindow
from maps.regioncache import cached_regions
from runs.config import RunConfig
from runs.hindsight import Account, smoothed_twice
from runs.looking import Looked, Windows, look_in
from runs.pace import Pace
from runs.records import Passage
from runs.runlog import RunLog, StepRecord, Trajectories, Trajectory
from runs.secondpass import SecondPass
from runs.session import Frame, RecordedFix, Session
from vision.camera import Camera
from vision.matcher import LineMatcher, MatcherConfig

logger = logging.getLogger(__name__)

#: Called after every frame or recorded fix with how many are done, and of how many.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class StateSpan:
    """The localizer's state after an odometry step, held for the step's time."""

    start_ns: int
    stamp_ns: int
    state: State


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """What a run found out: `records` and `outcomes` go together, one each a frame or recorded fix.

    `spans` and `predict_ms` have one element an odometry step. `dropped`: frames that were not matched, to
    keep to the rate. `again`: what looking again at frames without a fix brought to the smoothed trajectory.
    """

    trajectories: Trajectories
    records: tuple[StepRecord, ...]
    outcomes: tuple[Outcome, ...]
    spans: tuple[StateSpan, ...]
    predict_ms: tuple[float, ...]
    dropped: int = 0
    again: SecondPass = field(default_factory=SecondPass)

    @property
    def usable(self) -> bool:
        """Whether the robot was localized: some fix was accepted."""
        return any(record.accepted for record in self.records)


def run_session(session: Session, config: RunConfig, log: RunLog, progress: Progress) -> RunResult:
    """Run a session through matcher and localizer, and smooth it at the end.

    An image that cannot be read shows nothing, and the run goes on; InputError where there is nothing else, or
    where an image has another size than the camera.
    """
    localizer = Localizer(session.initial, config.localizer)
    eye = _Eye.of(session, config.matcher)
    pace = Pace(config.match_rate_hz)
    diary = _Diary(log, FixedLagSmoother(config.fixed_lag) if config.fixed_lag.enabled else None)
    total = len(session.frames) + len(session.fixes)
    log.begin(session, config)
    for event in session.events(config.odometry):
        match event:
            case OdometryStep():
                diary.move(localizer, event)
            case Frame() if eye is not None and pace.due(event.stamp_ns):
                windows = localizer.windows_at(event.stamp_ns)
                looked = eye.look(event, windows, localizer.slip_windows_at(event.stamp_ns))
                diary.fuse(localizer, event, looked.outcome, looked.window, looked.spent_ms)
                progress(len(diary.records) + pace.dropped, total)
            case RecordedFix():
                diary.fuse(localizer, event, event.fix)
                progress(len(diary.records) + pace.dropped, total)
    if eye is not None:
        eye.tell_unread(len(diary.records))
    result = diary.result(session.initial, config, eye, pace.dropped)
    log.finish(result.trajectories)
    return result


@dataclass(frozen=True, slots=True, eq=False)
class _Eye:
    """The camera and the matcher behind it; `unread`: what was wrong with images that could not be read."""

    camera: Camera
    matcher: LineMatcher
    unread: list[InputError] = field(default_factory=list)

    @classmethod
    def of(cls, session: Session, config: MatcherConfig) -> _Eye | None:
        """Open it; a session without images needs none."""
        if not session.frames or session.camera is None or session.wire_map is None:
            return None
        height = session.camera.mount.height_m
        regions = cached_regions(session.wire_map, (height, height))
        return cls(session.camera, LineMatcher(session.camera, session.wire_map, config, regions))

    def look(self, frame: Frame, windows: Windows, otherwise: Windows = ()) -> Looked:
        """Match a frame against the map inside the windows, or else the others."""
        try:
            image = frame.image()
        except InputError as error:
            self.unread.append(error)
            return Looked(NoFix(Reason.UNREADABLE_IMAGE), windows[-1], {})
        camera = self.camera
        if image.shape != (camera.height, camera.width):
            size = f"{image.shape[1]} x {image.shape[0]} px, by robot.yaml {camera.width} x {camera.height}"
            raise InputError(frame.path, "", size)
        return look_in(self.matcher, image, frame.stamp_ns, windows, otherwise)

    def tell_unread(self, looks: int) -> None:
        """Warn of images that could not be read; raise the first one's error where no look showed anything."""
        if not self.unread:
            return
        if len(self.unread) == looks:
            raise self.unread[0]
        logger.warning("%d images cannot be read, the first: %s", len(self.unread), self.unread[0])


@dataclass(frozen=True, slots=True, eq=False)
class _Diary:
    """What the localizer did, step by step, told to the log as it goes."""

    log: RunLog
    lag: FixedLagSmoother | None
    steps: list[OdometryStep] = field(default_factory=list)
    spans: list[StateSpan] = field(default_factory=list)
    published: list[PoseBelief] = field(default_factory=list)
    records: list[StepRecord] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    missed: list[Frame] = field(default_factory=list)
    relocalized: list[PoseBelief] = field(default_factory=list)
    lagged: list[PoseBelief] = field(default_factory=list)
    predict_ms: list[float] = field(default_factory=list)

    def move(self, localizer: Localizer, step: OdometryStep) -> None:
        """Let the localizer predict, and publish its belief at the step's end."""
        began = perf_counter()
        localizer.predict(step)
        self.predict_ms.append(_ms_since(began))
        self.steps.append(step)
        self.spans.append(StateSpan(step.start_ns, step.stamp_ns, localizer.state))
        estimate = localizer.estimate_at(step.stamp_ns)
        if estimate is not None:
            self.published.append(estimate.belief)
            self.log.belief(self.published[-1])
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
        self.records.append(passage.record())
        self.outcomes.append(outcome)
        self._remember(event, outcome, verdict, posterior)
        self.log.step(self.records[-1], event if isinstance(event, Frame) else None, outcome, window)

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

    def result(
        self, initial: PoseBelief | None, config: RunConfig, eye: _Eye | None, dropped: int
    ) -> RunResult:
        """Smooth, look again, and gather everything."""
        if self.lag is not None:
            self.lagged.extend(self.lag.rest())
        trajectories, again = self._trajectories(initial, config, eye)
        return RunResult(
            trajectories,
            tuple(self.records),
            tuple(self.outcomes),
            tuple(self.spans),
            tuple(self.predict_ms),
            dropped,
            again,
        )

    def _trajectories(
        self, initial: PoseBelief | None, config: RunConfig, eye: _Eye | None
    ) -> tuple[Trajectories, SecondPass]:
        """Dead reckoning and smoothing begin at the initial pose, or at the first trusted one."""
        fixes = sorted((o.belief for o in self.outcomes if isinstance(o, Fix)), key=lambda fix: fix.stamp_ns)
        known = initial is not None and initial.measured.all()
        start = initial if known else next(iter(self.published), None)
        nothing = Trajectory.of_beliefs([])
        if start is None:
            return Trajectories(nothing, Trajectory.of_beliefs(fixes), nothing, nothing), SecondPass()
        steps = [step for step in self.steps if step.start_ns >= start.stamp_ns]
        stamps_ns = [start.stamp_ns, *(step.stamp_ns for step in steps)]
        reckoned = accumulate(steps, advance, initial=start.pose)
        fused_ns = tuple(record.stamp_ns for record in self.records if record.accepted)
        account = Account(
            start, tuple(steps), tuple(fixes), tuple(self.published), fused_ns, tuple(self.relocalized)
        )
        look = None if eye is None else lambda frame, windows: eye.look(frame, windows).outcome
        smoothed, again = smoothed_twice(account, tuple(self.missed), look, config)
        published_ns = {belief.stamp_ns for belief in self.published}
        tracks = Trajectories(
            odometry=Trajectory.of_poses(list(zip(stamps_ns, reckoned, strict=True))),
            vision=Trajectory.of_beliefs(fixes),
            filtered=Trajectory.of_beliefs(self.published),
            smoothed=Trajectory.of_beliefs([at for at in smoothed if at.stamp_ns in published_ns]),
            fixed_lag=Trajectory.of_beliefs([at for at in self.lagged if at.stamp_ns in published_ns]),
        )
        return tracks, again


def _ms_since(began: float) -> float:
    return (perf_counter() - began) * 1e3
