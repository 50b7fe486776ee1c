"""Greedy redistribution, quadratic program and MPC in one slip event; and the MPC from within."""

from functools import cache
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from alloc.evaluation.metrics import evaluate
from alloc.evaluation.recorded_run import RecordedRun
from alloc.rules import RULES
from alloc.run.simulation import COMMAND, Simulation, simulate
from alloc.schema.tables import Rows
from mpc.problem import BELIEVED, Problem, Weights, solve
from mpc.unit import MPC
from paper_figs.event import DASHED, OFFERED, Floats
from paper_figs.style import LARGE, WIDE, Drawing
from studies.files.scenario_files import load_scenario

EVENT, SEARCH, OPTIMAL = "wet-patch", "perturb-observe", "mpc-casadi"
METHODS = {"greedy": ("greedy", SEARCH), "QP": ("qp", SEARCH), "MPC": ("cooperative", OPTIMAL)}
"""Short name of a method -> its rule, and the controller below."""
INSTANT, HALF, PLANNED = 12.0, 0.25, (8.72, 9.02, 9.5)
"""When the units stand beside each other, half the time of their means, and when plans begin that are shown [s]."""
TRAIN, CLOSE, LONG = (7.0, 21.0), (8.6, 9.8), (8.5, 14.0)
"""When the train is shown, when its foremost unit begins to slip, and when it searches [s]."""
LACK, PLANS, SOUGHT = "#f0e442", "#0072b2", "#e69f00"
EDGED: Any = {"linewidth": 1.3, "path_effects": [withStroke(linewidth=2.1, foreground="0.25")]}


def find_front(run: xr.Dataset) -> list[Floats]:
    """Slip, slip of the peak [m/s], and adhesion [1] of the foremost unit's axle with most slip, (time,) each."""
    axles = np.flatnonzero(run["axle_unit"].values == 0)
    most = axles[run["slip_velocity"].values[:, axles].argmax(axis=1)][:, None]
    names = "slip_velocity", "peak_slip", "adhesion_limit"
    return [np.take_along_axis(run[name].values, most, axis=1)[:, 0] for name in names]


@cache
def run_mpc() -> tuple[xr.Dataset, Rows, Rows]:
    """The event under the MPC; of its foremost unit what the controller remembers and the problems posed, (ticks,)."""
    run, rows = Simulation(load_scenario(EVENT).event(0), *METHODS["MPC"]), []
    for _ in range(run.ticks):
        run.run_to(COMMAND)
        rows.append(run.world.memory[0].copy())
    run.run_to_end()
    memory = MPC.rows_in(np.array(rows)).ravel()
    posed = BELIEVED.rows_in(np.ascontiguousarray(memory.problem)).ravel()
    return run.recorded(), memory, posed


def draw_plans(slips: Axes, torques: Axes) -> None:
    """The slip limit of the foremost unit, and slips and torques that the MPC plans at `PLANNED`, as CasADi solves it."""
    run, memory, posed = run_mpc()
    slip, period = find_front(run)[0], float(run.attrs["control_period"])
    slips.plot(run["time"], posed.limit, color="black", linewidth=0.8, label="slip limit")
    look: Any = {"color": PLANS, "lw": 2.0, "zorder": 3, "marker": "o", "ms": 3.5, "markevery": [0]}
    slips.text(8.93, 0.07, "plans of 0.15 s", color=PLANS)
    for instant in PLANNED:
        k = round(instant / period)
        weights = Weights(float(memory.change_weight[k]), float(memory.slip_weight[k]))
        problem = Problem(posed[k : k + 1], period, int(memory.horizon[k]), weights=weights)
        plan, time = solve(problem), instant + period * np.arange(problem.horizon + 1)
        slips.plot(time, np.append(slip[k], plan.slips), **look)
        torques.step(time, np.append(plan.torques, plan.torques[:, -1]), where="post", **look)


def draw_methods() -> Figure:
    """A column for each method, with equal scales: its units at an instant, the train, its foremost unit."""
    event = load_scenario(EVENT).event(0)
    runs = {name: simulate(event, *parts) for name, parts in METHODS.items() if name != "MPC"}
    runs["MPC"] = run_mpc()[0]
    damage = {name: run["friction_work"].values.sum(axis=1) / 1e3 for name, run in runs.items()}
    with mpl.rc_context(LARGE):
        drawn = Figure(figsize=(WIDE, 7.0), layout="constrained")
        panels = drawn.subplots(5, 3, sharey="row", height_ratios=(1.6, 1.0, 0.9, 1.2, 0.9))
        for column, (name, run) in zip(panels.T, runs.items(), strict=True):
            units, effort, worn, slips, torques = column
            arrays, (slip, peak, _), time = RecordedRun(run), find_front(run), run["time"].values
            look = EDGED | {"color": RULES[run.attrs["rule"]].colour}
            draw_units(units, arrays, look["color"])
            share = f"{100.0 * evaluate(run)['bound_use']:.1f} % of possible"
            title = f"$\\bf{{{name}}}$: {share}\nrule {', '.join(METHODS[name])}"
            units.set_title(title, pad=15.0)
            force, bound = arrays.bounds.force / 1e3, arrays.bounds.bound / 1e3
            effort.fill_between(time, force, bound, where=bound > force, color=LACK, lw=0.0)
            effort.plot(time, bound, **DASHED)
            effort.plot(time, force, **look)
            effort.axvline(INSTANT, color="0.4", linewidth=0.8, linestyle=":")
            worn.plot(time, np.transpose(list(damage.values())), color="0.7", linewidth=0.9)
            worn.plot(time, damage[name], **look)
            worn.text(20.8, 52.0, f"{damage[name][-1]:.0f} kJ at {time[-1]:.0f} s", ha="right")
            slips.plot(time, peak, **DASHED)
            slips.plot(time, slip, **look)
            torques.plot(time, run["motor_torque"].values[:, 0], **look)
        draw_plans(slips, torques)
        name_panels(panels)
        drawn.align_ylabels(panels[:, 0].tolist())
    return drawn


def draw_units(axes: Axes, run: RecordedRun, colour: str) -> None:
    """Of each unit what the rail carries, its limit, what it uses, and what of the train's lack it could give."""
    shown = np.abs(run["time"] - INSTANT) <= HALF
    load, unit = run["unit_static_load"], np.arange(1, run.axles.size + 1)
    rail, motors = (values[shown].mean(axis=0) for values in (run.sums.carried, run.motors))
    used = run["rail_force"][shown].mean(axis=0) @ run.of_unit
    spare = np.maximum(np.minimum(rail, motors) - used, 1.0)
    lack = float((run.bounds.bound - run.bounds.force)[shown].mean())
    more = spare * min(lack / spare.sum(), 1.0)
    more[more < 0.002 * load] = 0.0  # a trace would be taken for a line
    axes.bar(unit, rail / load, 0.9, color=OFFERED)
    axes.bar(unit, used / load, 0.62, color=colour)
    axes.bar(unit, more / load, 0.62, used / load, color=LACK, hatch="////", linewidth=0.0)
    limit = run["limit"][shown].mean(axis=0)
    axes.hlines(limit, unit - 0.45, unit + 0.45, color="black", linewidth=1.4)
    axes.grid(visible=False, axis="x")
    axes.set(xticks=unit, xlabel=f"unit, at {INSTANT:g} s")


def name_panels(panels: Any) -> None:
    """Letters, labels and limits of the panels, and words beside what they name."""
    train: Any = {"xlim": TRAIN, "xticks": (8, 12, 16, 20)}
    front: Any = {"xlim": CLOSE, "xticks": (9, 9.5)}
    rows: Any = (
        ("coefficient [1]", (0.0, 0.29), (0, 0.1, 0.2), {}),
        ("effort [kN]", (120.0, 215.0), (150, 200), train),
        ("wheel\ndamage [kJ]", (40.0, 165.0), (50, 100, 150), train | {"xlabel": "time [s]"}),
        ("slip [m/s]", (0.0, 0.24), (0, 0.1, 0.2), front),
        ("torque [N m]", (450.0, 850.0), (500, 800), front | {"xlabel": "time [s], unit 1"}),
    )  # fmt: skip
    for row, letter, (label, limits, ticks, more) in zip(panels, "abcde", rows, strict=True):
        row[0].set(ylabel=label, ylim=limits, yticks=ticks)
        for axes, number in zip(row, "123", strict=True):
            axes.set(**more)
            axes.tick_params(labelbottom=letter in "ace")
            axes.text(0.0, 1.03, f"({letter}{number})", transform=axes.transAxes)
    for row, column, x, y, text, side, colour in (
        (0, 0, 3.5, 0.25, "the rail carries", "center", "black"),
        (0, 0, 1.0, 0.145, "limit", "center", "black"),
        (0, 0, 2.5, 0.185, "held back", "right", "black"),
        (0, 0, 3.0, 0.07, "used", "center", "white"),
        (1, 0, 13.9, 197.0, "possible", "left", "black"),
        (1, 0, 12.2, 183.0, "lost", "left", "black"),
        (2, 0, 7.3, 140.0, "grey: the others", "left", "0.3"),
        (3, 0, 9.2, 0.02, "slip of the peak", "center", "black"),
        (3, 2, 9.1, 0.19, "slip limit", "left", "black"),
    ):  # fmt: skip
        panels[row, column].text(x, y, text, ha=side, color=colour)


def draw_search() -> Figure:
    """Slip and elasticity while the MPC searches, and plans over its horizon when the unit begins to slip."""
    run, memory, posed = run_mpc()
    curve, (slip, peak, adhesion) = load_scenario(EVENT).event(0).rail.curve, find_front(run)
    time, near = run["time"].values, np.maximum(slip, 1e-6) * np.array([[0.999], [1.001]])
    less, more = (np.log(curve(values, adhesion, run["speed"].values)) for values in near)
    look: dict[str, Any] = {"color": RULES[run.attrs["rule"]].colour}
    with mpl.rc_context(LARGE):
        drawn = Figure(figsize=(WIDE, 4.4), layout="constrained")
        panels = drawn.subplots(2, 2, sharex="col", height_ratios=(1.3, 1.0))
        (slips, close), (elasticity, torques) = panels
        for axes in (slips, close):
            axes.plot(time, memory.sought, color=SOUGHT, linewidth=2.4, label="target slip")
            axes.plot(time, slip, label="slip", **look)
            axes.plot(time, peak, label="slip of the peak", **DASHED)
            axes.set(ylim=(0.0, 0.24), ylabel="slip [m/s]")
        slips.plot(time, posed.limit, color="black", linewidth=0.8, label="slip limit")
        torques.plot(time, run["motor_torque"].values[:, 0], **look)
        draw_plans(close, torques)
        elasticity.plot(time, (more - less) / 0.002, label="true", **look)
        elasticity.plot(time, memory.elasticity, color=PLANS, linestyle="-.", label="believed")
        elasticity.set(xlabel="time [s]", xlim=LONG, ylim=(-0.1, 0.7), ylabel="elasticity [1]")
        torques.set(xlabel="time [s]", xlim=CLOSE, ylim=(450.0, 850.0), ylabel="torque [N m]")
        for axes, letter in zip(panels.flat, "acbd", strict=True):
            axes.text(0.0, 1.03, f"({letter})", transform=axes.transAxes)
            if axes in (slips, elasticity):
                axes.legend()
    return drawn


FIGURES = {
    "methods": Drawing(
        draw_methods,
        "The front slips on a wet patch while the rear has adhesion to spare (wet-patch), so sharing decides: (a) greedy "
        "and QP take the rear's caps from the slip of the front, unit 1, and hold back what the train lacks of what rail "
        "and motors allow; (b) cooperative gives it, (c) for more wheel damage; (d, e) unit 1. Cooperative above "
        "perturb-observe is nearly as good, greedy above the MPC as bad.",
    ),
    "mpc": Drawing(
        draw_search,
        "The foremost unit runs onto the patch: (a) slip follows its limit, which swings, to the peak; (b) the elasticity "
        "believed, relative change of coefficient over that of slip, comes to that of the true curve within 2 s; (c, d) "
        "plans: the first takes the rail for what it was, and at their ends torque rises, since later slip costs nothing.",
    ),
}
