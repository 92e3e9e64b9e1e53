"""The main loop: a session's events, in the order of their arrival, through matcher and localizer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from time import perf_counter

from localization.localizer import Localizer
from localization.odometry import OdometryStep, advance
from localization.smoother import SmootherConfig, smooth
from localization.states import State
from maps.errors import InputError
from maps.outcomes import Fix, Outcome, PoseBelief, SearchWindow
from maps.regioncache import cached_regions
from runs.config import RunConfig
from runs.looking import look_in
from runs.pace import Pace
from runs.records import Passage
from runs.runlog import RunLog, StepRecord, Trajectories, Trajectory
from runs.session import Frame, RecordedFix, Session
from vision.camera import Camera
from vision.images import read_image
from vision.matcher import LineMatcher, MatcherConfig

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
    keep to the rate.
    """

    trajectories: Trajectories
    records: tuple[StepRecord, ...]
    outcomes: tuple[Outcome, ...]
    spans: tuple[StateSpan, ...]
    predict_ms: tuple[float, ...]
    dropped: int = 0

    @property
    def usable(self) -> bool:
        """Whether the robot was localized: some fix was accepted."""
        return any(record.accepted for record in self.records)


def run_session(session: Session, config: RunConfig, log: RunLog, progress: Progress) -> RunResult:
    """Run a session through matcher and localizer, and smooth it at the end.

    InputError where an image cannot be read.
    """
    localizer = Localizer(session.initial, config.localizer)
    eye = _Eye.of(session, config.matcher)
    pace = Pace(config.match_rate_hz)
    diary = _Diary(log)
    total = len(session.frames) + len(session.fixes)
    log.begin(session, config)
    for event in session.events(config.odometry):
        match event:
            case OdometryStep():
                diary.move(localizer, event)
            case Frame() if eye is not None and pace.due(event.stamp_ns):
                windows = localizer.windows_at(event.stamp_ns)
                outcome, look_ms = eye.look(event, windows)
                diary.fuse(localizer, event, outcome, windows[-1], look_ms)
                progress(len(diary.records) + pace.dropped, total)
            case RecordedFix():
                diary.fuse(localizer, event, event.fix)
                progress(len(diary.records) + pace.dropped, total)
    result = diary.result(session.initial, config.smoother, pace.dropped)
    log.finish(result.trajectories)
    return result


@dataclass(frozen=True, slots=True, eq=False)
class _Eye:
    """The camera and the matcher behind it."""

    camera: Camera
    matcher: LineMatcher

    @classmethod
    def of(cls, session: Session, config: MatcherConfig) -> _Eye | None:
        """Open it; a session without images needs none."""
        if not session.frames or session.camera is None or session.wire_map is None:
            return None
        height = session.camera.mount.height_m
        regions = cached_regions(session.wire_map, (height, height))
        return cls(session.camera, LineMatcher(session.camera, session.wire_map, config, regions))

    def look(self, frame: Frame, windows: Sequence[SearchWindow]) -> tuple[Outcome, Mapping[str, float]]:
        """Match a frame against the map inside the windows; the milliseconds it took, by stage."""
        image = read_image(frame.path)
        camera = self.camera
        if image.shape != (camera.height, camera.width):
            size = f"{image.shape[1]} x {image.shape[0]} px, by robot.yaml {camera.width} x {camera.height}"
            raise InputError(frame.path, "", size)
        return look_in(self.matcher, image, frame.stamp_ns, windows)


@dataclass(frozen=True, slots=True, eq=False)
class _Diary:
    """What the localizer did, step by step, told to the log as it goes."""

    log: RunLog
    steps: list[OdometryStep] = field(default_factory=list)
    spans: list[StateSpan] = field(default_factory=list)
    published: list[PoseBelief] = field(default_factory=list)
    records: list[StepRecord] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    predict_ms: list[float] = field(default_factory=list)

    def move(self, localizer: Localizer, step: OdometryStep) -> None:
        """Let the localizer predict, and publish its belief at the step's end."""
        began = perf_counter()
        localizer.predict(step)
        self.predict_ms.append(_ms_since(began))
        self.steps.append(step)
        self.spans.append(StateSpan(step.start_ns, step.stamp_ns, localizer.state))
        belief = localizer.belief_at(step.stamp_ns)
        if belief is not None:
            self.published.append(belief)
            self.log.belief(belief)

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
        self.log.step(self.records[-1], event if isinstance(event, Frame) else None, outcome, window)

    def result(self, initial: PoseBelief | None, config: SmootherConfig, dropped: int) -> RunResult:
        """Smooth, and gather everything."""
        return RunResult(
            self._trajectories(initial, config),
            tuple(self.records),
            tuple(self.outcomes),
            tuple(self.spans),
            tuple(self.predict_ms),
            dropped,
        )

    def _trajectories(self, initial: PoseBelief | None, config: SmootherConfig) -> Trajectories:
        """Dead reckoning and smoothing begin at the initial pose, or at the first trusted one."""
        fixes = sorted((o.belief for o in self.outcomes if isinstance(o, Fix)), key=lambda fix: fix.stamp_ns)
        known = initial is not None and initial.measured.all()
        start = initial if known else next(iter(self.published), None)
        nothing = Trajectory.of_beliefs([])
        if start is None:
            return Trajectories(nothing, Trajectory.of_beliefs(fixes), nothing, nothing)
        steps = [step for step in self.steps if step.start_ns >= start.stamp_ns]
        stamps_ns = [start.stamp_ns, *(step.stamp_ns for step in steps)]
        reckoned = accumulate(steps, advance, initial=start.pose)
        within = [fix for fix in fixes if start.stamp_ns <= fix.stamp_ns <= stamps_ns[-1]]
        published_ns = {belief.stamp_ns for belief in self.published}
        smoothed = smooth(start, steps, within, config)
        return Trajectories(
            odometry=Trajectory.of_poses(list(zip(stamps_ns, reckoned, strict=True))),
            vision=Trajectory.of_beliefs(fixes),
            filtered=Trajectory.of_beliefs(self.published),
            smoothed=Trajectory.of_beliefs([at for at in smoothed if at.stamp_ns in published_ns]),
        )


def _ms_since(began: float) -> float:
    return (perf_counter() - began) * 1e3
