"""What reads files from outside, each with a good file to begin from, and where its file lies."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maps.formats.exporting import pgm_bytes
from maps.formats.imported import ImportOptions
from maps.formats.importing import import_map
from maps.mapfile import read_map
from runs.camerainfo import read_camera_info
from runs.config import read_config
from runs.evaluation import read_truth
from runs.folder import read_steps, read_tum
from runs.runlog import COLUMNS
from runs.session import read_session
from vision.encoding import jpeg
from vision.images import read_image

TESTS = Path(__file__).resolve().parents[1]
SAMPLE = TESTS.parent / "runs" / "samples" / "building_a"


@dataclass(frozen=True)
class Reader:
    """`file`: what is changed, in the folder that `lay` fills; `read` is called with that folder.

    `tries`: how often in the tests that always run. `most_s`: as long it may take.
    """

    name: str
    file: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    lay: Callable[[Path], None] = lambda folder: None  # noqa: ARG005
    tries: int = 12
    most_s: float = 5.0


def readers() -> list[Reader]:
    """Return all readers whose libraries are installed."""
    found = [
        Reader("robot", "robot.yaml", (_sample("robot.yaml"),), read_session, _session),
        Reader("map", "map.yaml", (_small_map(),), lambda at: read_map(at / "map.yaml")),
        Reader("odometry", "odometry.csv", (_head("odometry.csv"), _TWIST), read_session, _session),
        Reader("frames", "frames.csv", (_head("frames.csv"),), read_session, _session),
        Reader("fixes", "fixes.csv", (_FIXES,), read_session, _session),
        Reader("truth", "ground_truth_dense.csv", (_head("ground_truth_dense.csv"),), read_truth),
        Reader("config", "config.yaml", (_CONFIG,), lambda at: read_config(at / "config.yaml")),
        Reader("image", "image", _images(), lambda at: read_image(at / "image")),
        Reader("camera info", "info.yaml", (_CAMERA,), lambda at: read_camera_info(at / "info.yaml")),
        Reader("trajectory", "track.tum", (_TUM,), lambda at: read_tum(at / "track.tum")),
        Reader("steps", "steps.csv", (_STEPS,), read_steps),
        Reader("grid", "map.pgm", (_grid(),), _imported("lab.yaml"), _grid_yaml),
        Reader("grid's yaml", "lab.yaml", (_GRID,), _imported("lab.yaml"), _grid_picture),
        Reader("lines", "lines.csv", (_LINES,), _imported("lines.csv")),
        Reader("sdf", "house.sdf", (_SDF,), _imported("house.sdf")),
    ]
    found += _drives()
    if (drawing := _dxf()) is not None:
        found.append(Reader("dxf", "plan.dxf", (drawing,), _imported("plan.dxf")))
    if (model := _ifc()) is not None:
        from maps.formats.ifc import import_ifc

        # What this project does with a model; below, in a process of its own, which has its libraries to load.
        here: Callable[[Path], object] = lambda at: import_ifc(at / "house.ifc", ImportOptions())  # noqa: E731
        found.append(Reader("ifc here", "house.ifc", (model,), here))
        found.append(Reader("ifc", "house.ifc", (model,), _imported("house.ifc"), tries=1, most_s=20.0))
    return found


def _drives() -> list[Reader]:
    """Return the readers of what holds a drive and is no session folder."""
    import drives
    from drives import look

    euroc = "mav0/cam0"
    found = [
        Reader("video", "drive.avi", (drives.film(),), look, _filmed),
        Reader("video's stamps", "frames.csv", (drives.STAMPS,), look, _filmed),
        Reader("tum", "rgb.txt", (drives.TUM_ROWS,), look, _tum),
        Reader("euroc", f"{euroc}/data.csv", (drives.EUROC_ROWS,), look, _euroc),
        Reader("euroc's camera", f"{euroc}/sensor.yaml", (drives.SENSOR,), look, _euroc),
    ]
    try:
        import rosbags.highlevel  # noqa: F401
    except ModuleNotFoundError:
        return found
    for suffix in ("mcap", "db3", "bag"):
        seeds = (drives.bag_bytes(suffix),)
        found.append(
            Reader(f"bag {suffix}", f"drive.{suffix}", seeds, drives.bag_reader(suffix), _map_beside)
        )
    found.append(
        Reader(
            "bag metadata",
            "bag/metadata.yaml",
            (drives.metadata(),),
            lambda at: look(at / "bag", drives.named()),
            _ros2_folder,
        )
    )
    found.append(
        Reader("odd bag", "draw", (b"", b"0123456789", b"9876543210"), drives.odd_bag, _map_beside, tries=4)
    )
    return found


def _map_beside(folder: Path) -> None:
    (folder / "map.yaml").write_bytes(_small_map())


def _ros2_folder(folder: Path) -> None:
    import drives

    _map_beside(folder)
    drives.lay_ros2_folder(folder)


def _filmed(folder: Path) -> None:
    import drives

    _session(folder)
    (folder / "frames.csv").write_bytes(drives.STAMPS)
    (folder / "drive.avi").write_bytes(drives.film())


def _tum(folder: Path) -> None:
    _session(folder)
    (folder / "frames.csv").unlink()
    (folder / "rgb").mkdir(exist_ok=True)
    for name in ("a", "b"):
        (folder / "rgb" / f"{name}.jpg").write_bytes(_images()[0])


def _euroc(folder: Path) -> None:
    import drives

    _session(folder)
    (folder / "frames.csv").unlink()
    (folder / "robot.yaml").write_bytes(b"wheels: {radius_m: 0.05, baseline_m: 0.34}\n")
    camera = folder / "mav0" / "cam0"
    (camera / "data").mkdir(parents=True, exist_ok=True)
    for name in ("a", "b"):
        (camera / "data" / f"{name}.jpg").write_bytes(_images()[0])
    (camera / "data.csv").write_bytes(drives.EUROC_ROWS)
    (camera / "sensor.yaml").write_bytes(drives.SENSOR)


def _imported(name: str) -> Callable[[Path], object]:
    return lambda at: import_map(at / name, ImportOptions())


def _sample(name: str) -> bytes:
    return (SAMPLE / name).read_bytes()


def _head(name: str) -> bytes:
    return b"".join(_sample(name).splitlines(keepends=True)[:12])


def _small_map() -> bytes:
    """The sample's map with few of its edges."""
    text = _sample("map.yaml")
    lines = text.splitlines(keepends=True)
    start = next(row for row, line in enumerate(lines) if line.startswith(b"segments:"))
    end = next(row for row, line in enumerate(lines[start + 1 :], start + 1) if line[:1].isalpha())
    entries = [row for row in range(start + 1, end) if lines[row].startswith((b"- ", b"  - "))]
    return b"".join(lines[: entries[12]] + lines[end:]) if len(entries) > 12 else text


def _session(folder: Path) -> None:
    """Lay the sample's first rows and pictures."""
    (folder / "robot.yaml").write_bytes(_sample("robot.yaml"))
    (folder / "map.yaml").write_bytes(_small_map())
    (folder / "odometry.csv").write_bytes(_head("odometry.csv"))
    (folder / "frames.csv").write_bytes(_head("frames.csv"))
    (folder / "images").mkdir(exist_ok=True)
    for row in _head("frames.csv").decode().splitlines()[1:]:
        (folder / row.split(",")[1]).touch()


def _images() -> tuple[bytes, ...]:
    grey = (np.add.outer(np.arange(24), np.arange(32)) * 4).astype(np.uint8)
    return jpeg(grey), pgm_bytes(grey), b"P6\n4 2\n65535\n" + bytes(48), _png()


def _png() -> bytes:
    import cv2

    done, data = cv2.imencode(".png", (np.arange(24 * 32).reshape(24, 32) * 5).astype(np.uint16))
    assert done
    return data.tobytes()


def _grid() -> bytes:
    grey = np.full((40, 50), 205, np.uint8)
    grey[5:35, 5:45] = 0
    grey[6:34, 6:44] = 254
    return pgm_bytes(grey)


def _grid_yaml(folder: Path) -> None:
    (folder / "lab.yaml").write_bytes(_GRID)


def _grid_picture(folder: Path) -> None:
    (folder / "map.pgm").write_bytes(_grid())


def _dxf() -> bytes | None:
    try:
        import ezdxf
    except ModuleNotFoundError:
        return None
    import logging
    from io import StringIO

    logging.getLogger("ezdxf").setLevel(logging.ERROR)
    document, text = ezdxf.new("R12", units=0), StringIO()
    space = document.modelspace()
    space.add_polyline2d([(0, 0), (8, 0), (8, 3), (0, 3)], close=True, dxfattribs={"layer": "A-WALL"})
    space.add_line((3, 0), (4, 0), dxfattribs={"layer": "Doors"})
    document.write(text)
    return text.getvalue().encode()


def _ifc() -> bytes | None:
    try:
        import ifcopenshell  # noqa: F401
    except ModuleNotFoundError:
        return None
    sys.path.append(os.fspath(TESTS / "maps" / "formats"))
    from test_ifc import House

    text: str = House().file.to_string()
    return text.encode()


_TWIST = (
    b"timestamp_s,forward_mps,turn_radps,arrival_s\n0.0,0.1,0,0.01\n0.1,0.2,0.1,0.11\n0.2,0.1,-0.1,0.21\n"
)
_FIXES = (
    b"timestamp_s,x_m,y_m,phi_rad,std_x_m,std_y_m,std_phi_rad,arrival_s\n"
    b"0.5,1.0,2.0,0.1,0.05,0.05,0.02,0.6\n1.5,1.1,2.0,,0.05,0.05,,1.6\n"
)
_CONFIG = (
    b"match_rate_hz: 2.0\nseed: 3\nmatcher: {lines: {min_length_px: 30.0}}\nlocalizer: {}\nsmoother: {}\n"
)
_CAMERA = b"""image_width: 640
image_height: 480
camera_name: c
camera_matrix: {rows: 3, cols: 3, data: [570, 0, 320, 0, 570, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}
"""
_TUM = b"# t x y z\n0.100000000 1 2 0 0 0 0.1 0.99\n0.2 1 2 0 0 0 0.1 0.99\n"
_STEPS = "{}\n0.1,0.1,a.jpg,{}\n".format(",".join(COLUMNS), "," * (len(COLUMNS) - 4)).encode()
_GRID = (
    b"image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
    b"occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"
)
_LINES = b"x0,y0,z0,x1,y1,z1\n0,0,0,4,0,0\n4,0,0,4,3,0\n4,3,0,0,3,0\n0,3,0,0,0,0\n0,0,0,0,0,2.5\n"
_SDF = b"""<?xml version='1.0'?>
<sdf version='1.5'><model name='h'><link name='w'><pose>0 0 1.25 0 0 0</pose>
<collision name='c'><geometry><box><size>8 0.15 2.5</size></box></geometry><pose>0 0 0 0 0 0</pose></collision></link>
<link name='v'><pose>4 4 1.25 0 0 1.57</pose>
<collision name='d'><geometry><box><size>8 0.15 2.5</size></box></geometry></collision></link></model></sdf>
"""
