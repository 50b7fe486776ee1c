"""What the log of a train tells: speeds, slips found, coefficients, wheel damage, brake force per car."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.estimation.known_train import MeasuredTrain
from alloc.estimation.measured_run import Findings, analyse_run
from alloc.spans import spans
from paper_figs.palette import VERMILION
from paper_figs.registry import figure
from paper_figs.source import Source
from paper_figs.style import PAGE, along_train, new_panels, train_bar
from studies.logs.export import log_table, rounded
from studies.logs.measured_log import MeasuredLog, check_log
from studies.scenario.loading import load_scenario

SCENARIO, RULE, CONTROLLER = "wet-patch", "greedy", "cut-and-ramp"

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
    """Rows over time: speeds, slip velocity with slips found, coefficient, wheel damage, and brake forces if measured.

    `found` is what the log's analysis found, by default under the default criterion of slips.
    """
    if found is None:
        found = analyse_run(log.run, log.train)
    shown = np.flatnonzero(np.isfinite(found.slip_velocity).any(axis=0))
    has_force, axle_count = bool(found.covered.any()), log.train.radius.size
    rows = 2 + 2 * has_force + (found.car_force is not None)
    drawn, panels = new_panels(PAGE, 0.9 + 1.75 * rows, rows, sharex=True)
    axes = list(panels)
    _axles(axes[0], log, 3.6 * log.run.rim_speed, shown)
    axes[0].plot([], [], color=along_train(axle_count)[0], linewidth=0.8, label="wheels")
    speed = _broken(log, 3.6 * log.run.speed)
    measured = log.run.speed_source == "measured"
    deviation = None if measured else log.run.speed_deviation
    source = "train" if measured else f"train, {log.run.speed_source}"
    axes[0].plot(*speed, color="black", linestyle="--", label=source)
    axes[0].set(ylabel="speed [km/h]", ylim=(0.0, None))
    axes[0].legend(loc="best")
    _axles(axes[1], log, found.slip_velocity, shown)
    if deviation is not None:
        time, error = _broken(log, DEVIATIONS * deviation)
        label = f"stated error of the train's speed, {DEVIATIONS} deviations"
        axes[1].fill_between(time, -error, error, color="0.75", linewidth=0.0, label=label)
        axes[1].legend(loc="best")
    _slips(axes[1], log, found)
    if has_force:
        _axles(axes[2], log, found.coefficient, shown)
        onsets = [
            (event.onset_time, (1.0 if event.kind == "slip" else -1.0) * event.onset_coefficient)
            for event in found.events
        ]
        _mark(axes[2], onsets, "D", "as a slip begins: adhesion estimated")
        axes[2].set_ylabel("coefficient [–]")
        _axles(axes[3], log, 1e-3 * found.damage, shown)
        axes[3].set_ylabel("wheel damage Q\nper axle [kJ]")
        axes[3].set_title(f"all axles: {1e-3 * found.total_damage:.4g} kJ")
    if found.car_force is not None:
        _car_forces(axes[-1], log, found.car_force)
    axes[-1].set(xlabel="time [s]", xlim=(log.run.time[0], log.run.time[-1]))
    drawn.align_ylabels(axes)
    if axle_count > 1:
        of_axles = axes[: rows - (found.car_force is not None)]
        train_bar(drawn, of_axles, axle_count, "axle from the front")
    return drawn


def _broken(log: MeasuredLog, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Time and values with a nan at every gap, so that no line is drawn across one."""
    gaps = np.flatnonzero(np.diff(log.run.part)) + 1
    return np.insert(log.run.time, gaps, np.nan), np.insert(values, gaps, np.nan)


def _axles(
    axes: Axes, log: MeasuredLog, values: NDArray[np.float64], shown: NDArray[np.int64]
) -> None:
    """A line per axle, `values` (time, axle)."""
    colours = along_train(values.shape[1])
    for i in shown:
        axes.plot(*_broken(log, values[:, i]), color=colours[i], linewidth=0.8)


def _slips(axes: Axes, log: MeasuredLog, found: Findings) -> None:
    """Shade the slips found and mark each at its largest."""
    time = log.run.time
    slipping = np.zeros(time.size, dtype=bool)
    marks = []
    for event in found.events:
        inside = (time >= event.start) & (time <= event.end)
        slipping |= inside
        slip = found.slip_velocity[inside, event.axle]
        worst = int(np.nanargmax(np.abs(slip)))
        marks.append((time[inside][worst], slip[worst]))
    for begin, end in spans(slipping).tolist():  # once, however many axles slip
        axes.axvspan(time[begin], time[end - 1], color=VERMILION, alpha=0.12, linewidth=0.0)
    _mark(axes, marks, "o", "slip or slide found, at its largest")
    axes.set_ylabel("slip velocity [m/s]")


def _mark(axes: Axes, points: list[tuple[float, float]], marker: str, label: str) -> None:
    if points:
        x, y = zip(*points, strict=True)
        axes.plot(
            x, y, linestyle="none", marker=marker, markersize=4, color=VERMILION,
            markerfacecolor="none", label=label,
        )  # fmt: skip
        axes.legend(loc="best")


def _car_forces(axes: Axes, log: MeasuredLog, force: NDArray[np.float64]) -> None:
    cars = force.shape[1]
    for car, colour in enumerate(along_train(cars)):
        own = _broken(log, 1e-3 * force[:, car])
        axes.plot(*own, color=colour, linewidth=0.8, label=f"car {car + 1}")
    axes.set_ylabel("brake force\nper car [kN]")
    axes.legend(loc="best", ncols=min(cars, 6))
