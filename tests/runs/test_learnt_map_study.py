"""What a learnt map is worth: learnt from one drive through a building, tried on the other; minutes.

`pytest -m slow -s tests/runs/test_learnt_map_study.py` prints the figures of docs/reports/matcher.md.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maps.mapfile import read_map
from maps.outcomes import SearchWindow
from maps.wiremap import WireMap
from tests.conftest import Command
from tests.sessionframes import QI3, RenderedSession, Verdict, drawn_window, judged, rendered_session
from vision.lines import ImageSegments, LineConfig, extract_segments
from vision.matcher import LineMatcher

pytestmark = pytest.mark.slow

#: Two drives through one building, by other ways, furniture moved.
DRIVES = ("building_0001", "building_0001_return")
DRAWS = 3


def looks(
    session: RenderedSession, segments: list[ImageSegments], wire_map: WireMap, wide: bool
) -> list[Verdict]:
    """Every frame with three windows drawn around the truth, or once without any."""
    session = replace(session, wire_map=wire_map)
    matcher = LineMatcher(session.camera, wire_map, regions=session.regions)
    verdicts = []
    for draw in range(1 if wide else DRAWS):
        rng = np.random.default_rng(draw)
        for number, frame in enumerate(session.frames):
            window = SearchWindow.everywhere() if wide else drawn_window(frame.truth, QI3, rng)
            verdicts.append(judged(session, number, matcher.match_segments(segments[number], 0, window)))
    return verdicts


def told(name: str, verdicts: list[Verdict]) -> tuple[int, int]:
    """Print a line of the report; return right and wrong fixes."""
    fixes = [verdict for verdict in verdicts if verdict.fixed]
    right, wrong = sum(v.right for v in verdicts), sum(v.wrong for v in verdicts)
    metres = [verdict.error_m for verdict in fixes]
    print(
        f"\n{name}: {len(verdicts)} looks, right {right}, wrong {wrong}, median {100 * np.median(metres):.2f} cm, "
        f"p95 {100 * np.percentile(metres, 95):.1f} cm, ANEES {np.mean([v.nees for v in fixes if v.right]):.2f}; "
        f"{dict(Counter(verdict.outcome for verdict in verdicts))}, of the ambiguous with the truth "
        f"{sum(verdict.offered for verdict in verdicts)}"
    )
    return right, wrong


@pytest.mark.parametrize("learnt_on", DRIVES)
def test_a_learnt_map_gives_more_fixes_on_the_other_drive(
    wireloc: Command, data: Path, tmp_path: Path, learnt_on: str
) -> None:
    other = DRIVES[1 - DRIVES.index(learnt_on)]
    run, better = tmp_path / "run", tmp_path / "learnt.yaml"
    folder = data / "rendered" / learnt_on
    assert wireloc("run", folder, "--out", run).code == 0
    ended = wireloc("map", "learn", folder / "map.yaml", run, "--out", better)
    assert ended.code == 0, ended.err
    session = rendered_session(data / "rendered" / other)
    segments = [extract_segments(frame.image, session.camera, LineConfig()) for frame in session.frames]
    maps = {"as drawn": session.wire_map, "learnt": read_map(better)}
    for wide in (False, True):
        (right, wrong), (more, fewer) = (
            told(f"{other}, {'no prior' if wide else 'QI 3'}, {name}", looks(session, segments, of, wide))
            for name, of in maps.items()
        )
        assert fewer <= wrong
        assert more >= right
