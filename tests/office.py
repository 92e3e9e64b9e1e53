"""An office building of any size, as a map: floors of rooms on both sides of corridors."""

from __future__ import annotations

from typing import Any

WALL_M = 0.16
HEIGHT_M = 2.8
DOOR_M, DOOR_TOP_M = 0.92, 2.05


def office(rooms: int, lamps: int = 1, windows: int = 2) -> dict[str, Any]:
    """Return a map document: `rooms` rooms of about 20 m2, twenty to a corridor, the corridors joined at one end.

    Each room has skirtings, ceiling and corner edges, a door with linings on both faces, windows with sashes, and
    lamps: about 85 segments with the defaults.
    """
    segments: list[dict[str, Any]] = []
    lintels: list[dict[str, Any]] = []
    boxes: list[tuple[float, float, float, float]] = []
    per_corridor, deep = 20, 5.0
    corridors = -(-rooms // per_corridor)
    pitch = 2.0 * deep + 2.0 + 3.0 * WALL_M
    for corridor in range(corridors):
        here = min(per_corridor, rooms - corridor * per_corridor)
        y0 = corridor * pitch
        width = 4.0
        length = (here + 1) // 2 * (width + WALL_M)
        boxes.append((0.0, y0, length, y0 + 2.0))
        _box(segments, f"corridor{corridor}", (0.0, y0, length, y0 + 2.0))
        for number in range(here):
            column, north = number // 2, number % 2 == 0
            # Rooms differ a little, as rooms do.
            size = width - 0.05 * ((number * 7 + corridor) % 5)
            x0 = column * (width + WALL_M)
            low = y0 + 2.0 + WALL_M if north else y0 - WALL_M - deep
            box = (x0, low, x0 + size, low + deep)
            name = f"room{corridor}_{number}"
            boxes.append(box)
            _box(segments, name, box)
            door = x0 + 0.6 + 0.3 * ((number * 3) % 5)
            inner, outer = (low, y0 + 2.0) if north else (low + deep, y0)
            boxes.append((door, min(inner, outer), door + DOOR_M, max(inner, outer)))
            for side, y in (("in", inner), ("out", outer)):
                _frame(
                    segments, f"{name}/door_{side}", "door", (door, y), (door + DOOR_M, y), 0.0, DOOR_TOP_M
                )
                _frame(
                    segments,
                    f"{name}/lining_{side}",
                    "door",
                    (door - 0.07, y),
                    (door + DOOR_M + 0.07, y),
                    0.0,
                    2.12,
                )
                lintels.append(
                    {
                        "name": f"{name}/{side}",
                        "p0": [door, y],
                        "p1": [door + DOOR_M, y],
                        "bottom_m": DOOR_TOP_M,
                    }
                )
            wall = low + deep if north else low
            for window in range(windows):
                a = x0 + 0.3 + window * (size - 0.4) / windows
                b = a + (size - 0.4) / windows - 0.3
                _frame(
                    segments, f"{name}/window{window}", "window", (a, wall), (b, wall), 0.9, 2.2, closed=True
                )
                middle = 0.5 * (a + b)
                for part, (c, d) in enumerate(((a, middle), (middle, b))):
                    ends = (c + 0.05, wall), (d - 0.05, wall)
                    _frame(
                        segments,
                        f"{name}/window{window}/sash{part}",
                        "window",
                        *ends,
                        0.95,
                        2.15,
                        closed=True,
                    )
            for lamp in range(lamps):
                x, y = x0 + 0.5 * size - 0.3, low + 1.5 + 1.2 * lamp
                corners = [(x, y), (x + 0.6, y), (x + 0.6, y + 0.6), (x, y + 0.6)]
                for side in range(4):
                    p, q = corners[side], corners[(side + 1) % 4]
                    _line(segments, f"{name}/lamp{lamp}/{side}", "lamp", (*p, HEIGHT_M), (*q, HEIGHT_M))
    if corridors > 1:
        boxes.append((-2.0 - WALL_M, 0.0, -WALL_M, (corridors - 1) * pitch + 2.0))
        boxes += [(-WALL_M - 1e-3, k * pitch, 1e-3, k * pitch + 2.0) for k in range(corridors)]
    floor = [{"outer": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]} for x0, y0, x1, y1 in boxes]
    return {"units": "m", "segments": segments, "floor": floor, "lintels": lintels}


def _line(
    segments: list[dict[str, Any]], name: str, kind: str, p: tuple[float, ...], q: tuple[float, ...]
) -> None:
    segments.append(
        {"name": name, "kind": kind, "p0": [round(v, 4) for v in p], "p1": [round(v, 4) for v in q]}
    )


def _box(segments: list[dict[str, Any]], name: str, box: tuple[float, float, float, float]) -> None:
    x0, y0, x1, y1 = box
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for side in range(4):
        p, q = corners[side], corners[(side + 1) % 4]
        for kind, z in (("floor", 0.0), ("skirting", 0.09), ("ceiling", HEIGHT_M)):
            _line(segments, f"{name}/{kind}{side}", kind, (*p, z), (*q, z))
        _line(segments, f"{name}/corner{side}", "corner", (*p, 0.0), (*p, HEIGHT_M))


def _frame(
    segments: list[dict[str, Any]],
    name: str,
    kind: str,
    p: tuple[float, float],
    q: tuple[float, float],
    bottom: float,
    top: float,
    *,
    closed: bool = False,
) -> None:
    _line(segments, f"{name}/left", kind, (*p, bottom), (*p, top))
    _line(segments, f"{name}/right", kind, (*q, bottom), (*q, top))
    _line(segments, f"{name}/top", kind, (*p, top), (*q, top))
    if closed:
        _line(segments, f"{name}/bottom", kind, (*p, bottom), (*q, bottom))
