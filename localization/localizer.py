"""Where the robot is: odometry and fixes in, belief, search window and state out."""

from __future__ import annotations

from dataclasses import dataclass, field

from localization.heading import HeadingConfig, HeadingSearch
from localization.history import History
from localization.odometry import OdometryStep
from localization.verdicts import ACCEPTED, Fused, Missed, Refusal, Rejected, Relocalized, Unused, Verdict
from localization.window import (
    ANYWHERE,
    State,
    StateConfig,
    WindowConfig,
    search_window,
    state_of,
)
from maps.outcomes import Ambiguous, Fix, NoFix, Outcome, PoseBelief, SearchWindow


@dataclass(frozen=True, slots=True)
class LocalizerConfig:
    """How fixes are judged.

    `gate`: probability that a good fix passes the chi-square gate on its innovation. `history_s`: how
    late a fix may come; longer than any matcher takes. `rivals_needed`: so many fixes on end that the gate
    refuses, but that agree with each other and with the odometry between them, outweigh the belief: a wheel
    has slipped, or somebody has moved the robot.
    """

    gate: float = 0.999
    history_s: float = 1.5
    rivals_needed: int = 3
    window: WindowConfig = field(default_factory=WindowConfig)
    state: StateConfig = field(default_factory=StateConfig)
    heading: HeadingConfig = field(default_factory=HeadingConfig)


class Localizer:
    """The belief over time, from odometry and absolute fixes, late or not.

    It has no belief, and is LOST, until it knows a position and a heading.
    """

    def __init__(self, initial: PoseBelief, config: LocalizerConfig | None = None) -> None:
        """Begin at a belief; what it does not know of the pose has an infinite variance."""
        self._config = config or LocalizerConfig()
        self.reset(initial)

    def reset(self, belief: PoseBelief) -> None:
        """Forget the past and begin again at a belief."""
        config, measured = self._config, belief.measured
        self._misses = 0
        self._history: History | None = None
        self._search: HeadingSearch | None = None
        self._rival: History | None = None
        self._rivals = 0
        if measured.all():
            self._history = History(belief, config.gate, config.history_s * 1e9)
        elif measured[:2].all():
            self._search = HeadingSearch(belief, config.heading, config.gate)

    @property
    def belief(self) -> PoseBelief | None:
        """The newest belief; None while lost."""
        return self._history.belief if self._history else None

    @property
    def state(self) -> State:
        """How well the robot knows where it is."""
        if self._history is None:
            return State.LOST
        return state_of(self._history.belief, self._history.fused_ns, self._config.state)

    def predict(self, step: OdometryStep) -> None:
        """Follow one odometry step; steps come in order of time."""
        if self._rival:
            self._rival.append(step)
        if self._history:
            self._history.append(step)
        elif self._search:
            self._search.predict(step)

    def fuse(self, outcome: Outcome) -> Verdict:
        """Take what came of a look at the world, and tell what became of it."""
        match outcome:
            case Fix(belief=fix):
                verdict = self._fuse(fix)
            case Ambiguous():
                verdict = Missed(Unused.AMBIGUOUS)
            case NoFix(reason=reason):
                verdict = Missed(reason)
        self._misses = 0 if isinstance(verdict, ACCEPTED) else self._misses + 1
        return verdict

    def belief_at(self, stamp_ns: int) -> PoseBelief | None:
        """Return the belief at a stamp; None while lost, and before the history begins."""
        return self._history.belief_at(stamp_ns) if self._history else None

    def window_at(self, stamp_ns: int) -> SearchWindow:
        """Return where an image of this stamp should be searched."""
        if self._history:
            belief = self._history.belief_at(stamp_ns) or self._history.belief
            return search_window(belief, self._misses, self._config.window)
        if self._search:
            return self._search.window_at(stamp_ns, self._config.window.probability)
        return ANYWHERE

    def _fuse(self, fix: PoseBelief) -> Verdict:
        if self._history:
            verdict: Verdict = self._history.insert(fix)
            if isinstance(verdict, Fused):
                self._rival = None
            elif isinstance(verdict, Rejected) and verdict.reason is Refusal.GATE and fix.measured.all():
                verdict = self._against_rival(fix) or verdict
            return verdict
        if self._search is None:
            return Missed(Unused.POSITION_UNKNOWN)
        self._history = self._search.gather(fix)
        if self._history is None:
            return Missed(Unused.HEADING_UNKNOWN)
        self._search = None
        verdict = self._history.verdict_of(fix)
        self._history.keep(self._config.history_s * 1e9)
        return verdict

    def _against_rival(self, fix: PoseBelief) -> Relocalized | None:
        """Let a refused fix join those refused before it, or begin anew; enough of them become the belief."""
        joined = self._rival.insert(fix) if self._rival else None
        if not isinstance(joined, Fused):
            self._rival, self._rivals = History(fix, self._config.gate, self._config.history_s * 1e9), 1
            return None
        self._rivals += 1
        if self._rivals < self._config.rivals_needed:
            return None
        self._history, self._rival = self._rival, None
        return Relocalized(joined.nis)
