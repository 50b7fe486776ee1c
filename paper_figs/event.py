"""Slip events: a run over time, the allocation at an instant, controllers on one drop, and an event that moves.

`python -m paper_figs.event [FILE.gif]` writes the moving picture of the README.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from alloc.evaluation.metrics import evaluate
from alloc.laws import window
from alloc.onboard.controllers import CONTROLLERS
from alloc.plant.rows import rows_of_train
from alloc.rules import RULES
from alloc.run.event import Event
from paper_figs.style import NARROW, WIDE, Drawing
from studies.files.scenario_files import load_scenario
from studies.run_cell import recorded

OFFERED, DARK, MOTOR_CAR = "#c6dcef", "#444444", "#dfe7ee"
ADHESION = LinearSegmentedColormap.from_list("adhesion", ["#08306b", "#6baed6", "#f4f9fd"])
"""From a slippery rail (dark) to a good one (nearly white)."""
SLIP = LinearSegmentedColormap.from_list("slip", ["#ffffff", "#fdae61", "#a63603", "#4d1a00"])
"""From a wheel that rolls (white) to one that spins or slides (dark)."""
LEAST_SLIP = 0.1
"""Slip velocity [m/s] that the darkest shade stands for at least: less is creep."""
DASHED: dict[str, Any] = {"color": "black", "linewidth": 0.7, "linestyle": (0, (2.5, 1.5))}
COLUMNS = 600
"""Instants that a page can print beside each other."""
Floats = NDArray[np.float64]


def find_use(run: xr.Dataset, units: Sequence[int]) -> Floats:
    """Coefficients over time, (3, time): what the rail offers these units, what they use of it, and their limit.

    Means over their axles, weighted with the loads.
    """
    member = np.isin(run["axle_unit"].values, units)
    load, weight = run["axle_load"].values[:, member], run["unit_static_load"].values[list(units)]
    offered = (run["adhesion_limit"].values[:, member] * load).sum(axis=1)
    used = np.abs(run["rail_force"].values[:, member].sum(axis=1))
    limit = run["limit"].values[:, list(units)] @ weight / weight.sum()
    return np.array([offered / load.sum(axis=1), used / load.sum(axis=1), limit])


def _rule_colour(run: xr.Dataset) -> str:
    """That of the run's rule; grey where it is no registered one."""
    rule = RULES.get(run.attrs["rule"])
    return DARK if rule is None else rule.colour


# a run over time


def draw_course(*runs: xr.Dataset) -> Figure:
    """A column for each run of one train: adhesion and slip of every axle, then what units have, may use and use.

    Of many units the foremost and the rearmost are shown, and all together.
    """
    count = runs[0].sizes["unit"]
    strips = {f"unit {unit + 1} of {count}": [unit] for unit in sorted({0, count - 1})}
    strips["all units"] = list(range(count))
    heights = (1.3, 1.3, *[1.0] * len(strips))
    drawn = Figure(figsize=(WIDE if len(runs) > 1 else NARROW, 5.2), layout="constrained")
    panels = drawn.subplots(
        len(heights), len(runs), squeeze=False, sharex=True, sharey="row", height_ratios=heights
    )
    maps = (
        ("adhesion_limit", np.minimum, 0.0, ADHESION, "adhesion [1]"),
        ("slip_velocity", np.maximum, LEAST_SLIP, SLIP, "slip [m/s]"),
    )
    for row, (name, keep, least, shades, label) in zip(panels, maps, strict=False):
        arrays = [np.abs(run[name].values) for run in runs]
        scale = Normalize(0.0, max(least, *(values.max() for values in arrays)))
        for axes, run, values in zip(row, runs, arrays, strict=True):
            time, axles = run["time"].values, values.shape[1]
            shown = keep.reduceat(values, np.arange(0, time.size, -(-time.size // COLUMNS)))
            look: dict[str, Any] = {"norm": scale, "aspect": "auto", "interpolation": "none"}
            extent = (time[0], time[-1], axles + 0.5, 0.5)
            shade = axes.imshow(shown.T, cmap=shades, extent=extent, **look)
            axes.set_yticks(sorted({1, axles // 2, axles} - {0}))
            axes.grid(visible=False)
        row[0].set_ylabel("axle")
        drawn.colorbar(shade, ax=row.tolist(), label=label, aspect=12, pad=0.02)
    top = 1.3 * max(float(run["limit"].max()) for run in runs)  # more adhesion serves nothing
    for column, run in zip(panels.T, runs, strict=True):
        for axes, (name, units) in zip(column[2:], strips.items(), strict=True):
            _draw_strip(axes, run, units)
            axes.set_title(name, loc="right", pad=2.0)
            axes.set(ylim=(0.0, top), xlim=run["time"].values[[0, -1]])
        share = 100.0 * evaluate(run)["bound_use"]
        result = "" if np.isnan(share) else f": {share:.1f} % of the possible"
        axes.set_title(f"all units{result}", loc="right", pad=2.0)
        axes.set_xlabel("time [s]")
        title = f"{run.attrs['rule']}, {run.attrs['controller']}"
        title = title if len(runs) > 1 else f"{run.attrs['event']}: {title}"
        column[0].set_title(title, color=_rule_colour(run))
    for axes in panels[2:, 0]:
        axes.set_ylabel("coefficient [1]")
    drawn.align_ylabels(panels[:, 0].tolist())
    drawn.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return drawn


def _draw_strip(axes: Axes, run: xr.Dataset, units: Sequence[int]) -> None:
    """What units have, may use and use, over time."""
    time, (offered, used, limit) = run["time"].values, find_use(run, units)
    axes.fill_between(time, 0.0, offered, color=OFFERED, linewidth=0.0, label="the rail offers")
    axes.plot(time, limit, label="limit", **DASHED)
    axes.plot(time, used, color=_rule_colour(run), linewidth=0.9, label="used")


# rules and controllers beside each other

COMPARED = ("alone", "preset", "sharing", "greedy", "exact", "cooperative", "oracle")
INSTANT = 11.5
"""Of the event wet-patch [s]: the front is on the patch, the rear is not."""


def draw_allocation() -> Figure:
    """What each rule makes of one instant of one event."""
    drawn = Figure(figsize=(WIDE, 1.9), layout="constrained")
    panels = drawn.subplots(1, len(COMPARED), sharey=True)
    for axes, rule in zip(panels, COMPARED, strict=True):
        run = recorded(load_scenario("wet-patch"), rule, "perturb-observe", 0)
        at = run.sel(time=slice(INSTANT - 0.25, INSTANT + 0.25))
        each = np.array([find_use(at, [unit]).mean(axis=1) for unit in range(run.sizes["unit"])])
        plan = float(at["plan"].mean())
        _draw_bars(axes, each, RULES[rule].colour)
        axes.axhline(plan, label="plan", **DASHED)
        title = f"{rule}\n{100.0 * each[:, 1].mean() / plan:.0f} % of plan"
        axes.set_title(title, loc="center", color=RULES[rule].colour)
    panels[0].set_ylabel("coefficient [1]")
    handles = panels[0].get_legend_handles_labels()
    drawn.legend(*handles, loc="outside lower center", ncols=4)
    return drawn


def _draw_bars(axes: Axes, each: Floats, colour: str) -> None:
    """Of each unit what the rail offers, what it uses, and its limit, (units, 3)."""
    units = np.arange(1, len(each) + 1)
    axes.bar(units, each[:, 0], 0.9, color=OFFERED, label="the rail offers")
    axes.bar(units, each[:, 1], 0.55, color=colour, label="used")
    axes.hlines(each[:, 2], units - 0.45, units + 0.45, color="black", label="limit")
    axes.set(xlabel="unit", xticks=units)
    axes.grid(visible=False, axis="x")


def draw_adhesion_drop() -> Figure:
    """Controllers that wait for a slip, hold a slip, and search for the peak."""
    drawn = Figure(figsize=(WIDE, 3.8), layout="constrained")
    panels = drawn.subplot_mosaic("aad\nbbd\nccd")
    force, torque, slip, path = (panels[name] for name in "abcd")
    force.sharex(slip)
    torque.sharex(slip)
    event, across = load_scenario("falling-adhesion"), np.linspace(0.0, 0.3, 200)
    for name in ("cut-and-ramp", "pi-creep", "perturb-observe"):
        run = recorded(event, "alone", name, 0).sel(time=slice(5.0, 10.0))
        axle = run.isel(axle=int(np.argmax(run["axle_unit"].values == 0)))
        look: dict[str, Any] = {"color": CONTROLLERS[name].colour, "linewidth": 0.9}
        force.plot(run["time"], axle["coefficient"], **look)
        torque.plot(run["time"], run["motor_torque"][:, 0], **look)
        slip.plot(run["time"], axle["slip_velocity"], label=name, **look)
        path.plot(axle["slip_velocity"], axle["coefficient"], **look)
    rail = axle["adhesion_limit"].values
    force.fill_between(run["time"], 0.0, rail, color=OFFERED, linewidth=0.0)
    for level in rail[[0, -1]]:
        path.plot(across, event.event().rail.curve(across, level), **DASHED)
    force.set(ylabel="coefficient [1]", ylim=(0.0, 0.2))
    force.set_title("(a) foremost driven axle; filled: what the rail offers")
    torque.set(ylabel="torque [N m]", ylim=(0.0, 900.0))
    torque.set_title("(b) its motors")
    slip.set(xlabel="time [s]", ylabel="slip [m/s]", xlim=(5.0, 10.0), ylim=(0.0, 0.5))
    path.set(xlabel="slip [m/s]", ylabel="coefficient [1]", xlim=(0.0, 0.3), ylim=(0.0, 0.2))
    path.set_title("(d) dashed: its curve before and after")
    slip.set_title("(c) its slip")
    slip.legend(ncols=3, loc="upper left")
    return drawn


# an event that moves

FRAMES, RATE, BEFORE = 80, 9, 1.5
"""Pictures, pictures a second, and the time [s] before the first slip at which it begins."""


def write_film(path: Path, name: str = "wet-patch", rule: str = "cooperative") -> None:
    """Write an event under `rule` and cut-and-ramp as a GIF: train and rail, each unit, and all units over time."""
    run, event = recorded(load_scenario(name), rule, "cut-and-ramp", 0), load_scenario(name).event()
    time, slip = run["time"].values, np.abs(run["slip_velocity"].values)
    worst, units = slip.max(axis=1), range(run.sizes["unit"])
    first = np.searchsorted(time, time[np.argmax(worst > 0.5 * worst.max())] - BEFORE)
    instants = np.linspace(first, time.size - 1, FRAMES).astype(int)
    each = np.array([find_use(run, [unit]) for unit in units])
    drawn = Figure(figsize=(NARROW, 3.3), layout="constrained")
    line, bars, whole = drawn.subplots(3, 1, height_ratios=(0.5, 1.0, 0.8))

    def show_frame(frame: int) -> None:
        k = instants[frame]
        for axes in (line, bars, whole):
            axes.clear()
        _draw_train(line, event, run, k, worst.max())
        _draw_bars(bars, each[:, :, k], _rule_colour(run))
        bars.set(xlim=(len(units) + 0.6, 0.4), ylim=(0.0, 1.3 * each.max()))
        bars.set_ylabel("coefficient [1]")
        bars.legend(loc="upper center", ncols=3)
        _draw_strip(whole, run, units)
        whole.axvspan(time[k], time[-1], color="white", alpha=0.85, linewidth=0.0, zorder=5)
        whole.set(xlim=time[instants[[0, -1]]], ylim=0.0, xlabel="time [s]")
        whole.set_ylabel("all units [1]")

    moving = FuncAnimation(drawn, show_frame, FRAMES, init_func=lambda: None)
    moving.save(path, PillowWriter(RATE), dpi=200)


def _draw_train(axes: Axes, event: Event, run: xr.Dataset, k: int, worst: float) -> None:
    """Cars, wheels and rail at instant `k`, the front at 0; of each wheel the largest slip of the last tenth of a second."""
    at, axles, front = run.isel(time=k), rows_of_train(event.train).wheelsets, 0.0
    for car in event.train.cars:
        corner, face = (front - car.length + 0.5, 0.42), MOTOR_CAR if car.motors else "white"
        axes.add_patch(Rectangle(corner, car.length - 1.0, 0.5, facecolor=face, edgecolor=DARK))
        front -= car.length
    places = np.linspace(front, 0.0, 400)
    factor = np.ones((1, places.size))
    for patch in event.rail.patches:
        near = window(float(at["position"]) + places, patch.start, patch.end, patch.edge)
        now = window(float(at["time"]), patch.begin, patch.until, patch.fade)
        factor *= 1.0 + near * now * (patch.factor - 1.0)
    extent, scale = (front, 0.0, 0.0, 0.14), Normalize(0.3, 1.0)
    axes.imshow(factor, cmap=ADHESION, norm=scale, aspect="auto", extent=extent)
    slip = np.abs(run["slip_velocity"].values[max(0, k - 10) : k + 1]).max(axis=0)
    look: dict[str, Any] = {"edgecolors": "black", "linewidths": 0.5, "cmap": SLIP}
    size = np.where(axles.unit >= 0, 12.0, 6.0)
    axes.scatter(axles.offset, 0.27 + 0.0 * size, size, slip, vmin=0.0, vmax=worst, **look)
    note = "darker wheels slip more, darker rail is slipperier"
    axes.text(0.5 * front, -0.3, note, ha="center", color=DARK)
    instant = f"{float(at['time']):4.1f} s, {3.6 * float(at['speed']):2.0f} km/h"
    axes.set_title(f"{run.attrs['rule']}, {run.attrs['controller']}: {instant}")
    axes.set(xlim=(front - 1.0, 1.0), ylim=(-0.3, 1.0))
    axes.set_axis_off()


def draw_slip_event() -> Figure:
    """The README's event without and with sharing."""
    rules = ("alone", "cooperative")
    return draw_course(
        *(recorded(load_scenario("wet-patch"), rule, "cut-and-ramp", 0) for rule in rules)
    )


FIGURES = {
    "slip-event": Drawing(
        draw_slip_event,
        "An eight-car train runs onto a wet patch, and units slip one after another; under cooperative sharing those that "
        "have adhesion to spare make up for the force that is lost.",
    ),
    "allocation-bars": Drawing(
        draw_allocation,
        f"One instant of one event, wet-patch at {INSTANT:g} s, the front on the patch: caps inferred from its slip "
        "(greedy, exact) hold back the rear, which could make up for it; rules that go by each unit's report (sharing, "
        "cooperative) use a part of that, a fixed preset, which hears nobody, as much as sharing; the oracle, which knows "
        "the rail, uses all.",
    ),
    "adhesion-drop": Drawing(
        draw_adhesion_drop,
        "When adhesion falls by a third, cut-and-ramp cuts the torque and raises it until the wheel slips again, "
        "perturb-observe searches and stays near the peak of the new curve, and pi-creep holds a slip far beyond the "
        "peak: between 6.5 s and 10 s the axle carries 98.7, 99.5 and 94.3 % of what the rail offers.",
    ),
}

if __name__ == "__main__":
    with mpl.rc_context(fname=str(Path(__file__).with_name("readhesion.mplstyle"))):
        write_film(Path(sys.argv[1] if len(sys.argv) > 1 else "slip-event.gif"))
