"""The methods that experiments compare, behind one interface."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from maps.errors import InputError
from maps.outcomes import Outcome, SearchWindow
from maps.partition import PartitionConfig
from maps.regioncache import cached_regions
from maps.regions import ViewRegions
from maps.wiremap import WireMap
from vision.camera import Camera
from vision.lines import ImageSegments
from vision.matcher import LineMatcher, MatcherConfig
from vision.paper.interpretation import Interpretation
from vision.paper.matcher import PaperConfig, PaperMatcher


@dataclass(frozen=True, slots=True)
class SearchCounts:
    """How much there is to search, in the paper's letters, and what the tests leave of it.

    `mv`, `mh`: selected model segments, vertical and not. `n`: image segments, of which `nv` may be vertical.
    `pairs`: of `mh * n`, those that pass the unary test. `couples`: pairs of pairs of verticals that pass the
    binary one. `combinations_h`, `combinations_v`: lengths of the two lists; `products`: of all combinations of
    both. `hypotheses`: what is kept of those.
    """

    mv: int
    mh: int
    n: int
    nv: int
    pairs: int
    couples: int
    combinations_h: int
    combinations_v: int
    products: int
    hypotheses: int

    @property
    def log10_most(self) -> float:
        """How many combinations there are before any test, (n + 1)^mh (nv + 1)^mv, as a logarithm to base 10."""
        return self.mh * math.log10(self.n + 1) + self.mv * math.log10(self.nv + 1)


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a method says of one image, and what it took.

    `ms`: by stage. `counts`, `stages`: None where a method does not enumerate. `exhausted`: whether it gave up
    before it had tried all combinations.
    """

    outcome: Outcome
    ms: Mapping[str, float] = field(default_factory=dict)
    counts: SearchCounts | None = None
    exhausted: bool = False
    stages: Interpretation | None = None

    @property
    def total_ms(self) -> float:
        """All stages together."""
        return sum(self.ms.values())


class Method(Protocol):
    """Something that finds a pose from the segments of an image."""

    @property
    def name(self) -> str:
        """What tables call it."""

    def match_segments(self, camera: Camera, segments: ImageSegments, window: SearchWindow) -> Answer:
        """Find the pose of the camera's robot inside a window."""


@dataclass(frozen=True, slots=True, eq=False)
class DefaultMethod:
    """`vision.matcher`, with a configuration of one's own."""

    wire_map: WireMap
    regions: ViewRegions
    config: MatcherConfig = field(default_factory=MatcherConfig)
    name: str = "default"

    def match_segments(self, camera: Camera, segments: ImageSegments, window: SearchWindow) -> Answer:
        """Match as a run does."""
        matcher = LineMatcher(camera, self.wire_map, self.config, self.regions)
        started = time.perf_counter()
        outcome = matcher.match_segments(segments, 0, window)
        return Answer(outcome, {"match": 1e3 * (time.perf_counter() - started)})


@dataclass(frozen=True, slots=True, eq=False)
class PaperMethod:
    """`vision.paper`: the paper's method as written."""

    wire_map: WireMap
    regions: ViewRegions
    config: PaperConfig = field(default_factory=PaperConfig)
    name: str = "paper"

    def match_segments(self, camera: Camera, segments: ImageSegments, window: SearchWindow) -> Answer:
        """Interpret the image, and count what there was to search."""
        matcher = PaperMatcher(camera, self.wire_map, self.regions, self.config)
        found = matcher.interpret(segments, window)
        counts = SearchCounts(
            mv=found.mv,
            mh=found.mh,
            n=found.lines,
            nv=len(found.vertical_lines),
            pairs=len(found.unary),
            couples=found.verticals.couples,
            combinations_h=len(found.horizontal_list),
            combinations_v=len(found.vertical_list),
            products=found.hypotheses.possible,
            hypotheses=len(found.hypotheses),
        )
        outcome = matcher.outcome(segments, found, 0, window)
        return Answer(outcome, found.stage_ms, counts, found.exhausted, found)


@dataclass(frozen=True, slots=True)
class Setting:
    """What a study tells its methods.

    `camera_height_m`: for the map's view regions. `drawn`: images are drawn from the map, so that edges are as
    straight and sharp as lines. `budget`: hypotheses that the paper's method may evaluate for one image; it tells
    where that was not enough.
    """

    camera_height_m: float
    drawn: bool
    budget: int = 400_000


def _default_method(wire_map: WireMap, setting: Setting) -> Method:
    config = MatcherConfig.for_stated_noise() if setting.drawn else MatcherConfig()
    heights_m = (setting.camera_height_m, setting.camera_height_m)
    return DefaultMethod(wire_map, cached_regions(wire_map, heights_m), config)


def _paper_method(wire_map: WireMap, setting: Setting) -> Method:
    """The paper's, with regions cut along every event where the map is the experiment's own hall or its like."""
    heights_m = (setting.camera_height_m, setting.camera_height_m)
    partition = PartitionConfig(surplus=0.0) if setting.drawn else PartitionConfig()
    regions = cached_regions(wire_map, heights_m, partition)
    return PaperMethod(wire_map, regions, PaperConfig(budget=setting.budget))


#: By name.
METHODS: dict[str, Callable[[WireMap, Setting], Method]] = {
    "paper": _paper_method,
    "default": _default_method,
}


def chosen_methods(names: str, wire_map: WireMap, setting: Setting) -> tuple[Method, ...]:
    """Return methods by their names, separated by commas; InputError for a name that is none.

    A method that needs the map's view regions builds them here, once.
    """
    wanted = dict.fromkeys(name.strip() for name in names.split(",") if name.strip())
    unknown = [name for name in wanted if name not in METHODS]
    if unknown or not wanted:
        raise InputError("--methods", "", f"{', '.join(unknown) or 'none'} is not among {', '.join(METHODS)}")
    return tuple(METHODS[name](wire_map, setting) for name in wanted)
