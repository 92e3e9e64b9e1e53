"""De Souza and Kak's search, for comparison: where the uncertainty of a pose spreads the image of an edge.

They predict each edge from the estimate and look for it in that zone. At 10 degrees, 0.5 m and an edge 6 m away
the zone is some 400 px of 640 wide, and hardly a line is outside it (paper, section 3.6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.outcomes import SearchWindow
from maps.wiremap import WireMap
from runs.experiments.cases import Case
from runs.experiments.syntheticimage import FOCAL_PX, draw_scene, synthetic_image
from vision.camera import Camera
from vision.lines import ImageSegments
from vision.projection import Projector


def zone_px(dt_m: float, dphi_deg: float, distance_m: float) -> tuple[float, float]:
    """Return the width of the zone, pixels: the estimate's errors in quadrature, and both at their worst."""
    turn, shift = math.radians(dphi_deg), dt_m / distance_m
    likely = 2.0 * FOCAL_PX * math.hypot(math.tan(turn), shift)
    worst = 2.0 * FOCAL_PX * math.tan(turn + math.atan(shift))
    return likely, worst


def pairs_in_zone(
    camera: Camera, wire_map: WireMap, segments: ImageSegments, window: SearchWindow
) -> tuple[int, int]:
    """Return how many pairs of a predicted edge and an image line the zones leave, and of how many.

    Edges are predicted from the window's centre. A line is in an edge's zone if its middle is no farther from the
    predicted line than half the zone (in quadrature) at the edge's own distance.
    """
    seen = Projector(camera, wire_map).predict(window.centre, np.arange(len(wire_map)))
    focal = camera.focal_px
    half = focal * np.hypot(math.tan(window.dphi_rad), window.dt_m / seen.depths_m.mean(axis=1))
    middles = np.column_stack([segments.ideal_px.mean(axis=1), np.full(len(segments), focal)])
    distances = np.abs(seen.normals @ middles.T)
    return int((distances <= half[:, None]).sum()), distances.size


@dataclass(frozen=True, slots=True, eq=False)
class ZoneStudy:
    """The zones of a synthetic image; called with its number."""

    wire_map: WireMap
    case: Case
    seed: int

    def __call__(self, number: int) -> list[tuple[int, int]]:
        """Draw the image and count the pairs left, and all."""
        image = synthetic_image(self.wire_map, draw_scene(self.wire_map, self.seed, number), self.case)
        return [pairs_in_zone(image.camera, self.wire_map, image.segments, image.window)]
