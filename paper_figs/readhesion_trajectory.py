"""Torque and coefficient over slip velocity: readhesion paper Figs. 14 and 15."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.plant.sets.one_axle import PATCH_FADE
from paper_figs.readhesion_cases import (
    CASES,
    COLOURS,
    SECOND,
    THIRD,
    case_runs,
    heading,
    on_coefficient_scale,
)
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.paper import DROP, RECOVERY

LAST = 2.0
"""Time [s] before the recovery in which the loci are drawn heavily: the limit cycle, if there is one."""


def figure(source: Source) -> Figure:
    """The figure, from runs of both cases (they take a second)."""
    return draw(case_runs())


def draw(runs: TableRuns) -> Figure:
    """A column per case, from the drop to the recovery. Torque on the scale of the coefficient, see readhesion-torque."""
    drawn = new_figure(7.1, 3.6)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(1, 2, sharey=True)
        for lane, (axes, (name, case)) in enumerate(zip(panels, CASES.items(), strict=True)):
            _loci(axes, runs, lane, COLOURS[name])
            axes.set_title(f"({'ab'[lane]}) {heading(name, case)}", fontsize=7.5)
            axes.set(xlim=(0.0, None), xlabel="slip velocity [m/s]")
        panels[0].set_ylabel("coefficient [–]")
        handles, labels = panels[0].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower center", ncols=3)
    return drawn


def _loci(axes: Axes, runs: TableRuns, lane: int, colour: str) -> None:
    low = (runs.time >= DROP) & (runs.time < RECOVERY - PATCH_FADE)
    last = low & (runs.time >= RECOVERY - LAST)
    torque, slip = on_coefficient_scale(runs, lane), runs.slip[:, lane]
    axes.plot(slip[low], torque[low], color=colour, linewidth=0.7, alpha=0.7, label="motor torque")
    axes.plot(
        slip[last], torque[last], color=THIRD, linewidth=1.8,
        label=f"motor torque, last {LAST:g} s before the recovery",
    )  # fmt: skip
    settled = low & (
        runs.time >= DROP + PATCH_FADE
    )  # the curve itself, without the edge of the drop
    order = np.argsort(slip[settled])
    axes.plot(
        slip[settled][order], runs.coefficient[settled, lane][order], "--", color=SECOND,
        linewidth=1.0, label="tangential force coefficient",
    )  # fmt: skip
