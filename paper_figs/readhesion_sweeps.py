"""What the readhesion paper sweeps and does not print: its Figs. 16 to 21, limit cycles, calibration."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MultipleLocator

from paper_figs.palette import BLUE, GREEN, ORANGE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import legend_below, new_figure, new_panels, plain_ticks
from studies.readhesion_paper import study as readhesion
from studies.readhesion_paper.calibration import RANGES, best, fulfilling
from studies.readhesion_paper.limit_cycle import critical_width
from studies.readhesion_paper.limit_cycle_comparison import (
    compare_cycles,
    growth_over_widths,
    paper_model,
)
from studies.readhesion_paper.paper import CASE_A, PAPER_LIMITS

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
TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Ticks of logarithmic axes."""
HEADROOM = 12.0
"""Objective above the best one up to which sets are shown."""


@figure("margin-sweep", "readhesion and adhesion used over a_0 (readhesion paper Figs. 16, 17, 18)",
        study("readhesion"))  # fmt: skip
def margin_sweep(table: pd.DataFrame) -> Figure:
    """Three panels; filled points: readhesion is possible."""
    return _sweep(table, "margin", "width")


@figure("width-sweep", "readhesion and adhesion used over a_w (readhesion paper Figs. 19, 20, 21)",
        study("readhesion"))  # fmt: skip
def width_sweep(table: pd.DataFrame) -> Figure:
    """Three panels; filled points: readhesion is possible."""
    return _sweep(table, "width", "margin")


def _sweep(table: pd.DataFrame, over: str, other: str) -> Figure:
    """Three panels over "margin" (a_0) or "width" (a_w), the `other` as in case A."""
    held = getattr(CASE_A, other)
    as_printed = table["parabola"] == readhesion.PRINTED
    rows = table[as_printed & np.isclose(table[other].astype(float), held)]
    drawn = new_figure(7.1, 5.6)
    panels = drawn.subplot_mosaic([["possible", "possible"], ["used", "share"]])
    possible, used, share = (panels[name] for name in ("possible", "used", "share"))
    _possibility(possible, rows, over)
    _indices(used, share, rows[rows["part"] == "indices"], over)
    possible.set_title(f"(a) readhesion possibility, ${SYMBOLS[other]}$ = {held:g} km/h/s")
    used.set_title("(b) used coefficient")
    share.set_title("(c) utilisation")
    handles = used.get_legend_handles_labels()[0]
    title = f"${SYMBOLS[over]}$ [km/h/s]"
    drawn.legend(handles=handles, loc="outside right center", title=title)
    return drawn


def _possibility(axes: Axes, rows: pd.DataFrame, over: str) -> None:
    """Circle: readhesion possible; cross: not. Bars: the limit adhesion coefficient."""
    runs, limits = rows[rows["part"] == "indices"], rows[rows["part"] == "limit"]
    good = runs["possible"].astype(bool)
    for own, marker, colour, label in (
        (runs[good], "o", BLUE, "possible"),
        (runs[~good], "x", VERMILION, "not possible"),
    ):
        axes.plot(
            own["limit"], own[over], marker, color=colour, markersize=3.6,
            markerfacecolor="none", markeredgewidth=0.9, label=label,
        )  # fmt: skip
    axes.plot(
        limits["limit_coefficient"], limits[over], "|", color="black", markersize=11,
        markeredgewidth=1.4, label="limit adhesion coefficient",
    )  # fmt: skip
    axes.set(xlabel=LIMIT, ylabel=f"${SYMBOLS[over]}$ [km/h/s]")
    axes.set_ylim(runs[over].min() - 0.08, runs[over].max() + 0.22)
    axes.legend(loc="upper left", ncols=3)


def _indices(used: Axes, share: Axes, runs: pd.DataFrame, over: str) -> None:
    """Used coefficient and utilisation, a line per value; points where readhesion is possible."""
    values = sorted(runs[over].unique())
    for k, value in enumerate(values):
        own = runs[np.isclose(runs[over], value)].sort_values("limit")
        colour = SHADES(0.92 * k / max(len(values) - 1, 1))
        good = own["possible"].to_numpy(dtype=bool)
        for axes, y in ((used, own["used_coefficient"]), (share, 100.0 * own["utilisation"])):
            axes.plot(own["limit"], y, color=colour, linewidth=1.0, label=f"{value:g}")
            axes.plot(own["limit"][good], y[good], "o", color=colour, markersize=2.6)
    ends = [min(PAPER_LIMITS), max(PAPER_LIMITS)]
    used.plot(ends, ends, ":", color="black", linewidth=0.9, label="ideal")
    share.axhline(100.0, linestyle=":", color="black", linewidth=0.9)
    used.set(xlabel=LIMIT, ylabel=r"$\mu_\mathrm{use}$ [–]")
    share.set(xlabel=LIMIT, ylabel=r"$\mu_\mathrm{r}$ [%]")
    for axes in (used, share):
        axes.xaxis.set_major_locator(MultipleLocator(0.04))


@figure("limit-cycle", "limit cycle of the torque table, simulated and predicted; when wheels run away",
        lambda source: compare_cycles(WIDTHS, LIMITS, source.jobs))  # fmt: skip
def limit_cycle(cycles: pd.DataFrame, growth_widths: tuple[float, ...] = GROWTH_WIDTHS) -> Figure:
    """Panels: period and swing of slip over mu_lim, and growth of swings about the runaway equilibrium over a_w.

    Simulated cycles are drawn where the wheel readheres.
    """
    drawn, (period, slip, growth) = new_panels(7.1, 2.9, 1, 3)
    for colour, (width, rows) in zip((BLUE, VERMILION), cycles.groupby("width"), strict=True):
        back = rows[rows["possible"]]  # wheels that run away swing as well, elsewhere
        circle = {"marker": "o", "markersize": 3.5, "markerfacecolor": "none", "linestyle": "none"}
        of_width = f"$a_w$ = {width:g} km/h/s"
        for panel, quantity in ((period, "period"), (slip, "slip_swing")):
            predicted = rows[f"predicted_{quantity}"]
            panel.plot(rows["limit"], predicted, color=colour, label=f"predicted, {of_width}")
            label = f"simulated, {of_width}"
            panel.plot(back["limit"], back[quantity], color=colour, label=label, **circle)
    period.set(title="(a) period", ylabel="period [s]")
    slip.set(title="(b) swing of slip", ylabel="slip velocity [m/s]")
    for panel in (period, slip):
        panel.set_xlabel(LIMIT)
        panel.set_ylim(bottom=0.0)
    sizes = growth_over_widths(growth_widths)
    growth.plot(growth_widths, sizes, ".-", color=GREEN)
    critical = critical_width(paper_model()) * 3.6
    growth.axvline(critical, linestyle="--", color="black", linewidth=0.9)
    growth.axhline(1.0, linestyle=":", color="black", linewidth=0.9)
    growth.annotate(
        f"factor rests\nfrom {critical:.2f} on", (critical, float(np.max(sizes))),
        xytext=(6, 0), textcoords="offset points", va="top",
    )  # fmt: skip
    growth.set(title="(c) swings while running away", xlabel="$a_w$ [km/h/s]")
    growth.set_ylabel("growth per swing [–]")
    legend_below(drawn, 2, period)
    return drawn


@figure("calibration", "how narrowly the readhesion paper determines what it does not print",
        study("calibration", FEW_EVENTS))  # fmt: skip
def calibration(table: pd.DataFrame) -> Figure:
    """A panel per parameter. Filled: sets that fulfil all findings but the half-slip; star: the best of them."""
    good, chosen = fulfilling(table), best(table)
    top = float(table["objective"].min()) + HEADROOM
    others = table[table["objective"] <= top].drop(good.index, errors="ignore")
    drawn, panels = new_panels(7.1, 4.8, 2, 2, sharey=True)
    for axes, (name, (low, high, logarithmic)) in zip(panels.flat, RANGES.items(), strict=True):
        for unit, (marker, colour) in UNIT_LOOKS.items():
            look = {"color": colour, "markersize": 3.6, "markeredgewidth": 0.7}
            shown = unit.replace("s2", "s²")
            for rows, face, label in (
                (others, "none", f"{shown}, not all findings"),
                (good, colour, f"{shown}, all findings but the half-slip"),
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
        if len(good) > 1:
            axes.axvspan(good[name].min(), good[name].max(), color=BLUE, alpha=0.10)
    for axes in panels[:, 0]:
        axes.set_ylabel("objective [–]")
    legend_below(drawn, 3, panels[0, 0])
    return drawn
