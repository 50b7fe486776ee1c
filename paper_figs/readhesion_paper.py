"""Runs of the readhesion paper's torque table: its Figs. 5, 7 to 15, 22 and 23."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.onboard.controllers.torque_table import torque_factor
from alloc.plant.sets.one_axle import PATCH_FADE
from paper_figs.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made
from paper_figs.style import legend_below, new_panels
from studies.readhesion_paper.findings import HALF_SLIP_LIMIT, HALF_SLIP_WIDTHS
from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    CASE_B,
    DROP,
    RECOVERY,
    RIVAL,
    Case,
    Unprinted,
    run_cases,
)

CASES: dict[str, Case] = {"A": CASE_A, "B": CASE_B}
COLOURS = {"A": BLUE, "B": VERMILION}
"""Colour of each case in every figure."""
HALF_SLIP = Case(width=HALF_SLIP_WIDTHS[-1], limit=HALF_SLIP_LIMIT)
SETS: dict[str, tuple[Unprinted, str]] = {
    "calibrated": (CALIBRATED, GREEN),
    "rival": (RIVAL, PURPLE),
}
"""Sets of what is not printed, by name, and their colours."""
FROM, UNTIL = 5.0, 15.0
"""Times [s] that the paper's figures show."""
CLOSE = (9.0, 11.0)
"""Times [s] of the close view of case A."""
PEAK_SLIP = 0.3
"""Largest slip velocity [m/s] of the panels that show the peak."""
LAST = 2.0
"""Time [s] before the recovery in which the loci are drawn heavily: the limit cycle, if there is one."""
FORCE = "tangential force coefficient"


@lru_cache(maxsize=4)
def case_runs(
    cases: tuple[Case, ...] = tuple(CASES.values()), unprinted: Unprinted = CALIBRATED
) -> TableRuns:
    """Runs of Table 2, the rail's recovery included; a lane per case."""
    return run_cases(unprinted, cases, recovers=True)


def on_coefficient_scale(runs: TableRuns, lane: int) -> np.ndarray:
    """Torque on the scale of the coefficient, (instants,): the tangential force it would hold at the wheel.

    By R_g/(W g r) M/(M + J/r2): of the motor's torque at the rim, the share that accelerates the wheelset itself at the
    train's acceleration is left out, so that torque and coefficient lie on each other as long as nothing slips.
    """
    return np.asarray(runs.torque[:, lane] / runs.torque_per_coefficient)


def _heading(letter: str, name: str) -> str:
    case = CASES[name]
    return (
        f"({letter}) case {name}: $a_w$ = {case.width:g}, $a_0$ = {case.margin:g} km/h/s, "
        rf"$\mu_\mathrm{{lim}}$ = {case.limit:g}"
    )


def _pair(
    axes: Axes, time: np.ndarray, values: Sequence[np.ndarray], labels: Sequence[str], colour: str,
    widths: tuple[float | None, float] = (None, 1.0), shown: tuple[float, float] = (FROM, UNTIL),
) -> None:  # fmt: skip
    """A quantity of a case and, dashed, what it is held against; shaded where the rail is low."""
    axes.plot(time, values[0], color=colour, linewidth=widths[0], label=labels[0])
    axes.plot(time, values[1], "--", color=BLACK, linewidth=widths[1], label=labels[1])
    axes.axvspan(DROP, RECOVERY, color="#000000", alpha=0.05, linewidth=0)
    axes.set_xlim(shown)


@figure("torque-table",
        "torque factor over the deviation of acceleration (readhesion paper Fig. 5)")  # fmt: skip
def torque_table() -> Figure:
    """The table of both cases, with margin and width of case B marked."""
    drawn, axes = new_panels(4.6, 2.9)
    deviation = np.linspace(-0.3, 1.6, 400)
    for (name, case), dashes in zip(CASES.items(), ("-", "--"), strict=True):
        factor = [torque_factor(value, case.margin, case.width) for value in deviation]
        label = f"case {name}: $a_0$ = {case.margin:g}, $a_w$ = {case.width:g} km/h/s"
        axes.plot(deviation, factor, dashes, color=COLOURS[name], label=label)
    arrow = {"arrowstyle": "<->", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    ends = (0.0, CASE_B.margin, CASE_B.margin + CASE_B.width)
    for begin, end, text in zip(ends, ends[1:], ("$a_0$", "$a_w$"), strict=False):
        place = (begin, -0.10), (end, -0.10)
        axes.annotate("", *place, annotation_clip=False, arrowprops=arrow)
        axes.text(0.5 * (begin + end), -0.10 + 0.02, text, ha="center", va="bottom")
    axes.set(xlim=(deviation[0], deviation[-1]), ylim=(-0.2, 1.1), ylabel="torque factor [–]")
    axes.set_xlabel("wheel acceleration less the commanded one [km/h/s]")
    axes.legend(loc="upper right")
    return drawn


@figure("readhesion-slip", "slip with and without readhesion (readhesion paper Figs. 7, 8, 9)",
        made(case_runs))  # fmt: skip
def readhesion_slip(runs: TableRuns) -> Figure:
    """Rows: case A, case B on the same scale, case B as a whole."""
    drawn, panels = new_panels(5.6, 5.6, 3, sharex=True)
    rows = (("A", 0, PEAK_SLIP), ("B", 1, PEAK_SLIP), ("B", 1, None))
    labels = ("slip velocity", "at the curve's peak: micro slip below, macro above")
    for axes, (name, lane, top), letter in zip(panels, rows, "abc", strict=True):
        values = runs.slip[:, lane], runs.peak_slip[:, lane]
        _pair(axes, runs.time, values, labels, COLOURS[name], (None, 0.9))
        axes.set(ylim=(0.0, top), ylabel="slip velocity [m/s]")
        axes.set_title(_heading(letter, name) + ("" if top else ", whole"))
    panels[0].legend(loc="upper right", ncols=2)
    panels[-1].set_xlabel("time [s]")
    drawn.align_ylabels(panels.tolist())
    return drawn


@figure("readhesion-torque", "torque and coefficient with and without readhesion (readhesion paper Figs. 10, 11)",
        made(case_runs))  # fmt: skip
def readhesion_torque(runs: TableRuns) -> Figure:
    """A row per case. Scale: R_g/(W g r) M/(M + J/r2), so both lie on each other while nothing slips."""
    drawn, panels = new_panels(5.6, 4.4, 2, sharex=True, sharey=True)
    labels = (r"motor torque $\times\ R_g/(Wgr)\ M/(M + J/r^2)$", FORCE)
    for lane, (axes, name) in enumerate(zip(panels, CASES, strict=True)):
        values = on_coefficient_scale(runs, lane), runs.coefficient[:, lane]
        _pair(axes, runs.time, values, labels, COLOURS[name])
        axes.set(ylim=(0.08, 0.21), ylabel="coefficient [–]")
        axes.set_title(_heading("ab"[lane], name))
        axes.legend(loc="upper right", ncols=2)
    panels[-1].set_xlabel("time [s]")
    return drawn


@figure("readhesion-factor", "torque factor with and without readhesion (readhesion paper Figs. 12, 13)",
        made(case_runs))  # fmt: skip
def readhesion_factor(runs: TableRuns) -> Figure:
    """Rows: case A, two seconds of it, case B; the factor, and the filtered command as a share of the plan."""
    drawn, panels = new_panels(5.6, 5.6, 3, sharey=True)
    close = f", {CLOSE[0]:g} to {CLOSE[1]:g} s"
    rows = (("A", 0, (FROM, UNTIL), ""), ("A", 0, CLOSE, close), ("B", 1, (FROM, UNTIL), ""))
    labels = ("torque factor of the table", "torque command after its filter, over the plan")
    for axes, (name, lane, shown, part), letter in zip(panels, rows, "abc", strict=True):
        values = runs.factor[:, lane], runs.command[:, lane] / runs.plan
        _pair(axes, runs.time, values, labels, COLOURS[name], (1.0, 1.0), shown)
        axes.set(ylim=(-0.05, 1.3), yticks=(0.0, 0.5, 1.0), ylabel="factor [–]", xlabel="time [s]")
        axes.set_title(_heading(letter, name) + part)
    panels[0].legend(loc="upper right", ncols=2)
    return drawn


@figure("readhesion-trajectory", "torque and coefficient over slip: limit cycle or none (readhesion paper Figs. 14, 15)",
        made(case_runs))  # fmt: skip
def readhesion_trajectory(runs: TableRuns) -> Figure:
    """A column per case, from the drop to the recovery. Torque on the scale of the coefficient, see readhesion-torque."""
    drawn, panels = new_panels(7.1, 3.6, 1, 2, sharey=True)
    for lane, (axes, name) in enumerate(zip(panels, CASES, strict=True)):
        _loci(axes, runs, lane, COLOURS[name])
        axes.set_title(_heading("ab"[lane], name), fontsize=7.5)
        axes.set(xlim=(0.0, None), xlabel="slip velocity [m/s]")
    panels[0].set_ylabel("coefficient [–]")
    legend_below(drawn, 3, panels[0])
    return drawn


def _loci(axes: Axes, runs: TableRuns, lane: int, colour: str) -> None:
    low = (runs.time >= DROP) & (runs.time < RECOVERY - PATCH_FADE)
    last = low & (runs.time >= RECOVERY - LAST)
    torque, slip = on_coefficient_scale(runs, lane), runs.slip[:, lane]
    axes.plot(slip[low], torque[low], color=colour, linewidth=0.7, alpha=0.7, label="motor torque")
    heavy = f"motor torque, last {LAST:g} s before the recovery"
    axes.plot(slip[last], torque[last], color=ORANGE, linewidth=1.8, label=heavy)
    settled = low & (runs.time >= DROP + PATCH_FADE)  # the curve, without the edge of the drop
    order = np.argsort(slip[settled])
    coefficient = runs.coefficient[settled, lane][order]
    axes.plot(slip[settled][order], coefficient, "--", color=BLACK, linewidth=1.0, label=FORCE)


@figure("half-slip", "slip and torque on a rail just below the plan (readhesion paper Figs. 22, 23)",
        *(made(case_runs, (HALF_SLIP,), unprinted) for unprinted, _ in SETS.values()))  # fmt: skip
def half_slip(*runs: TableRuns) -> Figure:
    """A column per set; rows: slip velocity, torque and coefficient.

    Under the calibrated set the wheel readheres as ever; under the rival in m/s2 it half-slips on, as the paper has it.
    """
    drawn, panels = new_panels(7.1, 4.2, 2, len(SETS), sharex=True, squeeze=False)
    case, units = HALF_SLIP, ("motor torque, as a coefficient", FORCE)
    for (slip, torque), one, letter, name in zip(panels.T, runs, "ab", SETS, strict=True):
        unprinted, colour = SETS[name]
        values, labels = (
            (one.slip[:, 0], one.peak_slip[:, 0]),
            ("slip velocity", "at the curve's peak"),
        )
        _pair(slip, one.time, values, labels, colour, (None, 0.9))
        values = on_coefficient_scale(one, 0), one.coefficient[:, 0]
        _pair(torque, one.time, values, units, colour, (None, 0.9))
        slip.set_title(
            f"({letter}) {name}, $a_w$ = {case.width:g}, $a_0$ = {case.margin:g} "
            rf"{unprinted.unit.replace('s2', 's²')}, $\mu_\mathrm{{lim}}$ = {case.limit:g}"
        )
        torque.set_xlabel("time [s]")
        slip.legend(loc="upper left")
        torque.legend(loc="upper left")
        slip.set_ylim(0.0, 1.35 * float(one.slip.max()))
        torque.set_ylim(0.08, 0.22)
    panels[0, 0].set_ylabel("slip velocity [m/s]")
    panels[1, 0].set_ylabel("coefficient [–]")
    drawn.align_ylabels(panels[:, 0].tolist())
    return drawn
