"""Pictures whose poses are known: how many map edges show, what else does, how exactly, how many fixes it makes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import convolve

from maps.outcomes import Fix
from maps.poses import Pose2
from runs.simulation.observable import observed
from tests.sessionframes import QI1, RenderedSession, drawn_window, is_right
from vision.images import GreyImage
from vision.lines import LineConfig, LineMethod, extract_segments
from vision.matcher import LineMatcher
from vision.projection import Projector

#: A line belongs to a map edge whose line passes both its ends this near, if it lies beside it.
_NEAR_PX = 3.0
_LSD = LineConfig(method=LineMethod.LSD)


@dataclass(frozen=True, slots=True)
class PictureStatistics:
    """Of several pictures, pooled.

    `noise`: standard deviation of a pixel, grey levels, median over pictures. `lines`: LSD's segments of 20 px or
    more a picture. `unmapped`: share of their length that is on no map edge. `seen`: share of the map edges of 40 px
    or more that LSD supports. `off_px`: median distance of the default extraction's lines from their edges.
    `fixes`: right whole fixes among pictures with five edges to see, from windows of 0.3 m and 10 degrees. `off_m`:
    median error of their positions. `wrong`: whole fixes elsewhere.
    """

    noise: float
    lines: float
    unmapped: float
    seen: float
    off_px: float
    fixes: float
    off_m: float
    wrong: float

    def row(self) -> str:
        """The figures of a row of a Markdown table."""
        return " | ".join(f"{getattr(self, one.name):.3g}" for one in fields(self))


def statistics_of(
    session: RenderedSession, pictures: Iterable[tuple[GreyImage, Pose2]], rng: np.random.Generator
) -> PictureStatistics:
    """Look at pictures with the poses that they were taken from; `rng` draws the windows about them."""
    projector = Projector(session.camera, session.wire_map)
    matcher = LineMatcher(session.camera, session.wire_map, regions=session.regions)
    noise, lines, unmapped_px, all_px, visible, supported = [], [], 0.0, 0.0, 0, 0
    offs_px, offs_m, fixes, wrong, fair = list[float](), list[float](), 0, 0, 0
    for image, truth in pictures:
        edges = projector.predict(truth, np.arange(len(session.wire_map))).ideal_px
        lsd = extract_segments(image, session.camera, _LSD)
        noise.append(_noise(image))
        lines.append(len(lsd))
        mapped = np.isfinite(_offsets(lsd.ideal_px, edges))
        unmapped_px, all_px = unmapped_px + lsd.lengths_px[~mapped].sum(), all_px + lsd.lengths_px.sum()
        shown = observed(image, projector, truth)
        visible, supported = visible + shown.visible, supported + shown.observable
        off = _offsets(extract_segments(image, session.camera, LineConfig()).ideal_px, edges)
        offs_px += off[np.isfinite(off)].tolist()
        if shown.observable < 5:
            continue
        fair += 1
        outcome = matcher.match(image, 0, drawn_window(truth, QI1, rng))
        if isinstance(outcome, Fix) and not outcome.partial:
            pose, right = outcome.belief.pose, is_right(outcome.belief.pose, truth)
            fixes, wrong = fixes + right, wrong + (not right)
            offs_m += [float(np.hypot(*pose.minus(truth)[:2]))] if right else []
    return PictureStatistics(
        float(np.median(noise)),
        float(np.mean(lines)),
        unmapped_px / all_px,
        supported / visible,
        float(np.median(offs_px)),
        fixes / fair,
        float(np.median(offs_m)),
        wrong / fair,
    )


def _noise(image: GreyImage) -> float:
    """The standard deviation of a pixel, by a filter that slopes and upright or level edges leave at zero.

    Immerkaer, Computer Vision and Image Understanding 1996, with a median in place of the mean.
    """
    residual = convolve(image.astype(float), np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]))
    return float(np.median(np.abs(residual))) / (0.6745 * 6.0)


def _offsets(lines_px: np.ndarray, edges_px: np.ndarray) -> np.ndarray:
    """The distance of each line (M, 2, 2) from the nearest edge (P, 2, 2) that it lies on, infinite without one."""
    way = edges_px[:, 1] - edges_px[:, 0]
    length = np.linalg.norm(way, axis=1)
    way = way / length[:, None]
    away = lines_px[:, None] - edges_px[None, :, :1]
    across = away[..., 0] * way[:, None, 1] - away[..., 1] * way[:, None, 0]
    along = (away * way[:, None]).sum(axis=3)
    middle = along.mean(axis=2)
    on = (np.abs(across).max(axis=2) < _NEAR_PX) & (middle > 0.0) & (middle < length)
    return np.where(on, np.abs(across.mean(axis=2)), np.inf).min(axis=1, initial=np.inf)
