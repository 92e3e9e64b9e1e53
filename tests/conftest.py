"""What tests share: the command line in this process, a toy drive, the optional development data."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]

ROBOT = """\
wheels: {radius_m: 0.05, baseline_m: 0.4}
initial_pose: {x_m: 1.0, y_m: 2.0, phi_rad: 0.5, std_x_m: 0.05, std_y_m: 0.05, std_phi_rad: 0.03}
"""


@dataclass(frozen=True)
class Ended:
    """How a command ended, and what it said."""

    code: int
    out: str
    err: str


Command = Callable[..., Ended]


@pytest.fixture
def wireloc(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Return the command line as a function: `wireloc("run", session, "--out", out)`."""
    from runs.cli import main

    def command(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["wireloc", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return Ended(int(ended.value.code or 0), said.out, said.err)

    return command


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """Return a session on a circle: perfect wheels at 20 Hz, a perfect fix a second, truth, no images."""
    folder = tmp_path / "toy"
    folder.mkdir()
    write_toy(folder)
    return folder


@pytest.fixture(scope="session")
def sample() -> Path:
    """Return the rendered session that comes with the project."""
    return REPOSITORY / "runs" / "samples" / "building_a"


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the development data; without it the test is skipped."""
    named = os.environ.get("WIRELOC_DATA")
    places = [Path(named)] if named else [REPOSITORY.parent / "shared" / "data"]
    found = [place for place in places if place.is_dir()]
    if not found:
        pytest.skip("needs the development data, see $WIRELOC_DATA")
    return found[0]


def write_toy(folder: Path, seconds: float = 8.0) -> None:
    """Write the toy session: 0.4 m/s and 0.3 rad/s from (1, 2, 0.5); wheels of 5 cm, 40 cm apart."""
    (folder / "robot.yaml").write_text(ROBOT)
    odometry, truth, fixes = [], [], []
    for time in _times(seconds, 0.05):
        left, right = (time * (0.4 + side * 0.3 * 0.2) / 0.05 for side in (-1, 1))
        odometry.append(f"{time:.3f},{left:.9f},{right:.9f}")
        truth.append(f"{time:.3f},{_pose(time)}")
    for time in _times(seconds - 1.0, 1.0):
        fixes.append(f"{time + 0.33:.3f},{_pose(time + 0.33)},0.05,0.05,0.02")
    write_rows(folder / "odometry.csv", "timestamp_s,left_wheel_rad,right_wheel_rad", odometry)
    write_rows(folder / "ground_truth_dense.csv", "timestamp_s,x_m,y_m,phi_rad", truth)
    header = "timestamp_s,x_m,y_m,phi_rad,std_x_m,std_y_m,std_phi_rad"
    write_rows(folder / "fixes.csv", header, fixes)


def write_rows(path: Path, header: str, rows: list[str]) -> None:
    """Write a CSV file."""
    path.write_text("\n".join([header, *rows]) + "\n")


def _times(seconds: float, step: float) -> Iterator[float]:
    return (count * step for count in range(round(seconds / step) + 1))


def _pose(time: float) -> str:
    """Return x, y, phi on the circle of radius v / w."""
    radius, phi = 0.4 / 0.3, 0.5 + 0.3 * time
    x = 1.0 + radius * (math.sin(phi) - math.sin(0.5))
    y = 2.0 - radius * (math.cos(phi) - math.cos(0.5))
    return f"{x:.9f},{y:.9f},{math.remainder(phi, math.tau):.9f}"
