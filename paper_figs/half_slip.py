"""A half-slip just below the plan: readhesion paper Figs. 22 and 23."""

import matplotlib as mpl
from matplotlib.figure import Figure

from alloc.table_lanes import TableRuns
from paper_figs.readhesion_cases import (
    SECOND,
    case_runs,
    last_label,
    on_coefficient_scale,
    over_time,
)
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_findings import HALF_SLIP_LIMIT, HALF_SLIP_WIDTHS
from studies.readhesion_paper import Case

CASES = tuple(Case(width=width, limit=HALF_SLIP_LIMIT) for width in HALF_SLIP_WIDTHS)
COLOUR = "#009e73"


def figure(source: Source) -> Figure:
    """The figure, from runs of its cases (they take a second)."""
    return draw(case_runs(CASES))


def draw(runs: TableRuns) -> Figure:
    """A column per a_w; rows: slip velocity, torque and coefficient."""
    drawn = new_figure(7.1, 4.2)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(2, len(CASES), sharex=True, sharey="row", squeeze=False)
        for lane, case in enumerate(CASES):
            slip, torque = panels[:, lane]
            slip.plot(runs.time, runs.slip[:, lane], color=COLOUR, label="slip velocity")
            slip.plot(
                runs.time, runs.peak_slip[:, lane], "--", color=SECOND, linewidth=0.9,
                label="at the curve's peak",
            )  # fmt: skip
            torque.plot(
                runs.time, on_coefficient_scale(runs, lane), color=COLOUR,
                label="motor torque, as a coefficient",
            )  # fmt: skip
            torque.plot(
                runs.time, runs.coefficient[:, lane], "--", color=SECOND, linewidth=0.9,
                label="tangential force coefficient",
            )  # fmt: skip
            slip.set_title(
                f"({'ab'[lane]}) $a_w$ = {case.width:g}, $a_0$ = {case.margin:g} km/h/s, "
                rf"$\mu_\mathrm{{lim}}$ = {case.limit:g}"
            )
            over_time(slip)
            over_time(torque)
            last_label([torque])
        panels[0, 0].set(ylim=(0.0, 1.35 * float(runs.slip.max())), ylabel="slip velocity [m/s]")
        panels[1, 0].set(ylim=(0.12, 0.2), ylabel="coefficient [–]")
        for axes in panels[:, 0]:
            axes.legend(loc="upper left")
        drawn.align_ylabels(panels[:, 0].tolist())
    return drawn
