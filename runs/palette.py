"""One colour for each layer of a run, the same in recordings, plots and reports.

The hues are Okabe and Ito's, told apart by colour-blind readers, and each of them shows on a dark and
on a light background.
"""

from __future__ import annotations

TRUTH = "#8c8c8c"
ODOMETRY = "#e69f00"
VISION = "#56b4e9"
FILTERED = "#0a84d6"
FIXED_LAG = "#8a6fc8"
SMOOTHED = "#009e73"
REJECTED = "#d55e00"
AMBIGUOUS = "#cc79a7"
IMAGE_LINE = "#d8d8d8"

#: A trajectory's name, its colour and what people call it, in the order of every table and legend.
TRACKS = {
    "odometry": (ODOMETRY, "odometry"),
    "vision": (VISION, "raw vision"),
    "filtered": (FILTERED, "filtered"),
    "fixed_lag": (FIXED_LAG, "fixed lag"),
    "smoothed": (SMOOTHED, "smoothed"),
}
#: Tracks that not every run has.
OPTIONAL_TRACKS = ("fixed_lag",)

#: The three states and their colours.
STATES = {"TRACKING": FILTERED, "UNCERTAIN": ODOMETRY, "LOST": REJECTED}

#: Kinds of map segments take these in alphabetical order, pale: they are what the rest lies upon.
KINDS = ("#b9b2a4", "#9fb8c8", "#b7a6c9", "#a8c3a0", "#c9a9a0", "#c8c39a", "#9fc4bd", "#b5b5b5", "#d3a7b8")

#: From none to most, for regions by what they see: light to dark, so that it also prints in grey.
COUNTS = ("#f2efe8", "#a8d5ea", VISION, FILTERED, "#123a63")

#: How well a fix would be, best to worst, and grey where nothing constrains: light colours are weak fixes.
COVERAGE = ("#123a63", FILTERED, "#a8d5ea", "#f0c987", "#d8d4cc")


def rgb(colour: str) -> tuple[int, int, int]:
    """Return `#rrggbb` as three bytes."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def rgba(colour: str, opacity: float) -> tuple[int, int, int, int]:
    """Return `#rrggbb` as four bytes, with an opacity of 0 to 1."""
    return *rgb(colour), round(255 * opacity)


def kind_colours(kinds: tuple[str, ...]) -> dict[str, str]:
    """Return a colour for each kind of map segment; the same set of kinds always looks the same."""
    return {kind: KINDS[index % len(KINDS)] for index, kind in enumerate(sorted(set(kinds)))}


def count_colour(share: float) -> tuple[int, int, int]:
    """Return the colour on the scale of `COUNTS` at a share of 0 to 1."""
    place = min(max(share, 0.0), 1.0) * (len(COUNTS) - 1)
    stop = min(int(place), len(COUNTS) - 2)
    pairs = zip(rgb(COUNTS[stop]), rgb(COUNTS[stop + 1]), strict=True)
    red, green, blue = (round(low + (place - stop) * (high - low)) for low, high in pairs)
    return red, green, blue
