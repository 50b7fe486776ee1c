"""A half-slip just below the plan: readhesion paper Figs. 22 and 23."""

from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.figure import Figure

from paper_figs.readhesion_cases import (
    SECOND,
    case_runs,
    last_label,
    on_coefficient_scale,
    over_time,
)
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_paper.findings import HALF_SLIP_LIMIT, HALF_SLIP_WIDTHS
from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.paper import CALIBRATED, RIVAL, Case, Unprinted

CASE = Case(width=HALF_SLIP_WIDTHS[-1], limit=HALF_SLIP_LIMIT)
SETS: dict[str, Unprinted] = {"calibrated": CALIBRATED, "rival": RIVAL}
"""Sets of what is not printed, by name."""
COLOURS = {"calibrated": "#009e73", "rival": "#7b3294"}


def figure(source: Source) -> Figure:
    """The figure, from a run under each set (they take a second)."""
    return draw([case_runs((CASE,), unprinted) for unprinted in SETS.values()])


def draw(runs: Sequence[TableRuns]) -> Figure:
    """A column per set; rows: slip velocity, torque and coefficient.

    Under the calibrated set the wheel readheres as ever; under the rival in m/s2 it half-slips on, as the paper has it.
    """
    drawn = new_figure(7.1, 4.2)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(2, len(SETS), sharex=True, squeeze=False)
        for column, (one, (name, unprinted)) in enumerate(zip(runs, SETS.items(), strict=True)):
            slip, torque = panels[:, column]
            slip.plot(one.time, one.slip[:, 0], color=COLOURS[name], label="slip velocity")
            slip.plot(
                one.time, one.peak_slip[:, 0], "--", color=SECOND, linewidth=0.9,
                label="at the curve's peak",
            )  # fmt: skip
            torque.plot(
                one.time, on_coefficient_scale(one, 0), color=COLOURS[name],
                label="motor torque, as a coefficient",
            )  # fmt: skip
            torque.plot(
                one.time, one.coefficient[:, 0], "--", color=SECOND, linewidth=0.9,
                label="tangential force coefficient",
            )  # fmt: skip
            unit = unprinted.unit.replace("s2", "s²")
            slip.set_title(
                f"({'ab'[column]}) {name}, $a_w$ = {CASE.width:g}, $a_0$ = {CASE.margin:g} {unit}, "
                rf"$\mu_\mathrm{{lim}}$ = {CASE.limit:g}"
            )
            over_time(slip)
            over_time(torque)
            last_label([torque])
            slip.legend(loc="upper left")
            torque.legend(loc="upper left")
            slip.set_ylim(0.0, 1.35 * float(one.slip.max()))
            torque.set_ylim(0.08, 0.22)
        panels[0, 0].set_ylabel("slip velocity [m/s]")
        panels[1, 0].set_ylabel("coefficient [–]")
        drawn.align_ylabels(panels[:, 0].tolist())
    return drawn
