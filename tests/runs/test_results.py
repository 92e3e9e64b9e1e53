"""The run folder: there whole or not at all."""

from datetime import datetime

import numpy as np
import pytest

from maps.errors import InputError
from maps.outcomes import PoseBelief
from maps.poses import Pose2
from runs.results import StagedFolder, default_folder, point_latest, seconds, write_metrics, write_tum
from runs.runlog import Trajectory


def half_done(out, error):
    """Write a file, then fail."""
    with StagedFolder(out) as folder:
        (folder / "file").write_text("half")
        raise error


def test_folder_appears_when_it_is_whole(tmp_path):
    out = tmp_path / "deep" / "run"
    with StagedFolder(out) as folder:
        (folder / "file").write_text("whole")
        assert not out.exists()
    assert (out / "file").read_text() == "whole"
    assert not folder.exists()


def test_error_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="broken"):
        half_done(tmp_path / "run", ValueError("broken"))
    assert list(tmp_path.iterdir()) == []


def test_killed_run_stays_readable_but_not_in_place(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        half_done(tmp_path / "run", KeyboardInterrupt())
    assert (tmp_path / "run.partial" / "file").read_text() == "half"
    assert not (tmp_path / "run").exists()
    with StagedFolder(tmp_path / "run"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert not any((tmp_path / "run").iterdir())


def test_full_folder_and_file_are_refused_and_kept(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "precious").write_text("kept")
    (tmp_path / "file").write_text("kept")
    with pytest.raises(InputError, match="is not empty"):
        StagedFolder(tmp_path / "full")
    with pytest.raises(InputError, match="is not a folder"):
        StagedFolder(tmp_path / "file")
    assert (tmp_path / "full" / "precious").read_text() == (tmp_path / "file").read_text() == "kept"


def test_empty_folder_is_taken(tmp_path):
    (tmp_path / "run").mkdir()
    with StagedFolder(tmp_path / "run") as folder:
        (folder / "file").write_text("whole")
    assert (tmp_path / "run" / "file").exists()


def test_folder_below_a_file(tmp_path):
    (tmp_path / "file").write_text("kept")
    with pytest.raises(InputError), StagedFolder(tmp_path / "file" / "run"):
        pass


@pytest.mark.parametrize(
    ("stamp_ns", "text"),
    [
        (0, "0.000000000"),
        (1_700_000_000_123_456_789, "1700000000.123456789"),
        (-1, "-0.000000001"),
        (-1_500_000_000, "-1.500000000"),
    ],
)
def test_seconds_are_exact(stamp_ns, text):
    assert seconds(stamp_ns) == text


def test_tum_rows(tmp_path):
    unknown = np.diag([1.0, 1.0, np.inf])
    beliefs = [
        PoseBelief(1, Pose2(1.5, -2.0, np.pi / 2), np.eye(3)),
        PoseBelief(2, Pose2(0.0, 0.0, 1.0), unknown),
    ]
    write_tum(tmp_path / "a.tum", Trajectory.of_beliefs(beliefs))
    first, second = np.loadtxt(tmp_path / "a.tum")
    half = np.sqrt(0.5)
    np.testing.assert_allclose(first, [1e-9, 1.5, -2.0, 0, 0, 0, half, half], atol=1e-12)
    np.testing.assert_allclose(second[3:], [0, 0, 0, 0, 1], atol=1e-12)


def test_metrics_are_never_nan(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_metrics(tmp_path / "metrics.json", {"a": float("nan")})


def test_default_folder_is_numbered_where_taken(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    now = datetime(2030, 1, 2, 3, 4, 5)
    first = default_folder("toy", now)
    assert str(first) == "results/toy-20300102-030405"
    first.mkdir(parents=True)
    assert str(default_folder("toy", now)) == "results/toy-20300102-030405-2"


def test_latest_points_to_the_last(tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        point_latest(tmp_path / name)
        assert (tmp_path / "latest").resolve() == tmp_path / name
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first", "latest", "second"]


def test_real_folder_called_latest_stays(tmp_path):
    (tmp_path / "latest").mkdir()
    (tmp_path / "run").mkdir()
    point_latest(tmp_path / "run")
    assert not (tmp_path / "latest").is_symlink()
