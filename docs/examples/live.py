"""Play a recorded session as a robot would live it: odometry in this thread, matching in another.

    python docs/examples/live.py SESSION [SPEED]

SESSION: a session folder, a bag with robot.yaml and map.yaml beside it, or another layout.
SPEED: 1 (as it was), 10 (ten times faster), 0 (as fast as matching goes, no image dropped).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from localization.localizer import Localizer
from localization.odometry import OdometryNoise, OdometryStep
from maps.outcomes import SearchWindow
from maps.regioncache import cached_regions
from runs.live import LiveLocalizer, Seen
from runs.opening import open_session
from runs.session import Frame, RecordedFix, Session
from vision.matcher import LineMatcher


def main(path: Path, speed: float = 1.0, told: bool = False) -> LiveLocalizer:
    """Play a session, and tell what happens; `told`: where the robot starts, else it finds out."""
    session = open_session(path)
    matcher = matcher_of(session)
    # The first search everywhere takes seconds: what can be seen from where is worked out once.
    matcher.match(session.frames[0].image(), 0, SearchWindow.everywhere())
    localizer = Localizer(session.initial if told else None)
    with LiveLocalizer(localizer, matcher, watcher=tell) as live:
        play(session, live, speed)
        live.wait()
        belief = live.belief
        place = belief.pose if belief else "nowhere"
        print(f"{live.state}: {place}, {live.dropped} images dropped")  # noqa: T201
        return live


def matcher_of(session: Session) -> LineMatcher:
    """Return a matcher for the session's camera and map; on a robot, read both with `runs.robot` and `maps`."""
    camera, wire_map = session.camera, session.wire_map
    if camera is None or wire_map is None:
        sys.exit(f"{session.folder}: no images to match")
    regions = cached_regions(wire_map, (camera.mount.height_m, camera.mount.height_m))
    return LineMatcher(camera, wire_map, regions=regions)


def play(session: Session, live: LiveLocalizer, speed: float) -> None:
    """Hand over every event when its time has come; a robot's drivers do this."""
    began, first_ns = time.monotonic(), session.start_ns
    for event in session.events(OdometryNoise()):
        arrival_ns = event.stamp_ns if isinstance(event, OdometryStep) else event.arrival_ns
        if speed > 0.0:
            due = began + (arrival_ns - first_ns) * 1e-9 / speed
            time.sleep(max(due - time.monotonic(), 0.0))
        match event:
            case OdometryStep():
                live.on_odometry(event)
            case Frame():
                live.on_image(event.image(), event.stamp_ns)
                if speed == 0.0:
                    live.wait()
            case RecordedFix():
                live.on_outcome(event.fix, event.stamp_ns)


def tell(seen: Seen) -> None:
    """Print what came of an image."""
    print(f"{seen.stamp_ns * 1e-9:8.2f} s  {type(seen.outcome).__name__}: {seen.verdict}")  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 1.0)
