"""Torque factor of the table over time: readhesion paper Figs. 12 and 13."""

import matplotlib as mpl
from matplotlib.figure import Figure

from paper_figs.readhesion_cases import CASES, COLOURS, SECOND, case_runs, heading, over_time
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_paper.lanes import TableRuns

CLOSE = (9.0, 11.0)
"""Times [s] of the close view of case A."""


def figure(source: Source) -> Figure:
    """The figure, from runs of both cases (they take a second)."""
    return draw(case_runs())


def draw(runs: TableRuns) -> Figure:
    """Rows: case A, two seconds of it, case B; the factor, and the filtered command as a share of the plan."""
    drawn = new_figure(5.6, 5.6)
    rows = (("A", 0, None), ("A", 0, CLOSE), ("B", 1, None))
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(3, 1, sharey=True)
        for axes, (name, lane, close), letter in zip(panels, rows, "abc", strict=True):
            axes.plot(
                runs.time, runs.factor[:, lane], color=COLOURS[name], linewidth=1.0,
                label="torque factor of the table",
            )  # fmt: skip
            axes.plot(
                runs.time, runs.command[:, lane] / runs.plan, "--", color=SECOND, linewidth=1.0,
                label="torque command after its filter, over the plan",
            )  # fmt: skip
            over_time(axes, *(close or ()))
            part = f", {close[0]:g} to {close[1]:g} s" if close else ""
            axes.set(
                ylim=(-0.05, 1.3), yticks=(0.0, 0.5, 1.0), ylabel="factor [–]", xlabel="time [s]"
            )
            axes.set_title(f"({letter}) {heading(name, CASES[name])}{part}")
        panels[0].legend(loc="upper right", ncols=2)
    return drawn
