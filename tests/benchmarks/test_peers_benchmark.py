"""The matcher beside others on the same segments and windows: the paper's method, PoseLib and cvxpnpl.

The last two solve for a pose from given pairs, and so have to take what lies nearest to the prediction from the
window's centre. They come with the extra `peers`.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from maps.outcomes import Fix, SearchWindow
from maps.poses import Array, Pose2
from tests.sessionframes import QI1, QI3, RenderedSession, drawn_window, is_right, rendered_session
from vision.constraints import level_from_optical
from vision.lines import ImageSegments, LineConfig, extract_segments
from vision.matcher import LineMatcher
from vision.paper.covariance import robot_pose
from vision.paper.matcher import PaperConfig, PaperMatcher
from vision.projection import Projector

poselib = pytest.importorskip("poselib", reason="needs the extra `peers`")
cvxpnpl = pytest.importorskip("cvxpnpl", reason="needs the extra `peers`")

SESSIONS = ("building_a", "building_b")
FRAMES = 20
#: The paper's method takes half a minute for a busy frame even with this budget: one frame in so many, and slow.
PAPER_STEP = 5
BUDGET = 50_000
#: Beyond what the window does to a direction, a line may lean this much from the edge it is taken for.
LEAN_RAD = math.radians(10.0)
#: What counts as an inlier to PoseLib, in pixels.
INLIER_PX = 3.0

Method = Callable[[ImageSegments, SearchWindow], Pose2 | None]
Maker = Callable[[RenderedSession], Method]


def nearest_pairs(projector: Projector, segments: ImageSegments, window: SearchWindow) -> tuple[Array, Array]:
    """Return lines (K, 2, 2), ideal pixels, and for each the nearest edge (K, 2, 3) predicted from the centre."""
    predicted = projector.predict(window.centre, np.arange(len(projector.wire_map)))
    if not len(predicted) or not len(segments):
        return np.zeros((0, 2, 2)), np.zeros((0, 2, 3))
    start, way = predicted.ideal_px[:, 0], predicted.ideal_px[:, 1] - predicted.ideal_px[:, 0]
    along = way / predicted.lengths_px[:, None]
    offset = segments.ideal_px[None] - start[:, None, None]
    at = np.clip((offset * along[:, None, None]).sum(axis=3), 0.0, predicted.lengths_px[:, None, None])
    away = np.linalg.norm(offset - at[..., None] * along[:, None, None], axis=3).mean(axis=2)
    direction = segments.ideal_px[:, 1] - segments.ideal_px[:, 0]
    direction = direction / np.linalg.norm(direction, axis=1)[:, None]
    away[np.abs(along @ direction.T) < math.cos(LEAN_RAD + window.dphi_rad)] = np.inf
    nearest = away.argmin(axis=0)
    # Half a window away, at two metres' range, is as far as anything may look.
    reach = projector.camera.focal_px * (math.tan(window.dphi_rad) + window.dt_m / 2.0)
    near = away.min(axis=0) <= reach
    return segments.ideal_px[near], projector.wire_map.endpoints[predicted.rows[nearest[near]]]


def in_the_plane(projector: Projector, optical_from_map: Array, centre: Array) -> Pose2:
    """Return the robot's pose that comes nearest to a camera's rotation and centre in space."""
    level = optical_from_map.T @ level_from_optical(projector.camera).T
    psi = math.atan2(level[1, 0] - level[0, 1], level[0, 0] + level[1, 1])
    return robot_pose(projector.camera, psi, float(centre[0]), float(centre[1]))


def ours(session: RenderedSession) -> Method:
    matcher = LineMatcher(session.camera, session.wire_map, regions=session.regions)
    return lambda segments, window: _fixed(matcher.match_segments(segments, 0, window))


def papers(session: RenderedSession) -> Method:
    config = PaperConfig(budget=BUDGET)
    matcher = PaperMatcher(session.camera, session.wire_map, session.regions, config)
    return lambda segments, window: _fixed(matcher.match_segments(segments, 0, window))


def _fixed(outcome) -> Pose2 | None:
    return outcome.belief.pose if isinstance(outcome, Fix) and not outcome.partial else None


def poselibs(session: RenderedSession) -> Method:
    """PoseLib's RANSAC over minimal sets of lines, started at the window's centre."""
    projector = Projector(session.camera, session.wire_map)
    focal = session.camera.focal_px
    camera = {"model": "PINHOLE", "width": session.camera.width, "height": session.camera.height}
    camera["params"] = [focal, focal, 0.0, 0.0]
    nothing_2d, nothing_3d = np.zeros((0, 2)), np.zeros((0, 3))

    def method(segments: ImageSegments, window: SearchWindow) -> Pose2 | None:
        lines, edges = nearest_pairs(projector, segments, window)
        if len(lines) < 3:
            return None
        rotation, centre = session.camera.map_from_optical(window.centre)
        start = poselib.CameraPose()
        start.R, start.t = rotation.T, -rotation.T @ centre
        found, inliers = poselib.estimate_absolute_pose_pnpl(
            nothing_2d,
            nothing_3d,
            lines[:, 0],
            lines[:, 1],
            edges[:, 0],
            edges[:, 1],
            camera,
            {"max_epipolar_error": INLIER_PX, "max_iterations": 10_000},
            {},
            start,
        )
        if inliers["num_inliers"] < 4:
            return None
        return in_the_plane(projector, found.R, found.center())

    return method


def cvxpnpls(session: RenderedSession) -> Method:
    """cvxpnpl: all pairs at once, a convex relaxation without outliers in mind."""
    projector = Projector(session.camera, session.wire_map)
    focal = session.camera.focal_px
    matrix = np.diag([focal, focal, 1.0])

    def method(segments: ImageSegments, window: SearchWindow) -> Pose2 | None:
        lines, edges = nearest_pairs(projector, segments, window)
        if len(lines) < 4:
            return None
        try:
            with warnings.catch_warnings():
                # It says when it is not sure, which with wrong pairs is always.
                warnings.simplefilter("ignore", UserWarning)
                found = cvxpnpl.pnl(lines, edges, matrix)
        except (np.linalg.LinAlgError, ValueError):
            return None
        poses = [in_the_plane(projector, rotation, -rotation.T @ shift) for rotation, shift in found]
        # Several answers: the one nearest to the window is the best for it that a prior can say.
        return min(poses, key=lambda pose: abs(pose.minus(window.centre)).sum(), default=None)

    return method


METHODS = {"here": ours, "PoseLib": poselibs, "cvxpnpl": cvxpnpls}


SIZES = pytest.mark.parametrize("size", [QI1, QI3], ids=["QI 1", "QI 3"])


@SIZES
def test_solvers(benchmark, data, size):
    """More right fixes than solvers with nearest neighbours, and no more wrong ones."""
    check_ahead(benchmark.pedantic(lambda: compare(data, size, METHODS, FRAMES), rounds=1))


@SIZES
@pytest.mark.slow
def test_the_papers_method(benchmark, data, size):
    """The same against the paper's method."""
    methods = {"here": ours, "paper": papers}
    check_ahead(benchmark.pedantic(lambda: compare(data, size, methods, FRAMES // PAPER_STEP), rounds=1))


def check_ahead(tallies: dict[str, tuple[int, int, float]]) -> None:
    """The matcher here has more right fixes than each peer, no more wrong ones, and smaller errors."""
    right, wrong, off = tallies.pop("here")
    for theirs in tallies.values():
        assert right > theirs[0]
        assert wrong <= theirs[1]
        assert not off >= theirs[2]


def compare(
    data: Path, size: tuple[float, float], makers: dict[str, Maker], frames: int
) -> dict[str, tuple[int, int, float]]:
    """Print and return what each method makes of the same looks: right, wrong, median error of its answers in cm."""
    right, wrong = dict.fromkeys(makers, 0), dict.fromkeys(makers, 0)
    errors, good, spent = ({name: [] for name in makers} for _ in range(3))
    looks = 0
    for name in SESSIONS:
        session = rendered_session(data / "rendered" / name)
        methods = {key: make(session) for key, make in makers.items()}
        rng = np.random.default_rng(5)
        numbers = np.linspace(0, len(session.frames) - 1, frames).astype(int)
        for frame in [session.frames[number] for number in numbers]:
            segments = extract_segments(frame.image, session.camera, LineConfig())
            window = drawn_window(frame.truth, size, rng)
            looks += 1
            for key, method in methods.items():
                if looks == 1:
                    method(segments, window)
                started = time.perf_counter()
                pose = method(segments, window)
                spent[key].append(1e3 * (time.perf_counter() - started))
                if pose is None:
                    continue
                errors[key].append(math.hypot(pose.x - frame.truth.x, pose.y - frame.truth.y))
                hit = is_right(pose, frame.truth)
                right[key] += hit
                wrong[key] += not hit
                good[key] += errors[key][-1:] if hit else []
    print(f"\n{looks} looks at {size[0]:.2f} m, {math.degrees(size[1]):.0f} deg")
    for key in makers:
        off, near = (100 * np.median(of[key] or [np.nan]) for of in (errors, good))
        print(
            f"{key}: right {right[key]}, wrong {wrong[key]}, off by {off:.1f} cm, right ones by {near:.1f} cm, "
            f"median {np.median(spent[key]):.1f} ms, mean {np.mean(spent[key]):.1f} ms"
        )
    return {key: (right[key], wrong[key], float(100 * np.median(errors[key] or [np.nan]))) for key in makers}
