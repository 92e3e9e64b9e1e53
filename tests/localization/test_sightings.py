import numpy as np
import pytest

from localization.sightings import EvidenceConfig, sighting_of
from localization.verdicts import Unused
from maps.outcomes import Ambiguous, Fix, Look, NoFix, PoseBelief, Reason, SearchWindow
from maps.poses import Pose2

CONFIG = EvidenceConfig()
BELIEF = PoseBelief(7, Pose2(1.0, 2.0, 0.5), 0.01 * np.eye(3))
NARROW = SearchWindow(BELIEF.pose, 0.5, 0.2)


def missed(reason: Reason, edges: int = 20, seen: int = 0, lines: int = 0) -> NoFix:
    """A look that expected as many edges, each another segment, and saw the first few of them."""
    return NoFix(
        reason,
        Look(
            lines_px=np.zeros((lines, 2, 2)),
            predicted_px=np.zeros((edges, 2, 2)),
            predicted_map=np.arange(edges),
            matched_map=np.arange(seen),
        ),
    )


@pytest.mark.parametrize(
    ("outcome", "window", "doubt", "blind"),
    [
        (missed(Reason.WEAK_EVIDENCE), NARROW, CONFIG.miss, False),
        (missed(Reason.NO_HYPOTHESIS), NARROW, CONFIG.miss, False),
        (missed(Reason.NO_HYPOTHESIS, edges=7), NARROW, 1.0, False),
        (missed(Reason.WEAK_EVIDENCE), SearchWindow.everywhere(), CONFIG.floor_miss, False),
        (missed(Reason.WEAK_GEOMETRY), NARROW, 1.0, False),
        (missed(Reason.TOO_FEW_SEGMENTS), NARROW, 1.0, True),
        (missed(Reason.UNREADABLE_IMAGE), NARROW, 1.0, True),
    ],
)
def test_what_a_look_without_a_place_says(outcome, window, doubt, blind):
    found = sighting_of(outcome, 5, window, CONFIG)
    assert (found.stamp_ns, found.places, found.doubt, found.blind) == (5, (), doubt, blind)
    assert found.unused is outcome.reason


@pytest.mark.parametrize(
    ("edges", "seen", "lines", "doubt"),
    [
        (40, 10, 150, CONFIG.clear_miss),
        (40, 20, 150, CONFIG.floor_miss),  # half of it is there
        (40, 10, 30, CONFIG.floor_miss),  # blurred, dark or covered
        (12, 3, 150, CONFIG.floor_miss),  # not much to miss
    ],
)
def test_an_image_full_of_something_else_speaks_against_a_place(edges, seen, lines, doubt):
    outcome = missed(Reason.WEAK_EVIDENCE, edges, seen, lines)
    assert sighting_of(outcome, 5, SearchWindow.everywhere(), CONFIG).doubt == doubt
    assert sighting_of(outcome, 5, NARROW, CONFIG).doubt == CONFIG.miss


def test_places_compete():
    fix = sighting_of(Fix(BELIEF), 5, SearchWindow.everywhere(), CONFIG)
    assert (fix.stamp_ns, fix.places, fix.odds, fix.doubt) == (7, (BELIEF,), (1.0,), None)
    assert fix.unused is Unused.UNCONFIRMED
    both = sighting_of(Ambiguous((BELIEF, BELIEF), (0.7, 0.3)), 5, None, CONFIG)
    assert (both.stamp_ns, both.odds, both.doubt, both.unused) == (7, (0.7, 0.3), None, Unused.AMBIGUOUS)


def test_order_is_by_stamp_then_by_content():
    first = sighting_of(missed(Reason.WEAK_EVIDENCE), 9, NARROW, CONFIG)
    others = [
        sighting_of(Fix(PoseBelief(9, Pose2(x, 0.0, 0.0), np.eye(3))), 0, None, CONFIG) for x in (2.0, 3.0)
    ]
    looks = [*others, first, sighting_of(Fix(BELIEF), 0, None, CONFIG)]
    for arrived in (looks, looks[::-1]):
        assert sorted(arrived, key=lambda look: look.order) == [looks[3], first, *others]
