"""The motion model of a differential drive: steps from wheel angles or twists, and their errors.

Between two odometry stamps the robot runs along a circular arc (Thrun et al., Probabilistic Robotics,
section 5.4), so a step is an arc length and a turn. Two kinds of errors come with it: random ones,
independent from step to step, and systematic ones, which a few parameters of the robot explain (Borenstein
and Feng, IEEE Trans. Robotics and Automation 1996): the filter estimates those along with the pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from localization.motion import displacement
from maps.poses import Array, Pose2, frozen

#: How many parameters explain the systematic errors. Each is a unit normal a priori.
PARAMETERS = 4
#: Of a step that knows only random errors.
_UNBIASED = frozen(np.zeros((3, PARAMETERS)))


@dataclass(frozen=True, slots=True, eq=False)
class OdometryStep:
    """The robot's motion between two odometry stamps.

    `forward_m` along the arc and `turn_rad` counter-clockwise; `covariance`: (2, 2) of the two
    [m^2, m rad, rad^2]; `sideways_m2`: variance of a slip to the side.
    `systematic`: (3, PARAMETERS), what one standard deviation of each parameter adds to (forward, turn,
    sideways) [m, rad, m]. `forgetting`: the parameters' correlation falls by exp(-forgetting) within the
    step, towards what was known of them a priori. `slip`: how many times its variance a step may be off by
    more when the wheels do not grip.
    """

    start_ns: int
    stamp_ns: int
    forward_m: float
    turn_rad: float
    covariance: Array
    sideways_m2: float = 0.0
    systematic: Array = field(default_factory=lambda: _UNBIASED)
    forgetting: float = 0.0
    slip: float = 0.0
    #: Covariance of the random errors of (forward, turn, sideways), (3, 3).
    random: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))
        object.__setattr__(self, "systematic", frozen(self.systematic))
        random = np.zeros((3, 3))
        random[:2, :2], random[2, 2] = self.covariance, self.sideways_m2
        random.setflags(write=False)
        object.__setattr__(self, "random", random)

    def part(self, start_ns: int, stamp_ns: int) -> OdometryStep:
        """Return the share of this step between two stamps: motion, variance and bias linear in time.

        Consecutive shares compose back to the step. Stamps beyond its end continue its rates.
        """
        if (start_ns, stamp_ns) == (self.start_ns, self.stamp_ns):
            return self
        share = (stamp_ns - start_ns) / (self.stamp_ns - self.start_ns)
        return OdometryStep(
            start_ns,
            stamp_ns,
            share * self.forward_m,
            share * self.turn_rad,
            share * self.covariance,
            share * self.sideways_m2,
            share * self.systematic,
            share * self.forgetting,
            self.slip,
        )

    def continued(self, stamp_ns: int) -> OdometryStep:
        """Guess the motion from this step's end to a later stamp."""
        return self.gone_on(self.stamp_ns, stamp_ns)

    def gone_on(self, start_ns: int, stamp_ns: int) -> OdometryStep:
        """Guess the motion between two later stamps: this step's rates go on.

        The robot may as well have stopped, or doubled its speed: one standard deviation.
        """
        guess = self.part(start_ns, stamp_ns)
        unknown = np.diag([guess.forward_m**2, guess.turn_rad**2])
        return replace(guess, covariance=guess.covariance + unknown)

    def then(self, step: OdometryStep) -> tuple[OdometryStep, ...]:
        """Return what lies after this step's end of another one, with the hole between them filled."""
        if step.stamp_ns <= self.stamp_ns:
            return ()
        if step.start_ns <= self.stamp_ns:
            return (step.part(self.stamp_ns, step.stamp_ns),)
        return (self.continued(step.start_ns), step)


@dataclass(frozen=True, slots=True)
class WheelGeometry:
    """The two driven wheels: rolling radii, and the distance between their points of contact [m].

    `std_…`: how well each is known [m]; None where nobody says.
    """

    left_radius_m: float
    right_radius_m: float
    baseline_m: float
    std_left_radius_m: float | None = None
    std_right_radius_m: float | None = None
    std_baseline_m: float | None = None


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """How odometry goes wrong: randomly, with variances that grow with the way, and systematically.

    `wheel_m2_per_m`: of each wheel's roll, 3 mm after a metre: slip and uneven floors. Chong and Kleeman
    (ICRA 1997) found 0.6 mm on encoder wheels that carry no load; driven wheels do worse.
    `twist_forward_m2_per_m`, `twist_turn_rad2_per_rad`, `twist_turn_rad2_per_m`: twists are often commanded
    or filtered speeds, late and held too long: 5 cm after a metre, 0.07 rad after a turn of 1 rad, and a
    straight metre bends by 0.03 rad.
    `wheel_slip`, `twist_slip`: where the wheels do not grip, variances are so many times more: 2 cm after a
    metre, 10 cm for twists, whose variances know a good deal of it already.
    `sideways_share`: of the forward variance; slip in turns.
    `swerve_radps2`: how fast the rate of a turn may change within a step of wheels, of which nobody sees more than
    its ends: next to nothing between rows 20 ms apart, a good deal where rows are lost for seconds. It leads no
    farther aside than `most_swerve` of the way.
    `floor_m2_per_s`, `floor_rad2_per_s`: 0.5 mm and 0.03 degrees after a second, moving or not. At
    standstill one view, and so one error, comes again and again: averaging must not trust it.

    The rest are standard deviations of systematic errors, shares of the measured value if not said otherwise.
    `radius_share`, `baseline_share`: for wheels whose geometry does not say it. A tape measures a radius to
    a quarter of a millimetre; the points of contact of wide or soft wheels are known less well.
    `twist_forward_share`, `twist_turn_share`: what a driver's scale is off.
    `twist_bias_radps`: 0.1 degrees per second, as a cheap gyroscope keeps after its zero was set.
    `crab_rad`: between the direction of travel and the heading that fixes tell, as a camera or
    markers are mounted by eye.
    `memory_s`: for so long these errors last; load, tyres and floors change.
    """

    wheel_m2_per_m: float = 1e-5
    twist_forward_m2_per_m: float = 2.5e-3
    twist_turn_rad2_per_rad: float = 1e-2
    twist_turn_rad2_per_m: float = 1e-3
    wheel_slip: float = 10.0
    twist_slip: float = 15.0
    sideways_share: float = 0.1
    swerve_radps2: float = 2.0
    most_swerve: float = 0.25
    floor_m2_per_s: float = 2.5e-7
    floor_rad2_per_s: float = 2.5e-7
    radius_share: float = 0.005
    baseline_share: float = 0.01
    twist_forward_share: float = 0.1
    twist_turn_share: float = 0.1
    twist_bias_radps: float = 2e-3
    crab_rad: float = 0.01
    memory_s: float = 100.0


def wheel_step(
    start_ns: int,
    stamp_ns: int,
    left_rad: float,
    right_rad: float,
    geometry: WheelGeometry,
    noise: OdometryNoise,
) -> OdometryStep:
    """Return the step of wheels that turned by `left_rad` and `right_rad` between two stamps.

    Its parameters: left radius, right radius, baseline, crab.
    """
    left_m, right_m = geometry.left_radius_m * left_rad, geometry.right_radius_m * right_rad
    baseline_m = geometry.baseline_m
    forward_m, turn_rad = 0.5 * (left_m + right_m), (right_m - left_m) / baseline_m
    # Variances of the wheels' rolls, to the middle and to the turn: (l + r)/2 and (r - l)/b.
    left_m2, right_m2 = noise.wheel_m2_per_m * abs(left_m), noise.wheel_m2_per_m * abs(right_m)
    cross = 0.5 * (right_m2 - left_m2) / baseline_m
    swerve_m = _swerve_m(forward_m, (stamp_ns - start_ns) * 1e-9, noise)
    # Who swerves does not only end aside, but also nearer.
    middle_m2 = 0.25 * (left_m2 + right_m2) + (0.3 * swerve_m) ** 2
    random = ((middle_m2, cross), (cross, (left_m2 + right_m2) / baseline_m**2))
    left_off = left_rad * _known(geometry.std_left_radius_m, noise.radius_share * geometry.left_radius_m)
    right_off = right_rad * _known(geometry.std_right_radius_m, noise.radius_share * geometry.right_radius_m)
    narrow = _known(geometry.std_baseline_m, noise.baseline_share * baseline_m) / baseline_m
    systematic = (
        (0.5 * left_off, 0.5 * right_off, 0.0, 0.0),
        (-left_off / baseline_m, right_off / baseline_m, -narrow * turn_rad, 0.0),
        (0.0, 0.0, 0.0, noise.crab_rad * forward_m),
    )
    motion = forward_m, turn_rad
    return _step(start_ns, stamp_ns, motion, random, systematic, noise, noise.wheel_slip, swerve_m)


def _swerve_m(forward_m: float, seconds: float, noise: OdometryNoise) -> float:
    """Return how far aside of its arc's end a step may end that turned early or late, one standard deviation.

    A turn rate that changes evenly by a dt bends the way by v a dt^3 / 12 at its end, against the mean rate's arc.
    """
    return abs(forward_m) * min(noise.swerve_radps2 * seconds**2 / 12.0, noise.most_swerve)


def twist_step(
    start_ns: int, stamp_ns: int, forward_mps: float, turn_radps: float, noise: OdometryNoise
) -> OdometryStep:
    """Return the step of a robot that kept one twist between two stamps.

    Its parameters: scale of the speed, scale and bias of the turn rate, crab.
    """
    seconds = (stamp_ns - start_ns) * 1e-9
    forward_m, turn_rad = forward_mps * seconds, turn_radps * seconds
    forward_m2 = noise.twist_forward_m2_per_m * abs(forward_m)
    turn_rad2 = noise.twist_turn_rad2_per_rad * abs(turn_rad) + noise.twist_turn_rad2_per_m * abs(forward_m)
    systematic = (
        (noise.twist_forward_share * forward_m, 0.0, 0.0, 0.0),
        (0.0, noise.twist_turn_share * turn_rad, noise.twist_bias_radps * seconds, 0.0),
        (0.0, 0.0, 0.0, noise.crab_rad * forward_m),
    )
    random = ((forward_m2, 0.0), (0.0, turn_rad2))
    return _step(start_ns, stamp_ns, (forward_m, turn_rad), random, systematic, noise, noise.twist_slip)


def standing_step(start_ns: int, stamp_ns: int, noise: OdometryNoise) -> OdometryStep:
    """Return the step of a robot that is taken to stand still between two stamps."""
    nothing = ((0.0, 0.0), (0.0, 0.0))
    return _step(start_ns, stamp_ns, (0.0, 0.0), nothing, _UNBIASED, noise)


def _known(std_m: float | None, otherwise_m: float) -> float:
    return otherwise_m if std_m is None else std_m


def _step(
    start_ns: int,
    stamp_ns: int,
    motion: tuple[float, float],
    random: tuple[tuple[float, float], tuple[float, float]],
    systematic: Array | tuple[tuple[float, ...], ...],
    noise: OdometryNoise,
    slip: float = 0.0,
    swerve_m: float = 0.0,
) -> OdometryStep:
    """Return a step with the floor under its random errors."""
    seconds = (stamp_ns - start_ns) * 1e-9
    floor_m2, floor_rad2 = noise.floor_m2_per_s * seconds, noise.floor_rad2_per_s * seconds
    (forward_m2, cross), (_, turn_rad2) = random
    return OdometryStep(
        start_ns,
        stamp_ns,
        *motion,
        np.array([[forward_m2 + floor_m2, cross], [cross, turn_rad2 + floor_rad2]]),
        noise.sideways_share * forward_m2 + swerve_m**2 + floor_m2,
        np.asarray(systematic),
        seconds / noise.memory_s,
        slip,
    )


def advance(pose: Pose2, step: OdometryStep) -> Pose2:
    """Move a pose along a step's arc, as if it had no errors."""
    x, y = displacement(pose.phi, step.forward_m, step.turn_rad, 0.0)
    return Pose2(pose.x + x, pose.y + y, pose.phi + step.turn_rad)
