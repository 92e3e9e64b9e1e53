"""The hall: what the paper says of its own, and a map that nothing is wrong with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from maps.check import check_map
from maps.mapdocument import write_map
from runs.experiments.hall import CORNERS, DOORS, WINDOWS, hall_document, hall_map


def test_it_is_the_papers_size() -> None:
    hall = hall_map()
    assert len(hall) == 65
    x0, y0, x1, y1 = hall.floor.bounds
    assert (x1 - x0, y1 - y0) == (18.0, 12.0)


def test_it_has_four_reflex_corners_and_three_oblique_walls() -> None:
    corners = np.array(CORNERS)
    walls = np.roll(corners, -1, axis=0) - corners
    before = np.roll(walls, 1, axis=0)
    turn = before[:, 0] * walls[:, 1] - before[:, 1] * walls[:, 0]
    assert (len(corners), (turn < 0.0).sum()) == (12, 4)
    assert (np.abs(walls) > 1e-9).all(axis=1).sum() == 3


def test_doors_and_windows_fit_their_walls_and_differ_in_size() -> None:
    corners = np.array(CORNERS)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    features = [*((wall, start, end) for wall, start, end, _ in DOORS), *(w[:3] for w in WINDOWS)]
    assert all(0.0 < start < end < lengths[wall] for wall, start, end in features)
    widths = [round(end - start, 6) for _, start, end in features]
    assert len(set(widths)) == len(widths)


def test_nothing_is_wrong_with_it(tmp_path: Path) -> None:
    write_map(tmp_path / "map.yaml", hall_document())
    assert check_map(tmp_path / "map.yaml", (1.2, 1.2)).findings == ()
