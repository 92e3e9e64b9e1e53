"""The localizer on a live robot: odometry from one thread, images from another, the pose for whoever asks."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Condition, RLock
from types import TracebackType

from localization.localizer import Localizer
from localization.odometry import OdometryStep
from localization.states import Diagnosis, State
from localization.verdicts import Verdict
from maps.outcomes import Outcome, PoseBelief
from maps.poses import Pose2
from runs.looking import look_in
from runs.pace import Pace
from vision.images import GreyImage
from vision.matcher import LineMatcher


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What came of an image, and what became of that."""

    stamp_ns: int
    outcome: Outcome
    verdict: Verdict


#: Called in the matching thread after every image; may call the localizer.
Watcher = Callable[[Seen], None]


class LiveLocalizer:
    """Joins a localizer and a matcher: `with LiveLocalizer(localizer, matcher) as live`.

    All methods may be called from any thread and return at once but for `wait` and `close`. Matching runs in
    a thread of its own, outside the lock. While it is busy a newer image takes the place of the one that
    waits: an old image is worth less than a new one.
    """

    def __init__(
        self,
        localizer: Localizer,
        matcher: LineMatcher,
        match_rate_hz: float | None = None,
        watcher: Watcher | None = None,
    ) -> None:
        """Take both over: nobody else may call them from now on. `match_rate_hz`: at most; None: no limit."""
        self._localizer, self._matcher, self._watcher = localizer, matcher, watcher
        self._pace = Pace(match_rate_hz)
        self._lock = RLock()
        self._idle = Condition(self._lock)
        self._waiting: tuple[GreyImage, int] | None = None
        self._replaced = 0
        self._busy = False
        self._working: Future[None] | None = None
        self._hand = ThreadPoolExecutor(max_workers=1, thread_name_prefix="match")

    def __enter__(self) -> LiveLocalizer:
        """Nothing to open."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def on_odometry(self, step: OdometryStep) -> None:
        """Follow one odometry step; steps come in order of time."""
        with self._lock:
            self._localizer.predict(step)

    def on_image(self, image: GreyImage, stamp_ns: int) -> None:
        """Take a grey image (H, W) with its capture time on odometry's clock, to be matched soon or never.

        Raises what the matching of an earlier image raised.
        """
        self._raise_failure()
        with self._lock:
            if not self._pace.due(stamp_ns):
                return
            self._replaced += self._waiting is not None
            self._waiting = image, stamp_ns
            if not self._busy:
                self._busy, self._working = True, self._hand.submit(self._work)

    def on_outcome(self, outcome: Outcome, stamp_ns: int) -> Verdict:
        """Fuse what something else found, a marker or a beacon."""
        with self._lock:
            return self._localizer.fuse(outcome, None, stamp_ns)

    def reset(self, belief: PoseBelief | None) -> None:
        """Begin again at a belief; None: anywhere."""
        with self._lock:
            self._localizer.reset(belief)

    def pose_at(self, stamp_ns: int) -> PoseBelief | None:
        """Return the belief at a stamp, predicted where it is yet to come; None while lost, or too long ago."""
        with self._lock:
            return self._localizer.belief_at(stamp_ns)

    @property
    def belief(self) -> PoseBelief | None:
        """The newest belief; None while lost."""
        with self._lock:
            return self._localizer.belief

    @property
    def state(self) -> State:
        """How well the robot knows where it is."""
        return self.diagnosis.state

    @property
    def diagnosis(self) -> Diagnosis:
        """The state with its reasons."""
        with self._lock:
            return self._localizer.diagnosis

    @property
    def transforms(self) -> tuple[Pose2 | None, Pose2]:
        """Return map_from_odom (None while lost) and odom_from_robot of one moment (REP-105)."""
        with self._lock:
            return self._localizer.map_from_odom, self._localizer.odom_from_robot

    @property
    def dropped(self) -> int:
        """How many images were not matched, to keep to the rate or because a newer one came."""
        with self._lock:
            return self._pace.dropped + self._replaced

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until no image is being matched or waits; return whether that came in time."""
        with self._lock:
            done = self._idle.wait_for(lambda: not self._busy, timeout_s)
        self._raise_failure()
        return done

    def close(self) -> None:
        """Let the image being matched be finished, and drop the one that waits."""
        with self._lock:
            self._replaced += self._waiting is not None
            self._waiting = None
        self._hand.shutdown(wait=True)
        self._raise_failure()

    def _work(self) -> None:
        """Match the newest image until none waits."""
        try:
            while (task := self._next()) is not None:
                self._match(*task)
        finally:
            with self._lock:
                self._busy = False
                self._idle.notify_all()

    def _next(self) -> tuple[GreyImage, int] | None:
        with self._lock:
            task, self._waiting = self._waiting, None
            # Said under the same lock, or an image that comes now would wait for nobody.
            self._busy = task is not None
            return task

    def _match(self, image: GreyImage, stamp_ns: int) -> None:
        with self._lock:
            windows = self._localizer.windows_at(stamp_ns)
            otherwise = self._localizer.slip_windows_at(stamp_ns)
        looked = look_in(self._matcher, image, stamp_ns, windows, otherwise)
        with self._lock:
            verdict = self._localizer.fuse(looked.outcome, looked.window, stamp_ns)
        if self._watcher is not None:
            self._watcher(Seen(stamp_ns, looked.outcome, verdict))

    def _raise_failure(self) -> None:
        with self._lock:
            if self._busy or self._working is None:
                return
            ended, self._working = self._working, None
        # Outside the lock: the thread that ends may still need it.
        ended.result()
