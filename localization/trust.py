"""Which of the places is believed, and since when: the leading hypothesis, and whether it is trusted."""

from __future__ import annotations

from dataclasses import dataclass

from localization.beside import beside
from localization.ekf import innovation
from localization.hypotheses import Hypotheses, HypothesesConfig, Hypothesis
from localization.odometry import OdometryStep
from localization.sightings import Sighting
from localization.verdicts import Fused, Missed, Refusal, Rejected, Relocalized, Verdict
from maps.outcomes import PoseBelief

#: One look strains no more than this.
_MOST_PULL = 0.8


@dataclass(frozen=True, slots=True)
class TrustConfig:
    """When a place is believed.

    `sure`: probability at which a place found while lost is trusted, and above which it is not doubtful.
    `views`: so many looks apart from each other must have found it; one alone may be chance.
    `switch`: the leading place is trusted no longer once another one is so much likelier; less would make
    the published pose jump to and fro. The other one takes over when it is sure. `lost`: nor is a place
    less likely than this.
    `share`: nor one found while lost by fewer looks, up to `most_views`, than this share of those that have found
    something else or nothing since; the first `near` of them do not count: they were searched only where the robot
    was believed to be, and was not. Where most find nothing the map may be another building's, and what fits some of
    them does so by chance: until a place has been shown by `proven` looks all of them count, it is `unproven_share`
    of them, and against a place that was told `told_share`. That proof lapses after more than `lapse` looks on end
    that were not explained: two buildings' maps may agree on a part of a way.
    `patience`: a place is given up after so many looks on end that it did not explain, and one more for each that it
    did, up to `most_patience`. One that was told, and that nothing has shown, is soon given up; one that has been
    tracked lives on by odometry. One that `proven` looks have shown is `remembered` with that share of its weight:
    nothing is published, but a look that shows the robot where odometry has led from there does so by no chance.
    `usual_nis`, `bearable_nis`: squared innovations above the first add up (Page's cumulative sum, Biometrika 1954);
    once they come to the second, fixes have been pulling at the belief for longer than chance would have them: it may
    have slipped to where lines happen to fit. Then elsewhere is `strained` as likely at least, until a look that
    searched farther off found nothing better. Beyond `outlier_nis`, twice the gate, a fix is an outlier, which does
    not pull, unless it lies beside the place.
    """

    sure: float = 0.8
    views: float = 2.0
    switch: float = 2.0
    lost: float = 0.2
    share: float = 0.3
    near: float = 3.0
    unproven_share: float = 0.5
    told_share: float = 1.5
    proven: float = 8.0
    lapse: float = 10.0
    most_views: float = 6.0
    patience: float = 6.0
    most_patience: float = 60.0
    usual_nis: float = 5.0
    bearable_nis: float = 10.0
    outlier_nis: float = 33.0
    strained: float = 0.25
    remembered: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Mind:
    """All that is known at one time, a pure function of steps and looks in their order.

    `leader`: name of the leading hypothesis. `trusted`: whether it may be published. `misses`: looks on end
    that were not fused into it; `unexplained`: those among them with something to see, by how far they were apart.
    `strain`: how much of what is bearable fixes have pulled at it. `proven`: whether looks have shown that this is
    the map's building.
    """

    hypotheses: Hypotheses
    leader: int | None
    trusted: bool
    misses: int = 0
    unexplained: float = 0.0
    strain: float = 0.0
    proven: bool = False

    @classmethod
    def at(cls, belief: PoseBelief, config: HypothesesConfig) -> Mind:
        """Begin with a belief that is trusted."""
        return cls(Hypotheses.at(belief, config), 0, True)

    @classmethod
    def lost(cls) -> Mind:
        """Begin anywhere."""
        return cls(Hypotheses.none(), None, False)

    @property
    def leading(self) -> Hypothesis | None:
        """The leading hypothesis, trusted or not."""
        return None if self.leader is None else self.hypotheses.named(self.leader)

    @property
    def strained(self) -> bool:
        """Whether fixes have pulled at the leading place for longer than chance would have them."""
        return self.strain >= 1.0

    @property
    def trusted_place(self) -> Hypothesis | None:
        """The hypothesis to publish; None while lost."""
        return self.leading if self.trusted else None

    def moved(self, step: OdometryStep, config: HypothesesConfig) -> Mind:
        """Follow one step."""
        hypotheses = self.hypotheses.moved(step, config)
        trusted = self.trusted and any(place.name == self.leader for place in hypotheses.places)
        return Mind(hypotheses, self.leader, trusted, self.misses, self.unexplained, self.strain, self.proven)

    def seen(
        self, sighting: Sighting, gate: float, config: HypothesesConfig, trust: TrustConfig
    ) -> tuple[Mind, Verdict]:
        """Take a look at its stamp: the mind after it, and what became of the look."""
        hypotheses = self.hypotheses.seen(sighting, self.leader, gate, config)
        leader, trusted = self._chosen(hypotheses, trust)
        place = hypotheses.named(leader)
        if not trusted:
            verdict: Verdict = Missed(sighting.unused)
        elif (leader != self.leader or not self.trusted) and place and place.nis is not None:
            verdict = Relocalized(place.nis)
        elif place and place.nis is not None:
            verdict = Fused(place.nis)
        else:
            verdict = self._unfused(sighting)
        if isinstance(verdict, Relocalized):
            return Mind(hypotheses, leader, trusted, proven=self.proven), verdict
        strain = self._strained_by(verdict, sighting, config, trust)
        if trusted and strain >= 1.0:
            hypotheses = hypotheses.doubted(trust.strained)
        if isinstance(verdict, Fused) and place:
            proven = self.proven or place.views >= trust.proven
            return Mind(hypotheses, leader, trusted, strain=strain, proven=proven), verdict
        apart = 0.0 if sighting.blind else self.hypotheses.independence(sighting.stamp_ns, config)
        unexplained = self.unexplained + apart
        if trusted and place and unexplained > min(trust.patience + place.views, trust.most_patience):
            left = trust.remembered if place.views >= trust.proven else 0.0
            hypotheses, trusted = hypotheses.given_up(place, left), False
        proven = self.proven and unexplained <= trust.lapse
        return Mind(hypotheses, leader, trusted, self.misses + 1, unexplained, strain, proven), verdict

    def _strained_by(
        self, verdict: Verdict, sighting: Sighting, config: HypothesesConfig, trust: TrustConfig
    ) -> float:
        """Return the strain after a look; none once a search farther off has come back to the same place."""
        if self.strained and isinstance(verdict, Fused):
            return 0.0
        nis = verdict.nis if isinstance(verdict, Fused | Rejected) else None
        if nis is None or (nis > trust.outlier_nis and not self._beside(sighting, config)):
            return self.strain
        pulled = (nis - trust.usual_nis) / trust.bearable_nis
        return max(self.strain + min(pulled, _MOST_PULL), 0.0)

    def _beside(self, sighting: Sighting, config: HypothesesConfig) -> bool:
        """Whether a look shows one place, beside the leading one."""
        place = self.leading
        if place is None or len(sighting.places) != 1:
            return False
        return beside(place.estimate, sighting.places[0], config.beside)

    def _unfused(self, sighting: Sighting) -> Verdict:
        """Return why a look was not fused; one place is told how far off it was."""
        place = self.leading
        if place is None or len(sighting.places) != 1:
            return Missed(sighting.unused)
        return Rejected(Refusal.GATE, innovation(place.estimate, sighting.places[0]).nis)

    def _chosen(self, hypotheses: Hypotheses, trust: TrustConfig) -> tuple[int | None, bool]:
        """Return the leader's name and whether it is trusted."""
        if not hypotheses.places:
            return None, False
        best, old = hypotheses.places[0], hypotheses.named(self.leader)
        views = self._views_needed(best, trust)
        if self.trusted and old is not None:
            rival = next((place for place in hypotheses.places if place.views >= views), old)
            if old.weight >= max(trust.lost, rival.weight / trust.switch):
                return old.name, True
        return best.name, best.views >= views and best.weight >= trust.sure

    def _views_needed(self, place: Hypothesis, trust: TrustConfig) -> float:
        """Return how many looks must show a place, by how many others did not."""
        others = self.unexplained + 1.0 - place.views
        if self.proven:
            needed = trust.share * (others - trust.near)
        else:
            needed = (trust.told_share if self.trusted else trust.unproven_share) * others
        return min(max(trust.views, needed), trust.most_views)
