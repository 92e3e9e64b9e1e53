"""A first robot.yaml and map.yaml to edit: a small room with a door, a window and a pillar."""

from __future__ import annotations

from pathlib import Path

from maps.errors import InputError
from maps.mapdocument import write_whole

ROBOT = """\
# The robot. Metres and radians; a `std_...` beside a value says how well it is known.

wheels: # leave this out where odometry.csv holds speeds (forward_mps, turn_radps)
  radius_m: 0.05
  baseline_m: 0.34 # between the points where the two driven wheels touch the floor

camera:
  model: pinhole_radtan (OpenCV) # or: fisheye (OpenCV), with distortion_k1_k2_k3_k4
  width: 640
  height: 480
  fx: 570.0
  fy: 570.0
  cx: 319.5
  cy: 239.5
  distortion_k1_k2_p1_p2_k3: [0.0, 0.0, 0.0, 0.0, 0.0]
  mount: # where the camera sits: x forward, y left of the middle between the wheels
    x_m: 0.12
    y_m: 0.0
    height_m: 1.2 # above the floor
    pitch_down_rad: 0.1 # looking down is positive
    yaw_rad: 0.0 # looking left is positive
    roll_rad: 0.0
    std_height_m: 0.005
    std_pitch_down_rad: 0.003
    std_yaw_rad: 0.003
    std_roll_rad: 0.003

# time_offset_s: 0.0 # added to the times of images gives the clock of the odometry

initial_pose: # where the robot starts in the map; leave phi_rad out where it is not known
  x_m: 1.0
  y_m: 1.5
  phi_rad: 0.0 # 0 looks along the map's x axis, counter-clockwise from there
  std_x_m: 0.1
  std_y_m: 0.1
  std_phi_rad: 0.1
"""

MAP = """\
# The building: a room of 5 x 4 m, 2.5 m high, with a door, a window and a pillar that one can look over.
# Metres; x and y along the walls, z up from the floor. Straight edges that a camera sees as lines belong
# here, each from p0 to p1: to the centimetre, with a tape or a laser. `kind` is free; names should tell
# the place. Check it with `wireloc map check map.yaml`, look at it with `wireloc map show map.yaml`.

units: m
sigma_m: 0.01 # how well the edges are known; a segment may have its own sigma_m

segments:
# Where walls meet the floor, the door's gap left out.
- {name: south/floor, kind: floor, p0: [0.0, 0.0, 0.0], p1: [5.0, 0.0, 0.0]}
- {name: east/floor_a, kind: floor, p0: [5.0, 0.0, 0.0], p1: [5.0, 1.0, 0.0]}
- {name: east/floor_b, kind: floor, p0: [5.0, 1.9, 0.0], p1: [5.0, 4.0, 0.0]}
- {name: north/floor, kind: floor, p0: [5.0, 4.0, 0.0], p1: [0.0, 4.0, 0.0]}
- {name: west/floor, kind: floor, p0: [0.0, 4.0, 0.0], p1: [0.0, 0.0, 0.0]}
# Where walls meet the ceiling.
- {name: south/ceiling, kind: ceiling, p0: [0.0, 0.0, 2.5], p1: [5.0, 0.0, 2.5]}
- {name: east/ceiling, kind: ceiling, p0: [5.0, 0.0, 2.5], p1: [5.0, 4.0, 2.5]}
- {name: north/ceiling, kind: ceiling, p0: [5.0, 4.0, 2.5], p1: [0.0, 4.0, 2.5]}
- {name: west/ceiling, kind: ceiling, p0: [0.0, 4.0, 2.5], p1: [0.0, 0.0, 2.5]}
# Where walls meet each other.
- {name: corner_sw, kind: corner, p0: [0.0, 0.0, 0.0], p1: [0.0, 0.0, 2.5]}
- {name: corner_se, kind: corner, p0: [5.0, 0.0, 0.0], p1: [5.0, 0.0, 2.5]}
- {name: corner_ne, kind: corner, p0: [5.0, 4.0, 0.0], p1: [5.0, 4.0, 2.5]}
- {name: corner_nw, kind: corner, p0: [0.0, 4.0, 0.0], p1: [0.0, 4.0, 2.5]}
# A door, open, in the east wall.
- {name: door/right, kind: door, p0: [5.0, 1.0, 0.0], p1: [5.0, 1.0, 2.05]}
- {name: door/left, kind: door, p0: [5.0, 1.9, 0.0], p1: [5.0, 1.9, 2.05]}
- {name: door/head, kind: door, p0: [5.0, 1.0, 2.05], p1: [5.0, 1.9, 2.05]}
# A window in the north wall.
- {name: window/left, kind: window, p0: [1.5, 4.0, 0.9], p1: [1.5, 4.0, 2.1]}
- {name: window/right, kind: window, p0: [3.0, 4.0, 0.9], p1: [3.0, 4.0, 2.1]}
- {name: window/sill, kind: window, p0: [1.5, 4.0, 0.9], p1: [3.0, 4.0, 0.9]}
- {name: window/head, kind: window, p0: [1.5, 4.0, 2.1], p1: [3.0, 4.0, 2.1]}
# A low pillar in the room: see `holes` and `hole_tops_m` below.
- {name: pillar/top_s, kind: pillar, p0: [3.0, 1.0, 0.8], p1: [3.4, 1.0, 0.8]}
- {name: pillar/top_e, kind: pillar, p0: [3.4, 1.0, 0.8], p1: [3.4, 1.4, 0.8]}
- {name: pillar/top_n, kind: pillar, p0: [3.4, 1.4, 0.8], p1: [3.0, 1.4, 0.8]}
- {name: pillar/top_w, kind: pillar, p0: [3.0, 1.4, 0.8], p1: [3.0, 1.0, 0.8]}
- {name: pillar/sw, kind: pillar, p0: [3.0, 1.0, 0.0], p1: [3.0, 1.0, 0.8]}
- {name: pillar/se, kind: pillar, p0: [3.4, 1.0, 0.0], p1: [3.4, 1.0, 0.8]}
- {name: pillar/ne, kind: pillar, p0: [3.4, 1.4, 0.0], p1: [3.4, 1.4, 0.8]}
- {name: pillar/nw, kind: pillar, p0: [3.0, 1.4, 0.0], p1: [3.0, 1.4, 0.8]}

# Where the robot can drive; all else is solid and hides what is behind. The corners of the outline, one
# after the other; parts that touch are one floor. The second part is the passage through the door.
floor:
- outer: [[0.0, 0.0], [5.0, 0.0], [5.0, 4.0], [0.0, 4.0]]
  holes:
  - [[3.0, 1.0], [3.4, 1.0], [3.4, 1.4], [3.0, 1.4]]
  hole_tops_m: [0.8] # how high each hole's obstacle is; null: up to the ceiling
- outer: [[5.0, 1.0], [5.2, 1.0], [5.2, 1.9], [5.0, 1.9]]

# What hangs over passages, from bottom_m up.
lintels:
- {name: door/lintel, p0: [5.0, 1.0], p1: [5.0, 1.9], bottom_m: 2.05}
"""


def write_templates(folder: Path) -> tuple[Path, ...]:
    """Write robot.yaml and map.yaml to edit; InputError, and nothing written, where one is there already."""
    contents = {folder / "robot.yaml": ROBOT, folder / "map.yaml": MAP}
    for path in contents:
        if path.exists():
            raise InputError(path, "", "is there already, and is not overwritten")
    for path, text in contents.items():
        write_whole(path, text.encode())
    return tuple(contents)
