"""The figures of a comparison are those of evo, on the same files."""

import math

import numpy as np
import pytest

from runs.compare import rows_of
from runs.folder import read_run
from tests.runs.test_compare import write_run, write_tum

pytest.importorskip("evo")

TRACKS = ("odometry", "filtered", "smoothed")


@pytest.fixture
def run(tmp_path):
    """Return a run whose tracks wander about a curved truth at 50 Hz, through headings of pi."""
    folder = write_run(tmp_path / "run")
    seconds = np.round(1_700_000_000.0 + np.arange(0.0, 40.0, 0.02), 2)
    phi = 0.4 * (seconds - seconds[0])
    truth = np.column_stack([seconds, 3.0 * np.sin(phi), -3.0 * np.cos(phi), phi])
    write_tum(folder / "truth.tum", truth)
    for seed, name in enumerate(TRACKS):
        rng = np.random.default_rng(seed)
        off = np.cumsum(rng.normal(0.0, [0.01, 0.01, 0.005], (len(seconds), 3)), axis=0)
        write_tum(folder / f"{name}.tum", np.column_stack([seconds, truth[:, 1:] + off]))
    return folder


@pytest.mark.filterwarnings("ignore")
def test_figures_agree_with_evo(run):
    from evo.core import metrics, sync
    from evo.tools import file_interface

    truth = file_interface.read_tum_trajectory_file(str(run / "truth.tum"))
    rows = {row.track: row for row in rows_of(read_run(run))}
    for name in TRACKS:
        track = file_interface.read_tum_trajectory_file(str(run / f"{name}.tum"))
        pair = sync.associate_trajectories(truth, track, max_diff=1e-4)
        for relation, ours in (
            (metrics.PoseRelation.translation_part, rows[name].position_m),
            (metrics.PoseRelation.rotation_angle_deg, rows[name].heading_deg),
        ):
            error = metrics.APE(relation)
            error.process_data(pair)
            theirs = error.get_all_statistics()
            assert len(error.error) == rows[name].poses
            assert ours.rmse == pytest.approx(theirs["rmse"], abs=1e-6)
            assert ours.median == pytest.approx(theirs["median"], abs=1e-6)
            assert ours.max == pytest.approx(theirs["max"], abs=1e-6)
            assert ours.p95 == pytest.approx(np.percentile(error.error, 95.0), abs=1e-6)


def test_along_and_across_make_up_the_position(run):
    for row in rows_of(read_run(run)):
        if row.track in TRACKS:
            together = math.hypot(row.along_m.rmse, row.across_m.rmse)
            assert together == pytest.approx(row.position_m.rmse, abs=1e-9)
