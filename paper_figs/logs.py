"""What the log of a train tells: speeds, slips found, coefficients, wheel damage, brake force per car."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from paper_figs.drawing import Source, figure
from paper_figs.events import (
    AXLE,
    COEFFICIENT_SHADES,
    LEAST_SLIP,
    SLIP_SHADES,
    axle_map,
    shade_bar,
)
from paper_figs.style import BLACK, BLUE, DARK, GREY, NOTE, PAGE, VERMILION, new_figure
from studies.logs.measured_log import MeasuredLog, check_log
from studies.logs.measured_run import Findings, analyse_run
from studies.logs.simulated import log_table, rounded
from studies.logs.train import MeasuredTrain
from studies.scenario.scenario import load_scenario

SCENARIO, RULE, CONTROLLER = "wet-patch", "greedy", "cut-and-ramp"

MAP_HEIGHT = 1.35
"""Of a picture of all axles [inches]."""
NO_ONSET = "no slip or\nslide was found"
DEVIATIONS = 2
"""Standard deviations that are drawn of an estimated speed."""


def example_log(source: Source) -> MeasuredLog:
    """Need: a simulated run that was exported as a log."""
    run = source.run(SCENARIO, RULE, CONTROLLER)
    train = load_scenario(SCENARIO).event(0).model.train
    return check_log(rounded(log_table(run, train)), MeasuredTrain.of(train), SCENARIO)


@figure("measured-log", "what a train's log tells: slips found, coefficients, Q, brake force per car",
        example_log)  # fmt: skip
def measured_log(log: MeasuredLog, found: Findings | None = None) -> Figure:
    """Over time: speeds; slip, coefficient and brake force, a row per axle or car. At the right what it comes to per axle.

    `found` is what the log's analysis found, by default under the default criterion of slips.
    """
    if found is None:
        found = analyse_run(log.run, log.train)
    has_force, cars = bool(found.covered.any()), found.car_force is not None
    heights = (0.9, MAP_HEIGHT, *has_force * (MAP_HEIGHT,), *cars * (MAP_HEIGHT,))
    drawn = new_figure(PAGE, 0.8 + sum(heights))
    grid = drawn.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=(4.0, 1.0))
    speeds = drawn.add_subplot(grid[0, 0])
    rows = [drawn.add_subplot(grid[k, 0], sharex=speeds) for k in range(1, len(heights))]
    sides = [drawn.add_subplot(grid[k, 1]) for k in range(1, 2 + has_force)]
    _speeds(speeds, log)
    _slips(drawn, rows[0], log, found)
    if has_force:
        _coefficients(drawn, rows[1], log, found)
        _onsets(sides[1], found)
        _per_axle(sides[0], 1e-3 * found.axle_damage, "Q [kJ]")
        sides[0].set_title(f"Q, all: {1e-3 * found.total_damage:.3g} kJ")
    else:
        _per_axle(sides[0], found.slipping_time, "time [s]")
        sides[0].set_title("time in slips")
    if found.car_force is not None:
        force = axle_map(
            rows[-1], log.run.time, 1e-3 * found.car_force, COEFFICIENT_SHADES,
            Normalize(0.0, _top(1e-3 * found.car_force)),
        )  # fmt: skip
        rows[-1].set(title="brake force of each car", ylabel="car (1 = foremost)")
        shade_bar(drawn, force, [rows[-1]], "force [kN]")
    for own, side in zip(rows, sides, strict=False):
        side.set_ylim(own.get_ylim())
        side.tick_params(axis="y", labelleft=False)
    for one in (speeds, *rows[:-1]):
        one.tick_params(axis="x", labelbottom=False)
    rows[-1].set(xlabel="time [s]", xlim=(log.run.time[0], log.run.time[-1]))
    rows[-1].xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    drawn.align_ylabels([speeds, *rows])
    return drawn


def _top(values: NDArray[np.float64]) -> float:
    """Largest of what is known; 1 where nothing is."""
    largest = float(np.nanmax(values, initial=0.0))
    return largest if largest > 0.0 else 1.0


def _broken(log: MeasuredLog, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Time and values with a nan at every gap, so that no line is drawn across one."""
    gaps = np.flatnonzero(np.diff(log.run.part)) + 1
    return np.insert(log.run.time, gaps, np.nan), np.insert(values, gaps, np.nan)


def _speeds(axes: Axes, log: MeasuredLog) -> None:
    """The train's speed, and the fastest and slowest wheel beside it."""
    rims = np.ma.masked_invalid(3.6 * log.run.rim_speed)
    for name, colour, values in (
        ("fastest wheel", VERMILION, rims.max(axis=1)),
        ("slowest wheel", BLUE, rims.min(axis=1)),
    ):
        axes.plot(*_broken(log, values.filled(np.nan)), color=colour, linewidth=0.8, label=name)
    source = log.run.speed_source
    name = "train" if source == "measured" else f"train, {source}"
    axes.plot(*_broken(log, 3.6 * log.run.speed), color=BLACK, linestyle="--", label=name)
    axes.set(ylabel="speed [km/h]", ylim=(0.0, None), title=_error(log))
    # at the right, where no panel stands
    axes.legend(loc="upper left", bbox_to_anchor=(1.05, 1.0)).set_in_layout(False)


def _error(log: MeasuredLog) -> str:
    """What is stated of the error of a speed that is no channel of its own."""
    deviation = log.run.speed_deviation
    if log.run.speed_source == "measured" or deviation is None:
        return ""
    error = DEVIATIONS * float(np.nanmedian(deviation))
    return f"stated error of the train's speed: ± {error:.2g} m/s ({DEVIATIONS} deviations, median)"


def _slips(drawn: Figure, axes: Axes, log: MeasuredLog, found: Findings) -> None:
    """Slip of every axle, and a ring where each slip found is largest."""
    time, slip = log.run.time, np.abs(found.slip_velocity)
    image = axle_map(axes, time, slip, SLIP_SHADES, Normalize(0.0, max(LEAST_SLIP, _top(slip))))
    marks = []
    for event in found.events:
        inside = np.flatnonzero((time >= event.start) & (time <= event.end))
        worst = inside[int(np.nanargmax(slip[inside, event.axle]))]
        marks.append((time[worst], event.axle + 1))
    _mark(axes, marks, "o")
    axes.set(
        ylabel=AXLE,
        title=f"slip of every axle; rings: {len(marks)} slips and slides found, at their largest",
    )
    shade_bar(drawn, image, [axes], "slip [m/s]")


def _coefficients(drawn: Figure, axes: Axes, log: MeasuredLog, found: Findings) -> None:
    """Tangential force over load of every axle, and a diamond where a slip begins."""
    values = np.abs(found.coefficient)
    image = axle_map(axes, log.run.time, values, COEFFICIENT_SHADES, Normalize(0.0, _top(values)))
    known = [one for one in found.events if np.isfinite(one.onset_coefficient)]
    _mark(axes, [(one.onset_time, one.axle + 1) for one in known], "D")
    axes.set(
        ylabel=AXLE,
        title="coefficient of every axle; diamonds: onset of a slip, where the adhesion shows",
    )
    shade_bar(drawn, image, [axes], "coefficient [–]")


def _onsets(axes: Axes, found: Findings) -> None:
    """Adhesion as it shows at the onset of each slip, by axle."""
    known = [one for one in found.events if np.isfinite(one.onset_coefficient)]
    places = [(one.onset_coefficient, one.axle + 1) for one in known]
    _mark(axes, places, "D")
    axes.set(title="adhesion at onset", xlabel="coefficient [–]")
    axes.set_xlim(0.0, 1.15 * max((place[0] for place in places), default=1.0))
    if not places:
        axes.text(
            0.5, 0.5, NO_ONSET, transform=axes.transAxes, ha="center", va="center", fontsize=NOTE, color=DARK,
        )  # fmt: skip


def _per_axle(axes: Axes, values: NDArray[np.float64], label: str) -> None:
    axes.barh(np.arange(values.size) + 1, np.nan_to_num(values), height=0.8, color=GREY)
    axes.set(xlabel=label, xlim=(0.0, 1.1 * _top(values)))
    axes.grid(visible=False, axis="y")


def _mark(axes: Axes, points: Sequence[tuple[float, float]], marker: str) -> None:
    if points:
        x, y = zip(*points, strict=True)
        axes.plot(
            x, y, linestyle="none", marker=marker, markersize=4.5, color=BLUE,
            markerfacecolor="none", markeredgewidth=0.9,
        )  # fmt: skip
