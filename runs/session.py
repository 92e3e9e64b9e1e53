"""A session folder: everything a robot recorded on one drive, as one stream of events.

The ground truth is not among it: nothing here opens those files.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path, PurePath
from typing import Protocol

import numpy as np

from localization.odometry import (
    OdometryNoise,
    OdometryStep,
    WheelGeometry,
    standing_step,
    twist_step,
    wheel_step,
)
from maps.errors import InputError
from maps.mapfile import read_map
from maps.outcomes import Fix, PoseBelief
from maps.poses import Array, Pose2, frozen
from maps.wiremap import WireMap
from runs.robot import Robot, read_robot
from runs.tables import Times, read_table
from runs.video import folder_video
from vision.camera import Camera
from vision.images import GreyImage, decode_image, read_bytes, read_image

WHEEL_COLUMNS = ("left_wheel_rad", "right_wheel_rad")
TWIST_COLUMNS = ("forward_mps", "turn_radps")


class Picture(Protocol):
    """An image that is no file of its own: a message of a bag, a frame of a video."""

    def read(self) -> bytes:
        """Return it as an image file's bytes; InputError where it cannot be read."""


@dataclass(frozen=True, slots=True)
class Frame:
    """An image as recorded: its capture time on odometry's clock, and when it reached the computer.

    `picture`: where the image comes from if it is no file; `path` is then only its name in messages.
    """

    stamp_ns: int
    arrival_ns: int
    filename: str
    path: Path
    picture: Picture | None = None

    def data(self) -> bytes:
        """Return the image as a file's bytes; InputError where it cannot be read."""
        return read_bytes(self.path) if self.picture is None else self.picture.read()

    def image(self) -> GreyImage:
        """Return the image as grey levels (H, W); InputError where it cannot be read."""
        return read_image(self.path) if self.picture is None else decode_image(self.picture.read(), self.path)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFix:
    """An absolute fix recorded by something else, to be fused as it is."""

    stamp_ns: int
    arrival_ns: int
    fix: Fix


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """What odometry recorded: cumulative wheel angles, or twists that each hold until the next row.

    `stamps_ns`, `arrivals_ns`: (N,). `values`: (N, 2), left and right [rad], or forward [m/s] and turn
    [rad/s] where `wheels` is None.
    """

    stamps_ns: Times
    arrivals_ns: Times
    values: Array
    wheels: WheelGeometry | None

    def steps(self, noise: OdometryNoise) -> Iterator[tuple[int, OdometryStep]]:
        """Yield the motion between consecutive rows with its arrival: that of its later row.

        Steps come in order: one that is ready waits for those before it.
        """
        arrivals_ns = np.maximum.accumulate(self.arrivals_ns)
        for row in range(1, len(arrivals_ns)):
            # Two rows at a time: as lists, hours of them would take ten times the memory of the arrays.
            start_ns, stamp_ns = self.stamps_ns[row - 1 : row + 1].tolist()
            before, now = self.values[row - 1 : row + 1].tolist()
            if self.wheels is None:
                forward_mps, turn_radps = before
                step = twist_step(start_ns, stamp_ns, forward_mps, turn_radps, noise)
            else:
                left_rad, right_rad = now[0] - before[0], now[1] - before[1]
                step = wheel_step(start_ns, stamp_ns, left_rad, right_rad, self.wheels, noise)
            yield int(arrivals_ns[row]), step


Event = OdometryStep | Frame | RecordedFix


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """One drive: robot, map, odometry, frames and fixes in the order of their rows.

    `start_ns` is the first event's stamp and `initial` the belief there, None where nobody knows.
    `wire_map` and `map_path` may be None where there are no images to match.
    """

    name: str
    folder: Path
    robot: Robot
    wire_map: WireMap | None
    map_path: Path | None
    odometry: Odometry
    frames: tuple[Frame, ...]
    fixes: tuple[RecordedFix, ...]
    start_ns: int
    initial: PoseBelief | None

    @property
    def camera(self) -> Camera | None:
        """The robot's camera."""
        return self.robot.camera

    def events(self, noise: OdometryNoise) -> Iterator[Event]:
        """Yield one stream ordered by arrival; of what arrives together, odometry comes first.

        Frames and fixes that arrive together come by stamp, then by row. Before odometry's first row
        the robot is taken to stand still.
        """
        looks: list[Frame | RecordedFix] = [*self.frames, *self.fixes]
        looks.sort(key=lambda look: (look.arrival_ns, look.stamp_ns))
        arriving: list[tuple[int, Event]] = [(look.arrival_ns, look) for look in looks]
        merged = heapq.merge(self._steps(noise), arriving, key=itemgetter(0))
        return (event for _, event in merged)

    def _steps(self, noise: OdometryNoise) -> Iterator[tuple[int, Event]]:
        first_ns = int(self.odometry.stamps_ns[0])
        if self.start_ns < first_ns:
            still = standing_step(self.start_ns, first_ns, noise)
            yield int(self.odometry.arrivals_ns[0]), still
        yield from self.odometry.steps(noise)


def read_session(folder: Path, map_path: Path | None = None) -> Session:
    """Read a session folder; the map is `map_path`, or map.yaml in the folder or one folder up.

    InputError names the file, and the line or key, of what is missing or cannot be.
    """
    if not folder.is_dir():
        raise InputError(folder, "", "no such session folder")
    robot = read_robot(folder / "robot.yaml")
    odometry = read_odometry(folder / "odometry.csv", robot)
    frames = _read_frames(folder, robot) if (folder / "frames.csv").exists() else ()
    fixes = _read_fixes(folder / "fixes.csv") if (folder / "fixes.csv").exists() else ()
    if not frames and not fixes:
        raise InputError(folder, "", "neither frames.csv nor fixes.csv: nothing to localize with")
    return session_of(folder, robot, odometry, frames, fixes, map_path)


def session_of(
    source: Path,
    robot: Robot,
    odometry: Odometry,
    frames: tuple[Frame, ...],
    fixes: tuple[RecordedFix, ...],
    map_path: Path | None,
) -> Session:
    """Put a session together, whatever it was read from; InputError names what is missing."""
    if not frames and not fixes:
        raise InputError(source, "", "neither images nor fixes: nothing to localize with")
    if frames and robot.camera is None:
        raise InputError(robot.path, "camera", "missing, and there are images")
    map_path = map_path or find_map(source)
    if frames and map_path is None:
        raise InputError(source / "map.yaml", "", "no such file, nor one folder up; name one with --map")
    looks_ns = [frame.stamp_ns for frame in frames] + [fix.stamp_ns for fix in fixes]
    start_ns = min(int(odometry.stamps_ns[0]), *looks_ns)
    return Session(
        name=source.resolve().stem if source.is_file() else source.resolve().name,
        folder=source,
        robot=robot,
        wire_map=read_map(map_path) if map_path else None,
        map_path=map_path,
        odometry=odometry,
        frames=frames,
        fixes=fixes,
        start_ns=start_ns,
        initial=robot.start.at(start_ns) if robot.start else None,
    )


def find_map(folder: Path) -> Path | None:
    """Return the map in a session's folder or one folder up, None where there is none."""
    places = (folder / "map.yaml", folder.resolve().parent / "map.yaml")
    return next((path for path in places if path.is_file()), None)


def read_odometry(path: Path, robot: Robot) -> Odometry:
    """Read odometry.csv; InputError names the line of what cannot be."""
    table = read_table(path)
    stamps_ns = table.times()
    if len(table) < 2:
        raise InputError(path, "", "one row alone is no motion")
    by_wheels = table.has(*WHEEL_COLUMNS)
    if not by_wheels and not table.has(*TWIST_COLUMNS):
        either = f"neither {', '.join(WHEEL_COLUMNS)} nor {', '.join(TWIST_COLUMNS)}"
        raise InputError(path, "line 1", f"{either} among the columns")
    if by_wheels and robot.wheels is None:
        raise InputError(robot.path, "wheels", "missing, and odometry.csv has wheel angles")
    columns = WHEEL_COLUMNS if by_wheels else TWIST_COLUMNS
    values = np.column_stack([table.numbers(name) for name in columns])
    if not by_wheels:
        values = values * robot.twist_scales
    return Odometry(stamps_ns, table.arrivals(stamps_ns), frozen(values), robot.wheels if by_wheels else None)


def _read_frames(folder: Path, robot: Robot) -> tuple[Frame, ...]:
    table = read_table(folder / "frames.csv")
    stamps_ns = table.times()
    corrected_ns = stamps_ns + robot.time_offset_ns
    arrivals_ns = table.arrivals(stamps_ns) if table.has("arrival_s") else corrected_ns
    # Without file names the rows are the stamps of a video's frames.
    filmed = None if table.has("filename") else folder_video(folder, len(table))
    frames = []
    for row, filename in enumerate(filmed.filenames if filmed else table.texts("filename")):
        with table.naming(row, "filename"):
            path = folder / filename if filmed else image_path(folder, filename)
        stamp_ns, arrival_ns = int(corrected_ns[row]), int(arrivals_ns[row])
        # An image cannot arrive before it was taken, whatever the two clocks say.
        picture = filmed.pictures[row] if filmed else None
        frames.append(Frame(stamp_ns, max(arrival_ns, stamp_ns), filename, path, picture))
    return tuple(frames)


def image_path(folder: Path, filename: str) -> Path:
    """Return an image's path; ValueError where it leaves the folder, or is not there."""
    relative = PurePath(filename)
    if not filename or relative.is_absolute() or ".." in relative.parts:
        raise ValueError(f"{filename!r} is not a path inside the session folder")
    path = folder / relative
    try:
        found = path.is_file()
    except OSError as error:
        raise ValueError(error.strerror or str(error)) from None
    if not found:
        raise ValueError(f"{filename}: no such file")
    return path


def _read_fixes(path: Path) -> tuple[RecordedFix, ...]:
    table = read_table(path)
    stamps_ns = table.times(may_repeat=True)
    arrivals_ns = table.arrivals(stamps_ns)
    x_m, y_m = table.numbers("x_m"), table.numbers("y_m")
    std_x_m, std_y_m = table.numbers("std_x_m"), table.numbers("std_y_m")
    phi_rad = table.numbers("phi_rad", may_be_empty=True)
    std_phi_rad = table.numbers("std_phi_rad", may_be_empty=True)
    fixes = []
    for row in range(len(table)):
        with table.naming(row, "std"):
            deviations = _deviations(std_x_m[row], std_y_m[row], phi_rad[row], std_phi_rad[row])
        pose = Pose2(float(x_m[row]), float(y_m[row]), float(np.nan_to_num(phi_rad[row])))
        belief = PoseBelief(int(stamps_ns[row]), pose, np.diag(deviations) ** 2)
        fixes.append(RecordedFix(belief.stamp_ns, int(arrivals_ns[row]), Fix(belief)))
    return tuple(fixes)


def _deviations(std_x_m: float, std_y_m: float, phi_rad: float, std_phi_rad: float) -> Array:
    """Return the standard deviations of (x, y, phi), (3,), infinite for a heading that is not there."""
    if np.isnan(phi_rad) and not np.isnan(std_phi_rad):
        raise ValueError("std_phi_rad without phi_rad")
    if np.isnan(std_phi_rad) and not np.isnan(phi_rad):
        raise ValueError("phi_rad without std_phi_rad")
    deviations = np.array([std_x_m, std_y_m, np.inf if np.isnan(phi_rad) else std_phi_rad])
    if not (deviations > 0.0).all():
        raise ValueError("not above zero")
    return deviations
