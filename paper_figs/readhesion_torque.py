"""Motor torque on the scale of the coefficient, and the coefficient: readhesion paper Figs. 10 and 11."""

import matplotlib as mpl
from matplotlib.figure import Figure

from paper_figs.readhesion_cases import (
    CASES,
    COLOURS,
    SECOND,
    case_runs,
    heading,
    last_label,
    on_coefficient_scale,
    over_time,
)
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_paper.lanes import TableRuns


def figure(source: Source) -> Figure:
    """The figure, from runs of both cases (they take a second)."""
    return draw(case_runs())


def draw(runs: TableRuns) -> Figure:
    """A row per case. Scale: R_g/(W g r) M/(M + J/r2), so both lie on each other while nothing slips."""
    drawn = new_figure(5.6, 4.4)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(2, 1, sharex=True, sharey=True)
        for lane, (axes, (name, case)) in enumerate(zip(panels, CASES.items(), strict=True)):
            axes.plot(
                runs.time, on_coefficient_scale(runs, lane), color=COLOURS[name],
                label=r"motor torque $\times\ R_g/(Wgr)\ M/(M + J/r^2)$",
            )  # fmt: skip
            axes.plot(
                runs.time, runs.coefficient[:, lane], "--", color=SECOND, linewidth=1.0,
                label="tangential force coefficient",
            )  # fmt: skip
            over_time(axes)
            axes.set(ylim=(0.08, 0.21), ylabel="coefficient [–]")
            axes.set_title(f"({'ab'[lane]}) {heading(name, case)}")
            axes.legend(loc="upper right", ncols=2)
        last_label(panels)
    return drawn
