"""The main loop: a session's events, in the order of their arrival, through matcher and localizer."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from localization.fixedlag import FixedLagSmoother
from localization.localizer import Localizer
from localization.odometry import OdometryStep
from maps.errors import InputError
from maps.outcomes import NoFix, Outcome, Reason
from maps.regioncache import cached_regions
from runs.config import RunConfig
from runs.diary import Diary, StateSpan
from runs.looking import Looked, Windows, look_in
from runs.pace import Pace
from runs.runlog import RunLog, StepRecord, Trajectories
from runs.secondpass import SecondPass
from runs.session import Frame, RecordedFix, Session
from vision.camera import Camera
from vision.matcher import LineMatcher, MatcherConfig

logger = logging.getLogger(__name__)

#: Called after every frame or recorded fix with how many are done, and of how many; when a long drive is smoothed,
#: likewise after every part of it.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """What a run found out: `records` and `outcomes` go together, one each a frame or recorded fix.

    `spans` and `predict_ms` have one element an odometry step. After a run these lie on disk, and each element
    is read when it is asked for. `dropped`: frames that were not matched, to keep to the rate. `again`: what
    looking again at frames without a fix brought to the smoothed trajectory.
    """

    trajectories: Trajectories
    records: Sequence[StepRecord]
    outcomes: Sequence[Outcome]
    spans: Sequence[StateSpan]
    predict_ms: Sequence[float]
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
    diary = Diary(log, FixedLagSmoother(config.fixed_lag) if config.fixed_lag.enabled else None)
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
    if localizer.implausible:
        logger.warning(
            "odometry rows that no wheels can have rolled, and not believed: %d", localizer.implausible
        )
    look = None if eye is None else eye.look_again
    tracks, again = diary.trajectories(session.initial, config, look, progress)
    log.finish(tracks)
    return RunResult(
        tracks, diary.records, diary.outcomes, diary.spans, diary.predict_ms, pace.dropped, again
    )


@dataclass(slots=True, eq=False)
class _Eye:
    """The camera and the matcher behind it.

    `unread`: how many images could not be read, `wrong`: what was wrong with the first one.
    """

    camera: Camera
    matcher: LineMatcher
    unread: int = 0
    wrong: InputError | None = None

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
            self.unread += 1
            self.wrong = self.wrong or error
            return Looked(NoFix(Reason.UNREADABLE_IMAGE), windows[-1], {})
        camera = self.camera
        if image.shape != (camera.height, camera.width):
            size = f"{image.shape[1]} x {image.shape[0]} px, by robot.yaml {camera.width} x {camera.height}"
            raise InputError(frame.path, "", size)
        return look_in(self.matcher, image, frame.stamp_ns, windows, otherwise)

    def look_again(self, frame: Frame, windows: Windows) -> Outcome:
        """Match a frame once more."""
        return self.look(frame, windows).outcome

    def tell_unread(self, looks: int) -> None:
        """Warn of images that could not be read; raise the first one's error where no look showed anything."""
        if self.wrong is None:
            return
        if self.unread == looks:
            raise self.wrong
        logger.warning("%d images cannot be read, the first: %s", self.unread, self.wrong)
