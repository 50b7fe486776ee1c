"""Averaged brake force of the wagons over the number of them that are braked: RTRI report, Fig. 6."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.brake_panels import THEORY, WAGONS
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.brake_force import study as brake_force
from studies.brake_force.findings import row_of_test
from studies.brake_force.running_tests import run_test
from studies.brake_force.statements import CUT_OUT
from studies.core.collection import sweep_folder

FEW_EVENTS = 3
"""Days that are run for the figure where the results hold none."""


def figure(source: Source) -> Figure:
    """The figure, from what the results hold of the sweep `brake-force`, or from a few days' tests with wagons cut out."""
    folder = sweep_folder(source.store.folder, "brake-force")
    days = brake_force.stored(folder)
    if days:
        return draw(brake_force.run(folder, days, 0, source.jobs, source.on_row))
    rows = [
        row_of_test(name, run_test(name, k)) | {"event": k}
        for k in range(FEW_EVENTS)
        for name in CUT_OUT
    ]
    return draw(pd.DataFrame(rows))


def draw(table: pd.DataFrame) -> Figure:
    """Each day's averages with their uncertainty, mean over days, and the line through the means."""
    chosen = table[table["test"].isin(list(CUT_OUT))]
    count = chosen["test"].map(CUT_OUT).astype(float)
    mean, deviation = chosen["mean"].astype(float), chosen["whole_deviation"].astype(float)
    of_day = chosen["event"].rank(method="dense").astype(float)
    aside = 0.3 * (of_day - (of_day.max() + 1.0) / 2.0) / max(float(of_day.max()) - 1.0, 1.0)
    means = mean.groupby(count).mean()
    slope, intercept = np.polyfit(means.index.to_numpy(dtype=float), means.to_numpy(), 1)
    drawn = new_figure(4.2, 3.4)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots()
        axes.errorbar(
            count + aside, mean, 1.96 * deviation, fmt="o", color=WAGONS, markersize=2.5,
            elinewidth=0.6, alpha=0.7, label="a day's test, 95 %",
        )  # fmt: skip
        ends = np.array([0.0, 5.4])
        axes.plot(
            ends, slope * ends + intercept, color=THEORY, linewidth=0.9,
            label=f"line through the means: {slope:.1f} kN per wagon",
        )  # fmt: skip
        axes.plot(
            means.index, means, "D", color=THEORY, markersize=5, markerfacecolor="none",
            zorder=4, label="mean over days",
        )  # fmt: skip
        axes.set(xlim=(0.0, 5.4), ylim=(0.0, None), xticks=(0, 1, 2, 2.5, 3, 4, 5))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("braked wagons [–]")
        axes.set_ylabel("averaged brake force of all wagons [kN]")
        axes.legend(loc="upper left")
    return drawn
