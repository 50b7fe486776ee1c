"""Recorded slip events over time: speeds, limits, torque, detection (JP5484215 Figs. 5 and 16)."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from alloc.estimation.series import spans
from alloc.metrics import evaluate
from alloc.metrics.use import jerk
from alloc.onboard.parameters import Detector
from alloc.recording import attributes_of
from paper_figs.adhesion_use import (
    AVAILABLE,
    LIMIT,
    ROOM,
    draw_use,
    shown_units,
    use_handles,
    use_of_units,
)
from paper_figs.axle_maps import (
    ADHESION_SHADES,
    AXLE,
    LEAST_SLIP,
    SLIP_SHADES,
    axle_map,
    name_units,
    shade_bar,
)
from paper_figs.direct_labels import label_lines
from paper_figs.palette import BLUE, GREEN, ORANGE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, recorded
from paper_figs.style import COLUMN, PAGE, new_panels, rule_colour
from studies.scenario.loading import load_scenario

CONTROLLER = "cut-and-ramp"
UNIT = 0
"""The unit whose detection is shown."""
BEFORE, AFTER = 0.5, 0.8
"""Time shown around the onset of its longest signal [s]."""
MAP_HEIGHTS, STRIP_HEIGHT, NAME_HEIGHT = (1.05, 1.05), 0.66, 0.13
"""Of pictures of all axles, of a unit's strip, and of the name above it [inches]."""
BLENDED = 30.0
"""Time of blended braking shown [s]: until the last limits have been lifted."""


@figure("slip-event", "one slip event: adhesion at every axle, slip, and what each unit uses of it under its limit",
        recorded("wet-patch", "alone", CONTROLLER), recorded("wet-patch", "cooperative", CONTROLLER))  # fmt: skip
def slip_event(*runs: xr.Dataset) -> Figure:
    """One column per run, all of the same train.

    Rows: adhesion at every axle, so that a slippery place is seen to pass below the train; slip of every axle; what
    units and train have, use and may use. Possible is what rail and motors allow.
    """
    units = shown_units(runs[0])
    width = PAGE if len(runs) > 1 else COLUMN
    heights = (*MAP_HEIGHTS, *(len(units) + 1) * [STRIP_HEIGHT])
    shape = {"sharex": True, "sharey": "row", "squeeze": False, "height_ratios": heights}
    drawn, axes = new_panels(
        width, 0.9 + sum(heights) + (len(units) + 1) * NAME_HEIGHT, len(heights), len(runs), **shape
    )
    adhesion, slip = _norm(runs, "adhesion_limit"), _norm(runs, "slip_velocity", LEAST_SLIP)
    for column, run in zip(axes.T, runs, strict=True):
        time = run["time"].values
        rail = axle_map(
            column[0], time, run["adhesion_limit"].values, ADHESION_SHADES, adhesion, np.fmin
        )
        slips = axle_map(column[1], time, np.abs(run["slip_velocity"].values), SLIP_SHADES, slip)
        _use_strips(column[2:], run, units)
        for one in column[:2]:
            name_units(one, run["axle_unit"].values, units)
        column[0].set_title(_run_title(run), color=rule_colour(attributes_of(run)["rule"]))
        _time_axis(column[-1], run)
    axes[0, 0].set_ylabel(AXLE)
    axes[1, 0].set_ylabel(AXLE)
    shade_bar(drawn, rail, axes[0], "adhesion [–]")
    shade_bar(drawn, slips, axes[1], "slip [m/s]")
    _explain_strips(drawn, axes[2:, 0])
    drawn.align_ylabels(axes[:, 0].tolist())
    return drawn


def _time_axis(axes: Axes, run: xr.Dataset) -> None:
    axes.set(xlabel="time [s]", xlim=run["time"].values[[0, -1]])
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))


def _explain_strips(drawn: Figure, strips: Sequence[Axes]) -> None:
    """What the strips of the left column share: their quantity, named once, and what is drawn in them."""
    strips[len(strips) // 2].set_ylabel("coefficient [–]")
    drawn.legend(handles=use_handles(), loc="outside lower center", ncols=3)


def _norm(runs: Sequence[xr.Dataset], name: str, least: float = 0.0) -> Normalize:
    """A scale from 0 to the largest magnitude in any run, or to `least`."""
    return Normalize(0.0, max(least, *(float(np.abs(run[name].values).max()) for run in runs)))


def _run_title(run: xr.Dataset) -> str:
    """Rule and controller."""
    attributes = attributes_of(run)
    return f"{attributes['rule']}, {attributes['controller']}"


def _whole_train(run: xr.Dataset) -> str:
    """Name of the strip of all units, with the share used of what could be, where that is known."""
    use = evaluate(run)["bound_use"]
    known = "" if np.isnan(use) else f": {100.0 * use:.1f} % of the possible is used"
    return f"all units{known}"


def _use_strips(panels: Sequence[Axes], run: xr.Dataset, units: list[int]) -> None:
    """A strip for each of `units`, and one more for all units of the train if there is a panel left."""
    colour = rule_colour(attributes_of(run)["rule"])
    everyone = list(range(run.sizes["unit"]))
    groups = {f"unit {unit + 1}": [unit] for unit in units} | {_whole_train(run): everyone}
    top = ROOM * float(max(np.nanmax(run["limit"].values), np.nanmax(run["expected"].values)))
    for axes, (name, group) in zip(panels, groups.items(), strict=False):
        draw_use(axes, use_of_units(run, group), colour)
        axes.set_ylim(0.0, top)
        axes.set_title(name, loc="right", pad=2.0)  # above: inside it would lie on a line


@figure("sharing-wanders", "limits, torque and jerk of dynamic sharing beside the reference rule",
        recorded("very-low-adhesion", "sharing", CONTROLLER),
        recorded("very-low-adhesion", "greedy", CONTROLLER))  # fmt: skip
def sharing_wanders(*runs: xr.Dataset) -> Figure:
    """One column per run. Rows: what each unit has, uses and may use; jerk of the worst car."""
    units = shown_units(runs[0])
    heights = (*len(units) * [STRIP_HEIGHT], 1.1)
    shape = {"sharex": True, "sharey": "row", "squeeze": False, "height_ratios": heights}
    drawn, axes = new_panels(
        PAGE, 0.9 + sum(heights) + len(units) * NAME_HEIGHT, len(heights), len(runs), **shape
    )
    for column, run in zip(axes.T, runs, strict=True):
        rule = attributes_of(run)["rule"]
        _use_strips(column[:-1], run, units)
        values, rms = jerk(run), evaluate(run)["jerk_rms"]
        worst = int(np.argmax((values**2).mean(axis=0)))
        column[-1].plot(
            run["time"].values, values[:, worst], color=rule_colour(rule), linewidth=0.9
        )
        column[-1].set_title(f"jerk of the worst car; of the train {rms:.2f} m/s³ rms")
        _time_axis(column[-1], run)
        column[0].set_title(rule, color=rule_colour(rule))
    axes[-1, 0].set_ylabel("jerk [m/s³]")
    _explain_strips(drawn, axes[:-1, 0])
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
    """Rows: what foremost and rearmost unit have, use by each brake and may use; cylinder pressures."""
    run = run.sel(time=slice(0.0, BLENDED))
    drawn, axes = new_panels(PAGE, 4.6, 3, sharex=True)
    last = run.sizes["unit"] - 1
    _forces(axes[0], run, 0, "(a) foremost motor car")
    _forces(axes[1], run, last, "(b) rearmost motor car")
    axes[1].sharey(axes[0])
    _pressures(axes[2], run, last)
    _time_axis(axes[2], run)
    drawn.align_ylabels(axes.tolist())
    handles = axes[0].get_legend_handles_labels()[0]
    drawn.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    label_lines(axes[2])
    return drawn


def _forces(axes: Axes, run: xr.Dataset, unit: int, title: str) -> None:
    """Force per axle at the rail, parted between the brakes as their forces at the rim are.

    At the rim the brakes give more, by what stops the wheelsets' own rotation; limit and adhesion hold at the rail.
    """
    own = run["axle_unit"].values == unit
    to_rim = float(run["unit_gear"][unit] / run["unit_radius"][unit])
    electric = np.maximum(-run["motor_torque"].values[:, unit], 0.0) * to_rim
    air = run["brake_force"].values[:, own].mean(axis=1)
    part = electric / np.maximum(electric + air, 1.0)
    use, load = use_of_units(run, [unit]), run["axle_load"].values[:, own].mean(axis=1) / 1e3
    used = use.used * load
    axes.fill_between(
        use.time, 0.0, use.available * load, color=AVAILABLE, linewidth=0.0, label="adhesion available"
    )  # fmt: skip
    axes.stackplot(
        use.time, used * part, used * (1.0 - part), colors=(BLUE, ORANGE), linewidth=0.0,
        labels=("used by the electric brake", "used by the air brake"),
    )  # fmt: skip
    axes.plot(use.time, use.limit * load, **(LIMIT | {"label": "limit by the rule"}))
    # above limits and commands nothing is at stake
    axes.set(ylim=(0.0, ROOM * float((use.limit * load).max())), ylabel="force per axle [kN]")
    axes.set_title(title)


def _pressures(axes: Axes, run: xr.Dataset, last: int) -> None:
    time, pressure = run["time"].values, run["cylinder_pressure"].values / 1e3
    group, units = run["axle_group"].values, run["axle_unit"].values
    places = {"lead trailer": (0, GREEN)} | {
        place: (int(group[units == unit][0]), colour)
        for place, unit, colour in (("foremost", 0, BLUE), ("rearmost", last, VERMILION))
    }
    for name, (own, colour) in places.items():
        axes.plot(time, pressure[:, own], color=colour, label=name)
    axes.set(ylabel="pressure [kPa]", ylim=(0.0, None))
    axes.set_title("(c) brake cylinders of the lead trailer and of these motor cars")
