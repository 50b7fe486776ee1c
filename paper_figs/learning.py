"""Error of the increments along the train against the stations at which the train has learnt."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import t as student

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.core.collection import sweep_folder
from studies.core.statement import CONFIDENCE
from studies.learning import study as learning
from studies.learning.series import SERIES, TOLERANCE

ARM_STYLES: dict[str, tuple[str, str]] = {
    "no learning": ("#7f7f7f", ":"),
    "running mean": ("#d55e00", "-"),
    "running mean, held": ("#e69f00", "--"),
    "Gaussian": ("#0072b2", "-"),
    "Gaussian, robust": ("#7b3294", "--"),
}
"""Colour and dashes of each arm."""


FEW_EVENTS = 12
"""Station starts that are run for the figure where the results hold none: six in each direction."""


def figure(source: Source) -> Figure:
    """The figure, from what the results hold of the sweep `learning`, at least `FEW_EVENTS`."""
    folder = sweep_folder(source.store.folder, "learning")
    events = max(FEW_EVENTS, learning.stored(folder))
    return draw(learning.run(folder, events, 0, source.jobs, source.on_row))


def draw(table: pd.DataFrame) -> Figure:
    """One panel per kind of rail and kind of stored values: largest error of any unit, mean of the trains."""
    drawn = new_figure(7.1, 4.8)
    rails, stored = list(table["rail"].unique()), list(table["stored"].unique())
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(len(rails), len(stored), sharex=True, sharey=True, squeeze=False)
        for row, rail in enumerate(rails):
            for column, kind in enumerate(stored):
                one = axes[row, column]
                chosen = table[(table["rail"] == rail) & (table["stored"] == kind)]
                for arm in ARM_STYLES:
                    _arm(one, chosen[chosen["arm"] == arm], arm)
                one.axhline(TOLERANCE, color="black", linewidth=0.9, linestyle=(0, (1, 2)))
                one.set_title(f"{rail} rail, stored values {kind}")
                one.set(xlim=(table["station"].min(), table["station"].max()), ylim=(0.0, None))
        for one in axes[-1]:
            one.set_xlabel("stations")
        for one in axes[:, 0]:
            one.set_ylabel("largest error of any unit [–]")
        axes[0, 0].text(
            0.99, TOLERANCE, f"{TOLERANCE:g}", transform=axes[0, 0].get_yaxis_transform(),
            ha="right", va="bottom", fontsize=7,
        )  # fmt: skip
        handles, labels = axes[0, 0].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return drawn


def _arm(axes: Axes, rows: pd.DataFrame, arm: str) -> None:
    series = rows.pivot(index="station", columns=SERIES, values="error")
    mean, n = series.mean(axis=1), series.shape[1]
    colour, dashes = ARM_STYLES[arm]
    axes.plot(series.index, mean, color=colour, linestyle=dashes, label=arm)
    if n > 1 and arm != "no learning":
        half = float(student.ppf(0.5 + 0.5 * CONFIDENCE, n - 1)) * series.std(axis=1) / np.sqrt(n)
        axes.fill_between(
            series.index, mean - half, mean + half, color=colour, alpha=0.15, linewidth=0
        )
