"""Where the robot is: odometry and looks at the world in; belief, search window and state out."""

from __future__ import annotations

from dataclasses import dataclass, field

from localization.deadreckoning import DeadReckoning
from localization.ekf import Estimate
from localization.heading import HeadingConfig, HeadingSearch
from localization.hypotheses import HypothesesConfig
from localization.odometry import OdometryStep
from localization.plausible import Plausibility, PlausibleConfig
from localization.sightings import EvidenceConfig, Sighting, sighting_of
from localization.states import Diagnosis, State, StateConfig, diagnose
from localization.timeline import Timeline, TimelineConfig
from localization.trust import Mind, TrustConfig
from localization.verdicts import Missed, Unused, Verdict
from localization.window import WindowConfig, search_windows, slip_windows
from maps.outcomes import Fix, Outcome, PoseBelief, SearchWindow
from maps.poses import Pose2


@dataclass(frozen=True, slots=True)
class LocalizerConfig:
    """How looks are judged.

    `gate`: probability that a good fix passes the chi-square gate on its innovation; what lies beside the belief may
    be farther out (`localization.beside`). `history_s`: how
    late a look may come; longer than any matcher takes.
    """

    gate: float = 0.999
    history_s: float = 1.5
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    trust: TrustConfig = field(default_factory=TrustConfig)
    window: WindowConfig = field(default_factory=WindowConfig)
    state: StateConfig = field(default_factory=StateConfig)
    heading: HeadingConfig = field(default_factory=HeadingConfig)
    plausible: PlausibleConfig = field(default_factory=PlausibleConfig)


class Localizer:
    """The belief over time, from odometry and looks at the world, late or not.

    It has no belief, and is LOST, until a place is trusted: told, or found by looks that confirm each other.
    """

    def __init__(self, initial: PoseBelief | None = None, config: LocalizerConfig | None = None) -> None:
        """Begin at a belief; None, or an infinite variance, for what is not known of the pose."""
        self._config = config or LocalizerConfig()
        self._reckoning = DeadReckoning()
        self._plausibility = Plausibility(self._config.plausible)
        self.reset(initial)

    def reset(self, belief: PoseBelief | None) -> None:
        """Forget what is believed and begin again at a belief, or anywhere; odometry since then counts.

        The odometry frame stays as it is.
        """
        steps = self._recent_steps()
        self._timeline: Timeline | None = None
        self._search: HeadingSearch | None = None
        if belief is not None:
            known = belief.measured
            mind = Mind.at(belief, self._config.hypotheses) if known.all() else Mind.lost()
            self._timeline = Timeline(belief.stamp_ns, mind, self._parts(self._config.history_s * 1e9))
            if known[:2].all() and not known[2]:
                self._search = self._searching(belief)
        for step in steps:
            self._follow(step)

    @property
    def belief(self) -> PoseBelief | None:
        """The newest belief; None while lost."""
        return self.belief_at(self._timeline.newest_ns) if self._timeline else None

    @property
    def state(self) -> State:
        """How well the robot knows where it is."""
        return self.diagnosis.state

    @property
    def diagnosis(self) -> Diagnosis:
        """The state with its reasons."""
        return diagnose(*self._now(), self._config.state)

    @property
    def beliefs(self) -> tuple[tuple[PoseBelief, float], ...]:
        """All places that compete, trusted or not, with their probabilities, the likeliest first."""
        mind, _ = self._now()
        return tuple((place.estimate.belief, place.weight) for place in mind.hypotheses.places)

    @property
    def odom_from_robot(self) -> Pose2:
        """Dead reckoning since the beginning, at the newest odometry: it drifts, and never jumps (REP-105)."""
        return self._reckoning.odom_from_robot

    @property
    def map_from_odom(self) -> Pose2 | None:
        """What corrects the odometry frame; it jumps where `odom_from_robot` does not. None while lost."""
        belief = self.belief_at(self._reckoning.stamp_ns)
        return None if belief is None else belief.pose @ self._reckoning.odom_from_robot.inverse()

    @property
    def implausible(self) -> int:
        """How many odometry steps said what no wheels can do, and were not believed."""
        return self._plausibility.refused

    def predict(self, step: OdometryStep) -> OdometryStep:
        """Follow one odometry step, and return it as it was believed; steps come in order of time."""
        believed = self._plausibility.checked(step)
        self._reckoning.follow(believed)
        self._follow(believed)
        return believed

    def fuse(
        self, outcome: Outcome, window: SearchWindow | None = None, stamp_ns: int | None = None
    ) -> Verdict:
        """Take what came of a look at the world, and tell what became of it.

        `window`: the widest searched, None where nothing was. `stamp_ns`: of the image, needed where it shows
        no place; that of the newest odometry if nobody says.
        """
        newest_ns = self._timeline.end_ns if self._timeline else 0
        look = sighting_of(
            outcome, newest_ns if stamp_ns is None else stamp_ns, window, self._config.evidence
        )
        if self._timeline is None:
            self._timeline = self._anywhere(look.stamp_ns)
        verdict = self._timeline.insert(look)
        if self._now()[0].trusted:
            self._search = None
            return verdict
        return self._oriented(look, verdict) if isinstance(outcome, Fix) else verdict

    def belief_at(self, stamp_ns: int) -> PoseBelief | None:
        """Return the belief at a stamp; None while lost, and before the history begins."""
        estimate = self.estimate_at(stamp_ns)
        return estimate.belief if estimate else None

    def estimate_at(self, stamp_ns: int) -> Estimate | None:
        """Return the belief at a stamp together with odometry's systematic errors; None as `belief_at`."""
        mind = self._timeline.mind_at(stamp_ns) if self._timeline else None
        place = mind.trusted_place if mind else None
        return place.estimate if place else None

    def windows_at(self, stamp_ns: int) -> tuple[SearchWindow, ...]:
        """Return where an image of this stamp should be searched, the widest window last."""
        mind = self._expected(stamp_ns)
        if self._search and mind.misses < self._config.heading.misses:
            return (self._search.window_at(stamp_ns, self._config.window.probability),)
        return search_windows(mind, self._config.window)

    def slip_windows_at(self, stamp_ns: int) -> tuple[SearchWindow, ...]:
        """Return where to search it too if those windows show no place: wheels may have slipped."""
        return () if self._search else slip_windows(self._expected(stamp_ns), self._config.window)

    def _expected(self, stamp_ns: int) -> Mind:
        """Return what is known of a stamp; that of the newest one before the history begins."""
        return (self._timeline.mind_at(stamp_ns) if self._timeline else None) or self._now()[0]

    def _now(self) -> tuple[Mind, int]:
        """Return what is known at the newest stamp, and that stamp."""
        if self._timeline is None:
            return Mind.lost(), 0
        newest_ns = self._timeline.newest_ns
        mind = self._timeline.mind_at(newest_ns)
        return (mind or Mind.lost()), newest_ns

    def _follow(self, step: OdometryStep) -> None:
        if self._timeline is None:
            self._timeline = self._anywhere(step.start_ns)
        self._timeline.append(step)
        if self._search:
            self._search.predict(step)

    def _recent_steps(self) -> list[OdometryStep]:
        timeline = getattr(self, "_timeline", None)
        return timeline.steps if timeline else []

    def _oriented(self, look: Sighting, verdict: Verdict) -> Verdict:
        """Let a look that founds no place by itself, for want of a heading, help to find one."""
        fix = look.places[0]
        if self._search is None or self._search.stuck(fix.stamp_ns):
            if fix.measured[2] or self._timeline is None:
                return verdict
            self._search = self._searching(fix)
            for step in self._timeline.steps:
                self._search.predict(step)
            return Missed(Unused.HEADING_UNKNOWN)
        found = self._search.gather(look)
        if found is None:
            return Missed(Unused.HEADING_UNKNOWN)
        self._timeline, self._search = found, None
        verdict = found.verdict_of(look)
        found.keep(self._config.history_s * 1e9)
        return verdict

    def _anywhere(self, stamp_ns: int) -> Timeline:
        return Timeline(stamp_ns, Mind.lost(), self._parts(self._config.history_s * 1e9))

    def _searching(self, start: PoseBelief) -> HeadingSearch:
        return HeadingSearch(start, self._config.heading, self._parts(float("inf")))

    def _parts(self, span_ns: float) -> TimelineConfig:
        return TimelineConfig(self._config.gate, span_ns, self._config.hypotheses, self._config.trust)
