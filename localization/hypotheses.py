"""The places where the robot may be, each a Gaussian with a weight, and somewhere else.

A Gaussian-sum filter (Thrun et al., Probabilistic Robotics, section 7.5: the multi-hypothesis Kalman filter). All
functions here are pure: the same looks and steps in the same order give the same hypotheses, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from localization.beside import BesideConfig, beside
from localization.ekf import Estimate, Innovation, innovation, predict, quantile, update
from localization.odometry import OdometryStep
from localization.sightings import Sighting
from maps.outcomes import PoseBelief


@dataclass(frozen=True, slots=True)
class HypothesesConfig:
    """How hypotheses come, compete and go.

    `outlier`: likelihood, relative to a perfect fit, of a look under a hypothesis that does not explain
    it. Looks are no more trusted than that, because neighbouring ones share their errors; for the same
    reason log-likelihoods are divided by `temper`, as the matcher divides its own. Looks nearer than all of
    `apart_s`, `apart_m` and `apart_rad` to the one before count in proportion.
    `elsewhere`: least probability of being somewhere else altogether: wheels slip, people move robots. With
    it, three agreeing looks outweigh a hypothesis that explains none of them. `founding`: of what speaks for
    elsewhere, so much goes to a place that a look finds there. `strange`: likelihood of a look under
    elsewhere if no hypothesis explains it and it cannot found one, as positions without a heading.
    `least_odds`: places of an ambiguous look with less are not fused. Those with more count alike: what makes
    one of two look-alikes likelier in one image does so in the next. `most`: hypotheses kept. `same_m`,
    `same_rad`: hypotheses so near each other that either explains the other are one. `beside`: what is no other
    place though it is beyond the gate. `dropped`: a hypothesis with less than this share of the leading one goes
    once a look supports that one alone. `vague_m`, `vague_rad`: standard deviations beyond which a Gaussian says
    nothing. `founding_m`, `founding_rad`: greatest standard deviations of a look that founds a hypothesis.
    """

    outlier: float = 0.1
    temper: float = 4.0
    apart_s: float = 0.5
    apart_m: float = 0.1
    apart_rad: float = 0.1
    elsewhere: float = 0.01
    founding: float = 0.5
    strange: float = 0.25
    least_odds: float = 0.2
    most: int = 5
    same_m: float = 0.3
    same_rad: float = 0.5
    beside: BesideConfig = field(default_factory=BesideConfig)
    dropped: float = 0.1
    vague_m: float = 3.0
    vague_rad: float = 1.0
    founding_m: float = 0.5
    founding_rad: float = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """An estimate with its weight among all.

    `fused_ns`: stamp of the newest look fused. `views`: looks apart from each other that it explained.
    `nis`: of the newest look, None where it was not explained. `name`: its line of descent.
    """

    estimate: Estimate
    weight: float
    fused_ns: int
    views: float
    name: int
    nis: float | None = None

    def weighing(self, weight: float) -> Hypothesis:
        """Return the same with another weight."""
        # Several times faster than dataclasses' replace, at every look.
        return Hypothesis(self.estimate, weight, self.fused_ns, self.views, self.name, self.nis)


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """The places, heaviest first, and the probability of being elsewhere; together they weigh one.

    `looked_ns`: the newest look; `way_m`, `way_rad`: rolled and turned since. `born`: hypotheses ever founded.
    """

    places: tuple[Hypothesis, ...]
    elsewhere: float
    looked_ns: int | None = None
    way_m: float = 0.0
    way_rad: float = 0.0
    born: int = 0

    @classmethod
    def at(cls, belief: PoseBelief, config: HypothesesConfig) -> Hypotheses:
        """Begin with one place."""
        place = Hypothesis(Estimate.of(belief), 1.0 - config.elsewhere, belief.stamp_ns, 0.0, 0)
        return cls((place,), config.elsewhere, born=1)

    @classmethod
    def none(cls) -> Hypotheses:
        """Begin anywhere."""
        return cls((), 1.0)

    def named(self, name: int | None) -> Hypothesis | None:
        """Return the hypothesis of a name, None where it is gone."""
        return next((place for place in self.places if place.name == name), None)

    def given_up(self, place: Hypothesis, share: float) -> Hypotheses:
        """Give up a place: all but a share of its weight goes elsewhere; without any it is forgotten."""
        places = [other for other in self.places if other is not place]
        if share > 0.0:
            places.append(place.weighing(share * place.weight))
        places.sort(key=lambda other: -other.weight)
        elsewhere = self.elsewhere + (1.0 - share) * place.weight
        return Hypotheses(tuple(places), elsewhere, self.looked_ns, self.way_m, self.way_rad, self.born)

    def doubted(self, elsewhere: float) -> Hypotheses:
        """Let elsewhere be that likely at least."""
        if self.elsewhere >= elsewhere:
            return self
        scale = (1.0 - elsewhere) / (1.0 - self.elsewhere)
        places = tuple(place.weighing(scale * place.weight) for place in self.places)
        return Hypotheses(places, elsewhere, self.looked_ns, self.way_m, self.way_rad, self.born)

    def moved(self, step: OdometryStep, config: HypothesesConfig) -> Hypotheses:
        """Move every place along a step; what has become too vague to say anything goes elsewhere."""
        places, elsewhere = [], self.elsewhere
        for place in self.places:
            estimate = predict(place.estimate, step)
            spread = estimate.joint
            if spread[0, 0] + spread[1, 1] > config.vague_m**2 or spread[2, 2] > config.vague_rad**2:
                elsewhere += place.weight
            else:
                places.append(
                    Hypothesis(estimate, place.weight, place.fused_ns, place.views, place.name, place.nis)
                )
        way_m, way_rad = self.way_m + abs(step.forward_m), self.way_rad + abs(step.turn_rad)
        return Hypotheses(tuple(places), elsewhere, self.looked_ns, way_m, way_rad, self.born)

    def seen(
        self, sighting: Sighting, leader: int | None, gate: float, config: HypothesesConfig
    ) -> Hypotheses:
        """Weigh every place by a look at its stamp, fuse what fits, and found what nobody expected.

        `leader`: the name of the hypothesis that is spared when too many are there.
        """
        count = self.independence(sighting.stamp_ns, config)
        lost = config.outlier if sighting.doubt is None else sighting.doubt
        found, expected = list[Hypothesis](), set[int]()
        born = self.born
        for place in self.places:
            fits = _fits(place.estimate, sighting, gate, config)
            expected.update(number for number, *_ in fits)
            heirs = list(_heirs(place, sighting, fits, (lost, count), self.elsewhere, config))
            # The heaviest heir keeps the name; ties go to the likelier place, which comes first.
            first = max(heirs, key=lambda heir: heir.weight)
            for heir in heirs:
                found.append(heir if heir is first else replace(heir, name=born))
                born += heir is not first
        left = self.elsewhere
        if sighting.places:
            new = list(_founded(sighting, expected, left, born, config))
            found += new
            born += len(sighting.places)
            # A look that nobody explains, and that founds nothing, speaks for elsewhere all the same.
            left *= (config.outlier if new or expected else config.strange) ** count
        return _settled(
            Hypotheses(tuple(found), left, sighting.stamp_ns, 0.0, 0.0, born), leader, gate, config
        )

    def independence(self, stamp_ns: int, config: HypothesesConfig) -> float:
        """Return how far a look of this stamp is another one than the last, from 0 to 1."""
        if self.looked_ns is None:
            return 1.0
        seconds = (stamp_ns - self.looked_ns) * 1e-9
        apart = (seconds / config.apart_s, self.way_m / config.apart_m, self.way_rad / config.apart_rad)
        return min(1.0, max(apart))


#: A place of a look that is a hypothesis', too: its number, what it says anew, by how much both covariances must be
#: widened for that, its likelihood.
Fit = tuple[int, Innovation, float, float]


def _fits(estimate: Estimate, sighting: Sighting, gate: float, config: HypothesesConfig) -> list[Fit]:
    fits, alone = [], len(sighting.places) == 1
    for number, (place, odds) in enumerate(zip(sighting.places, sighting.odds, strict=True)):
        news = innovation(estimate, place)
        likely = math.exp(-0.5 * news.nis / config.temper)
        beyond = news.nis / quantile(gate, news.dof)
        if beyond <= 1.0:
            fits.append((number, news, 1.0, _alike(odds, config) * likely))
        elif alone and beyond <= config.beside.gates and beside(estimate, place, config.beside):
            fits.append((number, news, beyond, max(likely, config.beside.likelihood)))
    return fits


def _alike(odds: float, config: HypothesesConfig) -> float:
    """Return what a place of a look counts: look-alikes the same, what is much less likely in proportion."""
    return min(odds / config.least_odds, 1.0)


def _heirs(
    place: Hypothesis,
    sighting: Sighting,
    fits: list[Fit],
    doubt: tuple[float, float],
    elsewhere: float,
    config: HypothesesConfig,
) -> Iterator[Hypothesis]:
    """Yield what a look makes of a hypothesis: one for each place that fits it.

    `doubt`: its likelihood if it does not, and how much the look counts. What fits weighs no less than
    if it were founded anew.
    """
    lost, count = doubt
    fused = [fit for fit in fits if sighting.odds[fit[0]] >= config.least_odds]
    likelihood = lost + (1.0 - lost) * max((likely for *_, likely in fits), default=0.0)
    if not fused:
        yield replace(place, weight=place.weight * likelihood**count, nis=None)
        return
    total = sum(likely for *_, likely in fused)
    least = config.founding * elsewhere
    for number, news, beyond, likely in fused:
        yield Hypothesis(
            update(place.estimate, sighting.places[number], news, beyond),
            max(place.weight * likelihood**count * likely / total, least * sighting.odds[number]),
            sighting.stamp_ns,
            place.views + count,
            place.name,
            news.nis,
        )


def _founded(
    sighting: Sighting, expected: set[int], elsewhere: float, born: int, config: HypothesesConfig
) -> Iterator[Hypothesis]:
    """Yield a hypothesis for each place that none expected and that is narrow enough to be one."""
    shares = [_alike(odds, config) for odds in sighting.odds]
    for number, (belief, share) in enumerate(zip(sighting.places, shares, strict=True)):
        if number in expected or not belief.measured.all():
            continue
        if belief.position_std_m <= config.founding_m and belief.heading_std_rad <= config.founding_rad:
            weight = config.founding * elsewhere * share / sum(shares)
            yield Hypothesis(Estimate.of(belief), weight, sighting.stamp_ns, 1.0, born + number)


def _settled(found: Hypotheses, leader: int | None, gate: float, config: HypothesesConfig) -> Hypotheses:
    """Merge what is one place, drop what does not count, and make the weights sum to one."""
    places = _merged(sorted(found.places, key=lambda place: -place.weight), leader, gate, config)
    first = next((place for place in places if place.name == leader), None)
    if first is not None and first.nis is not None:
        least = config.dropped * first.weight
        places = [place for place in places if place.nis is not None or place.weight >= least]
    room = config.most - (first is not None)
    others = [place for place in places if place is not first][:room]
    places = sorted([first, *others] if first else others, key=lambda place: -place.weight)
    weights = sum(place.weight for place in places)
    total = weights + found.elsewhere
    elsewhere = max(found.elsewhere / total, config.elsewhere) if places else 1.0
    scale = (1.0 - elsewhere) / weights if places else 0.0
    kept = tuple(place.weighing(place.weight * scale) for place in places)
    return Hypotheses(kept, elsewhere, found.looked_ns, found.way_m, found.way_rad, found.born)


def _merged(
    places: list[Hypothesis], leader: int | None, gate: float, config: HypothesesConfig
) -> list[Hypothesis]:
    """Let the heavier of two hypotheses of one place, heaviest first, take the other's weight."""
    if len(places) < 2:
        return places
    kept: list[Hypothesis] = []
    for place in places:
        twin = next((i for i, k in enumerate(kept) if _same(k.estimate, place.estimate, gate, config)), None)
        if twin is None:
            kept.append(place)
            continue
        heavy = kept[twin]
        kept[twin] = replace(
            heavy,
            weight=heavy.weight + place.weight,
            views=max(heavy.views, place.views),
            name=place.name if place.name == leader else heavy.name,
        )
    return kept


def _same(estimate: Estimate, other: Estimate, gate: float, config: HypothesesConfig) -> bool:
    away = estimate.pose.minus(other.pose)
    near = math.hypot(away[0], away[1]) <= config.same_m and abs(away[2]) <= config.same_rad
    return near and innovation(estimate, other.belief).nis <= quantile(gate, 3)
