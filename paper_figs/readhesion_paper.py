"""Runs of the readhesion paper's torque table: its Figs. 5, 7 to 13, 22 and 23."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.onboard.controllers.simple import torque_factor
from paper_figs.palette import BLACK, BLUE, GREEN, PURPLE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made
from paper_figs.style import PAGE, legend_below, new_panels
from studies.readhesion_paper.findings import HALF_SLIP_LIMIT, HALF_SLIP_WIDTHS
from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    CASE_B,
    DROP,
    RECOVERY,
    RIVAL,
    UNITS,
    Case,
    Unprinted,
    run_cases,
)

CASES: dict[str, Case] = {"A": CASE_A, "B": CASE_B}
COLOURS = {"A": BLUE, "B": VERMILION}
"""Colour of each case in every figure."""
HALF_SLIP = Case(width=HALF_SLIP_WIDTHS[-1], limit=HALF_SLIP_LIMIT)
SETS: dict[str, Unprinted] = {"calibrated": CALIBRATED, "rival": RIVAL}
"""Sets of what is not printed, by name: in km/h/s and in m/s2."""
SET_COLOURS = {"calibrated": GREEN, "rival": PURPLE}
FROM, UNTIL = 5.0, 15.0
"""Times [s] that the paper's figures show."""
CLOSE = (9.0, 11.0)
"""Times [s] of the close view of case A."""
PEAK_SLIP = 0.3
"""Largest slip velocity [m/s] of the panels that show the peak."""
FORCE = "tangential force coefficient"


@lru_cache(maxsize=4)
def case_runs(
    cases: tuple[Case, ...] = tuple(CASES.values()), unprinted: Unprinted = CALIBRATED
) -> TableRuns:
    """Runs of Table 2, the rail's recovery included; a lane per case."""
    return run_cases(unprinted, cases, recovers=True)


IN_BOTH_UNITS = tuple(made(case_runs, tuple(CASES.values()), one) for one in SETS.values())
"""Need: runs of the paper's cases after the set of each unit."""


def on_coefficient_scale(runs: TableRuns, lane: int) -> np.ndarray:
    """Torque on the scale of the coefficient, (instants,): the tangential force it would hold at the wheel.

    By R_g/(W g r) M/(M + J/r2): of the motor's torque at the rim, the share that accelerates the wheelset itself at the
    train's acceleration is left out, so that torque and coefficient lie on each other as long as nothing slips.
    """
    return np.asarray(runs.torque[:, lane] / runs.torque_per_coefficient)


def _shown(unit: str) -> str:
    return unit.replace("s2", "s²")


def heading(name: str, unit: str) -> str:
    """Title of a case's panel, its parameters read in `unit`."""
    case = CASES[name]
    return rf"{name}: $a_w$ {case.width:g}, $a_0$ {case.margin:g} {_shown(unit)}, $\mu_\mathrm{{lim}}$ {case.limit:g}"


def _pair(
    axes: Axes, time: np.ndarray, values: Sequence[np.ndarray], labels: Sequence[str], colour: str,
    widths: tuple[float | None, float] = (None, 1.0), shown: tuple[float, float] = (FROM, UNTIL),
) -> None:  # fmt: skip
    """A quantity of a case and, dashed, what it is held against; shaded where the rail is low."""
    axes.plot(time, values[0], color=colour, linewidth=widths[0], label=labels[0])
    axes.plot(time, values[1], "--", color=BLACK, linewidth=widths[1], label=labels[1])
    axes.axvspan(DROP, RECOVERY, color="#000000", alpha=0.05, linewidth=0)
    axes.set_xlim(shown)


def by_set(
    draw: Callable[[TableRuns, Sequence[Axes], str], None],
    panels: np.ndarray,
    runs: Sequence[TableRuns],
) -> None:
    """A column per set; the paper names no unit of a_0 and a_w, so both stand side by side."""
    for column, one, name in zip(panels.T, runs, SETS, strict=True):
        draw(one, column, SETS[name].unit)
        column[-1].set_xlabel(column[-1].get_xlabel() or "time [s]")


@figure("torque-table",
        "torque factor over the deviation of acceleration (readhesion paper Fig. 5), in both units")  # fmt: skip
def torque_table() -> Figure:
    """The table of both cases, read in each unit, on one scale; margin and width of case B are marked."""
    drawn, panels = new_panels(PAGE, 2.7, 1, len(SETS), sharey=True)
    deviation = np.linspace(-0.3, 4.8, 600)
    for axes, letter, one in zip(panels, "ab", SETS.values(), strict=True):
        scale = 3.6 * UNITS[one.unit]  # km/h/s
        for (name, case), dashes in zip(CASES.items(), ("-", "--"), strict=True):
            margin, width = scale * case.margin, scale * case.width
            factor = [torque_factor(value, margin, width) for value in deviation]
            label = f"case {name}: $a_0$ = {case.margin:g}, $a_w$ = {case.width:g}"
            axes.plot(deviation, factor, dashes, color=COLOURS[name], label=label)
        arrow = {"arrowstyle": "<->", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
        ends = (0.0, scale * CASE_B.margin, scale * (CASE_B.margin + CASE_B.width))
        for begin, end, text in zip(ends, ends[1:], ("$a_0$", "$a_w$"), strict=False):
            place = (begin, -0.10), (end, -0.10)
            axes.annotate("", *place, annotation_clip=False, arrowprops=arrow)
            axes.text(0.5 * (begin + end), -0.08, text, ha="center", va="bottom")
        axes.set(xlim=(deviation[0], deviation[-1]), ylim=(-0.25, 1.1))
        axes.set_title(f"({letter}) $a_0$ and $a_w$ in {_shown(one.unit)}")
        axes.set_xlabel("deviation of acceleration [km/h/s]")
        axes.legend(loc="upper right")
    panels[0].set_ylabel("torque factor [–]")
    return drawn


@figure("readhesion-slip", "slip with and without readhesion (readhesion paper Figs. 7, 8, 9), in both units",
        *IN_BOTH_UNITS)  # fmt: skip
def readhesion_slip(*runs: TableRuns) -> Figure:
    """Rows: case A, case B on the same scale, case B as a whole; a column per unit."""
    drawn, panels = new_panels(PAGE, 5.6, 3, len(SETS), sharex=True, sharey="row")
    rows = (("A", 0, PEAK_SLIP), ("B", 1, PEAK_SLIP), ("B", 1, None))
    labels = ("slip velocity", "at the curve's peak: micro slip below, macro above")

    def draw(one: TableRuns, column: Sequence[Axes], unit: str) -> None:
        for axes, (name, lane, top) in zip(column, rows, strict=True):
            values = one.slip[:, lane], one.peak_slip[:, lane]
            _pair(axes, one.time, values, labels, COLOURS[name], (None, 0.9))
            axes.set_title(heading(name, unit) + ("" if top else ", whole"))

    by_set(draw, panels, runs)
    for axes, (_, _, top) in zip(panels[:, 0], rows, strict=True):
        axes.set(ylim=(0.0, top), ylabel="slip velocity [m/s]")
    legend_below(drawn, 2, panels[0, 0])
    drawn.align_ylabels(panels[:, 0].tolist())
    return drawn


@figure("readhesion-torque", "torque and coefficient with and without readhesion (readhesion paper Figs. 10, 11), by unit",
        *IN_BOTH_UNITS)  # fmt: skip
def readhesion_torque(*runs: TableRuns) -> Figure:
    """A row per case, a column per unit. Scale: R_g/(W g r) M/(M + J/r2), so the two lines coincide while nothing slips."""
    drawn, panels = new_panels(PAGE, 4.4, 2, len(SETS), sharex=True, sharey=True)
    labels = (r"motor torque $\times\ R_g/(Wgr)\ M/(M + J/r^2)$", FORCE)

    def draw(one: TableRuns, column: Sequence[Axes], unit: str) -> None:
        for lane, (axes, name) in enumerate(zip(column, CASES, strict=True)):
            values = on_coefficient_scale(one, lane), one.coefficient[:, lane]
            _pair(axes, one.time, values, labels, COLOURS[name])
            axes.set_title(heading(name, unit))

    by_set(draw, panels, runs)
    for axes in panels[:, 0]:
        axes.set(ylim=(0.04, 0.19), ylabel="coefficient [–]")
    legend_below(drawn, 2, panels[0, 0])
    return drawn


@figure("readhesion-factor", "torque factor with and without readhesion (readhesion paper Figs. 12, 13), in both units",
        *IN_BOTH_UNITS)  # fmt: skip
def readhesion_factor(*runs: TableRuns) -> Figure:
    """Rows: case A, two seconds of it, case B; a column per unit. The factor, and the filtered command over the plan."""
    drawn, panels = new_panels(PAGE, 5.6, 3, len(SETS), sharey=True)
    close = f", {CLOSE[0]:g} to {CLOSE[1]:g} s"
    rows = (("A", 0, (FROM, UNTIL), ""), ("A", 0, CLOSE, close), ("B", 1, (FROM, UNTIL), ""))
    labels = ("torque factor of the table", "torque command after its filter, over the plan")

    def draw(one: TableRuns, column: Sequence[Axes], unit: str) -> None:
        for axes, (name, lane, shown, part) in zip(column, rows, strict=True):
            values = one.factor[:, lane], one.command[:, lane] / one.plan
            _pair(axes, one.time, values, labels, COLOURS[name], (1.0, 1.0), shown)
            axes.set_title(heading(name, unit) + part)

    by_set(draw, panels, runs)
    for axes in panels[:, 0]:
        axes.set(ylim=(-0.05, 1.1), yticks=(0.0, 0.5, 1.0), ylabel="factor [–]")
    legend_below(drawn, 2, panels[0, 0])
    return drawn


@figure("half-slip", "slip and torque on a rail just below the plan (readhesion paper Figs. 22, 23)",
        *(made(case_runs, (HALF_SLIP,), unprinted) for unprinted in SETS.values()))  # fmt: skip
def half_slip(*runs: TableRuns) -> Figure:
    """A column per set; rows: slip velocity, torque and coefficient.

    Under the calibrated set the wheel readheres. Under the rival in m/s2 it keeps slipping by half, as in the paper.
    """
    drawn, panels = new_panels(PAGE, 4.2, 2, len(SETS), sharex=True, squeeze=False)
    case, units = HALF_SLIP, ("motor torque, as a coefficient", FORCE)
    for (slip, torque), one, letter, name in zip(panels.T, runs, "ab", SETS, strict=True):
        unprinted, colour = SETS[name], SET_COLOURS[name]
        values, labels = (
            (one.slip[:, 0], one.peak_slip[:, 0]),
            ("slip velocity", "at the curve's peak"),
        )
        _pair(slip, one.time, values, labels, colour, (None, 0.9))
        values = on_coefficient_scale(one, 0), one.coefficient[:, 0]
        _pair(torque, one.time, values, units, colour, (None, 0.9))
        slip.set_title(
            f"({letter}) {name}, $a_w$ = {case.width:g}, $a_0$ = {case.margin:g} "
            rf"{_shown(unprinted.unit)}, $\mu_\mathrm{{lim}}$ = {case.limit:g}"
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
