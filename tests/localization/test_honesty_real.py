"""Recorded odometry of other people's robots, with fixes of which one in twenty is grossly wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.stats import chi2

from localization.localizer import Localizer
from localization.odometry import OdometryNoise, OdometryStep
from localization.verdicts import ACCEPTED, Verdict
from maps.outcomes import PoseBelief
from maps.poses import Array
from runs.evaluation import read_truth
from runs.session import read_session

#: Filtered position error over that of the raw good fixes, at most.
RATIOS = {"mrclam_6_1": 0.5, "mrclam_7_1": 0.75, "lost_in_the_woods": 0.95, "labyrinth": 0.65}


@dataclass(frozen=True, eq=False)
class Driven:
    """What the localizer made of a session.

    `fixes`, `verdicts` and `after`, the belief right after each (None where there was none), go together, as do
    `wrong` and `truth`, (N, 2). `gap`: beliefs while there were no fixes, `gap_truth`: (G, 2).
    """

    fixes: list[PoseBelief]
    verdicts: list[Verdict]
    after: list[PoseBelief | None]
    wrong: Array
    truth: Array
    gap: list[PoseBelief]
    gap_truth: Array


def drive(folder: Path) -> Driven:
    session, truth = read_session(folder), read_truth(folder)
    assert truth is not None
    told = yaml.safe_load((folder / "truth.yaml").read_text())
    start_ns, end_ns = (round(second * 1e9) for second in told["fix_gap_s"])
    localizer = Localizer(session.initial)
    fixes, verdicts, after, gap, count = [], [], [], [], 0
    for event in session.events(OdometryNoise()):
        if isinstance(event, OdometryStep):
            localizer.predict(event)
            count += 1
            if start_ns < event.stamp_ns < end_ns and count % 10 == 0:
                gap.append(localizer.belief_at(event.stamp_ns))
        else:
            fixes.append(event.fix.belief)
            verdicts.append(localizer.fuse(event.fix))
            after.append(localizer.belief_at(event.stamp_ns))
    wrong = np.zeros(len(fixes), bool)
    wrong[[row["row"] for row in told["outlier_fixes"]]] = True

    def places(beliefs: list[PoseBelief]) -> Array:
        stamps = [belief.stamp_ns for belief in beliefs]
        return np.column_stack([np.interp(stamps, truth.stamps_ns, truth.poses[:, i]) for i in range(2)])

    return Driven(fixes, verdicts, after, wrong, places(fixes), gap, places(gap))


def rms(beliefs: list[PoseBelief], truth: Array) -> float:
    places = np.array([[belief.pose.x, belief.pose.y] for belief in beliefs])
    return math.sqrt(np.mean(np.sum((places - truth) ** 2, axis=1)))


@pytest.mark.parametrize("name", RATIOS)
def test_recorded_session(data, name):
    driven = drive(data / "real_odometry" / name)
    accepted = np.array([isinstance(verdict, ACCEPTED) for verdict in driven.verdicts])
    known = np.array([belief is not None for belief in driven.after])
    assert not (accepted & driven.wrong).any()
    # Where the heading has to be found first, fixes are gathered before any is fused.
    refused = ~accepted & known & ~driven.wrong
    assert refused.sum() <= 0.01 * (~driven.wrong).sum()
    filtered = rms([belief for belief in driven.after if belief is not None], driven.truth[known])
    good = ~driven.wrong
    raw = rms([fix for fix, keep in zip(driven.fixes, good, strict=True) if keep], driven.truth[good])
    assert filtered <= RATIOS[name] * raw
    for belief, truth in zip(driven.gap, driven.gap_truth, strict=True):
        off = truth - [belief.pose.x, belief.pose.y]
        assert off @ np.linalg.solve(belief.covariance[:2, :2], off) <= chi2.ppf(0.999, 2)
