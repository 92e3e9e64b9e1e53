"""One image in several windows: which are searched, what is believed, what is told."""

import numpy as np
import pytest

from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason, SearchWindow
from maps.poses import Pose2
from runs.looking import look_in
from vision.matcher import MatcherConfig

IMAGE = np.zeros((2, 2), np.uint8)
NARROW, WIDE = (SearchWindow(Pose2(0.0, 0.0, 0.0), size, 0.1) for size in (0.15, 0.5))
FAR = SearchWindow(Pose2(5.0, 0.0, 0.0), 0.3, 0.1)


class Finder:
    """Stands for the matcher: finds the centre of the windows it is told, and remembers all."""

    def __init__(self, *shown):
        self.config, self.timing_ms = MatcherConfig(), {"extract": 1.0, "match": 2.0}
        self.shown, self.searched = shown, []

    def match(self, _image, stamp_ns, window):
        self.searched.append(window)
        if window not in self.shown:
            return NoFix(Reason.WEAK_EVIDENCE)
        return Fix(PoseBelief(stamp_ns, window.centre, 1e-4 * np.eye(3)), Look(score=20.0))


def test_the_other_windows_are_for_images_that_show_nothing_in_the_first():
    finder = Finder(NARROW, WIDE)
    looked = look_in(finder, IMAGE, 7, (NARROW,), (WIDE,))
    assert finder.searched == [NARROW]
    assert isinstance(looked.outcome, Fix)
    assert (looked.window, looked.spent_ms) == (NARROW, {"extract": 1.0, "match": 2.0})


def test_what_the_others_show_is_told_with_their_window():
    finder = Finder(WIDE)
    looked = look_in(finder, IMAGE, 7, (NARROW,), (WIDE,))
    assert finder.searched == [NARROW, WIDE]
    assert isinstance(looked.outcome, Fix)
    assert (looked.window, looked.spent_ms) == (WIDE, {"extract": 2.0, "match": 4.0})


@pytest.mark.parametrize("otherwise", [(), (WIDE,)])
def test_nothing_anywhere(otherwise):
    looked = look_in(Finder(), IMAGE, 7, (NARROW,), otherwise)
    assert isinstance(looked.outcome, NoFix)
    assert looked.window == (otherwise or (NARROW,))[0]


def test_what_several_windows_show_is_weighed_together():
    looked = look_in(Finder(NARROW, FAR), IMAGE, 7, (NARROW, FAR), (WIDE,))
    assert isinstance(looked.outcome, Ambiguous)
    assert looked.window == FAR
