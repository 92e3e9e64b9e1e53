"""Whole runs on rendered sessions: how exact and how honest the filter is, beside the least that is possible.

`pytest -m slow -s` on this file prints the table of docs/reports/filter.md.
"""

import numpy as np
import pytest

from localization.odometry import OdometryStep, advance
from maps.poses import Pose2
from runs.config import RunConfig
from runs.evaluation import evaluate, read_truth
from runs.runlog import NullLog, Trajectory
from runs.runner import run_session
from runs.session import read_session
from runs.tracks import errors_of, interpolate

RENDERED = ("building_a", "building_b", "building_0001", "building_0001_return", "building_0002")


def told_the_truth(session, config, truth):
    """Return the track of a robot that is told its pose at every frame, and goes by its wheels in between.

    No filter that publishes as it goes can be much better: what the wheels do between two images shows in the
    second one.
    """
    pose, poses = session.initial.pose, []
    stamps_ns = [frame.stamp_ns for frame in session.frames]
    for step in session.events(config.odometry):
        if not isinstance(step, OdometryStep):
            continue
        pose = advance(pose, step)
        if stamps_ns and stamps_ns[0] <= step.stamp_ns:
            stamps_ns.pop(0)
            pose = Pose2.from_array(interpolate(np.array([step.stamp_ns]), truth)[0])
        poses.append((step.stamp_ns, pose))
    return Trajectory.of_poses(poses)


@pytest.mark.slow
@pytest.mark.parametrize("name", RENDERED)
def test_filter_of_a_rendered_session(data, name):
    session, config = read_session(data / "rendered" / name), RunConfig()
    result = run_session(session, config, NullLog(), lambda *_: None)
    truth = read_truth(session.folder)
    metrics = evaluate(session, result, truth)
    vision, filtered = metrics["vision"], metrics["filtered"]
    first_ns = next(record.stamp_ns for record in result.records if record.accepted)
    errors = errors_of(result.trajectories.filtered, truth)
    since = result.trajectories.filtered.stamps_ns > first_ns
    least = errors_of(told_the_truth(session, config, truth), truth)
    least_deg = np.degrees(np.sqrt(np.mean(np.square(least.heading_rad))))
    heading_deg = filtered["heading_error_deg"]["rmse"]
    print(
        f"\n{name} | {vision['fixes']} of {vision['attempted']}, {vision['wrong']} wrong",
        f"| {100 * filtered['position_error_m']['rmse']:.2f} cm",
        f"| {100 * errors.position_m[since].max():.1f} cm | {heading_deg:.2f} | {least_deg:.2f}",
        f"| {filtered['anees']:.2f}",
    )
    assert vision["wrong_accepted"] == 0
    assert metrics["tracking_wrong_s"] == 0.0
    assert filtered["position_error_m"]["rmse"] <= 0.015
    assert filtered["position_error_m"]["rmse"] < vision["position_error_m"]["rmse"]
    assert errors.position_m[since].max() <= 0.06
    # Wheels that slip by five degrees between two images cannot be followed any better.
    assert heading_deg <= max(0.4, 1.35 * least_deg)
    assert 0.45 <= filtered["anees"] <= 2.0
