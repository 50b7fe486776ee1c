"""Figures of the readhesion paper: 1, 5, 6 curve and table, 7 to 15 cases A and B, 16 to 21 the sweeps, 22 and 23.

The paper names no unit of a_0 and a_w. So each reading has a column of its own, with the set in use there.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from paper_figs.style import WIDE, Drawing
from studies import readhesion_paper as paper
from studies.readhesion_paper import CASE_A, CASE_B, DROP, IN_USE, RECOVERY, AxleRun, Case

NAMES = {CASE_A: "A: ", CASE_B: "B: "}
COLOURS = {0.2: "#0072B2", 0.3: "#009E73", 0.8: "#D55E00"}
"""By a_w."""
SHADES = mpl.colormaps["viridis"]
LIMIT = r"$\mu_\mathrm{lim}$"

SOURCE = "readhesion_paper"

Shown = tuple[Case, str, dict[str, Any]]
"""What a row of panels shows: a case, one of `QUANTITIES`, and limits of the axes."""
Pair = tuple[paper.Floats, paper.Floats]
SLIP, TORQUE, FACTOR = "slip velocity [m/s]", "torque as coefficient [–]", "torque factor [–]"
QUANTITIES: dict[str, tuple[str, Callable[[AxleRun], Pair]]] = {
    SLIP: ("slip velocity of the curve's peak", lambda run: (run.slip, run.peak_slip)),
    TORQUE: (
        "tangential force coefficient",
        lambda run: (paper.TO_COEFFICIENT * run.command, run.mu),
    ),
    FACTOR: ("torque command over the plan", lambda run: (run.factor, run.command / paper.PLAN)),
}
"""What is drawn over time: name of what it is held against, and both. Torque is the motor's command, as in the paper."""


def spell(unit: str) -> str:
    """As it is printed."""
    return unit.replace("s2", "s²")


def format_title(case: Case, unit: str) -> str:
    """Case, table and rail."""
    table = f"$a_w$ {case.width:g}, $a_0$ {case.margin:g} {spell(unit)}"
    return f"{NAMES.get(case, '')}{table}, {LIMIT} {case.limit:g}"


@cache
def drive_in_use(unit: str, case: Case) -> AxleRun:
    """The run of Table 2, recovery included."""
    return paper.run_axle(IN_USE[unit], case, recovers=True)


def new_panels(height: float, x: str, labels: list[str], **shared: Any) -> tuple[Figure, Any]:
    """A row of panels for each label, a column for each reading of the unit."""
    figure = Figure(figsize=(WIDE, height), layout="constrained")
    panels = figure.subplots(len(labels), len(IN_USE), squeeze=False, **shared)
    for row, label in zip(panels, labels, strict=True):
        row[0].set_ylabel(label)
    for axes in panels[-1]:
        axes.set_xlabel(x)
    figure.align_ylabels()
    return figure, panels


def draw_curve_and_table() -> Figure:
    """Figs. 1, 6 and 5."""
    figure = Figure(figsize=(WIDE, 2.5), layout="constrained")
    close, far, table = figure.subplots(1, 3)
    for axes, end in ((close, 0.15), (far, 5.0)):
        slip = np.linspace(0.0, end, 500)
        looks = ("#009E73", 2.4), ("#CC79A7", 1.0)  # where both are one the wide line is seen below
        for (colour, width), (unit, unprinted) in zip(looks, IN_USE.items(), strict=True):
            for most, look in ((paper.BEFORE, "-"), (CASE_A.limit, "--")):
                mu = unprinted.curve(slip, most)
                label = f"{most:g}, set in {spell(unit)}"
                axes.plot(slip, mu, look, color=colour, linewidth=width, label=label)
        axes.set(xlabel="slip velocity [m/s]", xlim=(0.0, end), ylim=(0.0, 0.2))
    close.set(xticks=[0.0, 0.05, 0.1, 0.15], ylabel="coefficient [–]")
    for case, name in NAMES.items():
        ends = [-0.2, case.margin, case.margin + case.width, 1.6]
        table.plot(ends, [1.0, 1.0, 0.0, 0.0], color=COLOURS[case.width], label=name.strip(": "))
    table.set(xlabel="deviation of acceleration\n[unit of $a_0$: km/h/s or m/s²]", ylabel=FACTOR)
    table.legend()
    handles, peak = close.get_legend_handles_labels(), r"$\mu_\mathrm{max}$"
    figure.legend(*handles, loc="outside lower center", ncols=4, title=peak)
    return figure


def draw_over_time(*rows: Shown) -> Figure:
    """A quantity of each row's case, and dashed what it is held against; shaded while the rail is low."""
    labels = [label for _, label, _ in rows]
    figure, panels = new_panels(0.5 + 1.4 * len(rows), "time [s]", labels, sharey="row")
    for column, unit in zip(panels.T, IN_USE, strict=True):
        for axes, (case, label, limits) in zip(column, rows, strict=True):
            run = drive_in_use(unit, case)
            quantity, reference = QUANTITIES[label][1](run)
            axes.plot(run.time, quantity, color=COLOURS[case.width])
            axes.plot(run.time, reference, "k--", linewidth=0.8)
            axes.axvspan(DROP, RECOVERY, color="0.95", linewidth=0.0)
            axes.set(title=format_title(case, unit), xlim=(5.0, 15.0))
            axes.set(**limits)
    dashed = "; ".join(dict.fromkeys(QUANTITIES[label][0] for label in labels))
    line = Line2D([], [], color="k", linestyle="--", linewidth=0.8, label=dashed)
    figure.legend(handles=[line], loc="outside lower center")
    return figure


def draw_trajectory() -> Figure:
    """Figs. 14, 15: from drop to recovery."""
    figure, panels = new_panels(4.6, SLIP, [TORQUE] * len(NAMES), sharex=True, sharey=True)
    slip = np.geomspace(0.01, 12.0, 500)
    for row, case in zip(panels, NAMES, strict=True):
        for axes, (unit, unprinted) in zip(row, IN_USE.items(), strict=True):
            run, colour = drive_in_use(unit, case), COLOURS[case.width]
            low = (run.time >= DROP) & (run.time < RECOVERY - paper.FADE)
            creep, torque = run.slip[low], paper.TO_COEFFICIENT * run.command[low]
            last = run.time[low] > RECOVERY - 2.0
            axes.plot(creep, torque, color=colour, linewidth=0.8, label="torque command")
            axes.plot(
                creep[last], torque[last], color="#E69F00", linewidth=2.2, label="its last 2 s"
            )
            axes.plot(creep[0], torque[0], "o", color=colour, label="adhesion drops")
            mu = unprinted.curve(slip, case.limit)
            axes.plot(slip, mu, "k--", linewidth=0.9, label="adhesion curve")
            macro = float(unprinted.curve.top(0.0, case.limit)[1]), slip[-1]
            axes.axvspan(*macro, color="0.93", linewidth=0.0, label="macro slip")
            axes.set(title=format_title(case, unit), xscale="log", xlim=(slip[0], slip[-1]))
            axes.xaxis.set_major_formatter("{x:g}")
    handles, names = panels[0, 0].get_legend_handles_labels()
    look: dict[str, Any] = {"color": "0.35"}  # stands for the colours of both cases
    handles[0] = Line2D([], [], linewidth=0.8, **look)
    handles[2] = Line2D([], [], marker="o", linestyle="none", **look)
    figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure


def draw_sweep(over: str, rows: pd.DataFrame) -> Figure:
    """Figs. 16 to 18 over a_0 ("margin"), 19 to 21 over a_w ("width"), the other as in case A.

    Grey: limits of the members. Left of the dashed line the printed curve is narrowed.
    """
    symbol = "$a_0$" if over == "margin" else "$a_w$"
    labels = ["", r"$\mu_\mathrm{use}$ [–]", r"$\mu_\mathrm{r}$ [%]"]
    figure, panels = new_panels(6.4, f"{LIMIT} [–]", labels, sharex=True, sharey="row")
    fixed = "width" if over == "margin" else "margin"
    rows = rows[(rows["part"] == "grid") & (rows[fixed] == getattr(CASE_A, fixed))]
    rows = rows[rows["status"] == "ok"].astype({"possible": bool})
    for (possible, *means), unit in zip(panels.T, IN_USE, strict=True):
        sets = rows[rows["unit"] == unit].groupby("member")
        limits = pd.DataFrame({k: paper.limits_over(grid, over) for k, grid in sets}).T
        possible.hlines(limits.columns, limits.min(), limits.max(), color="0.8", linewidth=6.0)
        used = sets.get_group(0).sort_values("limit")
        printed = used[np.isclose(used["limit"] % paper.FINER[0], [[0.0], [paper.FINER[0]]]).any(0)]
        for good, mark, colour in ((True, "o", "#0072B2"), (False, "x", "#D55E00")):
            some = printed[printed["possible"] == good]
            look: dict[str, Any] = {"color": colour, "markersize": 2.5, "markerfacecolor": "none"}
            possible.plot(some["limit"], some[over], mark, **look)
        for value, line in used.groupby(over):
            shade, good = SHADES(0.95 * float(value)), line["possible"].to_numpy()
            for axes, y in zip(means, (line["used"], 100.0 * line["utilisation"]), strict=True):
                axes.plot(line["limit"], y, color=shade, linewidth=0.8, label=f"{value:g}")
                axes.plot(line["limit"][good], y[good], "o", color=shade, markersize=2.5)
        means[0].plot([0.02, 0.16], [0.02, 0.16], "k:", linewidth=0.9)
        means[1].axhline(100.0, color="k", linestyle=":", linewidth=0.9)
        for axes in (possible, *means):
            axes.axvline(paper.VERY_SLIPPERY, color="0.5", linestyle="--", linewidth=0.7)
        possible.set(title=f"$a_0$, $a_w$ in {spell(unit)}", ylabel=f"{symbol} [{spell(unit)}]")
    handles = panels[1, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=10, title=symbol)
    return figure


def draw_downhill(rows: pd.DataFrame) -> Figure:
    """Section 4. Points: runs; lines: the share at which the table balances gravity."""
    figure, panels = new_panels(2.8, "gradient [‰]", ["torque kept [%]"], sharey=True)
    rows = rows[(rows["part"] == "downhill") & (rows["status"] == "ok")].sort_values("gradient")
    for axes, unit in zip(panels[0], IN_USE, strict=True):
        for value, line in rows[rows["unit"] == unit].groupby("margin"):
            shade = SHADES(0.95 * float(value))
            axes.plot(line["gradient"], 100.0 * line["expected"], color=shade, label=f"{value:g}")
            axes.plot(line["gradient"], 100.0 * line["kept"], "o", color=shade, markersize=3.0)
        axes.set_title(f"$a_0$ in {spell(unit)}")
    handles = panels[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=10, title="$a_0$")
    return figure


SMALL, CLOSE = {"ylim": (0.0, 0.35)}, {"xlim": (9.0, 11.0), "xticks": [9, 9.5, 10, 10.5]}
SLIPS: list[Shown] = [(CASE_A, SLIP, SMALL), (CASE_B, SLIP, SMALL), (CASE_B, SLIP, {})]
TORQUES: list[Shown] = [(case, TORQUE, {"ylim": (0.04, 0.19)}) for case in NAMES]
FACTORS: list[Shown] = [(CASE_A, FACTOR, {}), (CASE_A, FACTOR, CLOSE), (CASE_B, FACTOR, {})]
LOGARITHMIC = {"yscale": "log", "ylim": (0.03, 5.0), "yticks": [0.1, 1.0], "yticklabels": [0.1, 1]}
MILD: dict[str, Any] = {SLIP: LOGARITHMIC, TORQUE: {"ylim": (0.08, 0.18)}}
HALF_SLIPS = [(Case(width=a_w, limit=0.16), *look) for a_w in (0.2, 0.3) for look in MILD.items()]
_DRAWN: dict[str, tuple[Callable[..., Figure], str, str]] = {
    "readhesion-curve": (
        draw_curve_and_table,
        "Figs. 1, 5, 6: the adhesion curve, and the torque factor over the deviation of the acceleration",
        "",
    ),
    "readhesion-slip": (
        partial(draw_over_time, *SLIPS),
        "Figs. 7 to 9: slip stays small in case A, and grows in case B",
        "",
    ),
    "readhesion-torque": (
        partial(draw_over_time, *TORQUES),
        "Figs. 10, 11: the torque command against the coefficient of the rail in cases A and B",
        "",
    ),
    "readhesion-factor": (
        partial(draw_over_time, *FACTORS),
        "Figs. 12, 13: the torque factor in case A, two seconds of it, and in case B",
        "",
    ),
    "readhesion-trajectory": (
        draw_trajectory,
        "Figs. 14, 15: the torque over the slip is a closed cycle in case A, and leaves it in case B",
        "",
    ),
    "margin-sweep": (
        partial(draw_sweep, "margin"),
        "Figs. 16 to 18: where wheels readhere and how much adhesion they use, over the margin a_0",
        SOURCE,
    ),
    "width-sweep": (
        partial(draw_sweep, "width"),
        "Figs. 19 to 21: where wheels readhere and how much adhesion they use, over the width a_w",
        SOURCE,
    ),
    "half-slip": (
        partial(draw_over_time, *HALF_SLIPS),
        "Figs. 22, 23: slip and torque where the rail gives just less than the plan: the text's long half-slip at a_w 0.2 "
        "does not come, and that at a_w 0.3 comes in m/s² alone",
        "",
    ),
    "downhill": (
        draw_downhill,
        "Section 4: the torque that the table leaves on a dry rail downhill",
        SOURCE,
    ),
}
FIGURES = {
    name: Drawing(draw, f"{caption}; in both readings of the unit.", study, SOURCE)
    for name, (draw, caption, study) in _DRAWN.items()
}
