"""Recorded slip events over time: speeds, limits, torque, detection (JP5484215 Figs. 5 and 16)."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from alloc.metrics import evaluate
from alloc.metrics.motion import jerk
from alloc.onboard.parameters import Detector
from alloc.run_attributes import attributes_of
from alloc.spans import spans
from paper_figs.palette import BLUE, GREEN, ORANGE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, recorded
from paper_figs.style import COLUMN, PAGE, along_train, new_panels, rule_colour, train_bar
from studies.scenario.loading import load_scenario

CONTROLLER = "cut-and-ramp"
UNIT = 0
"""The unit whose detection is shown."""
BEFORE, AFTER = 0.5, 0.8
"""Time shown around the onset of its longest signal [s]."""
BLENDED = 30.0
"""Time of blended braking shown [s]: until the last limits have been lifted."""


@figure("slip-event", "one slip event over time: speeds, slip, torque and limit per car",
        recorded("wet-patch", "alone", CONTROLLER), recorded("wet-patch", "exact", CONTROLLER))  # fmt: skip
def slip_event(*runs: xr.Dataset) -> Figure:
    """One column per run, all of the same train; rows: speeds, slip velocity, torque, limit."""
    width = PAGE if len(runs) > 1 else COLUMN
    shape = {"sharex": True, "sharey": "row", "squeeze": False}
    drawn, axes = new_panels(width, 7.2, 4, len(runs), **shape)
    units = runs[0].sizes["unit"]
    for (speeds, slips, torques, limits), run in zip(axes.T, runs, strict=True):
        time = run["time"].values
        _of_units(speeds, time, 3.6 * _worst_axles(run, "rim_speed"))
        speeds.plot(time, 3.6 * run["speed"].values, color="black", linestyle="--", label="train")
        speeds.plot([], [], color=along_train(units)[0], label="rim, fastest axle of a unit")
        _of_units(slips, time, _worst_axles(run, "slip_velocity"))
        _of_units(torques, time, run["motor_torque"].values)
        _of_units(limits, time, run["limit"].values)
        limits.plot(time, run["expected"].values, color="black", linestyle="--", label="plan")
        rule = attributes_of(run)["rule"]
        speeds.set_title(
            f"rule {rule}, controller {attributes_of(run)['controller']}", color=rule_colour(rule)
        )
        limits.set(xlabel="time [s]", xlim=(0.0, float(time[-1])))
    first = axes[:, 0]
    first[0].legend(loc="best")
    first[3].legend(loc="best")
    first[3].xaxis.set_major_locator(MultipleLocator(5.0))
    labels = ("speed [km/h]", "slip velocity [m/s]", "motor torque [N m]", "limit [–]")
    for one, label in zip(first, labels, strict=True):
        one.set_ylabel(label)
    drawn.align_ylabels(first.tolist())
    if units > 1:
        train_bar(drawn, axes[:, -1], units, "traction unit (1 = foremost)")
    return drawn


def _of_units(axes: Axes, time: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """A line per unit, `values` (time, unit)."""
    for own, colour in zip(values.T, along_train(values.shape[1]), strict=True):
        axes.plot(time, own, color=colour, linewidth=0.9)


def _worst_axles(run: xr.Dataset, name: str) -> NDArray[np.float64]:
    """Of each unit the axle that has it worst, (time, unit)."""
    unit, values = run["axle_unit"].values, run[name].values
    columns = []
    for j in range(run.sizes["unit"]):
        own = values[:, unit == j]
        columns.append(own[np.arange(own.shape[0]), np.abs(own).argmax(axis=1)])
    return np.stack(columns, axis=1)


@figure("sharing-wanders", "limits, torque and jerk of dynamic sharing beside the reference rule",
        recorded("very-low-adhesion", "sharing", CONTROLLER),
        recorded("very-low-adhesion", "greedy", CONTROLLER))  # fmt: skip
def sharing_wanders(*runs: xr.Dataset) -> Figure:
    """One column per run; rows: limits, torque, jerk of the worst car."""
    shape = {"sharex": True, "sharey": "row", "squeeze": False}
    drawn, axes = new_panels(PAGE, 5.4, 3, len(runs), **shape)
    for (limits, torques, jerks), run in zip(axes.T, runs, strict=True):
        time, colour = run["time"].values, rule_colour(attributes_of(run)["rule"])
        _of_units(limits, time, run["limit"].values)
        _of_units(torques, time, run["motor_torque"].values)
        values = jerk(run)
        worst = int(np.argmax((values**2).mean(axis=0)))
        jerks.plot(time, values[:, worst], color=colour)
        rms = evaluate(run)["jerk_rms"]
        limits.set_title(f"{attributes_of(run)['rule']}: jerk {rms:.2f} m/s³ rms", color=colour)
        jerks.set_xlabel("time [s]")
    for one, label in zip(
        axes[:, 0], ("limit [–]", "motor torque [N m]", "jerk [m/s³]"), strict=True
    ):
        one.set_ylabel(label)
    lines = axes[0, 1].get_lines()
    names = [f"unit {j + 1}" for j in range(len(lines))]
    axes[0, 1].legend(lines, names, loc="upper right", ncols=2)
    drawn.align_ylabels(axes[:, 0].tolist())
    return drawn


@figure("slip-detection", "acceleration of a unit, thresholds and slip signal (JP5484215 Fig. 5)",
        recorded("wet-patch", "alone", CONTROLLER),
        made(lambda: load_scenario("wet-patch").event().onboard.detector))  # fmt: skip
def slip_detection(run: xr.Dataset, detector: Detector, unit: int = UNIT) -> Figure:
    """Around the longest signal of a unit, driving. Rows: acceleration as computed on board; slip; signal.

    The patent's signal follows the acceleration alone; here a slip velocity above a threshold of its own raises it too and
    keeps it on, see `alloc.onboard.Detector`.
    """
    time = run["time"].values
    signal = run["slipping"].values[:, unit].astype(bool)
    begin, end = spans(signal).T
    onset = int(begin[np.argmax(end - begin)]) if begin.size else 0
    start = float(time[onset]) - BEFORE
    shown = (time >= start) & (time <= start + BEFORE + AFTER)
    time, on = time[shown], signal[shown]
    computed = run["computed_acceleration"].values[shown, unit]
    slip = run["slip_velocity"].values[:, run["axle_unit"].values == unit].max(axis=1)[shown]
    heights = (3.0, 2.0, 0.9)
    drawn, axes = new_panels(PAGE, 4.8, 3, sharex=True, height_ratios=heights)
    upper, middle, lower = axes
    _thresholds(upper, time, computed, on, detector.on, detector.off, "m/s²")
    upper.set_ylabel("axle acceleration,\nunit's mean [m/s²]")
    upper.set_title(
        f"unit {unit + 1} of {run.sizes['unit']}, rule {attributes_of(run)['rule']}, {attributes_of(run)['event']}"
    )
    _thresholds(middle, time, slip, on, detector.speed_on, 0.5 * detector.speed_on, "m/s")
    middle.set_ylabel("slip of its\nworst axle [m/s]")
    lower.step(time, on.astype(float), where="post", color="black")
    lower.set(ylim=(-0.2, 1.2), xlabel="time [s]", ylabel="signal", xlim=time[[0, -1]])
    lower.set_yticks([0, 1], ["off", "on"])
    drawn.align_ylabels(axes.tolist())
    return drawn


def _thresholds(
    axes: Axes, time: NDArray[np.float64], value: NDArray[np.float64], signal: NDArray[np.bool_],
    on: float, off: float, unit: str,
) -> None:  # fmt: skip
    held = signal | np.concatenate([[False], signal[:-1]])  # a sample holds until the next one
    axes.fill_between(
        time, 0.0, 1.0, where=held.tolist(), step="post", transform=axes.get_xaxis_transform(),
        color="#bbbbbb", alpha=0.35, linewidth=0, label="signal on",
    )  # fmt: skip
    axes.plot(time, value, color=BLUE)
    axes.axhline(on, color=VERMILION, linestyle="--", label=f"on above {on:g} {unit}")
    axes.axhline(off, color=GREEN, linestyle=":", label=f"off below {off:g} {unit}")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.25 * (high - low))  # room for the legend
    axes.legend(loc="upper left", ncols=3)


@figure("blended-braking", "electric and air brake under limits (JP5484215 Fig. 16)",
        recorded("wet-stop", "greedy", CONTROLLER))  # fmt: skip
def blended_braking(run: xr.Dataset) -> Figure:
    """Rows: forces of the foremost unit, forces of the rearmost, cylinder pressures."""
    run = run.sel(time=slice(0.0, BLENDED))
    drawn, axes = new_panels(PAGE, 6.0, 3, sharex=True)
    _forces(axes[0], run, 0, "foremost motor car")
    _forces(axes[1], run, run.sizes["unit"] - 1, "rearmost motor car")
    axes[1].sharey(axes[0])
    _pressures(axes[2], run)
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    axes[2].set(xlabel="time [s]", xlim=(0.0, BLENDED))
    drawn.align_ylabels(axes.tolist())
    return drawn


def _forces(axes: Axes, run: xr.Dataset, unit: int, title: str) -> None:
    time = run["time"].values
    to_rim = float(run["unit_gear"][unit] / run["unit_radius"][unit]) / 1e3
    electric = np.maximum(-run["motor_torque"].values[:, unit], 0.0) * to_rim
    air = run["brake_force"].values[:, run["axle_unit"].values == unit].mean(axis=1) / 1e3
    load = float(run["unit_static_load"][unit]) / int((run["axle_unit"] == unit).sum()) / 1e3
    axes.stackplot(
        time, electric, air, colors=(BLUE, ORANGE), alpha=0.75,
        labels=("electric brake", "air brake"),
    )  # fmt: skip
    limit, plan = run["limit"].values[:, unit] * load, run["expected"].values * load
    axes.plot(time, limit, color="black", label="limit, at the rail")
    axes.plot(time, plan, color="black", linestyle="--", linewidth=0.9, label="plan")
    axes.set(ylabel="force per axle [kN]", title=title)


def _pressures(axes: Axes, run: xr.Dataset) -> None:
    time, pressure = run["time"].values, run["cylinder_pressure"].values / 1e3
    cars, units = run["axle_car"].values, run["axle_unit"].values
    first, last = (int(cars[units == j][0]) for j in (0, run.sizes["unit"] - 1))
    axes.plot(time, pressure[:, 0], color=GREEN, label="lead trailer")
    axes.plot(time, pressure[:, 2 * first], color=BLUE, label="foremost motor car")
    axes.plot(time, pressure[:, 2 * last], color=ORANGE, label="rearmost motor car")
    axes.set_ylabel("cylinder pressure [kPa]")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
