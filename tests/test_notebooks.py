"""Notebooks only call the packages, so their cells must run as they stand; they carry no outputs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "notebooks").glob("*.ipynb"))

#: What must have come of each notebook, by the names that its cells leave.
WORKED: dict[str, Callable[[dict[str, Any]], bool]] = {
    "filtered_against_raw": lambda names: {row.track for row in names["rows"]} >= {"vision", "filtered"},
    "maps_and_regions": lambda names: 0 < len(names["rows"]) < len(names["wire_map"]),
    "first_session": lambda names: names["navigation"].usable,
    "one_fix_step_by_step": lambda names: names["winner"] is not None and names["error_m"] < 0.3,
    "paper_experiments": lambda names: any(trial.usable for trial in names["trials"]),
}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_cells_run(path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(path.parent)
    code = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    names: dict[str, Any] = {}
    for cell in code:
        assert not cell["outputs"]
        exec(compile("".join(cell["source"]), str(path), "exec"), names)
    assert WORKED[path.stem](names)
