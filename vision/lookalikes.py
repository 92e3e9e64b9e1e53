"""Where else a picture may have been taken: the places that a part of the map, moved, makes look like this one.

A search of the floor starts from a coarse grid. Of two windows that are alike it may find the one and miss the
other by the few centimetres that keep a start from its optimum, and then be sure of the one. So the likeliest
pose is carried to wherever its matched edges have their like, and what is found there competes.
"""

from __future__ import annotations

import math

import numpy as np
import shapely

from maps.poses import Pose2
from maps.symmetries import motions_of
from vision.projection import Projector
from vision.refinement import Candidate, RefinementConfig, Scene, refine_poses

#: Places farther down the list share little with this one.
_MOST = 12
#: Nearer than this it is the same place.
_SAME_M, _SAME_RAD = 0.30, math.radians(5.0)


def with_lookalikes(
    scene: Scene, candidates: list[Candidate], stamp_ns: int, config: RefinementConfig
) -> list[Candidate]:
    """Return refined candidates, best first, with those where the best one's look-alikes are."""
    if not candidates:
        return candidates
    found = refine_poses(scene, lookalikes(scene.projector, candidates[0]), stamp_ns, config)
    new = [one for one in found if not any(_meet(one, other, config) for other in candidates)]
    return sorted([*candidates, *new], key=lambda candidate: -candidate.score)


def lookalikes(projector: Projector, candidate: Candidate) -> list[Pose2]:
    """Return the poses on the floor, most alike first, where the edges that a candidate matches have their like."""
    rows = np.unique(candidate.predicted.rows[candidate.matches.pieces])
    here, floor = candidate.belief.pose, projector.wire_map.floor
    found: list[Pose2] = []
    for motion in motions_of(projector.wire_map, rows):
        there = Pose2.from_array(motion) @ here
        on_floor = bool(shapely.contains_xy(floor, there.x, there.y))
        if on_floor and not any(_same_place(there, other) for other in (here, *found)):
            found.append(there)
        if len(found) == _MOST:
            break
    return found


def _same_place(pose: Pose2, other: Pose2) -> bool:
    x, y, phi = pose.minus(other)
    return math.hypot(x, y) <= _SAME_M and abs(phi) <= _SAME_RAD


def _meet(candidate: Candidate, other: Candidate, config: RefinementConfig) -> bool:
    x, y, phi = candidate.belief.pose.minus(other.belief.pose)
    return math.hypot(x, y) < config.same_m and abs(phi) < config.same_rad
