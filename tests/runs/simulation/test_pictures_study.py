"""Simulated pictures beside path-traced ones from the same poses: no stage may get an easier image.

`pytest -m slow -s` on this file prints the table of docs/simulation.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maps.poses import Pose2
from runs.simulation.filming import SHAKE_RAD
from runs.simulation.photograph import GreyImage, Photographer, Sensor
from runs.simulation.scene import Conditions, scene_of
from tests.picturestatistics import PictureStatistics, statistics_of
from tests.sessionframes import RENDERED, RenderedSession, rendered_session
from vision.encoding import jpeg
from vision.images import read_image

#: Every so many frames of a session.
EVERY = 3


def simulated(session: RenderedSession, seed: int, scratch: Path) -> Iterator[tuple[GreyImage, Pose2]]:
    """Take pictures from the poses of a session's frames, with the simulator's defaults."""
    rng, sensor, mount = np.random.default_rng(seed), Sensor(), session.camera.mount
    way = np.array([[frame.truth.x, frame.truth.y] for frame in session.frames])
    scene = scene_of(session.wire_map, Conditions(sun=seed % 2 == 0), rng, mount.height_m, way)
    photographer = Photographer(scene, session.camera, sensor)
    for frame in session.frames[::EVERY]:
        pitch, roll = SHAKE_RAD * rng.standard_normal(2)
        shaken = replace(mount, pitch_down_rad=mount.pitch_down_rad + pitch, roll_rad=mount.roll_rad + roll)
        rotation, centre = replace(session.camera, mount=shaken).map_from_optical(frame.truth)
        moments = np.tile(rotation, (sensor.rays, 1, 1)), np.tile(centre, (sensor.rays, 1))
        scratch.write_bytes(jpeg(photographer.take(*moments, rng), sensor.quality))
        yield read_image(scratch), frame.truth


@pytest.mark.slow
def test_no_stage_gets_an_easier_image_than_from_a_path_tracer(data, tmp_path) -> None:
    columns = "noise, lines, unmapped, seen, off_px, fixes, off_m, wrong"
    print(f"\nbuilding, pictures | {columns}")
    pairs = list[tuple[PictureStatistics, PictureStatistics]]()
    for number, name in enumerate(RENDERED):
        session = rendered_session(data / "rendered" / name)
        traced = [(frame.image, frame.truth) for frame in session.frames[::EVERY]]
        theirs = statistics_of(session, traced, np.random.default_rng(0))
        own = statistics_of(
            session, simulated(session, number, tmp_path / "picture.jpg"), np.random.default_rng(0)
        )
        print(f"{name}, path-traced | {theirs.row()}\n{name}, simulated | {own.row()}", flush=True)
        pairs.append((theirs, own))

    def over(name: str) -> float:
        """The mean of all buildings, simulated over path-traced."""
        return float(
            np.mean([getattr(own, name) for _, own in pairs])
            / np.mean([getattr(their, name) for their, _ in pairs])
        )

    # Building by building they differ both ways; on the whole no stage may find it easier, but for chance.
    assert over("lines") >= 0.9
    assert over("unmapped") >= 0.95
    assert over("seen") <= 1.05
    assert over("off_px") >= 0.95
    assert over("fixes") <= 1.05
