"""A whole fix beside OpenCV's LSD on the same image, in one process on one thread; growth with the map.

`make bench` prints the figures; pytest on this file with `--benchmark-only -s` these alone. The office of 60 rooms
is slow: its view regions take a minute or two to build once.
"""

from __future__ import annotations

import resource
import time
import tracemalloc
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maps.documents import checked
from maps.mapdocument import MapDocument
from maps.mapfile import build_map
from maps.outcomes import Fix, SearchWindow
from maps.regioncache import cached_regions
from tests.office import office
from tests.sessionframes import QI3, RENDERED, TRACKING, drawn_window, rendered_session
from tests.vision.drawing import CAMERA, exact_lines, poses_inside
from vision.images import GreyImage
from vision.lines import ImageSegments
from vision.lsd import find_lsd
from vision.matcher import LineMatcher

#: Most that a fix may cost, in runs of LSD: while tracking, of a wide window, without a prior.
MOST = (1.0, 2.5, 50.0)
ROUNDS = 5
#: Pieces that a view of the office must show to be timed.
RICH = 12


def tell(*figures: object) -> None:
    print(*figures)


def session_of(name: str, request: pytest.FixtureRequest):
    """Return the bundled session, or one of the development data."""
    if name == "sample":
        return rendered_session(request.getfixturevalue("sample"))
    return rendered_session(request.getfixturevalue("data") / "rendered" / name)


def fastest_ms(matcher: LineMatcher, image: GreyImage, windows: list[SearchWindow]) -> list[float]:
    """Best processor times of LSD alone and of a whole fix in each window, taken by turns; without a prior once.

    Not wall clock: a long call on a busy machine is interrupted more often than a short one.
    """
    spent = []
    for _ in range(ROUNDS):
        started = [time.process_time()]
        find_lsd(image)
        started.append(time.process_time())
        for window in windows[:2]:
            matcher.match(image, 0, window)
            started.append(time.process_time())
        spent.append(np.diff(started))
    started = [time.process_time()]
    matcher.match(image, 0, windows[2])
    everywhere = time.process_time() - started[0]
    return (1e3 * np.append(np.min(spent, axis=0), everywhere)).tolist()


@pytest.mark.parametrize("name", ["sample", *RENDERED[1:]])
def test_a_fix_beside_lsd(benchmark, request, name):
    """Extraction and match: as one run of LSD while tracking, a few for a wide window, tens without a prior."""
    session = session_of(name, request)
    matcher = LineMatcher(session.camera, session.wire_map, regions=session.regions)
    rng = np.random.default_rng(1)
    spent, extract = [], []
    for frame in session.frames[::4]:
        windows = [drawn_window(frame.truth, size, rng) for size in (TRACKING, QI3)]
        windows.append(SearchWindow.everywhere())
        image = frame.image
        if not spent:
            # What is compiled, and the views of the floor, once.
            fastest_ms(matcher, image, windows)
        spent.append(fastest_ms(matcher, image, windows))
        matcher.match(image, 0, windows[0])
        extract.append(matcher.timing_ms["extract"])
    ratio = np.array(spent)[:, 1:] / np.array(spent)[:, :1]
    middle, worst = np.median(ratio, axis=0), ratio.max(axis=0)
    times = np.median(spent, axis=0)
    tell(
        f"\n{name}: LSD {times[0]:.1f} ms; extraction {np.median(extract):.1f} ms; fixes while tracking "
        f"{times[1]:.1f} ms, QI 3 {times[2]:.1f} ms, global {times[3]:.0f} ms;",
        "in LSDs (worst frame): "
        + ", ".join(f"{a:.2f} ({b:.2f})" for a, b in zip(middle, worst, strict=True)),
    )
    frame = session.frames[0]
    benchmark(matcher.match, frame.image, 0, drawn_window(frame.truth, TRACKING, rng))
    assert all(middle <= MOST)


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """Medians over looks at an office: milliseconds and peak memory of a match, tracking and QI 3."""

    segments: int
    match_ms: tuple[float, float]
    match_mb: float
    regions_mb: float
    fixes: int
    matcher: LineMatcher
    look: tuple[ImageSegments, SearchWindow]


@cache
def grown(rooms: int, looks: int = 30) -> Growth:
    """Match exact lines of an office from poses anywhere in it; the same windows whatever the size."""
    wire_map = build_map(checked(MapDocument, office(rooms, lamps=7), "office"), Path("office"))
    height = CAMERA.mount.height_m
    regions = cached_regions(wire_map, (height, height))
    matcher = LineMatcher(CAMERA, wire_map, regions=regions)
    rng = np.random.default_rng(3)
    every = np.arange(len(wire_map))
    spent, fixes, peak = [], 0, 0
    views = [
        (pose, matcher.projector.predict(pose, every)) for pose in poses_inside(wire_map, rng, 4 * looks)
    ]
    # Where a wall fills the view there is nothing to match, and nothing to time.
    rich = [(pose, view) for pose, view in views if len(view) >= RICH][:looks]
    assert len(rich) == looks
    for pose, view in rich:
        segments = exact_lines(CAMERA, view)
        row = []
        for size in (TRACKING, QI3):
            window = drawn_window(pose, size, rng)
            times = []
            for _ in range(3):
                started = time.process_time()
                outcome = matcher.match_segments(segments, 0, window)
                times.append(time.process_time() - started)
            row.append(1e3 * min(times))
            fixes += isinstance(outcome, Fix)
        spent.append(row)
        tracemalloc.start()
        matcher.match_segments(segments, 0, window)
        peak = max(peak, tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    tracking, wide = np.median(spent, axis=0).tolist()
    memory = regions.memory_bytes / 1e6
    return Growth(len(wire_map), (tracking, wide), peak / 1e6, memory, fixes, matcher, (segments, window))


@pytest.mark.parametrize("rooms", [24, pytest.param(60, marks=pytest.mark.slow)])
def test_growth_with_the_map(benchmark, rooms):
    """At a fixed window, a building so many times as large costs at most so many times as much."""
    small, large = grown(5), grown(rooms)
    for of in (small, large):
        tell(
            f"\n{of.segments} segments: match {of.match_ms[0]:.1f} ms tracking, {of.match_ms[1]:.1f} ms QI 3; "
            f"peak of a match {of.match_mb:.1f} MB, regions {of.regions_mb:.0f} MB, {of.fixes} of 60 fixes; process "
            f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB so far"
        )
    segments, window = large.look
    benchmark(large.matcher.match_segments, segments, 0, window)
    larger = large.segments / small.segments
    assert all(now <= larger * before for now, before in zip(large.match_ms, small.match_ms, strict=True))
    assert large.match_mb <= larger * small.match_mb
