"""A comparison's own figure: how the innovations of fixes are distributed."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2

from runs.folder import RunFolder
from runs.palette import FILTERED, REJECTED
from runs.plots import INK, STYLE, blank_figure

#: Larger innovations share the last bin.
NIS_SHOWN = 25.0


@matplotlib.rc_context(STYLE)
def innovations(runs: Sequence[RunFolder]) -> Figure:
    """Draw how the fixes' innovations (NIS) are distributed, against what they should be: chi-square of 3.

    Fixes that measure less than a whole pose have fewer degrees of freedom, and are left out.
    """
    figure = blank_figure(2.2 * len(runs) + 0.8)
    panels = figure.subplots(len(runs), 1, sharex=True, squeeze=False)[:, 0]
    edges = np.linspace(0.0, NIS_SHOWN, 26)
    middles = 0.5 * (edges[1:] + edges[:-1])
    for axes, run in zip(panels, runs, strict=True):
        whole = [step for step in run.steps if step["nis"] and step["fix_phi_rad"]]
        for name, colour, taken in (("fused", FILTERED, True), ("refused", REJECTED, False)):
            values = [float(step["nis"]) for step in whole if (step["verdict"] != "REJECTED") == taken]
            axes.hist(np.minimum(values, NIS_SHOWN - 0.01), edges, color=colour, alpha=0.7, label=name)
        expected = len(whole) * np.diff(chi2.cdf(edges, 3))
        axes.plot(middles, expected, color=INK, linewidth=1.2, label="chi-square of 3")
        axes.set_ylabel("fixes")
        if len(runs) > 1:
            axes.set_title(run.name, fontsize=10.0)
    panels[-1].set_xlabel("innovation (NIS), the last bin with all above")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure
