"""The live localizer: two threads, images that are replaced while they wait, and the example of the docs."""

import dataclasses
import importlib.util
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from localization.localizer import Localizer
from localization.odometry import OdometryStep
from localization.states import State
from maps.outcomes import Fix, NoFix, PoseBelief, Reason, SearchWindow
from maps.poses import Pose2
from runs.live import LiveLocalizer
from runs.session import read_session
from vision.matcher import MatcherConfig

SECOND_NS = 1_000_000_000
KNOWN = PoseBelief(0, Pose2(1.0, 2.0, 0.5), np.diag([0.0025, 0.0025, 0.0004]))
IMAGE = np.zeros((4, 4), np.uint8)
EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "live.py"


def step(number: int) -> OdometryStep:
    return OdometryStep(
        number * SECOND_NS // 50, (number + 1) * SECOND_NS // 50, 0.01, 0.0, np.diag([1e-6, 1e-6]), 1e-7
    )


class SlowEye:
    """Stands for a matcher: finds what odometry says, once it is let go."""

    def __init__(self, held: bool = False, fails: bool = False):
        self.config, self.timing_ms = MatcherConfig(), {"extract": 0.0, "match": 0.0}
        self.fails, self.seen_ns = fails, []
        self.begun, self.go = threading.Event(), threading.Event()
        if not held:
            self.go.set()

    def match(self, _image, stamp_ns, window):
        self.begun.set()
        assert self.go.wait(5.0)
        if self.fails:
            raise ValueError("no such camera")
        self.seen_ns.append(stamp_ns)
        if window == SearchWindow.everywhere():
            return NoFix(Reason.NO_HYPOTHESIS)
        return Fix(PoseBelief(stamp_ns, window.centre, np.diag([1e-4, 1e-4, 1e-5])))


def test_a_newer_image_takes_the_place_of_the_one_that_waits():
    eye = SlowEye(held=True)
    with LiveLocalizer(Localizer(KNOWN), eye) as live:
        live.on_odometry(step(0))
        for number in range(5):
            live.on_image(IMAGE, number * 1_000_000)
            assert eye.begun.wait(5.0)
        eye.go.set()
        assert live.wait(5.0)
    assert eye.seen_ns == [0, 4_000_000]
    assert live.dropped == 3


def test_matching_holds_up_neither_odometry_nor_those_who_ask():
    eye = SlowEye(held=True)
    with LiveLocalizer(Localizer(KNOWN), eye) as live:
        live.on_image(IMAGE, 0)
        assert eye.begun.wait(5.0)
        for number in range(10):
            live.on_odometry(step(number))
        assert live.pose_at(SECOND_NS // 5).pose.x > 1.05
        assert live.pose_at(SECOND_NS // 2).pose.x > 1.2
        assert live.state is State.TRACKING
        before = live.belief.covariance[0, 0]
        eye.go.set()
        assert live.wait(5.0)
        assert live.belief.covariance[0, 0] < before
        correction, odometry = live.transforms
        assert (correction @ odometry).minus(live.belief.pose) == pytest.approx(np.zeros(3), abs=1e-9)


def test_the_rate_drops_images():
    eye = SlowEye()
    with LiveLocalizer(Localizer(KNOWN), eye, match_rate_hz=2.0) as live:
        for number in range(9):
            live.on_image(IMAGE, number * 100_000_000)
            live.wait(5.0)
    assert eye.seen_ns == [0, 500_000_000]
    assert live.dropped == 7


def test_what_matching_raises_is_raised_again():
    eye = SlowEye(fails=True)
    live = LiveLocalizer(Localizer(KNOWN), eye)
    live.on_image(IMAGE, 0)
    with pytest.raises(ValueError, match="no such camera"):
        live.wait(5.0)
    eye.begun.clear()
    live.on_image(IMAGE, 1)
    assert eye.begun.wait(5.0)
    with pytest.raises(ValueError, match="no such camera"):
        live.close()


def test_odometry_and_images_from_two_threads_at_once():
    """What arrives in disorder is in order within the history: the same belief as from one thread."""
    eye, watched = SlowEye(), []
    with LiveLocalizer(Localizer(KNOWN), eye, watcher=watched.append) as live:

        def images():
            for number in range(50):
                live.on_image(IMAGE, number * SECOND_NS // 50)
                time.sleep(0.001)

        thread = threading.Thread(target=images)
        thread.start()
        for number in range(60):
            live.on_odometry(step(number))
            assert live.belief is not None
            time.sleep(0.001)
        thread.join()
        assert live.wait(5.0)
        assert len(watched) + live.dropped == 50
        alone = Localizer(KNOWN)
        for number in range(60):
            alone.predict(step(number))
        for seen in watched:
            alone.fuse(seen.outcome, None, seen.stamp_ns)
        assert live.belief.pose == alone.belief.pose
        assert np.array_equal(live.belief.covariance, alone.belief.covariance)


def test_reset_and_outcomes_of_others():
    with LiveLocalizer(Localizer(), SlowEye()) as live:
        live.on_odometry(step(0))
        assert live.state is State.LOST
        live.reset(KNOWN)
        assert live.belief.pose.x == pytest.approx(1.01 * np.cos(0.0), abs=0.02)
        verdict = live.on_outcome(Fix(PoseBelief(SECOND_NS // 50, Pose2(9.0, 9.0, 0.0), KNOWN.covariance)), 0)
        assert verdict.nis > 100.0


def test_the_example_plays_a_session(sample, monkeypatch, capsys):
    """As fast as it goes, lost at the beginning; a few frames, so that it takes a second or two."""
    spec = importlib.util.spec_from_file_location("live_example", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)

    def shortened(folder):
        session = read_session(folder)
        odometry = session.odometry
        kept = odometry.stamps_ns < 5 * SECOND_NS
        parts = {name: getattr(odometry, name)[kept] for name in ("stamps_ns", "arrivals_ns", "values")}
        return dataclasses.replace(
            session, frames=session.frames[:4], odometry=dataclasses.replace(odometry, **parts)
        )

    monkeypatch.setattr(example, "open_session", shortened)
    live = example.main(sample, speed=0.0)
    truth = (sample / "ground_truth.csv").read_text().splitlines()[4].split(",")
    at = live.pose_at(round(float(truth[0]) * 1e9))
    assert at.pose.minus(Pose2(*map(float, truth[1:]))) == pytest.approx(np.zeros(3), abs=0.05)
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 5
    assert "UNCONFIRMED" in said[0]
    assert "Relocalized" in said[1]
    assert said[-1].startswith("TRACKING")
