"""What the paper prints, for tables that set it beside one's own figures."""

from __future__ import annotations

from dataclasses import dataclass

#: Table 3, 430 images a row: success, false negative, consistent and inconsistent false positive.
TABLE_3 = {"qi1": (421, 5, 4, 0), "qi2": (418, 5, 7, 0), "qi3": (415, 5, 7, 3)}
TABLE_3_IMAGES = 430


@dataclass(frozen=True, slots=True)
class RealImage:
    """A row of table 4: errors in heading [deg] and position [m], hypotheses kept, correspondences."""

    number: int
    heading_deg: float
    position_m: float
    hypotheses: int
    correspondences: int


#: Table 4, QI 3; of its ten images one, number 8, gave nothing.
TABLE_4: tuple[RealImage | None, ...] = (
    RealImage(1, 2.1, 0.15, 65, 5),
    RealImage(2, 1.8, 0.12, 55, 4),
    RealImage(3, 1.5, 0.19, 24, 5),
    RealImage(4, 2.5, 0.13, 120, 6),
    RealImage(5, 2.0, 0.16, 65, 5),
    RealImage(6, 2.1, 0.09, 180, 4),
    RealImage(7, 2.3, 0.13, 121, 4),
    None,
    RealImage(9, 0.5, 0.08, 360, 4),
    RealImage(10, 1.8, 0.20, 391, 9),
)
