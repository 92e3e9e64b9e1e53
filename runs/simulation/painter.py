"""The looks of a building: which paint each part gets, drawn once a region or a part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runs.simulation.facets import Material, Paint
from runs.simulation.walls import Region

#: Share of the parts that look almost as their surroundings do, and how much they then differ.
_FAINT_SHARE, _FAINT = 0.25, 0.05
#: Share of the furniture that has drawers or doors.
_DRAWERS_SHARE = 0.6
#: Planks, tiles, carpet.
_FLOOR_ODDS = (0.4, 0.45, 0.15)


@dataclass(frozen=True, slots=True)
class RoomLook:
    """A region's own paints; the wall's lower part has another up to `dado_m`, where there is one."""

    wall: Paint
    floor: Paint
    ceiling: Paint
    skirting: Paint
    door: Paint
    frame: Paint
    dado: Paint | None
    dado_m: float


class Painter:
    """Draws paints; whatever it paints later depends on what it painted before, so call it in one order."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._door_albedo = float(rng.uniform(0.12, 0.7))
        self._frame_albedo = float(rng.uniform(0.15, 0.85))

    def look(self, region: Region) -> RoomLook:
        """Draw a region's look."""
        rng = self._rng
        wall = self._paint(Material.PLASTER, rng.uniform(0.4, 0.72), rng.uniform(0.02, 0.05), 0.8)
        dado = None
        if rng.random() < 0.4 and not region.passage:
            dado = self._paint(Material.PLASTER, rng.uniform(0.12, 0.5), 0.04, 0.8)
        floor = self._floor()
        return RoomLook(
            wall=wall,
            floor=floor,
            ceiling=self._ceiling(),
            skirting=self._skirting(wall, floor),
            door=self._paint(Material.DOOR, self._door_albedo, rng.uniform(0.05, 0.2), 1.0),
            frame=self._paint(Material.PLASTER, self._frame_albedo, 0.03, 0.4),
            dado=dado,
            dado_m=float(rng.uniform(0.9, 1.4)),
        )

    def part(self, kind: str, area_m2: float, around: Paint, look: RoomLook) -> Paint:
        """Draw the paint of a part of a wall, by the kind of its edges where that tells something."""
        rng = self._rng
        if "window" in kind:
            if area_m2 > 0.1:
                return self._paint(Material.PANE, rng.uniform(2.0, 4.0), 0.0, 1.0)
            return self._paint(Material.PLASTER, rng.uniform(0.6, 0.9), 0.02, 0.3)
        if "skirting" in kind or "floor" in kind:
            return look.skirting
        if "door" in kind:
            return look.door if area_m2 > 0.8 else look.frame
        if rng.random() < _FAINT_SHARE:
            return self.shade(around, 1.0 + _FAINT * float(rng.choice([-1.0, 1.0])))
        return self._paint(Material.PLASTER, rng.uniform(0.1, 0.85), 0.04, 0.5)

    def strip(self, around: Paint) -> Paint:
        """Draw the paint of a narrow strip beside a lone edge: some stand out, some hardly do."""
        step = float(self._rng.uniform(0.04, 0.5))
        darker = self._rng.random() < 0.7 or around.albedo * (1.0 + step) > 0.9
        return self.shade(around, 1.0 - step if darker else 1.0 + step)

    def between(self, low: float, high: float) -> float:
        """Draw a measure."""
        return float(self._rng.uniform(low, high))

    def lamp(self) -> Paint:
        """Draw a lamp's paint."""
        return self._paint(Material.LAMP, self._rng.uniform(1.5, 5.0), 0.0, 1.0)

    def poster(self) -> Paint:
        """Draw a poster's paint."""
        return self._paint(Material.POSTER, 0.6, 0.0, float(self._rng.uniform(0.15, 0.5)))

    def furniture(self, books: bool) -> Paint:
        """Draw the paint of a shelf's front, or of other furniture."""
        rng = self._rng
        if books:
            size = (float(rng.uniform(0.02, 0.04)), float(rng.uniform(0.26, 0.36)))
            return Paint(Material.BOOKS, float(rng.uniform(0.3, 0.6)), 0.0, size, self._seed())
        if rng.random() < _DRAWERS_SHARE:
            size = (float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.15, 0.45)))
            return Paint(Material.TILES, float(rng.uniform(0.1, 0.7)), 0.5, size, self._seed())
        return self._paint(Material.WOOD, rng.uniform(0.08, 0.65), rng.uniform(0.1, 0.3), 1.0)

    def side(self, paint: Paint) -> Paint:
        """Draw the paint of the sides of a part that stands out: the part's own, a little dirtier or cleaner."""
        return self.shade(paint, self.between(0.75, 1.1))

    def shade(self, paint: Paint, factor: float) -> Paint:
        """Return a paint that is brighter by a factor; it keeps its pattern."""
        return Paint(
            paint.material, min(0.95, factor * paint.albedo), paint.contrast, paint.size_m, paint.seed
        )

    def _skirting(self, wall: Paint, floor: Paint) -> Paint:
        """Draw a skirting's paint: often much like the wall's or the floor's."""
        albedo = self._rng.choice([wall.albedo, floor.albedo, float(self._rng.uniform(0.15, 0.8))])
        return self._paint(Material.PLASTER, albedo * self._rng.uniform(0.9, 1.1), 0.03, 0.3)

    def _floor(self) -> Paint:
        rng = self._rng
        match rng.choice(3, p=_FLOOR_ODDS):
            case 0:
                width = float(rng.uniform(0.08, 0.16))
                size = (float(rng.uniform(0.9, 1.8)), width)
                return Paint(Material.PLANKS, float(rng.uniform(0.2, 0.42)), 0.28, size, self._seed())
            case 1:
                side = float(rng.choice([0.3, 0.4, 0.6]))
                strength = float(rng.uniform(0.25, 0.6))
                return Paint(
                    Material.TILES, float(rng.uniform(0.25, 0.6)), strength, (side, side), self._seed()
                )
            case _:
                return self._paint(Material.CARPET, rng.uniform(0.1, 0.35), 0.12, 0.25)

    def _ceiling(self) -> Paint:
        rng = self._rng
        albedo = float(rng.uniform(0.6, 0.85))
        if rng.random() < 0.4:
            return Paint(Material.TILES, albedo, 0.12, (0.6, 0.6), self._seed())
        return self._paint(Material.PLASTER, albedo, 0.02, 1.0)

    def _paint(self, material: Material, albedo: float, contrast: float, size_m: float) -> Paint:
        return Paint(material, float(albedo), float(contrast), (size_m, size_m), self._seed())

    def _seed(self) -> int:
        return int(self._rng.integers(1, 2**20))
