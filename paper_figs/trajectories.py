"""Torque over slip in the readhesion paper's cases: the loop about the peak, and the run away from it."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.plant.adhesion import PiecewiseCurve
from paper_figs.direct_labels import label_lines
from paper_figs.palette import BLACK, DARK, ORANGE, VERMILION
from paper_figs.readhesion_paper import (
    CASES,
    COLOURS,
    IN_BOTH_UNITS,
    SETS,
    by_set,
    heading,
    on_coefficient_scale,
)
from paper_figs.registry import figure
from paper_figs.style import PAGE, Look, new_panels
from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.paper import DROP, PATCH_FADE, RECOVERY, Case

LAST = 2.0
"""Time [s] before the recovery in which the loci are drawn heavily: the limit cycle, if there is one."""
ARROWS = (0.06, 0.17, 0.3)
"""Shares of a trajectory's length at which an arrow shows its direction."""
ARROW_LENGTH = 4.0
"""[pixels]"""


@figure("readhesion-trajectory", "torque and coefficient over slip (readhesion paper Figs. 14, 15), in both units",
        *IN_BOTH_UNITS)  # fmt: skip
def readhesion_trajectory(*runs: TableRuns) -> Figure:
    """A row per case, a column per unit, from the drop to the recovery. Torque on the scale of the coefficient.

    The logarithmic scale shows the loop about the peak and the run away from it beside each other.
    """
    drawn, panels = new_panels(PAGE, 4.8, 2, len(SETS), sharex=True, sharey=True)

    slips = np.concatenate([one.slip[_low(one)].ravel() for one in runs])
    ends = 0.8 * float(slips[slips > 0.0].min()), 1.3 * float(slips.max())

    def draw(one: TableRuns, column: Sequence[Axes], unit: str) -> None:
        for lane, (axes, name) in enumerate(zip(column, CASES, strict=True)):
            _loci(axes, one, lane, COLOURS[name])
            _curve(axes, ends, CASES[name], unit)
            axes.set_title(heading(name, unit))
        column[-1].set_xlabel("slip velocity [m/s]")

    by_set(draw, panels, runs)
    panels[0, 0].set(xscale="log", xlim=ends)
    panels[0, 0].xaxis.set_major_formatter("{x:g}")
    low, high = panels[0, 0].get_ylim()
    panels[0, 0].set_ylim(low, high + 0.12 * (high - low))
    for axes in panels[:, 0]:
        axes.set_ylabel("coefficient [–]")
    for axes in panels.flat:
        _name_loci(axes)
    label_lines(*panels.flat)
    return drawn


def _low(runs: TableRuns) -> np.ndarray:
    """From the drop of the rail until it recovers, (instants,)."""
    return np.asarray((runs.time >= DROP) & (runs.time < RECOVERY - PATCH_FADE))


def _loci(axes: Axes, runs: TableRuns, lane: int, colour: str) -> None:
    low = _low(runs)
    last = low & (runs.time >= RECOVERY - LAST)
    torque, slip = on_coefficient_scale(runs, lane), runs.slip[:, lane]
    axes.plot(slip[low], torque[low], color=colour, linewidth=0.8, label="motor torque")
    axes.plot(slip[last], torque[last], color=ORANGE, linewidth=2.2, label=f"its last {LAST:g} s")
    axes.plot(slip[low][:1], torque[low][:1], "o", color=colour, markersize=4.0, label="_begin")


def _curve(axes: Axes, ends: tuple[float, float], case: Case, unit: str) -> None:
    """The rail's curve after the drop, the side of macro slip shaded."""
    unprinted = next(one for one in SETS.values() if one.unit == unit)
    curve, slip = PiecewiseCurve(residual_ratio=unprinted.residual_ratio), np.geomspace(*ends, 800)
    force = curve.coefficient(slip, case.limit)
    axes.plot(slip, force, "--", color=BLACK, linewidth=1.0, label="adhesion curve")
    axes.axvspan(
        float(curve.limit(case.limit)[1]), ends[1], color=VERMILION, alpha=0.07, linewidth=0.0
    )


def _name_loci(axes: Axes) -> None:
    """Where the run begins, which way it goes, on which side of the peak wheels slip, and what each line is."""
    torque = axes.get_lines()[0]
    path = np.column_stack(torque.get_data())
    begin = tuple(path[0])
    axes.annotate(
        "the rail drops", begin, (0.0, 4.0), textcoords="offset points", ha="center", va="bottom"
    )
    page = axes.transData.transform(path)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(page, axis=0).T))])
    for share in ARROWS:
        k = min(int(np.searchsorted(length, share * length[-1])), len(path) - 2)
        ahead = min(int(np.searchsorted(length, length[k] + ARROW_LENGTH)), len(path) - 1)
        look = {"arrowstyle": "-|>", "color": torque.get_color(), "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tuple(path[ahead]), tuple(path[k]), arrowprops=look)
    side: Look = {
        "xycoords": "axes fraction",
        "textcoords": "offset points",
        "va": "top",
        "color": DARK,
    }
    axes.annotate("macro slip", (1.0, 1.0), (-3.0, -2.0), ha="right", **side)
    axes.annotate("micro slip", (0.0, 1.0), (3.0, -2.0), ha="left", **side)
