"""Every kind of fault on two rendered drives and twenty simulated ones: what must hold, holds.

`WIRELOC_STUDY=DIR pytest -m slow -s` on this file prints the table of docs/reports/faults.md. On two cores the drives
take 5 minutes and their 484 runs an hour and more; what is done is kept in DIR and not done again.
`WIRELOC_STUDY_DRIVES=N` takes only the first of the simulated drives.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from runs.experiments.output import Grid
from runs.faults.kinds import FAULTS, WRONG_MAP
from runs.faults.table import fault_table, shortfalls
from runs.simulation.rehearsal import Recipe
from runs.simulation.scene import Conditions
from runs.simulation.sessionfolder import simulate_folder
from runs.sweep import NONE, Item, Row
from runs.sweepstore import open_store, run_sweep, write_results

DRIVES = 20
SECONDS = 45.0
OTHERS = ("building_0001", "building_0002", "building_b")
#: The wrong map can be this building mirrored and stretched, or really another.
ANOTHER = f"{WRONG_MAP}: another"


def nobody(done: int, total: int) -> None:
    """Show no progress."""


def told(done: int, total: int) -> None:
    print(f"{done} of {total}", flush=True)


@pytest.mark.slow
def test_what_must_hold_under_faults(data: Path, sample: Path, tmp_path: Path) -> None:
    folder = Path(os.environ.get("WIRELOC_STUDY") or tmp_path)
    drives = [(sample, 0), (data / "rendered" / "building_0001", 0)]
    for seed in range(int(os.environ.get("WIRELOC_STUDY_DRIVES") or DRIVES)):
        # Every other drive is in the sample's building, the rest in three more.
        building = data / "rendered" / OTHERS[seed // 2 % len(OTHERS)] if seed % 2 else sample
        drives.append((simulated(folder / "sim", building, seed), seed))
    rows = swept(
        folder / "sweep",
        [
            Item(str(path.resolve()), None, None, seed, kind)
            for path, seed in drives
            for kind in (NONE, *FAULTS)
        ],
    )
    maps = {False: sample / "map.yaml", True: data / "rendered" / "building_0001" / "map.yaml"}
    others = [
        Item(str(path.resolve()), str(maps["building_a" in path.name].resolve()), None, seed)
        for path, seed in drives
    ]
    rows += [{**row, "fault": ANOTHER} for row in swept(folder / "others", others)]
    show(fault_table(rows))
    lines = shortfalls(rows)
    print("\n".join(lines))
    assert not lines


def simulated(folder: Path, building: Path, seed: int) -> Path:
    """Return a drive through a building, simulated unless it is there already."""
    out = folder / f"{seed:02d}-{building.name}"
    if not out.is_dir():
        recipe = Recipe(seed=seed, seconds=SECONDS, conditions=Conditions(sun=seed % 2 == 0))
        simulate_folder(out, building / "map.yaml", building / "robot.yaml", recipe, nobody)
    return out


def swept(folder: Path, items: Sequence[Item]) -> list[Row]:
    folder.parent.mkdir(parents=True, exist_ok=True)
    with open_store(folder) as store:
        rows = run_sweep(items, store, told, os.cpu_count() or 1)
        write_results(store, rows)
    return rows


def show(grid: Grid) -> None:
    for cells in (grid.header, ("---",) * len(grid.header), *grid.rows):
        print(f"| {' | '.join(cells)} |")
    print(grid.remark)
