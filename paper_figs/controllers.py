"""Readhesion controllers over random events: from none to MPC, on several adhesion curves, with noise and delay."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from alloc.metrics.registry import range_of
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import AdhesionCurve
from alloc.recording import attributes_of
from paper_figs.drawing import Source, figure, made, recorded, study
from paper_figs.saving import Origin
from paper_figs.style import (
    BAND_GREY,
    BLUE,
    BOUND,
    DARK,
    GREEN,
    PAGE,
    VERMILION,
    WORSE_TO_BETTER,
    ZERO,
    Look,
    Panel,
    bare_rows,
    bare_table,
    controller_look,
    handle,
    interval_mark,
    legend_below,
    name_rows,
    new_figure,
    new_panels,
    number_cell,
    plain_ticks,
    zero_line,
)
from studies.core.drawn_events import complete
from studies.core.statement import LEAST_SHOWN, mean_interval
from studies.ladder.curves_study import CURVES, PAIRS, paired_difference
from studies.ladder.ladder_study import LADDER, LOCOMOTIVE, YARDSTICKS
from studies.ladder.mismatch_study import (
    DELAYED,
    GIVEN,
    MIDDLE,
    NOISES,
    RAILS,
    REFERENCE,
    SEARCHER,
    SOUGHT,
    Setting,
    difference,
)
from studies.scenario.scenario import load_scenario

FEW_OF_LADDER, FEW_OF_CURVES, FEW_OF_MISMATCH = 6, 4, 2
"""Events that are run for a figure where the results have fewer: one or two of each train."""
PANELS = (
    Panel("utilisation_short", "adhesion used\nwhere short [%]", 100.0),
    Panel("effort_ratio", "effort\nover plan [%]", 100.0),
    Panel("search_time", "search time [s]"),
    Panel("unfinished_searches", "searches\nunfinished [%]", 100.0),
    Panel("torque_fluctuation", "torque fluctuation\nover plan [%]", 100.0),
    Panel("slip_time", "slip, summed\nover axles [s]"),
    Panel("damage", "wheel damage Q\n[kJ]", 1.0, True),
    Panel("jerk_rms", "jerk rms\n[m/s³]"),
)
BELOW = 0.15
"""Distance of the single events from their mean, in rows: no mark stands on another."""
PLACES, PILE = 100.0, 0.16
"""Places along a panel that part events from each other, and the height of a pile of all of them, in rows."""


@figure("ladder", "readhesion controllers from none to MPC over random events (sweep ladder)",
        study("ladder", FEW_OF_LADDER))  # fmt: skip
def ladder(table: pd.DataFrame) -> Figure:
    """A panel per metric: means by controller, filled with a free axle, open for the locomotive.

    Below a mean a short line for each event; those of one place are piled up, so a tall line is many events.
    """
    good = complete(table)
    free = good["train"] != LOCOMOTIVE
    drawn, axes = new_panels(PAGE, 6.0, 2, len(PANELS) // 2, sharey=True)
    for panel, one in zip(PANELS, axes.flat, strict=True):
        shown = panel.factor * good[panel.metric].dropna().to_numpy(dtype=float)
        spread = (
            float(np.ptp(np.log10(shown) if panel.logarithmic else shown)) if len(shown) else 0.0
        )
        for y, controller in enumerate(LADDER):
            own = good["controller"] == controller
            look = controller_look(controller)
            for chosen, shift, face in ((free, -0.28, look["color"]), (~free, 0.2, "white")):
                values = good.loc[own & chosen, panel.metric].dropna().astype(float)
                _mark(one, values, panel, spread, y + shift, look | {"markerfacecolor": face})
        one.set_xlabel(panel.label)
        if panel.logarithmic:
            one.set_xscale("log")
            one.xaxis.set_minor_formatter(NullFormatter())
        bare_rows(one)
    for bar in YARDSTICKS:
        axes[0, 0].axvline(100 * bar, **BOUND)
    name_rows(axes[0, 0], LADDER)
    counts = [good["scenario"][kind].nunique() for kind in (free, ~free)]
    drawn.suptitle(
        f"filled: multiple units ({counts[0]} events); open: locomotive, no free axle ({counts[1]} events)",
    )
    return drawn


def piled(values: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
    """How far each value is moved up, in rows, so that those of one place pile up; `spread`: of all that the panel shows."""
    place = np.round(values * PLACES / (spread or 1.0))
    below = np.array([np.count_nonzero(place[:k] == one) for k, one in enumerate(place)])
    return np.asarray(below * PILE / max(len(values) - 1, 1), dtype=np.float64)


def _mark(
    axes: Axes, events: "pd.Series[float]", panel: Panel, spread: float, y: float, look: Look
) -> None:
    """Events as pale points, their mean with its interval in the controller's colour."""
    if events.empty:
        return
    pale = look | {"marker": "|", "markersize": 2.0, "markeredgewidth": 0.6, "alpha": 0.5}
    shown = np.asarray(panel.factor * events.to_numpy(), dtype=np.float64)
    along = np.log10(shown) if panel.logarithmic else shown
    axes.plot(shown, y + BELOW + piled(along, spread), **pale)
    found = mean_interval(events, within=range_of(panel.metric))
    if panel.logarithmic:  # an interval that reaches below zero has no place on this axis
        found = replace(found, low=max(found.low, 0.1 * found.value))
    interval_mark(axes, found, y, panel.factor, look | {"markersize": 4.0, "elinewidth": 1.0})


CURVE_LOOKS: dict[str, Look] = {
    "piecewise": {"color": "#222222", "marker": "o", "linestyle": "none"},
    "flat piecewise": {"color": BLUE, "marker": "s", "linestyle": "none"},
    "Polach wet": {"color": VERMILION, "marker": "^", "linestyle": "none"},
    "flat slip ratio": {"color": GREEN, "marker": "D", "linestyle": "none"},
}
CURVE_PANELS = (
    Panel("held_effort", "effort over plan [%]", 100.0),
    Panel("utilisation", "adhesion used [%]", 100.0),
    Panel("slip_time", "slip over axles [s]"),
    Panel("damage", "wheel damage Q [kJ]"),
    Panel("jerk_rms", "jerk rms [m/s³]"),
)


@figure("curves", "differences of rules and controllers under several adhesion curves (sweep curves)",
        study("curves", FEW_OF_CURVES))  # fmt: skip
def curves(table: pd.DataFrame) -> Figure:
    """A row per pair, a panel per metric, each with a scale of its own: mean paired difference and interval by curve."""
    good = table[table["status"] == "ok"]
    drawn, axes = new_panels(PAGE, 5.6, len(PAIRS), len(CURVE_PANELS), sharey=True)
    for pair, row in zip(PAIRS, axes, strict=True):
        for panel, one in zip(CURVE_PANELS, row, strict=True):
            for y, curve in enumerate(CURVES):
                found = mean_interval(paired_difference(good, curve, pair, panel.metric))
                if found.count:
                    look = {"markersize": 4.0, "elinewidth": 0.9, **CURVE_LOOKS[curve]}
                    interval_mark(one, found, y, panel.factor, look)
            zero_line(one)
            one.grid(visible=False, axis="y")
            one.set_yticks([])
            one.locator_params(axis="x", nbins=3)
            one.set_ylim(len(CURVES) - 0.5, -0.5)
        row[0].set_title(pair.name)
    for panel, one in zip(CURVE_PANELS, axes[-1], strict=True):
        one.set_xlabel(panel.label)
    legend_below(drawn, [handle(curve, **look) for curve, look in CURVE_LOOKS.items()])
    return drawn


DROP_EVENT = "falling-adhesion"
DROPPED = ("cut-and-ramp", "perturb-observe", "mpc")
BEFORE, AFTER = 0.5, 4.0
"""Time that is shown before the drop and after it [s]."""
FALLEN = 0.99
"""Share of the first adhesion below which it has dropped."""
SLIPS = 400
"""Points of a curve."""


def curve_of(scenario: str) -> AdhesionCurve:
    """Adhesion curve of a shipped scenario."""
    return load_scenario(scenario).event().model.rail.curve


@figure("adhesion-drop", "several controllers on one adhesion drop: adhesion used, slip and torque, and paths over the slip",
        made(curve_of, DROP_EVENT), *(recorded(DROP_EVENT, "alone", one) for one in DROPPED))  # fmt: skip
def adhesion_drop(curve: AdhesionCurve, *runs: xr.Dataset) -> Figure:
    """The foremost axle with a motor as the adhesion falls everywhere at once; each unit is left to itself.

    Left: what it uses of the adhesion there is, its slip beside that of the curve's peak, and its motor's torque. Right: a
    panel per controller, force over slip on the curves before the drop (dashed) and after it; a ring is where it begins.
    """
    axle = int(np.flatnonzero(runs[0]["axle_unit"].values >= 0)[0])
    unit = int(runs[0]["axle_unit"].values[axle])
    time, there = runs[0]["time"].values, runs[0]["adhesion_limit"].values[:, axle]
    drop = float(time[np.argmax(there < FALLEN * there[0])])
    shown = (time >= drop - BEFORE) & (time <= drop + AFTER)
    drawn, axes = new_panels(PAGE, 4.6, 3, 2, width_ratios=(1.7, 1.0), squeeze=False)
    used, slips, torques = axes[:, 0]
    for one in (slips, torques):
        one.sharex(used)
    for one in axes[1:, 1]:
        one.sharex(axes[0, 1])
        one.sharey(axes[0, 1])
    used.fill_between(
        time[shown], 0.0, there[shown], color=BAND_GREY, linewidth=0.0, label="adhesion available"
    )
    slips.plot(
        time[shown],
        runs[0]["peak_slip"].values[shown, axle],
        label="slip at the curve's peak",
        **BOUND,
    )
    most = max(float(run["slip_velocity"].values[shown, axle].max()) for run in runs)
    slip = np.linspace(0.0, 1.1 * most, SLIPS)
    speed = float(runs[0]["speed"].values[shown][0])
    for run, path in zip(runs, axes[:, 1], strict=True):
        name = attributes_of(run)["controller"]
        look: Look = {"color": CONTROLLERS[name].colour, "linewidth": 0.9, "gid": name}
        own = {key: run[key].values[shown, axle] for key in ("slip_velocity", "coefficient")}
        used.plot(time[shown], own["coefficient"], **look)
        slips.plot(time[shown], own["slip_velocity"], **look)
        torques.plot(time[shown], run["motor_torque"].values[shown, unit], **look)
        for level, dashes in ((there[shown][0], "--"), (there[shown].min(), "-")):
            at = curve.coefficient(slip, level, speed)
            path.plot(slip, at, color=DARK, linewidth=0.8, linestyle=dashes, gid="curve")
        path.plot(own["slip_velocity"], own["coefficient"], **look)
        begin = {
            **look,
            "marker": "o",
            "markersize": 4.0,
            "markerfacecolor": "white",
            "gid": f"{name}, begin",
        }
        path.plot(own["slip_velocity"][:1], own["coefficient"][:1], **begin)
        path.set_title(name, color=look["color"])
        path.set_ylabel("coefficient [–]")
    used.set(
        ylabel="coefficient [–]",
        title=f"axle {axle + 1} of {runs[0].sizes['axle']}",
        xlim=time[shown][[0, -1]],
    )
    used.set_ylim(bottom=0.5 * float(there[shown].min()))
    slips.set_ylabel("slip [m/s]")
    torques.set(ylabel="motor torque [N m]", xlabel="time [s]")
    axes[-1, 1].set_xlabel("slip [m/s]")
    for one in (*axes[:-1, 0], *axes[:-1, 1]):
        one.tick_params(axis="x", labelbottom=False)
    names = [attributes_of(run)["controller"] for run in runs]
    shown_marks = [handle(one, color=CONTROLLERS[one].colour, linewidth=1.2) for one in names]
    legend_below(drawn, [
        *shown_marks, Patch(facecolor=BAND_GREY, label="adhesion available"),
        handle("slip at the curve's peak", **BOUND),
    ])  # fmt: skip
    return drawn


MISMATCH_PANELS = (
    Panel("utilisation_short", "adhesion used [%]", 100.0),
    Panel("damage", "wheel damage Q [kJ]"),
    Panel("slip_time", "slip over axles [s]"),
)
SEEKING = (SEARCHER, SOUGHT, DELAYED)
"""Settings that seek the best slip, each drawn over the noise."""
SEEKING_LOOKS: dict[str, Look] = {
    SEARCHER.name: {"linestyle": "-"},
    SOUGHT.name: {"linestyle": "-"},
    DELAYED.name: {"linestyle": "--", "markerfacecolor": "white"},
}
GIVEN_NAMES = ("½", "1", "1½", "piecewise", "Polach\nwet", "slip\nratio")
"""Names of the given slips at the axis: shares of that of the rail's own peak, then curves whose peak it is."""
WORST = 10.0
"""Difference in the adhesion used of the strongest colour [%]."""


@figure("mismatch", "the MPC by curve, noise, computing time and given slip (sweep mismatch)",
        study("mismatch", FEW_OF_MISMATCH))  # fmt: skip
def mismatch(table: pd.DataFrame) -> Figure:
    """Above: means of paired differences from cut-and-ramp over the noise of measured speeds, with their intervals.

    A column per adhesion curve, a row per metric; each panel has a scale of its own. Below: mean adhesion used by an MPC
    whose slip is given, at 0.02 km/h of noise. Blue is better than cut-and-ramp, orange worse; a cell is white where the
    interval of the difference includes zero.
    """
    good = table[table["status"] == "ok"]
    drawn = new_figure(PAGE, 6.6)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[2.3, 1.0])).tolist()
    axes = above.subplots(len(MISMATCH_PANELS), len(RAILS), sharex=True)
    for panel, row in zip(MISMATCH_PANELS, axes, strict=True):
        for curve, one in zip(RAILS, row, strict=True):
            for k, setting in enumerate(SEEKING):
                _over_noise(one, panel, good, curve, setting, 0.0012 * (k - 1))
            one.axhline(0.0, color=ZERO, linewidth=0.8, zorder=0)
            one.locator_params(axis="y", nbins=4)
        row[0].set_ylabel(panel.label)
    for curve, top, bottom in zip(RAILS, axes[0], axes[-1], strict=True):
        top.set_title(curve, loc="center")
        bottom.set_xticks(NOISES, [f"{noise:g}" for noise in NOISES])
    axes[-1, len(RAILS) // 2].set_xlabel("noise of measured speeds [km/h]")
    above.suptitle(f"less {REFERENCE.name}'s")
    handles = [handle(one.name, color=_seeking_look(one)["color"], marker=_seeking_look(one)["marker"],
                      **SEEKING_LOOKS[one.name]) for one in SEEKING]  # fmt: skip
    legend_below(above, handles)
    _given(below.subplots(), good)
    return drawn


def _seeking_look(setting: Setting) -> Look:
    return controller_look(setting.controller) | SEEKING_LOOKS[setting.name] | {"gid": setting.name}


def _over_noise(
    axes: Axes, panel: Panel, good: pd.DataFrame, curve: str, setting: Setting, shift: float
) -> None:
    """Differences from the reference with the same noise, joined by a line."""
    found = {
        noise: mean_interval(difference(good, curve, noise, setting.name, REFERENCE.name, panel.metric).dropna())
        for noise in NOISES
    }  # fmt: skip
    look = _seeking_look(setting) | {"linewidth": 0.9, "elinewidth": 0.8, "markersize": 3.2}
    for noise, one in found.items():
        if one.count:
            interval_mark(
                axes, one, noise + shift, panel.factor, look | {"linestyle": "none"}, upright=True
            )
    known = {noise + shift: panel.factor * one.value for noise, one in found.items() if one.count}
    line = {key: look[key] for key in ("color", "linestyle", "linewidth", "gid")}
    axes.plot(list(known), list(known.values()), **line)


def _given(axes: Axes, good: pd.DataFrame) -> None:
    """A cell per curve and given slip: the mean as a number, its difference from the reference as a colour."""
    panel, scale = MISMATCH_PANELS[0], Normalize(-WORST, WORST)
    for y, curve in enumerate(RAILS):
        for x, setting in enumerate(GIVEN):
            rows = good[(good["curve"] == curve) & (good["noise"] == MIDDLE)]
            own = rows.loc[rows["setting"] == setting.name, panel.metric].dropna()
            if own.empty:
                continue
            less = mean_interval(
                difference(good, curve, MIDDLE, setting.name, REFERENCE.name, panel.metric).dropna()
            )
            open_ = less.count >= LEAST_SHOWN and less.low <= 0.0 <= less.high
            worth = 0.5 if open_ or not less.count else float(scale(panel.factor * less.value))
            number_cell(
                axes, x, y, (0.96, 0.92), worth, WORSE_TO_BETTER, f"{panel.factor * own.mean():.1f}"
            )
    name_rows(axes, list(RAILS))
    axes.set_xticks(range(len(GIVEN)), GIVEN_NAMES)
    axes.set(
        xlim=(-0.5, len(GIVEN) - 0.5),
        ylabel="adhesion curve",
        xlabel="given slip: that of a curve's peak, or times that of the rail's own [–]",
    )
    axes.set_title("adhesion used where the slip is given [%]")
    bare_table(axes)


MEASURED = ("peers", "peers-acados")
"""Stored tables that have times of a unit's period."""
STORED = Path(__file__).parents[1] / "docs" / "results"
PERIOD = 10.0
"""Control period [ms]: what takes longer is late."""
NOT_STORED = (
    "a clone of the repository has\nthese times (docs/results);\nan installed package has none"
)
KINDS: dict[str, tuple[str, Look]] = {
    "compiled|own iteration": ("this project's solver", {"color": CONTROLLERS["mpc"].colour, "marker": "o"}),
    "QP by": ("its iteration in Python with another QP solver", {"color": BLUE, "marker": "s"}),
    "": ("another solver of the whole problem", {"color": VERMILION, "marker": "^"}),
}  # fmt: skip
"""Pattern that a solver's name begins with -> kind of solver, and its look; the first that fits counts."""


def stored_times(source: Source) -> pd.DataFrame:
    """Need: solver, median and 99 % of its times [ms], as the stored tables have them; none in an installed package."""
    rows: dict[str, dict[str, float]] = {}
    for path in (STORED / f"{name}.json" for name in MEASURED):
        if path.exists():
            stored = json.loads(path.read_text())
            events, seed = (re.findall(rf"--{key} (\d+)", stored["command"])[0] for key in ("events", "seed"))  # fmt: skip
            source.origins.append(Origin(stored["command"], f"{events} events", (int(seed),)))
            for cell, (value,) in ((k, v) for k, v in stored["values"].items() if len(v) == 1):
                _, _, metric, solver = cell.split(" | ")
                if metric in ("time", "time_p99"):
                    rows.setdefault(solver.removeprefix("solver="), {})[metric] = value
    return pd.DataFrame(rows, ["time", "time_p99"]).T


@figure("mpc-times", "computing time of a period of the MPC: the solver of this project and others",
        stored_times)  # fmt: skip
def mpc_times(times: pd.DataFrame) -> Figure:
    """CPU time of a unit of four axles with 20 steps of prediction: a mark at the median, a line from there to 99 %.

    Dashed: the control period, within which a command has to be there. The compiled step is a whole period with belief and
    search, every other time is that of a solve alone; times of others include Python. Nothing is stored of the greatest
    times, of other horizons, and of a train's controller.
    """
    drawn, one = new_panels(PAGE, 1.2 + 0.16 * max(len(times), 6))
    found = times.sort_values("time")
    for y, (solver, (median, most)) in enumerate(zip(found.index, found.to_numpy(), strict=True)):
        look = next(look for kind, (_, look) in KINDS.items() if re.match(kind, str(solver)))
        one.plot(
            [median, most],
            [y, y],
            color=look["color"],
            linewidth=1.2,
            gid=f"{solver}, median to 99 %",
        )
        one.plot([median], [y], **look, markersize=4.0, linestyle="none", gid=f"{solver}, median")
    one.axvline(PERIOD, **BOUND)
    one.set_xscale("log")
    plain_ticks(one.xaxis, LogLocator(10.0))
    one.set(xlabel="computing time of a period [ms]", ylabel="solver")
    bare_rows(one)
    if times.empty:
        one.text(0.5, 0.5, NOT_STORED, transform=one.transAxes, ha="center", va="center")
    else:
        name_rows(one, [str(solver) for solver in found.index])
    looks = [
        handle(words, **look, linestyle="none", markersize=4.0) for words, look in KINDS.values()
    ]
    legend_below(drawn, [*looks, handle("control period", **BOUND)], 2)
    return drawn
