"""A map whose every edge is 5 cm off: how far fusing fixes could help at best, and how far it does.

`pytest -m slow -s` on this file prints, for two drives and three such maps each, the RMSE of the fixes, of the
filtered poses, and of what perfect odometry would make of the same fixes: each pose off by the mean error of all
fixes so far.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runs.config import RunConfig
from runs.evaluation import read_truth
from runs.faults.kinds import chosen_fault, corrupted, fault_span
from runs.faults.recording import read_recording
from runs.faults.writing import write_recording
from runs.runlog import NullLog
from runs.runner import run_session
from runs.session import read_session
from runs.tracks import errors_of

SEEDS = range(3)


def nobody(done: int, total: int) -> None:
    """Show no progress."""


def rms_m(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


@pytest.mark.slow
def test_what_averaging_can_do_about_a_map_off_by_five_centimetres(
    data: Path, sample: Path, tmp_path: Path
) -> None:
    ratios = []
    print("\n| drive | seed | fixes cm | filtered cm | with perfect odometry cm | on the exact map cm |")
    print("| --- | --- | --- | --- | --- | --- |")
    for folder in (sample, data / "rendered" / "building_0001"):
        recording, truth = read_recording(folder), read_truth(folder)
        exact = run_session(recording.session, RunConfig(), NullLog(), nobody).trajectories
        least_m = rms_m(errors_of(exact.filtered, truth).difference[:, :2])
        for seed in SEEDS:
            span = fault_span(recording, chosen_fault("map-moved"), None, None)
            faulty = corrupted(recording, "map-moved", span, seed)
            place = tmp_path / f"{folder.name}-{seed}"
            write_recording(recording, faulty, place, {}, nobody)
            session = read_session(place)
            result = run_session(session, RunConfig(), NullLog(), nobody)
            accepted = np.array([record.stamp_ns for record in result.records if record.accepted])
            vision = result.trajectories.vision
            fixes = errors_of(vision, truth).difference[np.isin(vision.stamps_ns, accepted), :2]
            so_far = np.cumsum(fixes, axis=0) / np.arange(1, len(fixes) + 1)[:, None]
            filtered_m = rms_m(errors_of(result.trajectories.filtered, truth).difference[:, :2])
            figures = (rms_m(fixes), filtered_m, rms_m(so_far), least_m)
            cells = (folder.name, str(seed), *(f"{100.0 * metres:.1f}" for metres in figures))
            print(f"| {' | '.join(cells)} |", flush=True)
            ratios.append(filtered_m / rms_m(fixes))
    # Whatever the map, a belief that is worse than the fixes it is made of would be wrong.
    assert np.median(ratios) < 1.0
