"""How a recording opens: a tab for each question that people ask of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import rerun.blueprint as rrb

from maps.poses import Array

#: The tabs, by the word that a command line takes.
TABS = {
    "where": "Where am I?",
    "why": "Why this fix?",
    "trust": "Can I trust it?",
    "speed": "How fast is it?",
    "run": "What ran?",
}

#: What accumulates in the plan as time goes by; everything else there shows its latest state.
TRAILS = (
    *(f"/world/tracks/{name}" for name in ("odometry", "filtered", "smoothed")),
    *(f"/world/fixes/{layer}/positions" for layer in ("accepted", "rejected", "ambiguous")),
)

#: Innovations of good fixes lie below the gate's 16; those far above need not be seen to scale.
NIS_SHOWN = 40.0

#: Close-ups of plots that a search of the whole floor would flatten: poses, and milliseconds.
POSES_SHOWN, MS_SHOWN = 200.0, 150.0

#: How far above and behind the robot the eye is that follows it.
NEAR_M = 4.5


@dataclass(frozen=True, slots=True, eq=False)
class Arrangement:
    """What the views of a run must show.

    `bounds`: (2, 2) lower and upper corner of the plan [m]; None where not known yet. `span_s`: the session's first
    and last time.
    """

    bounds: Array | None = None
    has_images: bool = False
    span_s: tuple[float, float] = (0.0, 1.0)


def arrange(shown: Arrangement, tab: str = "where") -> rrb.Blueprint:
    """Arrange the views of one run; `tab`, one of `TABS`, is in front."""
    pages = {
        "where": _where(shown),
        "why": _why(shown),
        "trust": _trust(shown),
        "speed": _speed(shown),
        "run": rrb.Vertical(rrb.TextDocumentView(origin="/run", name="Configuration"), name=TABS["run"]),
    }
    return rrb.Blueprint(
        rrb.Tabs(*pages.values(), active_tab=list(pages).index(tab)),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="sim_time"),
        auto_views=False,
    )


def _where(shown: Arrangement) -> rrb.Container:
    """The plan with tracks and robot, what the camera sees, and the state."""
    contents = [
        "+ /world/**",
        "- /world/robot/camera/lines/**",
        "- /world/window/**",
        "- /world/beliefs",
        "- /world/tracks/fixed_lag",
    ]
    plan = plan_view(shown.bounds, "Plan", contents, TRAILS)
    below = rrb.Horizontal(_state(shown), _decisions(), column_shares=[3, 2])
    top = rrb.Horizontal(plan, _camera(lines=False), column_shares=[3, 2]) if shown.has_images else plan
    return rrb.Vertical(top, below, row_shares=[4, 1], name=TABS["where"])


def _why(shown: Arrangement) -> rrb.Container:
    """The image with its lines, the window with what could be seen from it, and what was left of it all."""
    contents = [
        "+ /world/map/**",
        "+ /world/window/**",
        "+ /world/robot/**",
        "+ /world/fixes/**",
        "- /world/robot/camera/lines/**",
        "- /world/robot/camera/image",
    ]
    window = rrb.Spatial3DView(
        # In the robot's own frame it stays in the middle, looking up the screen.
        origin="/world/robot",
        contents=contents,
        name="Search window, its regions, and what can be seen from it",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=[-NEAR_M, 0.0, 1.2 * NEAR_M],
            look_target=[1.0, 0.0, 0.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
    )
    plots = [_plot(shown, "nis", "Innovation", NIS_SHOWN), _decisions()]
    top: rrb.Container | rrb.View = window
    if shown.has_images:
        top = rrb.Horizontal(_camera(lines=True), window, column_shares=[1, 1])
        plots = [
            _plot(shown, "lines", "Lines and matches"),
            _plot(shown, "hypotheses", "What is left, stage by stage", POSES_SHOWN),
            *plots,
        ]
    return rrb.Vertical(top, rrb.Horizontal(*plots), row_shares=[5, 2], name=TABS["why"])


def _trust(shown: Arrangement) -> rrb.Container:
    """Errors within their bounds, innovations below theirs, and every ellipse."""
    contents = ["+ /world/map/floor", "+ /world/beliefs", "+ /world/fixes/**", "+ /world/tracks/**"]
    plots = rrb.Vertical(
        _plot(shown, "position", "Position: error, and what the filter allows for, m"),
        _plot(shown, "heading", "Heading: error, and what the filter allows for, deg"),
        _plot(shown, "nis", "Innovation", NIS_SHOWN),
        _state(shown),
        row_shares=[3, 3, 3, 2],
    )
    side = rrb.Vertical(
        plan_view(shown.bounds, "Fixes and beliefs, 95 % ellipses", contents, history=True),
        _decisions(),
        row_shares=[2, 1],
    )
    return rrb.Horizontal(plots, side, column_shares=[3, 2], name=TABS["trust"])


def _speed(shown: Arrangement) -> rrb.Container:
    views = [
        _plot(shown, "timing", "Milliseconds, stage by stage"),
        _plot(shown, "timing", "Milliseconds, close up", MS_SHOWN),
    ]
    if shown.has_images:
        views += [
            _plot(shown, "lines", "Lines and matches"),
            _plot(shown, "hypotheses", "What is left, stage by stage"),
        ]
    return rrb.Vertical(*views, name=TABS["speed"])


def plan_view(
    bounds: Array | None,
    name: str,
    contents: Sequence[str],
    trails: Sequence[str] = (),
    *,
    history: bool = False,
) -> rrb.Spatial3DView:
    """Look down on the floor, north up, from a height that shows all of it.

    `trails`, or with `history` everything, show all that they ever showed.
    """
    return rrb.Spatial3DView(
        origin="/world",
        contents=contents,
        name=name,
        eye_controls=eye_above(bounds),
        overrides={path: ever() for path in trails},
        time_ranges=ever() if history else None,
    )


def eye_above(bounds: Array | None) -> rrb.EyeControls3D | None:
    """Look down from where all of it, (2, 2) lower and upper corner, is in sight, north up."""
    if bounds is None:
        return None
    (x, y), (width, depth) = bounds.mean(axis=0), bounds[1] - bounds[0]
    height = 0.85 * max(width, 1.5 * depth, 2.0)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=[x, y - 0.15 * height, height],
        look_target=[x, y, 0.0],
        eye_up=[0.0, 0.0, 1.0],
    )


def ever(timelines: Sequence[str] = ("sim_time", "frame")) -> rrb.VisibleTimeRanges:
    """Show what an entity ever showed, up to the time shown."""
    return rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
            )
            for timeline in timelines
        ]
    )


def _camera(*, lines: bool) -> rrb.Spatial2DView:
    if lines:
        return rrb.Spatial2DView(
            origin="/world/robot/camera", name="Camera: found green to red, unseen pink, unclaimed pale"
        )
    contents = ["$origin/image", "$origin/lines/matched"]
    return rrb.Spatial2DView(origin="/world/robot/camera", contents=contents, name="Camera")


def _state(shown: Arrangement) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(origin="/plots/state", name="State", time_view=time_axis(shown.span_s))


def _decisions() -> rrb.TextLogView:
    columns = rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["Body"])
    return rrb.TextLogView(origin="/decisions", name="Decisions", columns=columns)


def _plot(shown: Arrangement, series: str, name: str, reach: float = 0.0) -> rrb.TimeSeriesView:
    """Plot the series under one path, from 0 up to `reach`; where that is 0, as high as they go."""
    return rrb.TimeSeriesView(
        origin=f"/plots/{series}",
        name=name,
        axis_x=time_axis(shown.span_s),
        axis_y=rrb.ScalarAxis(range=(0.0, reach)) if reach else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )


def time_axis(span_s: tuple[float, float]) -> rrb.TimeAxis:
    """Show a whole session at once."""
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=second) for second in span_s)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))
