"""One drive as one least-squares problem: every frame's pose, the robot's parameters, and the map's own errors.

    maximise over  robot, poses, sways, shifts
        p(lines | mount, pose + sway, map + shift)  p(motion between poses | odometry, wheels, time offset)
        p(sway)  p(shift)  p(robot)

The errors of one map segment are shared by all frames that see it: without the shifts, a hundred looks at one
misplaced edge would count as a hundred witnesses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from localization.drivenmotion import OdometryRecord, motions_between
from localization.odometry import OdometryNoise
from maps.poses import Array, frozen, wrap_angle
from vision.camera import Camera
from vision.seenlines import COLUMNS, MOUNT, MOUNT_PARAMETERS, PLACE, MapLines, SeenLines, line_residuals
from vision.seenlines import with_mount as mounted

#: The robot's parameters: six of the mount, four of odometry.
ROBOT = len(MOUNT_PARAMETERS) + 4
#: Unknowns of a frame: pose and sway.
FRAME = 5


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One frame: its stamp by the camera's clock [s], a guess of its pose (3,), and its matched lines."""

    stamp_s: float
    pose: Array
    seen: SeenLines


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known of the robot's parameters beforehand: `values`, `std` (10,), mount first, then odometry."""

    values: Array
    std: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))
        object.__setattr__(self, "std", frozen(self.std))


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Residuals of one kind: n of d components each, `residuals` (n, d), whitened; `jacobian` (n d, unknowns).

    `student`: degrees of freedom of their distribution, infinite for a normal one. `scaled`: whether their spread
    is estimated, too.
    """

    residuals: Array
    jacobian: csr_array
    student: float
    scaled: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """All unknowns: `robot` (10,), `frames` (F, 5) of x, y, phi and two sways, `shifts` (N, 2) of the map."""

    robot: Array
    frames: Array
    shifts: Array


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """How errors are distributed.

    `lines`, `motion`, `places`: degrees of freedom of Student distributions: few, as lines are mistaken for their
    neighbours, wheels slip and doors stand open. `sway_rad`: how far the camera's pitch and roll differ from frame
    to frame, as floors are uneven and masts sway.
    """

    lines: float = 5.0
    motion: float = 5.0
    places: float = 5.0
    sway_rad: float = 5e-4


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that does not change while the unknowns are sought. `map_sigma_m`: (N,)."""

    camera: Camera
    segments: MapLines
    map_sigma_m: Array
    record: OdometryRecord
    odometry: OdometryNoise
    prior: Prior
    views: tuple[View, ...]
    noise: NoiseModel

    @cached_property
    def used(self) -> NDArray[np.int64]:
        """The map segments that some frame sees, (S,)."""
        return np.unique(self.seen.rows)

    @cached_property
    def seen(self) -> SeenLines:
        """All frames' lines."""
        return SeenLines.joined([view.seen for view in self.views])

    @property
    def unknowns(self) -> int:
        """How many there are."""
        return ROBOT + FRAME * len(self.views) + 2 * len(self.used)

    def start(self, robot: Array | None = None) -> State:
        """Return the state that the views' guesses and the prior make."""
        frames = np.zeros((len(self.views), FRAME))
        frames[:, :3] = [view.pose for view in self.views]
        values = self.prior.values if robot is None else robot
        return State(np.array(values), frames, np.zeros((len(self.map_sigma_m), 2)))

    def moved(self, state: State, step: Array) -> State:
        """Return a state after a step (unknowns,)."""
        shifts = state.shifts.copy()
        shifts[self.used] += step[self._first_shift :].reshape(-1, 2)
        frames = state.frames + step[ROBOT : self._first_shift].reshape(-1, FRAME)
        return State(state.robot + step[:ROBOT], frames, shifts)

    def blocks(self, state: State) -> dict[str, Block]:
        """Return all residuals at a state."""
        sways = state.frames[:, 3:] / self.noise.sway_rad
        columns = np.add.outer(ROBOT + FRAME * np.arange(len(self.views)), [3, 4])
        places = state.shifts[self.used] / self.map_sigma_m[self.used, None]
        weights = np.repeat(1.0 / self.map_sigma_m[self.used], 2)
        robot = (state.robot - self.prior.values) / self.prior.std
        return {
            "lines": self._lines(state),
            "motion": self._motion(state),
            "sways": self._plain(
                sways, columns.ravel(), np.full(sways.size, 1 / self.noise.sway_rad), np.inf
            ),
            "places": self._plain(
                places, np.arange(self._first_shift, self.unknowns), weights, self.noise.places
            ),
            "prior": self._plain(robot[:, None], np.arange(ROBOT), 1.0 / self.prior.std, np.inf, False),
        }

    @property
    def _first_shift(self) -> int:
        return ROBOT + FRAME * len(self.views)

    def _lines(self, state: State) -> Block:
        camera = mounted(self.camera, state.robot[: len(MOUNT_PARAMETERS)])
        apart, by = line_residuals(camera, state.frames, self.seen, self.segments, state.shifts)
        columns = np.empty((len(self.seen), COLUMNS), np.int64)
        columns[:, :FRAME] = ROBOT + FRAME * self.seen.frames[:, None] + np.arange(FRAME)
        columns[:, MOUNT] = np.arange(len(MOUNT_PARAMETERS))
        place = self._first_shift + 2 * np.searchsorted(self.used, self.seen.rows)
        columns[:, PLACE] = place[:, None] + [0, 1]
        jacobian = self._sparse(by.reshape(-1, COLUMNS), np.repeat(columns, 2, axis=0))
        return Block(apart.reshape(-1, 1), jacobian, self.noise.lines)

    def _motion(self, state: State) -> Block:
        """What the poses say of the motion between frames, less what odometry says."""
        stamps_s = np.array([view.stamp_s for view in self.views])
        said = motions_between(self.record, state.robot[len(MOUNT_PARAMETERS) :], stamps_s, self.odometry)
        before, after = state.frames[:-1, :3], state.frames[1:, :3]
        cos, sin = np.cos(before[:, 2]), np.sin(before[:, 2])
        zero, one = np.zeros_like(cos), np.ones_like(cos)
        to_body = np.array([[cos, sin, zero], [-sin, cos, zero], [zero, zero, one]]).transpose(2, 0, 1)
        driven = np.einsum("fij,fj->fi", to_body, after - before)
        apart = driven - said.poses
        apart[:, 2] = wrap_angle(apart[:, 2])
        by_before = -to_body
        by_before[:, 0, 2], by_before[:, 1, 2] = driven[:, 1], -driven[:, 0]
        slopes = np.concatenate([by_before, to_body, -said.slopes], axis=2)
        # Whitened: the covariance is L L'.
        roots = np.linalg.cholesky(said.covariances)
        residuals = np.linalg.solve(roots, apart[:, :, None])[:, :, 0]
        slopes = np.linalg.solve(roots, slopes)
        first = ROBOT + FRAME * np.arange(len(before))[:, None]
        odometry = np.broadcast_to(np.arange(len(MOUNT_PARAMETERS), ROBOT), (len(before), 4))
        columns = np.concatenate([first + [0, 1, 2], first + [5, 6, 7], odometry], axis=1)
        width = columns.shape[1]
        return Block(
            residuals,
            self._sparse(slopes.reshape(-1, width), np.repeat(columns, 3, axis=0)),
            self.noise.motion,
        )

    def _plain(
        self,
        residuals: Array,
        columns: NDArray[np.int64],
        weights: Array,
        student: float,
        scaled: bool = True,
    ) -> Block:
        """Residuals that are unknowns, each over its own deviation."""
        return Block(
            residuals.reshape(-1, 1), self._sparse(weights[:, None], columns[:, None]), student, scaled
        )

    def _sparse(self, values: Array, columns: NDArray[np.int64]) -> csr_array:
        """A matrix of rows (R, C) whose values belong to the columns (R, C)."""
        rows = np.repeat(np.arange(len(values)), values.shape[1])
        entries = coo_array((values.ravel(), (rows, columns.ravel())), shape=(len(values), self.unknowns))
        return csr_array(entries)
