"""The report of a run: one self-contained page, from the run folder and pictures of its worst frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from maps.documents import read_text
from runs.folder import RunFolder, Step, read_run
from runs.page import STATISTICS, heading, headlines, note, number, page, picture, table, verbatim
from runs.palette import TRACKS
from runs.plots import cumulative, errors_over_time, plan, svg
from runs.runlog import ACCEPTED
from runs.worst import WorstFrame

#: More rows than this would bury what follows; steps.csv has them all.
MOST_DECISIONS = 200


def write_report(folder: Path, worst: Sequence[WorstFrame] = ()) -> None:
    """Write report.html into a run folder, with pictures of the frames that went worst.

    InputError where the folder is not a whole run.
    """
    run = read_run(folder)
    html = page(str(run.metrics.get("session", run.name)), _parts(run, worst))
    (folder / "report.html").write_text(html, encoding="utf-8")


def _parts(run: RunFolder, worst: Sequence[WorstFrame]) -> list[str]:
    against = "truth" if run.truth is not None else "the smoothed poses, for want of a truth"
    return [
        svg(plan([run])),
        headlines(_figures(run.metrics)),
        heading("Accuracy"),
        *_accuracy(run.metrics),
        note(_fixes(run.metrics["vision"])),
        *_worst(worst),
        heading(f"Errors against {against}"),
        svg(errors_over_time(run)),
        svg(cumulative([run])),
        heading("Looks without a fix that was used"),
        *_decisions(run.steps),
        heading("Time"),
        table(*_timing(run.metrics["timing_ms"])),
        heading("Configuration"),
        verbatim(read_text(run.path / "config.yaml")),
    ]


def _worst(frames: Sequence[WorstFrame]) -> list[str]:
    """Show the worst frames, with what the colours mean."""
    if not frames:
        return []
    key = (
        "Matched lines green to red by how far they lie from the map's edges, edges that were not found dashed in "
        "blue, lines that no edge claims grey."
    )
    pictures = [
        picture(frame.jpeg, f"{frame.stamp_ns / 1e9:.2f} s, {Path(frame.filename).name}: {frame.wrong}")
        for frame in frames
    ]
    return [
        heading(f"The worst {len(frames)} frames" if len(frames) > 1 else "The worst frame"),
        note(key),
        *pictures,
    ]


def _figures(metrics: dict[str, Any]) -> list[tuple[str, str]]:
    vision, filtered, smoothed = metrics["vision"], metrics["filtered"], metrics["smoothed"]
    availability = metrics["availability"]
    return [
        ("filtered, position RMSE", number(_error(filtered, "position_error_m", "rmse"), " m")),
        ("filtered, heading RMSE", number(_error(filtered, "heading_error_deg", "rmse"), "°", 2)),
        ("smoothed, position RMSE", number(_error(smoothed, "position_error_m", "rmse"), " m")),
        ("fixes accepted", f"{vision['accepted']} of {vision['attempted']}"),
        ("wrong fixes accepted", "-" if vision["wrong_accepted"] is None else str(vision["wrong_accepted"])),
        ("time localized", number(None if availability is None else 100.0 * availability, " %", 1)),
    ]


def _accuracy(metrics: dict[str, Any]) -> list[str]:
    return [
        table(
            [title, *STATISTICS.values()],
            [
                [label, *(number(_error(metrics[name], quantity, key), digits=digits) for key in STATISTICS)]
                for name, (_, label) in TRACKS.items()
                if metrics.get(name)
            ],
        )
        for title, quantity, digits in (
            ("position, m", "position_error_m", 3),
            ("heading, deg", "heading_error_deg", 2),
        )
    ]


def _error(track: dict[str, Any], quantity: str, statistic: str) -> float | None:
    return (track.get(quantity) or {}).get(statistic)


def _fixes(vision: dict[str, Any]) -> str:
    counts = [
        f"{vision['attempted']} looks: {vision['fixes']} fixes, {vision['partial']} partial, "
        f"{vision['ambiguous']} ambiguous, {sum(vision['no_fix'].values())} without a fix",
        f"{vision['accepted']} accepted, {vision['rejected']} rejected",
    ]
    if vision["wrong"] is not None:
        counts.append(f"{vision['wrong']} wrong, {vision['wrong_accepted']} of them accepted")
    return "; ".join(counts) + "."


def _decisions(steps: tuple[Step, ...]) -> list[str]:
    """List every look that did not move the belief, and why."""
    unused = [step for step in steps if step["verdict"] not in ACCEPTED]
    if not unused:
        return [note("Every look gave a fix, and every fix was accepted.")]
    reasons = Counter(step["reason"] or step["outcome"] for step in unused)
    summary = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())
    header = ["time, s", "outcome", "verdict", "reason", "matches", "NIS", "image"]
    rows = [
        [
            f"{float(step['timestamp_s']):.2f}",
            step["outcome"],
            step["verdict"],
            step["reason"] or "-",
            step["matches"] or "-",
            number(float(step["nis"]), digits=1) if step["nis"] else "-",
            Path(step["filename"]).name or "-",
        ]
        for step in unused[:MOST_DECISIONS]
    ]
    parts = [note(f"{len(unused)} of {len(steps)}: {summary}."), table(header, rows)]
    if len(unused) > MOST_DECISIONS:
        parts.append(note(f"The first {MOST_DECISIONS}; steps.csv has the others."))
    return parts


def _timing(timing_ms: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    rows = [
        [stage, number(spread["median"], digits=2), number(spread["p95"], digits=2)]
        for stage, spread in timing_ms.items()
    ]
    return ["milliseconds", "median", "95 %"], rows
