"""Coverage as a layer over a map's recording.

world/coverage/best          cells, coloured by the best heading's standard deviation
world/coverage/headings      an arrow a heading, coloured by its own
world/coverage/look_alikes   squares, as large as the share of headings with look-alikes
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import rerun as rr

from maps.poses import Array
from maps.wiremap import WireMap
from runs.coverage import Coverage
from runs.coverageplan import NAMES, cells, sigma_class
from runs.maprecording import layout
from runs.palette import AMBIGUOUS, COVERAGE, rgb
from runs.scene import log_map

#: Layers lie apart, so that they do not flicker into each other.
BEST_M, TWINS_M, ARROWS_M = -0.02, 0.01, 0.03
#: A square of look-alikes where every heading has them, as a share of its cell's side.
SQUARE = 0.9


def record_coverage(path: Path, wire_map: WireMap, coverage: Coverage, title: str) -> None:
    """Write a map and its coverage into one rerun file."""
    recording = rr.RecordingStream("wireloc")
    recording.save(path, default_blueprint=layout(wire_map))
    recording.send_recording_name(title)
    log_map(recording, wire_map)
    best = sigma_class(coverage.worst_sigma_m.min(axis=1)).astype(int).tolist()
    recording.log(
        "world/coverage/best", _mesh(cells(coverage), [COVERAGE[c] for c in best], BEST_M), static=True
    )
    # Colours of a mesh are opaque: the share of headings is told by size.
    share = coverage.mistakable.mean(axis=1)
    squares = [
        place + SQUARE * math.sqrt(part) * (cell - place)
        for place, cell, part in zip(coverage.places, cells(coverage), share.tolist(), strict=True)
        if part > 0.0
    ]
    if squares:
        mesh = _mesh(squares, [AMBIGUOUS] * len(squares), TWINS_M)
        recording.log("world/coverage/look_alikes", mesh, static=True)
    recording.log("world/coverage/headings", _arrows(coverage), static=True)
    recording.flush()
    recording.disconnect()


def _mesh(corners: list[Array], colours: list[str], height_m: float) -> rr.Mesh3D:
    """Squares as one mesh, two triangles each."""
    flat = np.concatenate(corners)
    first = 4 * np.arange(len(corners))[:, None, None]
    return rr.Mesh3D(
        vertex_positions=np.column_stack([flat, np.full(len(flat), height_m)]),
        vertex_colors=[rgb(colour) for colour in colours for _ in range(4)],
        triangle_indices=(first + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3),
    )


def _arrows(coverage: Coverage) -> rr.Arrows3D:
    """Short arrows from the cells' centres; what each heading promises shows on hover."""
    ways = np.stack([np.cos(coverage.headings), np.sin(coverage.headings)], axis=1)
    starts = np.repeat(coverage.places, len(ways), axis=0) + np.tile(
        0.15 * coverage.cell_m * ways, (len(coverage.places), 1)
    )
    vectors = np.tile(0.28 * coverage.cell_m * ways, (len(coverage.places), 1))
    classes = sigma_class(coverage.worst_sigma_m.ravel()).astype(int).tolist()
    labels = [
        f"{NAMES[number]}, {segments} segments, {'?' if np.isnan(twins) else int(twins)} look-alikes"
        for number, segments, twins in zip(
            classes, coverage.segments.ravel().tolist(), coverage.twins.ravel().tolist(), strict=True
        )
    ]
    return rr.Arrows3D(
        origins=np.column_stack([starts, np.full(len(starts), ARROWS_M)]),
        vectors=np.column_stack([vectors, np.zeros(len(vectors))]),
        colors=[rgb(COVERAGE[number]) for number in classes],
        radii=rr.Radius.ui_points(0.8),
        labels=labels,
        show_labels=False,
    )
