"""Which frames serve a calibration, and which tilt explains them best."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from localization.drivenmotion import motions_between
from localization.odometry import OdometryNoise, advance
from maps.outcomes import Fix, NoFix, PoseBelief, Reason
from maps.poses import Pose2
from runs.robotparameters import with_robot
from runs.robottilt import TiltConfig, with_best_tilt
from runs.robotviews import Shot, ViewConfig, chosen_frames, record_of, trusted_poses
from runs.runlog import Trajectory
from runs.session import read_session
from vision.matcher import MatcherConfig
from vision.measurements import LineMeasurements
from vision.projection import Projector

TIGHT = np.array([0.02, 0.02, 0.02, 0.002, 0.002, 0.002])


@pytest.fixture(scope="module")
def session(sample):
    return read_session(sample)


def values_of(session):
    mount, wheels = session.camera.mount, session.odometry.wheels
    tilt = [mount.pitch_down_rad, mount.roll_rad, mount.yaw_rad]
    driven = [wheels.left_radius_m, wheels.right_radius_m, wheels.baseline_m, 0.0]
    return np.array([mount.x_m, mount.y_m, mount.height_m, *tilt, *driven])


def shot_of(session, frame, lines=None):
    nothing = np.zeros((0, 2))
    empty = LineMeasurements(
        np.zeros((0, 2, 3)), *nothing.T, np.zeros((0, 2, 2)), np.zeros(0), nothing, np.zeros(0)
    )
    return Shot(frame, frame.stamp_ns, (frame.stamp_ns - session.start_ns) * 1e-9, lines or empty)


def test_frames_of_a_standing_robot_are_left_out_and_long_drives_are_thinned(session):
    chosen = chosen_frames(session, ViewConfig())
    assert 40 <= len(chosen) < len(session.frames)
    steps = [step for _, step in session.odometry.steps(OdometryNoise())]
    for before, after in pairwise(chosen):
        between = [
            step for step in steps if before.stamp_ns <= step.start_ns and step.stamp_ns <= after.stamp_ns
        ]
        moved = sum(abs(step.forward_m) / 0.05 + abs(step.turn_rad) / 0.05 for step in between)
        assert moved > 0.8
    few = chosen_frames(session, ViewConfig(most=10))
    assert 6 <= len(few) <= 11
    assert few[-1].stamp_ns - few[0].stamp_ns > 40e9


def test_the_record_is_the_sessions_odometry_without_its_scales(session):
    record = record_of(session)
    noise = OdometryNoise()
    ours = motions_between(record, values_of(session)[6:], record.stamps_s[[0, -1]], noise).poses[0]
    pose = Pose2(0.0, 0.0, 0.0)
    for _, step in session.odometry.steps(noise):
        pose = advance(pose, step)
    assert np.abs(Pose2.from_array(ours).minus(pose)).max() < 1e-6
    twists = replace(session.odometry, wheels=None)
    scaled = replace(session, robot=replace(session.robot, twist_scales=(2.0, 0.5)), odometry=twists)
    np.testing.assert_allclose(record_of(scaled).values[7], session.odometry.values[7] / [2.0, 0.5])


def test_only_frames_whose_fix_was_accepted_and_agrees_are_trusted(session):
    frames = session.frames[:5]
    track = Trajectory.of_poses(
        [
            (frame.stamp_ns + late_ns, Pose2(0.1 * k, 0.0, 0.0))
            for k, frame in enumerate(frames)
            for late_ns in (-50_000_000, 50_000_000)
        ]
    )
    # The second is elsewhere, the third refused, the fourth showed nothing, the fifth is far from any pose.
    places = [0.0, 0.4, 0.2, None, 0.4]
    outcomes = [
        NoFix(Reason.WEAK_EVIDENCE)
        if place is None
        else Fix(PoseBelief(frame.stamp_ns, Pose2(place, 0.0, 0.0), np.diag([1e-4, 1e-4, 1e-5])))
        for place, frame in zip(places, frames, strict=True)
    ]
    records = [
        SimpleNamespace(filename=frame.filename, accepted=k not in (2, 3)) for k, frame in enumerate(frames)
    ]
    result = SimpleNamespace(trajectories=SimpleNamespace(smoothed=track), records=records, outcomes=outcomes)
    shots = [shot_of(session, frame) for frame in frames]
    shots[4] = replace(shots[4], camera_ns=shots[4].camera_ns + 3_000_000_000)
    trusted = trusted_poses(result, session, shots)
    assert list(trusted) == [0]
    np.testing.assert_allclose(trusted[0], 0.0, atol=1e-9)


def test_the_tilt_that_explains_the_lines_is_found(session):
    poses = {
        number: np.array(pose)
        for number, pose in enumerate([(2.2, 7.0, 0.3), (2.5, 6.5, -1.2), (3.0, 7.2, 2.8)])
    }
    true = values_of(session)
    wrong = true.copy()
    wrong[3:5] += [0.016, -0.009]
    shots = []
    for number, pose in poses.items():
        predicted = Projector(session.camera, session.wire_map).predict(
            Pose2.from_array(pose), np.arange(len(session.wire_map))
        )
        ends = predicted.ideal_px
        way = ends[:, 1] - ends[:, 0]
        lengths = np.hypot(*way.T)
        rays = np.concatenate([ends, np.full((len(ends), 2, 1), session.camera.focal_px)], axis=2)
        tight = np.full(len(ends), 0.4)
        polarity = np.where(session.wire_map.polarity[predicted.rows] < 0, -1.0, 1.0)
        lines = LineMeasurements(rays, tight, tight, ends, lengths, way / lengths[:, None], polarity)
        shots.append(shot_of(session, session.frames[number], lines))
    askew = with_robot(session, wrong, TIGHT)
    std = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.02])
    found = with_best_tilt(askew, wrong, std, shots, poses, MatcherConfig(), TiltConfig())
    # Exact lines are put right from the next step but one, too: what is left is less than one and a half.
    assert np.abs(found[3:5] - true[3:5]).max() < 1.5 * TiltConfig().step_rad
    np.testing.assert_array_equal(np.delete(found, [3, 4]), np.delete(wrong, [3, 4]))
