"""The worst frames: wrong fixes first, then refused ones, then frames without a fix."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from maps.outcomes import Fix, Look, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from runs.runlog import StepRecord, Trajectory
from runs.session import Frame
from runs.worst import WORST, worst_frames

TRUTH = Trajectory(np.array([0, 10**11]), np.zeros((2, 3)))


def record(second, outcome, verdict, reason="", nis=None):
    blank = dict.fromkeys(StepRecord.__dataclass_fields__)
    cells = {"stamp_ns": second * 10**9, "filename": f"{second}.png", "outcome": outcome, "verdict": verdict}
    return StepRecord(**{**blank, **cells, "reason": reason, "nis": nis})


def fix(second, off_m, std_m=0.02):
    return Fix(PoseBelief(second * 10**9, Pose2(off_m, 0.0, 0.0), np.diag([std_m**2, std_m**2, 1e-4])))


def without(lines):
    return NoFix(Reason.WEAK_EVIDENCE, Look(lines_px=np.zeros((lines, 2, 2))))


@pytest.fixture
def drive(tmp_path):
    """Return a session and a run of eight looks, each of its own kind; the frames are blank."""
    looks = [
        (record(1, "FIX", "FUSED", nis=1.0), fix(1, 0.01)),
        (record(2, "FIX", "FUSED", nis=2.0), fix(2, 0.50)),
        (record(3, "FIX", "REJECTED", "GATE", 90.0), fix(3, 0.90)),
        (record(4, "FIX", "REJECTED", "GATE", 20.0), fix(4, 0.02)),
        (record(5, "NO_FIX", "MISSED", "WEAK_EVIDENCE"), without(10)),
        (record(6, "NO_FIX", "MISSED", "WEAK_EVIDENCE"), without(200)),
        (record(7, "FIX", "FUSED", nis=3.0), fix(7, 0.20)),
        (record(8, "PARTIAL", "FUSED", nis=3.0), fix(8, 0.50, std_m=0.4)),
    ]
    frames = []
    for told, _ in looks:
        path = tmp_path / told.filename
        cv2.imwrite(str(path), np.zeros((48, 64), np.uint8))
        frames.append(Frame(told.stamp_ns, told.stamp_ns, told.filename, path))
    records, outcomes = zip(*looks, strict=True)
    return SimpleNamespace(frames=tuple(frames)), SimpleNamespace(records=records, outcomes=outcomes)


def test_wrong_comes_before_refused_before_missing(drive):
    found = worst_frames(*drive, TRUTH)
    assert [frame.filename for frame in found] == ["2.png", "3.png", "4.png", "6.png", "5.png"]
    assert len(found) == WORST
    assert found[0].wrong == "wrong, and fused: 0.50 m and 0.0° off"
    assert found[1].wrong == "wrong, and refused: 0.90 m and 0.0° off"
    assert "GATE, too far from what the filter expected (NIS 20.0); it was 0.02 m" in found[2].wrong
    assert found[3].wrong.startswith("no fix: WEAK_EVIDENCE, the best pose")


def test_without_a_truth_nothing_is_called_wrong(drive):
    found = worst_frames(*drive, None)
    assert [frame.filename for frame in found][:2] == ["3.png", "4.png"]
    assert not any("wrong" in frame.wrong or "nan" in frame.wrong for frame in found)


def test_fix_outside_its_own_covariance_comes_before_a_large_but_honest_one(drive):
    session, result = drive
    result.records, result.outcomes = result.records[6:], result.outcomes[6:]
    found = worst_frames(session, result, TRUTH)
    assert [frame.filename for frame in found] == ["7.png", "8.png"]
    assert "more than its covariance says" in found[0].wrong


def test_picture_that_is_gone_is_left_out(drive):
    session, result = drive
    session.frames[1].path.unlink()
    assert worst_frames(session, result, TRUTH)[0].filename == "3.png"


def test_run_without_pictures_has_no_worst_frames(drive):
    _, result = drive
    assert worst_frames(SimpleNamespace(frames=()), result, TRUTH) == []
