"""The readhesion paper: runs of its torque table (Figs. 7 to 15, 22, 23), what it sweeps (16 to 21), and its limit cycle."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from paper_figs.drawing import Source, figure, made, study
from paper_figs.style import (
    BLACK,
    BLUE,
    DARK,
    GREEN,
    ORANGE,
    PAGE,
    PURPLE,
    VERMILION,
    Look,
    handle,
    legend_below,
    new_panels,
)
from studies.core.calibration import PERCENTILES
from studies.readhesion_paper import study as readhesion
from studies.readhesion_paper.findings import HALF_SLIP_LIMIT, HALF_SLIP_WIDTHS
from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.limit_cycle import critical_width
from studies.readhesion_paper.limit_cycle_comparison import (
    compare_cycles,
    growth_over_widths,
    paper_model,
)
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    CASE_B,
    DROP,
    PAPER_LIMITS,
    PATCH_FADE,
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
"""Sets of what is not printed, by name: in km/h/s and in m/s2. The paper names no unit of a_0 and a_w, so both are drawn."""
SET_COLOURS = {"calibrated": GREEN, "rival": PURPLE}
FROM, UNTIL = 5.0, 15.0
"""Times [s] that the paper's figures show."""
CLOSE = (9.0, 11.0)
"""Times [s] of the close view of case A."""
PEAK_SLIP = 0.3
"""Largest slip velocity [m/s] of the panels that show the peak."""
SYMBOLS = {"margin": "a_0", "width": "a_w"}
FORCE = "tangential force coefficient"
LIMIT = r"$\mu_\mathrm{lim}$ [–]"


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
    shown: tuple[float, float] = (FROM, UNTIL),
) -> None:  # fmt: skip
    """A quantity of a case and, dashed, what it is held against; shaded where the rail is low."""
    axes.plot(time, values[0], color=colour, label=labels[0])
    axes.plot(time, values[1], "--", color=BLACK, linewidth=0.9, label=labels[1])
    axes.axvspan(DROP, RECOVERY, color="#000000", alpha=0.05, linewidth=0)
    axes.set_xlim(shown)


@figure("readhesion-slip", "slip with and without readhesion (readhesion paper Figs. 7, 8, 9), in both units",
        *IN_BOTH_UNITS)  # fmt: skip
def readhesion_slip(*runs: TableRuns) -> Figure:
    """Rows: case A, case B on the same scale, case B as a whole; a column per unit."""
    drawn, panels = new_panels(PAGE, 5.6, 3, len(SETS), sharex=True, sharey="row")
    rows = (("A", 0, PEAK_SLIP), ("B", 1, PEAK_SLIP), ("B", 1, None))
    labels = ("slip velocity", "at the curve's peak: micro slip below, macro above")
    for column, one, unprinted in zip(panels.T, runs, SETS.values(), strict=True):
        for axes, (name, lane, top) in zip(column, rows, strict=True):
            values = one.slip[:, lane], one.peak_slip[:, lane]
            _pair(axes, one.time, values, labels, COLOURS[name])
            axes.set_title(heading(name, unprinted.unit) + ("" if top else ", whole"))
    for axes, (_, _, top) in zip(panels[:, 0], rows, strict=True):
        axes.set_ylim(0.0, top)
    return _finished(drawn, panels, "slip velocity [m/s]")


@figure("readhesion-torque", "torque and coefficient with and without readhesion (readhesion paper Figs. 10, 11), by unit",
        *IN_BOTH_UNITS)  # fmt: skip
def readhesion_torque(*runs: TableRuns) -> Figure:
    """A row per case, a column per unit. Scale: R_g/(W g r) M/(M + J/r2), so the two lines coincide while nothing slips."""
    drawn, panels = new_panels(PAGE, 4.4, 2, len(SETS), sharex=True, sharey=True)
    labels = (r"motor torque $\times\ R_g/(Wgr)\ M/(M + J/r^2)$", FORCE)
    for column, one, unprinted in zip(panels.T, runs, SETS.values(), strict=True):
        for lane, (axes, name) in enumerate(zip(column, CASES, strict=True)):
            values = on_coefficient_scale(one, lane), one.coefficient[:, lane]
            _pair(axes, one.time, values, labels, COLOURS[name])
            axes.set(title=heading(name, unprinted.unit), ylim=(0.04, 0.19))
    return _finished(drawn, panels, "coefficient [–]")


@figure("readhesion-factor", "torque factor with and without readhesion (readhesion paper Figs. 12, 13), in both units",
        *IN_BOTH_UNITS)  # fmt: skip
def readhesion_factor(*runs: TableRuns) -> Figure:
    """Rows: case A, two seconds of it, case B; a column per unit. The factor, and the filtered command over the plan."""
    drawn, panels = new_panels(PAGE, 5.6, 3, len(SETS), sharey=True)
    close = f", {CLOSE[0]:g} to {CLOSE[1]:g} s"
    rows = (("A", 0, (FROM, UNTIL), ""), ("A", 0, CLOSE, close), ("B", 1, (FROM, UNTIL), ""))
    labels = ("torque factor of the table", "torque command after its filter, over the plan")
    for column, one, unprinted in zip(panels.T, runs, SETS.values(), strict=True):
        for axes, (name, lane, shown, part) in zip(column, rows, strict=True):
            values = one.factor[:, lane], one.command[:, lane] / one.plan
            _pair(axes, one.time, values, labels, COLOURS[name], shown)
            axes.set_title(heading(name, unprinted.unit) + part)
    panels[0, 0].set(ylim=(-0.05, 1.1), yticks=(0.0, 0.5, 1.0))
    return _finished(drawn, panels, "factor [–]")


@figure("half-slip", "slip and torque on a rail just below the plan (readhesion paper Figs. 22, 23)",
        *(made(case_runs, (HALF_SLIP,), unprinted) for unprinted in SETS.values()))  # fmt: skip
def half_slip(*runs: TableRuns) -> Figure:
    """A column per set; rows: slip velocity, torque and coefficient.

    Under the calibrated set the wheel readheres. Under the rival in m/s2 it keeps slipping by half, as in the paper.
    """
    drawn, panels = new_panels(PAGE, 4.2, 2, len(SETS), sharex=True, squeeze=False)
    labels = ("slip velocity", "at the curve's peak"), ("motor torque, as a coefficient", FORCE)
    for column, one, letter, name in zip(panels.T, runs, "ab", SETS, strict=True):
        slips = one.slip[:, 0], one.peak_slip[:, 0]
        forces = on_coefficient_scale(one, 0), one.coefficient[:, 0]
        for axes, values, words in zip(column, (slips, forces), labels, strict=True):
            _pair(axes, one.time, values, words, SET_COLOURS[name])
            axes.legend(loc="upper left")
        column[0].set_ylim(0.0, 1.35 * float(one.slip.max()))
        column[0].set_title(
            f"({letter}) {name}, $a_w$ = {HALF_SLIP.width:g}, $a_0$ = {HALF_SLIP.margin:g} "
            rf"{_shown(SETS[name].unit)}, $\mu_\mathrm{{lim}}$ = {HALF_SLIP.limit:g}"
        )
        column[1].set(ylim=(0.08, 0.22), xlabel="time [s]")
    panels[0, 0].set_ylabel("slip velocity [m/s]")
    panels[1, 0].set_ylabel("coefficient [–]")
    drawn.align_ylabels(panels[:, 0].tolist())
    return drawn


def _finished(
    drawn: Figure,
    panels: np.ndarray,
    label: str,
    along: str = "time [s]",
    shown: Sequence[Line2D] = (),
) -> Figure:
    """Labels at the left of each row and below each column, and one legend [default: of the first panel]."""
    for axes in panels[:, 0]:
        axes.set_ylabel(label)
    for axes in panels[-1]:
        axes.set_xlabel(along)
    legend_below(drawn, shown or panels[0, 0])
    drawn.align_ylabels(panels[:, 0].tolist())
    return drawn


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
    drawn, panels = new_panels(PAGE, 5.0, 2, len(SETS), sharex=True, sharey=True)
    shown = [(one.time >= DROP) & (one.time < RECOVERY - PATCH_FADE) for one in runs]
    slips = np.concatenate([one.slip[low].ravel() for one, low in zip(runs, shown, strict=True)])
    ends = 0.8 * float(slips[slips > 0.0].min()), 1.3 * float(slips.max())
    for column, one, low, unprinted in zip(panels.T, runs, shown, SETS.values(), strict=True):
        for lane, (axes, name) in enumerate(zip(column, CASES, strict=True)):
            torque, slip = on_coefficient_scale(one, lane), one.slip[:, lane]
            last, colour = low & (one.time >= RECOVERY - LAST), COLOURS[name]
            axes.plot(slip[low], torque[low], color=colour, linewidth=0.8, label="motor torque")
            thick: Look = {"linewidth": 2.2, "label": f"its last {LAST:g} s"}
            axes.plot(slip[last], torque[last], color=ORANGE, **thick)
            begin: Look = {"color": colour, "markersize": 4.0, "label": "_begin"}
            axes.plot(slip[low][:1], torque[low][:1], "o", **begin)
            curve = unprinted.curve
            along, peak = np.geomspace(*ends, 800), CASES[name].limit
            force = curve.coefficient(along, peak)
            axes.plot(along, force, "--", color=BLACK, linewidth=1.0, label="adhesion curve")
            macro = float(curve.limit(peak)[1]), ends[1]
            axes.axvspan(*macro, color=VERMILION, alpha=0.07, linewidth=0.0)
            axes.set_title(heading(name, unprinted.unit))
    first = panels[0, 0]
    first.set(xscale="log", xlim=ends)
    first.xaxis.set_major_formatter("{x:g}")
    low, high = first.get_ylim()
    first.set_ylim(low, high + 0.12 * (high - low))
    named = [
        handle("motor torque", color=DARK, linewidth=0.8),
        handle(f"its last {LAST:g} s", color=ORANGE, linewidth=2.2),
        handle("adhesion curve", color=BLACK, linewidth=1.0, linestyle="--"),
    ]
    _finished(drawn, panels, "coefficient [–]", "slip velocity [m/s]", named)
    drawn.draw_without_rendering()  # arrows have a length on the page
    for axes in panels.flat:
        _name_loci(axes)
    return drawn


def _name_loci(axes: Axes) -> None:
    """Where the run begins, which way it goes, and on which side of the peak wheels slip."""
    torque = axes.get_lines()[0]
    path = np.column_stack(torque.get_data())
    above: Look = {"textcoords": "offset points", "ha": "center", "va": "bottom"}
    axes.annotate("the rail drops", tuple(path[0]), (0.0, 4.0), **above)
    page = axes.transData.transform(path)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(page, axis=0).T))])
    for share in ARROWS:
        k = min(int(np.searchsorted(length, share * length[-1])), len(path) - 2)
        ahead = min(int(np.searchsorted(length, length[k] + ARROW_LENGTH)), len(path) - 1)
        look = {"arrowstyle": "-|>", "color": torque.get_color(), "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tuple(path[ahead]), tuple(path[k]), arrowprops=look)
    for words, x, off, side in (
        ("macro slip", 1.0, -3.0, "right"),
        ("micro slip", 0.0, 3.0, "left"),
    ):
        axes.annotate(
            words, (x, 1.0), (off, -2.0), "axes fraction", "offset points", ha=side, va="top", color=DARK
        )  # fmt: skip


SHADES = mpl.colormaps["viridis"]
"""Dark to light in every kind of colour vision; from small to large values."""


@figure("margin-sweep", "readhesion and adhesion used over a_0 (readhesion paper Figs. 16, 17, 18), in both units",
        study("readhesion"))  # fmt: skip
def margin_sweep(table: pd.DataFrame) -> Figure:
    """A column per unit; filled points: readhesion is possible."""
    return _sweep(table, "margin", "width")


@figure("width-sweep", "readhesion and adhesion used over a_w (readhesion paper Figs. 19, 20, 21), in both units",
        study("readhesion"))  # fmt: skip
def width_sweep(table: pd.DataFrame) -> Figure:
    """A column per unit; filled points: readhesion is possible."""
    return _sweep(table, "width", "margin")


def _sweep(table: pd.DataFrame, over: str, other: str) -> Figure:
    """Rows of panels over "margin" (a_0) or "width" (a_w), the `other` as in case A; a column per unit of both."""
    held = getattr(CASE_A, other)
    table = table[np.isclose(table[other].astype(float), held)]
    members = table[table["unit"].notna()]
    in_use = table[table["unit"].isna() & (table["parabola"] == readhesion.PRINTED)]
    drawn, panels = new_panels(PAGE, 7.4, 3, len(SETS), sharex=True, sharey="row")
    for (possible, used, share), one, letters in zip(
        panels.T, SETS.values(), ("ace", "bdf"), strict=True
    ):
        own, unit = members[members["unit"] == one.unit], _shown(one.unit)
        rows = in_use if one is CALIBRATED else own[own["member"] == 0]
        _possibility(possible, rows, over)
        _limits_of_members(possible, own, over)
        _indices(used, share, rows[rows["part"] == "indices"], over)
        title = f"readhesion possibility, ${SYMBOLS[other]}$ = {held:g} {unit}"
        for axes, letter, words in zip(
            (possible, used, share),
            letters,
            (title, "used coefficient", "utilisation"),
            strict=True,
        ):
            axes.set_title(f"({letter}) {words}")
        share.set_xlabel(LIMIT)
        possible.set_ylabel(f"${SYMBOLS[over]}$ [{unit}]")
    panels[1, 0].set_ylabel(r"$\mu_\mathrm{use}$ [–]")
    panels[2, 0].set_ylabel(r"$\mu_\mathrm{r}$ [%]")
    lines = panels[1, 0].get_legend_handles_labels()[0]
    title = f"(c) to (f): ${SYMBOLS[over]}$, in the unit of each column"
    drawn.legend(handles=lines, loc="outside lower center", ncols=6, title=title)
    points = panels[0, 0].get_legend_handles_labels()[0]
    drawn.legend(handles=points, loc="outside upper center", ncols=4)
    return drawn


def _possibility(axes: Axes, rows: pd.DataFrame, over: str) -> None:
    """Circle: readhesion possible; cross: not. Bars: the limit adhesion coefficient."""
    runs, limits = rows[rows["part"] == "indices"], rows[rows["part"] == "limit"]
    good = runs["possible"].astype(bool)
    small: Look = {"markersize": 3.0, "markerfacecolor": "none", "markeredgewidth": 0.8}
    for own, marker, colour, label in (
        (runs[good], "o", BLUE, "possible"),
        (runs[~good], "x", VERMILION, "not possible"),
    ):
        axes.plot(own["limit"], own[over], marker, color=colour, label=label, **small)
    axes.plot(
        limits["limit_coefficient"], limits[over], "|", color="black", markersize=10,
        markeredgewidth=1.4, label="limit adhesion coefficient",
    )  # fmt: skip
    axes.set_ylim(runs[over].min() - 0.08, runs[over].max() + 0.08)


def _limits_of_members(axes: Axes, members: pd.DataFrame, over: str) -> None:
    """Between which limit coefficients 90 % of the ensemble's members lie, those that have one."""
    look: Look = {"color": "black", "alpha": 0.25, "linewidth": 5.0}
    for value, rows in members[members["part"] == "limit"].groupby(over):
        known = rows["limit_coefficient"].dropna().to_numpy(dtype=float)
        if known.size > 1:
            ends = np.percentile(known, PERCENTILES)
            axes.plot(ends, [float(str(value))] * 2, label="_", solid_capstyle="butt", **look)
    axes.plot([], [], label="90 % of the ensemble's limits", **look)


def _indices(used: Axes, share: Axes, runs: pd.DataFrame, over: str) -> None:
    """Used coefficient and utilisation, a line per value; points where readhesion is possible."""
    values = sorted(runs[over].unique())
    for k, value in enumerate(values):
        own = runs[np.isclose(runs[over].astype(float), value)].sort_values("limit")
        colour = SHADES(0.92 * k / max(len(values) - 1, 1))
        good = own["possible"].to_numpy(dtype=bool)
        for axes, y in ((used, own["used_coefficient"]), (share, 100.0 * own["utilisation"])):
            axes.plot(own["limit"], y, color=colour, linewidth=1.0, label=f"{value:g}")
            axes.plot(own["limit"][good], y[good], "o", color=colour, markersize=2.6)
    ends = [min(PAPER_LIMITS), max(PAPER_LIMITS)]
    used.plot(ends, ends, ":", color="black", linewidth=0.9, label="ideal")
    share.axhline(100.0, linestyle=":", color="black", linewidth=0.9)
    share.xaxis.set_major_locator(MultipleLocator(0.04))


RING: Look = {"linestyle": "none", "marker": "o", "markersize": 3.5, "markerfacecolor": "none"}
"""Mark of what was simulated."""


@figure("downhill", "torque that the torque table leaves on a dry downhill over a_0 (readhesion paper, section 4), by unit",
        study("readhesion"))  # fmt: skip
def downhill(table: pd.DataFrame) -> Figure:
    """A column per unit, a line per a_0: where the table comes to rest against gravity. Circles: runs; no wheel slips."""
    drawn, panels = new_panels(PAGE, 2.7, 1, len(SETS), sharey=True, squeeze=False)
    table = table[table["part"] == "downhill"]
    for axes, letter, one in zip(panels[0], "ab", SETS.values(), strict=True):
        rows = table[table["read_in"] == one.unit]
        values = sorted(rows["margin"].unique())
        for k, value in enumerate(values):
            own = rows[rows["margin"] == value].sort_values("gradient")
            colour = SHADES(0.92 * k / max(len(values) - 1, 1))
            width = 2.2 if value == CASE_A.margin else 1.0
            rest, kept = 100.0 * own["expected"], 100.0 * own["kept"]
            axes.plot(own["gradient"], rest, color=colour, linewidth=width, label=f"{value:g}")
            axes.plot(own["gradient"], kept, color=colour, label="_simulated", **RING)
        axes.set(
            title=f"({letter}) $a_0$, $a_w$ = {CASE_A.width:g} in {_shown(one.unit)}",
            xlabel="gradient [‰]",
        )
    panels[0, 0].set_ylabel("torque over that of the plan [%]")
    lines = panels[0, 0].get_legend_handles_labels()[0]
    title = "$a_0$, in the unit of each column; thick: that of cases A and B"
    drawn.legend(handles=lines, loc="outside lower center", ncols=10, title=title)
    return drawn


WIDTHS = (0.1, 0.3)
LIMITS = tuple(round(0.112 + 0.004 * k, 3) for k in range(12))
GROWTH_WIDTHS = tuple(round(0.15 + 0.05 * k, 2) for k in range(14))


def _cycles(source: Source) -> dict[str, pd.DataFrame]:
    """Need: cycles of the set of each unit."""
    return {one.unit: compare_cycles(WIDTHS, LIMITS, source.jobs, one) for one in SETS.values()}


@figure("limit-cycle", "limit cycle of the torque table, simulated and predicted; when wheels run away; in both units",
        _cycles)  # fmt: skip
def limit_cycle(
    cycles: Mapping[str, pd.DataFrame], growth_widths: tuple[float, ...] = GROWTH_WIDTHS
) -> Figure:
    """A row per unit: period and swing of slip over mu_lim, and growth of swings about the runaway equilibrium over a_w.

    Simulated cycles are drawn where the wheel readheres. Numbers: difference of the predictions from the simulations.
    """
    drawn, panels = new_panels(PAGE, 4.8, len(cycles), 3, squeeze=False)
    sets: dict[str, Unprinted] = {one.unit: one for one in SETS.values()}
    for row, letters, (unit, table) in zip(panels, ("abc", "def"), cycles.items(), strict=False):
        words = []
        for axes, quantity, name in zip(
            row, ("period", "slip_swing"), ("period", "swing"), strict=False
        ):
            words.append(f"{name}, {_cycle_panel(axes, table, quantity)}")
        row[0].set_ylabel("period [s]")
        row[1].set_ylabel("swing of slip velocity [m/s]")
        _growth_panel(row[2], growth_widths, sets[unit])
        for axes, letter, word in zip(row, letters, (*words, "growth of swings"), strict=True):
            axes.set_title(f"({letter}) {_shown(unit)}: {word}")
    kinds = [handle("predicted", color=DARK), handle("simulated", color=DARK, **RING)]
    legend_below(drawn, [*kinds, *panels[0, 0].get_legend_handles_labels()[0]])
    return drawn


def _cycle_panel(axes: Axes, cycles: pd.DataFrame, quantity: str) -> str:
    """Predicted and simulated, a colour per a_w; returns between which shares the predictions are off."""
    for colour, (width, rows) in zip((BLUE, VERMILION), cycles.groupby("width"), strict=True):
        back = rows[rows["possible"]]  # wheels that run away swing as well, elsewhere
        label, predicted = f"$a_w$ = {width:g}", rows[f"predicted_{quantity}"]
        axes.plot(rows["limit"], predicted, color=colour, label=label)
        axes.plot(back["limit"], back[quantity], color=colour, label="_simulated", **RING)
    axes.set_xlabel(LIMIT)
    axes.margins(y=0.12)
    back = cycles[cycles["possible"]]
    off = 100.0 * (back[f"predicted_{quantity}"] / back[quantity] - 1.0).dropna()
    words = f"predicted {off.min():+.0f} to {off.max():+.0f} %" if len(off) else "none simulated"
    return words.replace("-", "−")


def _growth_panel(growth: Axes, widths: Sequence[float], one: Unprinted) -> None:
    """Above 1 swings grow into a limit cycle, below they die out: the factor comes to rest."""
    sizes = growth_over_widths(widths, one)
    critical = critical_width(paper_model(unprinted=one)) / UNITS[one.unit]
    growth.plot(widths, sizes, ".-", color=GREEN)
    low, high = growth.get_ylim()
    growth.axhspan(1.0, max(high, 1.0), color=VERMILION, alpha=0.12, linewidth=0.0)
    growth.axhspan(min(low, 1.0), 1.0, color=BLUE, alpha=0.12, linewidth=0.0)
    growth.set_ylim(min(low, 0.9), max(high, 1.1))
    for words, at, off, side in (
        ("swings grow:\nlimit cycle", 1.0, -3.0, ("right", "top")),
        ("swings die out:\nthe factor rests", 0.0, 3.0, ("left", "baseline")),
    ):
        growth.annotate(
            words, (at, at), (off, off), "axes fraction", "offset points", ha=side[0], va=side[1]
        )
    if critical <= max(widths):
        growth.plot([critical], [1.0], "o", color=BLACK)
        place = (critical, 1.0), (4.0, 3.0)
        growth.annotate(f"at {critical:.2f}", *place, textcoords="offset points")
    growth.set(xlabel=f"$a_w$ [{_shown(one.unit)}]", ylabel="growth per swing [–]")
