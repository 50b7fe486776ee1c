"""Slip velocity over time where the wheel readheres and where it does not: readhesion paper Figs. 7, 8 and 9."""

import matplotlib as mpl
from matplotlib.figure import Figure

from paper_figs.readhesion_cases import (
    CASES,
    COLOURS,
    SECOND,
    case_runs,
    heading,
    last_label,
    over_time,
)
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_paper.lanes import TableRuns

CLOSE = 0.3
"""Largest slip velocity [m/s] of the panels that show the peak."""


def figure(source: Source) -> Figure:
    """The figure, from runs of both cases (they take a second)."""
    return draw(case_runs())


def draw(runs: TableRuns) -> Figure:
    """Rows: case A, case B on the same scale, case B as a whole."""
    drawn = new_figure(5.6, 5.6)
    rows = (("A", 0, CLOSE), ("B", 1, CLOSE), ("B", 1, None))
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(3, 1, sharex=True)
        for axes, (name, lane, top), letter in zip(panels, rows, "abc", strict=True):
            axes.plot(runs.time, runs.slip[:, lane], color=COLOURS[name], label="slip velocity")
            axes.plot(
                runs.time, runs.peak_slip[:, lane], "--", color=SECOND, linewidth=0.9,
                label="at the curve's peak: micro slip below, macro above",
            )  # fmt: skip
            over_time(axes)
            whole = "" if top else ", whole"
            axes.set(ylim=(0.0, top), ylabel="slip velocity [m/s]")
            axes.set_title(f"({letter}) {heading(name, CASES[name])}{whole}")
        panels[0].legend(loc="upper right", ncols=2)
        last_label(panels)
        drawn.align_ylabels(panels.tolist())
    return drawn
