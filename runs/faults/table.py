"""What faults did to many runs: a row a kind, and which runs fell short of what must hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from runs.experiments.output import Grid
from runs.faults.kinds import FAULTS, WRONG_MAP
from runs.sweep import NONE, Row

#: Observable frames from a fault's end on until the pose is right again; frames on a wrong map until LOST.
RECOVERED_WITHIN, LOST_WITHIN = 5, 10
#: Maps that are a little wrong may cost this factor in the filtered RMSE.
WORSE = 2.0
SLIGHT = ("map-missing", "map-extra", "map-moved")
_HEADER = (
    "fault", "runs", "RMSE m", "to none", "worst", "max m", "TRACKING, UNCERTAIN, LOST", "wrong s", "unawares s",
    f"recovered ≤ {RECOVERED_WITHIN}", "slowest", "LOST after", "astray", "wrong fixes", "accepted",
)  # fmt: skip
_REMARK = (
    "Filtered pose. RMSE m: median of the runs. To none: over the same run without a fault, median and worst. "
    "Wrong s: longest time TRACKING with the pose over 0.5 m or 10° off; unawares: what is left of it once the pose "
    "has been wrong for three observable frames. Recovered: runs TRACKING within 0.30 m and 5° after so many "
    "observable frames of the fault's end; untold: runs left out, which had fewer than that many of them, and were "
    "right after none. Slowest: most such frames. LOST after: frames until the first LOST, fewest to most, and how "
    "many runs were lost; astray: how many of these frames came after the last right fix. Wrong fixes and those "
    "accepted: sums."
)


def fault_table(rows: Sequence[Row]) -> Grid:
    """Return a row a kind of fault over all sessions, configurations and seeds of a sweep."""
    base, kinds = _undisturbed(rows), dict.fromkeys(str(row["fault"]) for row in rows)
    groups = {kind: [row for row in rows if row["fault"] == kind] for kind in kinds}
    return Grid(
        "Faults",
        _HEADER,
        tuple((kind, *_cells(kind, group, base)) for kind, group in groups.items()),
        _REMARK,
    )


def shortfalls(rows: Sequence[Row]) -> list[str]:
    """Return a line for each run, or kind, that falls short of what must hold under faults.

    No run fails. But for a wrong map no pose is called right once it has been wrong for three observable frames,
    and it is right again within five of the fault's end, if so many were left. On a wrong map the robot is LOST
    within ten frames. Maps that are a little wrong at most double the filtered RMSE, on the median.
    """
    lines = [f"{_name(row)}: {what}" for row in rows for what in _short(row)]
    base = _undisturbed(rows)
    for kind in SLIGHT:
        ratios = _ratios([row for row in rows if row["fault"] == kind], base)
        if ratios and np.median(ratios) > WORSE:
            lines.append(f"{kind}: {np.median(ratios):.1f} times the undisturbed RMSE, on the median")
    return lines


def untold(row: Row) -> bool:
    """Tell whether a run cannot say how soon a pose is right again: it was not, and had too few frames for it."""
    if row["status"] == "failed" or isinstance(row.get("recovered_after"), int):
        return False
    looks = row.get("looks_after")
    return not (isinstance(looks, int) and looks >= RECOVERED_WITHIN)


def _short(row: Row) -> Iterable[str]:
    kind = str(row["fault"])
    if row["status"] == "failed":
        yield f"failed: {row['error']}"
        return
    if kind.startswith(WRONG_MAP):
        lost = row.get("lost_after")
        if not isinstance(lost, int) or lost > LOST_WITHIN:
            yield f"on a wrong map LOST after {_told(lost)} frames"
        return
    unawares_s = row.get("wrong_settled_s")
    if isinstance(unawares_s, float) and unawares_s > 0.0:
        yield f"wrong and TRACKING for {unawares_s:.1f} s after three observable frames"
    recovered = row.get("recovered_after")
    soon = isinstance(recovered, int) and recovered <= RECOVERED_WITHIN
    if _ends(kind) and not soon and not untold(row):
        yield f"right again after {_told(recovered)} observable frames"


def _cells(kind: str, group: Sequence[Row], base: dict[tuple[object, ...], float]) -> tuple[str, ...]:
    ratios = _ratios(group, base)
    lost = [count for row in group if isinstance(count := row.get("lost_after"), int)]
    astray = [count for row in group if isinstance(count := row.get("astray"), int)]
    recovered, slowest = _recoveries(group) if _ends(kind) else ("-", "-")
    return (
        str(len(group)),
        _figure(np.median, _values(group, "filtered_rmse_m"), 3),
        _figure(np.median, ratios, 1),
        _figure(max, ratios, 1),
        _figure(max, _values(group, "filtered_max_m"), 2),
        _states(group),
        _figure(max, _values(group, "tracking_wrong_s"), 1),
        _figure(max, _values(group, "wrong_settled_s"), 1),
        recovered,
        slowest,
        f"{min(lost)} to {max(lost)}, {len(lost)}" if lost else "-",
        f"{min(astray)} to {max(astray)}" if astray else "-",
        _figure(sum, _values(group, "wrong"), 0),
        _figure(sum, _values(group, "wrong_accepted"), 0),
    )


def _recoveries(group: Sequence[Row]) -> tuple[str, str]:
    """Return how many runs were right again soon enough, of those that can tell, and how long the slowest took."""
    told = [row for row in group if not untold(row)]
    came = [count for row in told if isinstance(count := row.get("recovered_after"), int)]
    soon, left_out = sum(count <= RECOVERED_WITHIN for count in came), len(group) - len(told)
    recovered = f"{soon} of {len(told)}" + (f", {left_out} untold" if left_out else "")
    if len(came) < len(told):
        return recovered, "never"
    return recovered, str(max(came)) if came else "-"


def _states(group: Sequence[Row]) -> str:
    seconds = [sum(_values(group, f"{state}_s")) for state in ("tracking", "uncertain", "lost")]
    return ", ".join(f"{100.0 * part / max(sum(seconds), 1e-9):.0f} %" for part in seconds)


def _ends(kind: str) -> bool:
    """Whether a fault has an end to recover from."""
    return kind in FAULTS and FAULTS[kind].needs != "map" and math.isfinite(FAULTS[kind].lasts_s)


def _undisturbed(rows: Sequence[Row]) -> dict[tuple[object, ...], float]:
    """Return the filtered RMSE of the runs without a fault."""
    found = [(row, row.get("filtered_rmse_m")) for row in rows if row["fault"] == NONE]
    return {_run(row): rmse for row, rmse in found if isinstance(rmse, float)}


def _ratios(group: Sequence[Row], base: dict[tuple[object, ...], float]) -> list[float]:
    return [
        rmse / base[_run(row)]
        for row in group
        if isinstance(rmse := row.get("filtered_rmse_m"), float) and base.get(_run(row), 0.0) > 0.0
    ]


def _run(row: Row) -> tuple[object, ...]:
    return row["session"], row["config"], row["seed"]


def _name(row: Row) -> str:
    return f"{row['session']}, {row['config']}, seed {row['seed']}, {row['fault']}"


def _told(count: object) -> str:
    return str(count) if isinstance(count, int) else "no number of"


def _values(group: Sequence[Row], name: str) -> list[float]:
    return [float(value) for row in group if isinstance(value := row.get(name), int | float)]


def _figure(of: object, values: Sequence[float], digits: int) -> str:
    assert callable(of)
    return f"{of(values):.{digits}f}" if values else "-"
