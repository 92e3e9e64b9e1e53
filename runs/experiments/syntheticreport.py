"""The synthetic experiment's tables, table 3 beside the paper's among them, and its page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from runs.experiments.cases import CASES, Case
from runs.experiments.judging import Category
from runs.experiments.output import Drawing, Grid, Report, figure_text
from runs.experiments.published import TABLE_3, TABLE_3_IMAGES
from runs.experiments.recalls import STAGES
from runs.experiments.synthetic import Trial, summary
from runs.experiments.syntheticfigures import hypotheses, outcomes, position_errors, stage_times

_COLUMNS = (
    "image,method,case,category,strictly_wrong,truth_listed,error_x_m,error_y_m,error_phi_rad,"
    "bound_m2,nees,lines,viewed,matches,right,hypotheses,log10_most,exhausted,ms"
)


def synthetic_report(trials: Sequence[Trial], cases: Sequence[Case], images: int, seed: int) -> Report:
    """Lay out the trials of all images, methods and cases."""
    content = summary(trials, images, seed)
    methods = tuple(dict.fromkeys(trial.method for trial in trials))
    names = [case.name for case in cases]
    # The widest window that the paper tells of, or whatever comes first.
    shown = next((name for name in ("qi3", "qi2", "qi1") if name in names), names[0])
    title = CASES[shown].title
    drawings = (
        Drawing("outcomes", "What became of the images", outcomes(trials, methods, names)),
        Drawing(
            "hypotheses",
            f"Hypotheses kept (figure 11), {title}",
            hypotheses(trials, methods, shown),
            "Dashed: how many combinations of pairs there are before any is refused.",
        ),
        Drawing(
            "errors",
            f"Position errors, {title}",
            position_errors(trials, methods, shown),
            "Shares are of all images. Dashed: what the Cramér-Rao bound allows with all pairs right.",
        ),
        Drawing("times", f"Time by stage, {title}", stage_times(content["results"], shown)),
    )
    grids = (_table_3(content), _figures(content), *_recalls(content))
    return Report("synthetic", "Synthetic images", content, grids, drawings, _rows(trials))


def _table_3(content: dict[str, Any]) -> Grid:
    """Table 3 of every case, with the paper's rows where it has one."""
    rows: list[tuple[str, ...]] = []
    for name in dict.fromkeys(result["case"] for result in content["results"]):
        if name in TABLE_3:
            counts = (f"{count}" for count in TABLE_3[name])
            rows.append((CASES[name].title, f"the paper's, of {TABLE_3_IMAGES}", *counts, "-", "-"))
        rows += [
            (
                CASES[name].title,
                result["method"],
                *(str(result[category]) for category in Category),
                str(result["wrong_strict"]),
            )
            for result in content["results"]
            if result["case"] == name
        ]
    header = ("case", "method", "success", "false neg.", "cons. FP", "incons. FP", "ambiguous", "wrong")
    remark = (
        f"{content['images']} images, seed {content['seed']}. Success: all pairs right. Consistent: a wrong pair, "
        "but the pose within 0.30 m and 3° or inside the bound's 99.9 % ellipsoid. Wrong: fixes not within 0.30 m "
        "and 3°, whatever the bound. The paper's hall is not published: its figures are for orientation."
    )
    return Grid("Table 3", header, tuple(rows), remark)


def _figures(content: dict[str, Any]) -> Grid:
    rows = [
        (
            CASES[result["case"]].title,
            result["method"],
            *(figure_text(result["hypotheses"][key], 0) for key in ("median", "p90", "max")),
            str(result["exhausted"]),
            figure_text(result["position_rms_over_bound"]),
            figure_text(result["anees"]),
            *(figure_text(result["ms"][key], 1) for key in ("median", "p90")),
        )
        for result in content["results"]
    ]
    header = ("case", "method", "hypotheses", "90 %", "max", "cut", "RMS / bound", "ANEES", "ms", "90 %")
    remark = (
        "Cut: images whose enumeration ended at its budget. RMS over the Cramér-Rao bound and ANEES "
        "(1 is honest) are over successes and consistent false positives."
    )
    return Grid("Search, accuracy and time", header, tuple(rows), remark)


def _recalls(content: dict[str, Any]) -> tuple[Grid, ...]:
    """What the constraints keep of what is true, for methods that have such stages; no table without any."""
    results = [result for result in content["results"] if result["recalls"]]
    if not results:
        return ()
    rows = [
        (
            CASES[result["case"]].title,
            result["method"],
            *(
                text
                for stage in STAGES
                for text in (
                    figure_text(result["recalls"][stage]["share"], 3),
                    f"{result['recalls'][stage]['of']:,}",
                )
            ),
        )
        for result in results
    ]
    header = ("case", "method", *(text for stage in STAGES for text in (stage, "of")))
    told = "; ".join(f"{stage}: {meaning}" for stage, meaning in STAGES.items())
    remark = f"Shares of what is true that each stage keeps, of what the stages before left it. {told}."
    return (Grid("Recall by stage", header, tuple(rows), remark),)


def _rows(trials: Sequence[Trial]) -> tuple[tuple[object, ...], ...]:
    rows: list[tuple[object, ...]] = [tuple(_COLUMNS.split(","))]
    for trial in trials:
        has_fix = trial.nees == trial.nees
        error = [f"{value:.6f}" if has_fix else "" for value in trial.error]
        rows.append(
            (
                *(trial.image, trial.method, trial.case, trial.category.value),
                *(int(trial.strictly_wrong), int(trial.truth_listed), *error),
                f"{trial.bound_variance_m2:.6g}",
                f"{trial.nees:.4f}" if has_fix else "",
                *(trial.lines, trial.viewed, trial.matches, trial.right, trial.hypotheses),
                "" if trial.counts is None else f"{trial.counts.log10_most:.4f}",
                int(trial.exhausted),
                f"{trial.total_ms:.3f}",
            )
        )
    return tuple(rows)
