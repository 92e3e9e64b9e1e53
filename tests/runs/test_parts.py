"""A long drive in parts: every moment told once, and as well as all at once."""

import dataclasses

import numpy as np
import pytest

from localization.fixedlag import FixedLagConfig
from maps.outcomes import Fix, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from runs.config import RunConfig
from runs.parts import Part, PartsConfig, parts_of
from runs.runlog import NullLog
from runs.runner import run_session
from runs.simulation.fixes import FixErrors
from runs.simulation.synthetic import SessionPlan, simulate_session
from runs.simulation.wheels import WheelErrors
from runs.tracks import errors_of

S = 10**9


def test_a_short_drive_is_one_part():
    assert parts_of(5 * S, 65 * S, PartsConfig(60.0, 10.0)) == [Part(None, None, None, None)]
    assert parts_of(5 * S, 5 * S, PartsConfig()) == [Part(None, None, None, None)]


def test_parts_are_equal_and_leave_no_gap():
    parts = parts_of(0, 100 * S, PartsConfig(40.0, 5.0))
    assert [part.end_ns for part in parts[:-1]] == [part.begin_ns for part in parts[1:]]
    assert parts[1].end_ns - parts[1].begin_ns == pytest.approx(100 * S / 3, abs=1)
    assert (parts[1].from_ns, parts[1].until_ns) == (parts[1].begin_ns - 5 * S, parts[1].end_ns + 5 * S)
    assert (parts[0].begin_ns, parts[0].from_ns, parts[-1].end_ns, parts[-1].until_ns) == (None,) * 4
    for stamp_ns in (-S, 0, parts[1].begin_ns - 1, parts[1].begin_ns, 70 * S, 200 * S):
        assert sum(part.tells_of(stamp_ns) for part in parts) == 1


@pytest.fixture(scope="module")
def drive():
    """A minute of fixes, some grossly wrong, with a gap where a cut will be."""
    errors = FixErrors(rate_hz=2.0, outlier_share=0.05, gaps_s=((18.0, 22.0),), delay_s=(0.05, 0.3))
    plan = SessionPlan(seconds=60.0, odometry=WheelErrors(rate_hz=20.0), fixes=errors)
    return simulate_session(np.random.default_rng(3), plan)


@pytest.fixture(scope="module")
def whole(drive):
    """The drive smoothed at once."""
    track, told = smoothed(drive.session, PartsConfig())
    assert told == []
    return track


@pytest.fixture(scope="module")
def cut(drive):
    """The drive smoothed in parts."""
    track, told = smoothed(drive.session, PartsConfig(20.0, 10.0))
    assert told == [(1, 3), (2, 3), (3, 3)]
    return track


def smoothed(session, parts):
    """Return the smoothed trajectory, and the progress that was told once the looks were done."""
    told, config = [], RunConfig(parts=parts, fixed_lag=FixedLagConfig(enabled=False))
    result = run_session(session, config, NullLog(), lambda done, total: told.append((done, total)))
    return result.trajectories.smoothed, told[len(session.fixes) :]


def test_in_parts_a_drive_is_smoothed_as_well_as_at_once(drive, whole, cut):
    assert cut.stamps_ns.tolist() == whole.stamps_ns.tolist()
    deviations = np.sqrt(np.linalg.eigvalsh(whole.covariances[:, :2, :2])[:, -1])
    assert (errors_of(cut, whole).position_m < deviations).all(), "less than what nobody knows anyway"
    truth = drive.drive.truth()
    errors = [errors_of(track, truth) for track in (whole, cut)]
    once, parted = (np.sqrt(np.mean(error.position_m**2)) for error in errors)
    assert parted < 1.05 * once
    assert errors[1].anees() == pytest.approx(errors[0].anees(), rel=0.2)


def test_without_overlap_cuts_are_seen(drive, whole, cut):
    """The overlap does something: a part that knows nothing of the next one ends as the filter does."""
    without, _ = smoothed(drive.session, PartsConfig(20.0, 0.0))
    assert errors_of(without, whole).position_m.max() > 2.0 * errors_of(cut, whole).position_m.max()


def test_a_carry_off_inside_a_later_part_is_found(drive):
    """Late in the drive somebody carries the robot; the fixes say where to."""
    carried, cut_ns = Pose2(4.0, 1.0, 0.5), 47 * S
    fixes = tuple(
        dataclasses.replace(fix, fix=Fix(moved(fix.fix.belief, carried))) if fix.stamp_ns > cut_ns else fix
        for fix in drive.session.fixes
    )
    session = dataclasses.replace(drive.session, fixes=fixes)
    parts, _ = smoothed(session, PartsConfig(20.0, 10.0))
    truth = drive.drive.truth()
    late = parts.stamps_ns > cut_ns + S
    back = carried.inverse()
    poses = np.array([(back @ Pose2.from_array(pose)).as_array() for pose in parts.poses[late]])
    there = dataclasses.replace(parts, stamps_ns=parts.stamps_ns[late], poses=poses, covariances=None)
    assert np.median(errors_of(there, truth).position_m) < 0.1
    early = dataclasses.replace(
        parts, stamps_ns=parts.stamps_ns[~late], poses=parts.poses[~late], covariances=None
    )
    assert np.median(errors_of(early, truth).position_m) < 0.1


def moved(belief, by):
    return PoseBelief(belief.stamp_ns, by @ belief.pose, belief.covariance)


def test_lost_at_a_cut(drive):
    """Nothing is published about the cut: the part begins where the robot last knew."""
    fixes = tuple(
        dataclasses.replace(fix, fix=NoFix(Reason.WEAK_EVIDENCE)) if 15 * S < fix.stamp_ns < 30 * S else fix
        for fix in drive.session.fixes
    )
    session = dataclasses.replace(drive.session, fixes=fixes)
    parts, _ = smoothed(session, PartsConfig(20.0, 2.0))
    assert len(set(parts.stamps_ns.tolist())) == len(parts)
    assert errors_of(parts, drive.drive.truth()).position_m.max() < 1.0
