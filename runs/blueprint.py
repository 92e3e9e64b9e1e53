"""How a recording opens: plan on the left, camera on the right, plots and decisions below."""

from __future__ import annotations

import rerun.blueprint as rrb

from maps.poses import Array

#: What accumulates in the plan as time goes by; everything else there shows its latest state.
TRAILS = (
    "/world/tracks/odometry",
    "/world/tracks/filtered",
    "/world/tracks/smoothed",
    *(
        f"/world/fixes/{layer}/{part}"
        for layer in ("accepted", "rejected", "ambiguous")
        for part in ("outlines", "positions")
    ),
)


#: Innovations of good fixes lie below the gate's 16; those far above need not be seen to scale.
NIS_SHOWN = 40.0


def arrange(
    bounds: Array | None, *, has_images: bool, highest_errors: tuple[float, float] | None = None
) -> rrb.Blueprint:
    """Arrange the views of one run.

    `bounds`: (2, 2) lower and upper corner of what the plan is to show [m]; None where not known yet.
    `highest_errors`: what the error plots must reach, position [m] and heading [deg], 0 where it does not
    matter; None without a truth.
    """
    top: rrb.Container | rrb.View = _plan(bounds)
    if has_images:
        camera = rrb.Spatial2DView(origin="/world/robot/camera", name="Camera")
        top = rrb.Horizontal(top, camera, column_shares=[1, 1])
    title = "3 sigma" if highest_errors is None else "error"
    position_m, heading_deg = highest_errors or (0.0, 0.0)
    details = [_plot("nis", "Innovation", NIS_SHOWN), _plot("timing", "Milliseconds")]
    if has_images:
        details.insert(1, _plot("lines", "Lines and matches"))
    state = rrb.StateTimelineView(origin="/plots/state", name="State")
    columns = rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["Body"])
    log = rrb.TextLogView(origin="/decisions", name="Decisions", columns=columns)
    bottom = rrb.Horizontal(
        rrb.Vertical(
            _plot("position", f"Position {title}, m", 1.1 * position_m),
            _plot("heading", f"Heading {title}, deg", 1.1 * heading_deg),
        ),
        rrb.Vertical(rrb.Tabs(*details, active_tab=0), state, row_shares=[3, 1]),
        log,
        column_shares=[3, 3, 2],
    )
    return rrb.Blueprint(
        rrb.Vertical(top, bottom, row_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="sim_time"),
        auto_views=False,
    )


def _plan(bounds: Array | None) -> rrb.Spatial3DView:
    """Look down on the floor, north up, from a height that shows all of it."""
    eye = None
    if bounds is not None:
        (x, y), (width, depth) = bounds.mean(axis=0), bounds[1] - bounds[0]
        height = 0.85 * max(width, 1.5 * depth, 2.0)
        eye = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=[x, y - 0.15 * height, height],
            look_target=[x, y, 0.0],
            eye_up=[0.0, 0.0, 1.0],
        )
    history = [
        rrb.VisibleTimeRange(
            timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
        )
        for timeline in ("sim_time", "frame")
    ]
    return rrb.Spatial3DView(
        origin="/world",
        contents=["+ /world/**", "- /world/robot/camera/lines/**"],
        name="Plan",
        eye_controls=eye,
        overrides={path: rrb.VisibleTimeRanges(history) for path in TRAILS},
    )


def _plot(series: str, name: str, reach: float = 0.0) -> rrb.TimeSeriesView:
    """Plot the series under one path, from 0 up to `reach`; where that is 0, as high as they go."""
    return rrb.TimeSeriesView(
        origin=f"/plots/{series}",
        name=name,
        axis_y=rrb.ScalarAxis(range=(0.0, reach)) if reach else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )
