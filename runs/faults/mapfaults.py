"""What goes wrong with maps: edges missing, too many, off by some centimetres, a door moved, another building."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maps.mapdocument import FloorPart, Lintel, MapDocument, Segment
from maps.poses import Array
from runs.faults.recording import Recording, Span

SHARE = 0.2
MOVED_M = 0.05
DOOR_M = 0.5
#: Another building: mirrored, longer and narrower, so that no room of it fits.
STRETCH_X, STRETCH_Y = -1.3, 0.75
#: Parts of one door frame are nearer than this in plan.
_TOGETHER_M = 0.3


def missing(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Take a fifth of the edges out of the map."""
    document = recording.document
    if document is None:
        return recording
    count = len(document.segments)
    gone = set(rng.choice(count, int(SHARE * count), replace=False).tolist())
    return _with(recording, [one for row, one in enumerate(document.segments) if row not in gone])


def extra(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Add a fifth of edges that do not exist: copies of others, up to a metre aside and half a metre up or down."""
    document = recording.document
    if document is None:
        return recording
    rows = rng.choice(len(document.segments), int(SHARE * len(document.segments)), replace=False)
    added = []
    for number, row in enumerate(rows.tolist()):
        shift = rng.uniform(-1.0, 1.0, 3) * (1.0, 1.0, 0.5)
        added.append(_shifted(document.segments[row], shift).model_copy(update={"name": f"extra/{number}"}))
    return _with(recording, [*document.segments, *added])


def moved(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Move every edge by five centimetres, each its own way."""
    document = recording.document
    if document is None:
        return recording
    ways = rng.standard_normal((len(document.segments), 3))
    shifts = MOVED_M * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return _with(recording, [_shifted(*pair) for pair in zip(document.segments, shifts, strict=True)])


def door_moved(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Move the frame of the door that is nearest to the drive's beginning, half a metre along its wall."""
    document = recording.document
    doors = (
        [] if document is None else [row for row, one in enumerate(document.segments) if one.kind == "door"]
    )
    if document is None or not doors:
        return recording
    start = recording.session.initial
    at = (
        np.array([start.pose.x, start.pose.y])
        if start
        else _middle(document.segments[int(rng.choice(doors))])
    )
    frame = _together(document, doors, at)
    corners = _plan([document.segments[row] for row in frame])
    along = corners[int(np.argmax(np.linalg.norm(corners - corners[0], axis=1)))] - corners[0]
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    shift = float(rng.choice([-1.0, 1.0])) * DOOR_M * along
    segments = [
        _shifted(one, np.append(shift, 0.0)) if row in frame else one
        for row, one in enumerate(document.segments)
    ]
    lintels = [
        one.model_copy(update={"p0": _point(one.p0, shift), "p1": _point(one.p1, shift)})
        if _nearest(np.array([one.p0, one.p1]), corners) < _TOGETHER_M
        else one
        for one in document.lintels
    ]
    return replace(recording, document=document.model_copy(update={"segments": segments, "lintels": lintels}))


def wrong(recording: Recording, span: Span, rng: np.random.Generator) -> Recording:  # noqa: ARG001
    """Put another building in the map's place: this one mirrored, longer and narrower."""
    document = recording.document
    if document is None:
        return recording
    centre = _plan(document.segments).mean(axis=0)

    def there(point: tuple[float, ...]) -> tuple[float, ...]:
        x, y = point[:2]
        return (
            float(centre[0] + STRETCH_X * (x - centre[0])),
            float(centre[1] + STRETCH_Y * (y - centre[1])),
            *point[2:],
        )

    def segment(one: Segment) -> Segment:
        # A mirror swaps the sides of an edge.
        return one.model_copy(update={"p0": there(one.p0), "p1": there(one.p1), "polarity": -one.polarity})

    def part(one: FloorPart) -> FloorPart:
        rings = [[there(point) for point in hole] for hole in one.holes]
        return one.model_copy(update={"outer": [there(point) for point in one.outer], "holes": rings})

    def lintel(one: Lintel) -> Lintel:
        return one.model_copy(update={"p0": there(one.p0), "p1": there(one.p1)})

    changed = {
        "segments": [segment(one) for one in document.segments],
        "floor": [part(one) for one in document.floor],
        "lintels": [lintel(one) for one in document.lintels],
    }
    return replace(recording, document=document.model_copy(update=changed))


def _together(document: MapDocument, doors: list[int], at: Array) -> set[int]:
    """Return the rows of the door nearest to a place: its nearest edge, and all that touch what is found."""
    plans = {row: _plan([document.segments[row]]) for row in doors}
    nearest = min(doors, key=lambda row: _nearest(plans[row], at[None]))
    found, fresh = {nearest}, [nearest]
    while fresh:
        row = fresh.pop()
        near = [
            other
            for other in doors
            if other not in found and _nearest(plans[other], plans[row]) < _TOGETHER_M
        ]
        found.update(near)
        fresh.extend(near)
    return found


def _nearest(some: Array, others: Array) -> float:
    return float(np.linalg.norm(some[:, None] - others[None], axis=2).min())


def _plan(segments: list[Segment]) -> Array:
    """Return the end points in plan, (2 N, 2)."""
    return np.array([point[:2] for one in segments for point in (one.p0, one.p1)], float)


def _middle(segment: Segment) -> Array:
    result: Array = _plan([segment]).mean(axis=0)
    return result


def _shifted(segment: Segment, shift: Array) -> Segment:
    return segment.model_copy(update={"p0": _point(segment.p0, shift), "p1": _point(segment.p1, shift)})


def _point(point: tuple[float, ...], shift: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in np.asarray(point) + shift)


def _with(recording: Recording, segments: list[Segment]) -> Recording:
    assert recording.document is not None
    return replace(recording, document=recording.document.model_copy(update={"segments": segments}))
