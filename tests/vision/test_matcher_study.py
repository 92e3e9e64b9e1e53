"""The matcher on every frame of the rendered sessions, with the floors that it must keep; minutes.

`pytest -m slow -s tests/vision/test_matcher_study.py` prints the figures of docs/reports/matcher.md.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
from sessionframes import QI3, TRACKING, Verdict, drawn_window, judged, rendered_sessions

from maps.outcomes import SearchWindow
from vision.lines import LineConfig, extract_segments
from vision.matcher import LineMatcher

pytestmark = pytest.mark.slow

#: From so many visible map edges on, a frame counts as observable; or as one to find oneself by without a prior.
OBSERVABLE, RICH = 5, 8
MOVED_M = 0.03


@dataclass(frozen=True, slots=True)
class Summary:
    """Shares of whole fixes, and the errors of these."""

    fixes: float
    observable_fixes: float
    wrong: float
    median_m: float
    anees: float


def summed_up(name: str, verdicts: list[Verdict]) -> Summary:
    """Print a line of the report, and the wrong fixes; ANEES is over the right ones."""
    fixes = [verdict for verdict in verdicts if verdict.fixed]
    observable = [verdict for verdict in verdicts if verdict.observable >= OBSERVABLE]
    wrong = [verdict for verdict in fixes if verdict.wrong]
    metres = np.array([verdict.error_m for verdict in fixes])
    degrees = np.degrees([verdict.error_rad for verdict in fixes])
    summary = Summary(
        len(fixes) / len(verdicts),
        sum(verdict.fixed for verdict in observable) / len(observable),
        len(wrong) / len(verdicts),
        float(np.median(metres)),
        float(np.mean([verdict.nees for verdict in fixes if verdict.right])),
    )
    print(
        f"\n{name}: {len(verdicts)} looks, fixes {summary.fixes:.1%} (observable {summary.observable_fixes:.1%}), "
        f"wrong {len(wrong)} ({summary.wrong:.2%}), median {100 * summary.median_m:.2f} cm "
        f"{np.median(degrees):.3f} deg, p95 {100 * np.percentile(metres, 95):.1f} cm "
        f"{np.percentile(degrees, 95):.2f} deg, ANEES {summary.anees:.2f}; "
        f"{dict(Counter(verdict.outcome for verdict in verdicts))}"
    )
    for verdict in sorted(fixes, key=lambda verdict: -verdict.error_m)[: max(3, len(wrong))]:
        print(
            f"  {'WRONG' if verdict.wrong else 'worst'} {verdict.session} {verdict.number}: "
            f"{verdict.error_m:.3f} m {np.degrees(verdict.error_rad):.2f} deg, observable {verdict.observable}"
        )
    return summary


def looked_around(data, size, draws: int, moved_m: float = 0.0) -> list[Verdict]:
    """Every frame `draws` times with a window of this half size; map edges moved by a random `moved_m`.

    What hides what stays as it was: walls are not moved.
    """
    verdicts = []
    for session in rendered_sessions(data):
        segments = [extract_segments(frame.image, session.camera, LineConfig()) for frame in session.frames]
        for draw in range(draws):
            rng = np.random.default_rng(draw)
            wire_map = session.wire_map
            if moved_m:
                moves = rng.normal(0.0, moved_m, (len(wire_map), 1, 3))
                wire_map = replace(
                    wire_map,
                    endpoints=wire_map.endpoints + moves,
                    sigma_m=np.full(len(wire_map), moved_m),
                )
            matcher = LineMatcher(session.camera, wire_map, regions=session.regions)
            for number, frame in enumerate(session.frames):
                window = drawn_window(frame.truth, size, rng)
                verdicts.append(judged(session, number, matcher.match_segments(segments[number], 0, window)))
    return verdicts


@pytest.mark.parametrize(
    ("name", "size", "draws"), [("tracking", TRACKING, 1), ("QI 3", QI3, 3)], ids=["tracking", "wide"]
)
def test_fixes_of_a_window(data, name, size, draws):
    """A filter's own window, and the paper's widest: nearly every frame that shows the building gives a fix."""
    summary = summed_up(name, looked_around(data, size, draws))
    assert summary.fixes >= 0.72
    assert summary.observable_fixes >= 0.90
    assert summary.wrong <= 0.003
    assert summary.median_m <= 0.010
    assert 0.5 <= summary.anees <= 2.0


def test_fixes_on_a_map_that_is_off(data):
    """Every edge moved on its own by 3 cm on each axis, as the map says of itself."""
    summary = summed_up("map off by 3 cm, QI 3", looked_around(data, QI3, draws=3, moved_m=MOVED_M))
    assert summary.fixes >= 0.60
    assert summary.wrong <= 0.01
    assert summary.median_m <= 0.06
    assert 0.5 <= summary.anees <= 2.0


def test_fixes_without_a_prior(data):
    """Anywhere on the floor: most rich frames say where they were taken, none says something else."""
    verdicts = []
    for session in rendered_sessions(data):
        matcher = LineMatcher(session.camera, session.wire_map, regions=session.regions)
        for number, frame in enumerate(session.frames):
            if frame.observable >= RICH:
                outcome = matcher.match(frame.image, 0, SearchWindow.everywhere())
                verdicts.append(judged(session, number, outcome))
    summed_up("global", verdicts)
    ambiguous = [verdict for verdict in verdicts if verdict.outcome == "Ambiguous"]
    print(f"  ambiguous {len(ambiguous)}, with the truth {sum(verdict.offered for verdict in ambiguous)}")
    assert sum(verdict.right for verdict in verdicts) >= 0.70 * len(verdicts)
    assert not any(verdict.wrong for verdict in verdicts)
