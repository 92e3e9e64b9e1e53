"""A map as a rerun recording in three dimensions: its edges by kind, floor, lintels and view regions.

    world/map/{segments/<kind>, floor, lintels}     the building
    world/regions/{seen, outlines}                  flat, coloured by the number of segments each one sees

Everything is there at all times.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from maps.regions import ViewRegions
from maps.wiremap import WireMap
from runs.palette import IMAGE_LINE, count_colour, rgba
from runs.scene import log_map

#: Regions lie under the floor's outline, so that the two do not flicker into each other.
REGIONS_M = -0.02


def record_map(path: Path, wire_map: WireMap, regions: ViewRegions, title: str) -> None:
    """Write a map and its view regions into one rerun file."""
    recording = rr.RecordingStream("wireloc")
    recording.save(path, default_blueprint=layout(wire_map))
    recording.send_recording_name(title)
    log_map(recording, wire_map)
    recording.log("world/regions/seen", _mesh(regions), static=True)
    recording.log("world/regions/outlines", _outlines(regions), static=True)
    recording.flush()
    recording.disconnect()


def _mesh(regions: ViewRegions) -> rr.Mesh3D:
    """Return all regions as one mesh: a convex polygon is a fan of triangles from its first corner."""
    cells = [regions.region(number) for number in range(len(regions))]
    most = max((len(cell.rows) for cell in cells), default=1)
    vertices, colours, triangles, start = [], [], [], 0
    for cell in cells:
        corners = len(cell.corners)
        vertices.append(np.column_stack([cell.corners, np.full(corners, REGIONS_M)]))
        colours += [count_colour(len(cell.rows) / most)] * corners
        triangles += [(start, start + corner, start + corner + 1) for corner in range(1, corners - 1)]
        start += corners
    return rr.Mesh3D(
        vertex_positions=np.concatenate(vertices), vertex_colors=colours, triangle_indices=triangles
    )


def _outlines(regions: ViewRegions) -> rr.LineStrips3D:
    """Return the regions' edges, which say on hover how much each region sees."""
    cells = [regions.region(number) for number in range(len(regions))]
    rings = [np.vstack([cell.corners, cell.corners[:1]]) for cell in cells]
    return rr.LineStrips3D(
        [np.column_stack([ring, np.full(len(ring), REGIONS_M)]) for ring in rings],
        colors=rgba(IMAGE_LINE, 0.5),
        radii=rr.Radius.ui_points(0.3),
        labels=[f"region {number}: {len(cell.rows)} segments" for number, cell in enumerate(cells)],
        show_labels=False,
    )


def layout(wire_map: WireMap) -> rrb.Blueprint:
    """Look at the building from the south and above, all of it in sight."""
    x0, y0, x1, y1 = wire_map.floor.bounds
    x, y, far = (x0 + x1) / 2.0, (y0 + y1) / 2.0, 0.85 * max(x1 - x0, 1.5 * (y1 - y0), 2.0)
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=[x, y - 0.6 * far, 0.8 * far],
        look_target=[x, y, 0.0],
        eye_up=[0.0, 0.0, 1.0],
    )
    return rrb.Blueprint(
        rrb.Spatial3DView(origin="/world", name="Map", eye_controls=eye),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="hidden"),
        auto_views=False,
    )
