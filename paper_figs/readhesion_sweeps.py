"""What the readhesion paper sweeps and does not print: its Figs. 16 to 21, limit cycles, calibration."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MultipleLocator

from paper_figs.direct_labels import label_lines
from paper_figs.palette import BLACK, BLUE, DARK, GREEN, ORANGE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import Source, study
from paper_figs.style import PAGE, Look, handle, legend_below, new_panels, plain_ticks
from studies.core.ensemble_range import PERCENTILES
from studies.readhesion_paper import study as readhesion
from studies.readhesion_paper.calibration import LEAST_MET, RANGES, best, members
from studies.readhesion_paper.findings import CLAIMS
from studies.readhesion_paper.limit_cycle import critical_width
from studies.readhesion_paper.limit_cycle_comparison import (
    compare_cycles,
    growth_over_widths,
    paper_model,
)
from studies.readhesion_paper.paper import CALIBRATED, CASE_A, PAPER_LIMITS, RIVAL, UNITS, Unprinted

SYMBOLS = {"margin": "a_0", "width": "a_w"}
SHADES = mpl.colormaps["viridis"]
"""Dark to light in every kind of colour vision; from small to large values."""
LIMIT = r"$\mu_\mathrm{lim}$ [–]"
WIDTHS = (0.1, 0.3)
LIMITS = tuple(round(0.112 + 0.004 * k, 3) for k in range(12))
GROWTH_WIDTHS = tuple(round(0.15 + 0.05 * k, 2) for k in range(14))
FEW_EVENTS = 60
"""Samples of the calibration that are drawn where the results hold none."""
PARAMETERS = {
    "residual_ratio": r"$\mu_\infty/\mu_\mathrm{max}$ [–]",
    "rise": "$T_u$ [s]",
    "fall": "$T_d$ [s]",
    "time_constant": r"$\tau$ [s]",
}
UNIT_LOOKS = {"km/h/s": ("o", BLUE), "m/s2": ("^", ORANGE)}
"""Marker and colour of each unit that a_0 and a_w may be meant in."""
RING: Look = {"marker": "o", "markersize": 3.5, "markerfacecolor": "none"}
"""Mark of what was simulated."""
TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Ticks of logarithmic axes."""
HEADROOM = 12.0
"""Objective above the best one up to which sets are shown."""


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
    drawn, panels = new_panels(PAGE, 7.4, 3, len(UNIT_LOOKS), sharex=True, sharey="row")
    for (possible, used, share), unit, letters in zip(
        panels.T, UNIT_LOOKS, ("ace", "bdf"), strict=True
    ):
        own = members[members["unit"] == unit]
        rows = in_use if unit == CALIBRATED.unit else own[own["member"] == 0]
        shown = unit.replace("s2", "s²")
        _possibility(possible, rows, over)
        _limits_of_members(possible, own, over)
        _indices(used, share, rows[rows["part"] == "indices"], over)
        possible.set_title(
            f"({letters[0]}) readhesion possibility, ${SYMBOLS[other]}$ = {held:g} {shown}"
        )
        used.set_title(f"({letters[1]}) used coefficient")
        share.set_title(f"({letters[2]}) utilisation")
        share.set_xlabel(LIMIT)
        possible.set_ylabel(f"${SYMBOLS[over]}$ [{shown}]")
    panels[1, 0].set_ylabel(r"$\mu_\mathrm{use}$ [–]")
    panels[2, 0].set_ylabel(r"$\mu_\mathrm{r}$ [%]")
    lines = panels[1, 0].get_legend_handles_labels()[0]
    title = f"(c) to (f): ${SYMBOLS[over]}$, in the unit of each column"
    drawn.legend(handles=lines, loc="outside lower center", ncols=6, title=title)
    points = panels[0, 0].get_legend_handles_labels()[0]
    drawn.legend(handles=points, loc="outside upper center", ncols=4)
    return drawn  # fmt: skip


def _possibility(axes: Axes, rows: pd.DataFrame, over: str) -> None:
    """Circle: readhesion possible; cross: not. Bars: the limit adhesion coefficient."""
    runs, limits = rows[rows["part"] == "indices"], rows[rows["part"] == "limit"]
    good = runs["possible"].astype(bool)
    for own, marker, colour, label in (
        (runs[good], "o", BLUE, "possible"),
        (runs[~good], "x", VERMILION, "not possible"),
    ):
        axes.plot(
            own["limit"], own[over], marker, color=colour, markersize=3.0,
            markerfacecolor="none", markeredgewidth=0.8, label=label,
        )  # fmt: skip
    axes.plot(
        limits["limit_coefficient"], limits[over], "|", color="black", markersize=10,
        markeredgewidth=1.4, label="limit adhesion coefficient",
    )  # fmt: skip
    axes.set_ylim(runs[over].min() - 0.08, runs[over].max() + 0.08)


def _limits_of_members(axes: Axes, members: pd.DataFrame, over: str) -> None:
    """Between which limit coefficients 90 % of the ensemble's members lie, those that have one."""
    for value, rows in members[members["part"] == "limit"].groupby(over):
        known = rows["limit_coefficient"].dropna().to_numpy(dtype=float)
        if known.size > 1:
            low, high = np.percentile(known, PERCENTILES)
            look: Look = {
                "color": "black",
                "alpha": 0.25,
                "linewidth": 5.0,
                "solid_capstyle": "butt",
            }
            axes.plot([low, high], [float(str(value))] * 2, label="_", **look)
    label = "90 % of the ensemble's limits"
    axes.plot([], [], color="black", alpha=0.25, linewidth=5.0, label=label)


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


def _cycles(source: Source) -> dict[str, pd.DataFrame]:
    """Need: cycles of the set of each unit."""
    return {
        one.unit: compare_cycles(WIDTHS, LIMITS, source.jobs, one) for one in (CALIBRATED, RIVAL)
    }


@figure("limit-cycle", "limit cycle of the torque table, simulated and predicted; when wheels run away; in both units",
        _cycles)  # fmt: skip
def limit_cycle(
    cycles: Mapping[str, pd.DataFrame], growth_widths: tuple[float, ...] = GROWTH_WIDTHS
) -> Figure:
    """A row per unit: period and swing of slip over mu_lim, and growth of swings about the runaway equilibrium over a_w.

    Simulated cycles are drawn where the wheel readheres. Numbers: difference of the predictions from the simulations.
    """
    drawn, panels = new_panels(PAGE, 4.6, len(cycles), 3, squeeze=False)
    sets: dict[str, Unprinted] = {one.unit: one for one in (CALIBRATED, RIVAL)}
    for row, letters, (unit, table) in zip(panels, ("abc", "def"), cycles.items(), strict=False):
        words = []
        for axes, quantity, name in zip(
            row, ("period", "slip_swing"), ("period", "swing"), strict=False
        ):
            _cycle_panel(axes, table, quantity)
            words.append(f"{name}, {_off(table, quantity)}")
        row[0].set_ylabel("period [s]")
        row[1].set_ylabel("swing of slip velocity [m/s]")
        _growth_panel(row[2], growth_widths, sets[unit])
        for axes, letter, word in zip(row, letters, (*words, "growth of swings"), strict=True):
            axes.set_title(f"({letter}) {unit.replace('s2', 's²')}: {word}")
    look = {"color": DARK, "linestyle": "none", **RING}
    shown = [handle("predicted", color=DARK), handle("simulated", **look)]
    drawn.legend(handles=shown, loc="outside lower center", ncols=2)
    label_lines(*panels[:, :2].flat)
    return drawn


def _off(cycles: pd.DataFrame, quantity: str) -> str:
    """Between which shares predictions are off what was simulated, where the wheel readheres."""
    back = cycles[cycles["possible"]]
    off = 100.0 * (back[f"predicted_{quantity}"] / back[quantity] - 1.0).dropna()
    words = f"predicted {off.min():+.0f} to {off.max():+.0f} %" if len(off) else "none simulated"
    return words.replace("-", "−")


def _cycle_panel(axes: Axes, cycles: pd.DataFrame, quantity: str) -> None:
    for colour, (width, rows) in zip((BLUE, VERMILION), cycles.groupby("width"), strict=True):
        back = rows[rows["possible"]]  # wheels that run away swing as well, elsewhere
        axes.plot(
            rows["limit"], rows[f"predicted_{quantity}"], color=colour, label=f"$a_w$ = {width:g}"
        )
        axes.plot(
            back["limit"],
            back[quantity],
            linestyle="none",
            color=colour,
            label="_simulated",
            **RING,
        )
    axes.set_xlabel(LIMIT)
    axes.margins(y=0.12)


def _growth_panel(growth: Axes, widths: Sequence[float], one: Unprinted) -> None:
    """Above 1 swings grow into a limit cycle, below they die out: the factor comes to rest."""
    sizes = growth_over_widths(widths, one)
    critical = critical_width(paper_model(unprinted=one)) / UNITS[one.unit]
    growth.plot(widths, sizes, ".-", color=GREEN)
    low, high = growth.get_ylim()
    growth.axhspan(1.0, max(high, 1.0), color=VERMILION, alpha=0.12, linewidth=0.0)
    growth.axhspan(min(low, 1.0), 1.0, color=BLUE, alpha=0.12, linewidth=0.0)
    growth.set_ylim(min(low, 0.9), max(high, 1.1))
    growth.annotate(
        "swings grow:\nlimit cycle", (1.0, 1.0), (-3.0, -3.0), "axes fraction", "offset points",
        ha="right", va="top",
    )  # fmt: skip
    growth.annotate(
        "swings die out:\nthe factor rests",
        (0.0, 0.0),
        (3.0, 3.0),
        "axes fraction",
        "offset points",
    )
    if critical <= max(widths):
        growth.plot([critical], [1.0], "o", color=BLACK)
        at = (critical, 1.0), (4.0, 3.0)
        growth.annotate(f"at {critical:.2f}", *at, textcoords="offset points")
    growth.set(xlabel=f"$a_w$ [{one.unit.replace('s2', 's²')}]", ylabel="growth per swing [–]")


@figure("calibration", "how narrowly the readhesion paper determines what it does not print",
        study("calibration", FEW_EVENTS))  # fmt: skip
def calibration(table: pd.DataFrame) -> Figure:
    """A panel per parameter. Filled: sets that meet as many findings as any; star: the best that misses only the half-slip.

    Bars: 90 % of the filled ones, in each unit.
    """
    chosen = best(table)
    good = pd.concat([members(table, unit) for unit in UNIT_LOOKS])
    top = float(table["objective"].min()) + HEADROOM
    others = table[table["objective"] <= top].drop(good.index, errors="ignore")
    drawn, panels = new_panels(PAGE, 4.8, 2, 2, sharey=True)
    for axes, (name, (low, high, logarithmic)) in zip(panels.flat, RANGES.items(), strict=True):
        for unit, (marker, colour) in UNIT_LOOKS.items():
            look = {"color": colour, "markersize": 3.6, "markeredgewidth": 0.7}
            shown = unit.replace("s2", "s²")
            for rows, face, label in (
                (others, "none", f"{shown}, fewer findings"),
                (good, colour, f"{shown}, {LEAST_MET} findings of {len(CLAIMS)}"),
            ):
                own = rows[rows["unit"] == unit]
                x, y = own[name], own["objective"]
                axes.plot(x, y, marker, markerfacecolor=face, label=label, **look)
        point = [chosen[name]], [chosen["objective"]]
        axes.plot(*point, "*", color="black", markersize=10, label="best")
        if logarithmic:
            axes.set_xscale("log")
            plain_ticks(axes.xaxis, FixedLocator(TICKS))
        axes.set(xlim=(low, high), ylim=(0.0, top), xlabel=PARAMETERS[name])
        for k, (unit, (_, colour)) in enumerate(UNIT_LOOKS.items()):
            filled = good.loc[good["unit"] == unit, name]
            if len(filled) > 1:
                ends = np.percentile(filled, PERCENTILES)
                height = (0.03 + 0.04 * k) * top
                axes.plot(
                    ends, [height, height], color=colour, linewidth=3.5, solid_capstyle="butt"
                )
    for axes in panels[:, 0]:
        axes.set_ylabel("objective [–]")
    legend_below(drawn, 3, panels[0, 0])
    return drawn
