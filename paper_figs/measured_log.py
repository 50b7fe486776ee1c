"""What the log of a train tells: speeds, slips found, coefficients, wheel damage, brake force per car."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.estimation.measured_run import Findings, MeasuredTrain, analyse_run
from alloc.spans import spans
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.logs.export import log_table, rounded
from studies.logs.measured_log import MeasuredLog, check_log
from studies.scenario.loading import load_scenario

SCENARIO, RULE, CONTROLLER = "wet-patch", "greedy", "cut-and-ramp"
COLOURS = LinearSegmentedColormap.from_list("axles", ["#0b2a5b", "#3f7fb5", "#7fb7a0", "#e3b23c"])
"""From the foremost axle or car (dark) to the rearmost (light)."""
FOUND = "#d55e00"
"""What the analysis marks."""

Colours = NDArray[np.float64]


def figure(source: Source) -> Figure:
    """The figure, from a simulated run that was exported as a log."""
    run = source.run(SCENARIO, RULE, CONTROLLER)
    train = load_scenario(SCENARIO).event(0).model.train
    log = check_log(rounded(log_table(run, train)), MeasuredTrain.of(train), SCENARIO)
    return draw(log, analyse_run(log.run, log.train))


def draw(log: MeasuredLog, found: Findings) -> Figure:
    """Rows over time: speeds, slip velocity with slips found, coefficient, wheel damage, and brake forces if measured."""
    shown = np.flatnonzero(np.isfinite(found.slip_velocity).any(axis=0))
    has_force = bool(found.covered.any())
    rows = 2 + 2 * has_force + (found.car_force is not None)
    drawn = new_figure(7.1, 0.9 + 1.75 * rows)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = list(drawn.subplots(rows, 1, sharex=True))
        colours = COLOURS(np.linspace(0.0, 1.0, log.train.radius.size))
        _speeds(axes[0], log, shown, colours)
        _slips(axes[1], log, found, shown, colours)
        if has_force:
            _coefficients(axes[2], log, found, shown, colours)
            _damage(axes[3], log, found, shown, colours)
        if found.car_force is not None:
            _car_forces(axes[-1], log, found)
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(log.run.time[0], log.run.time[-1])
        drawn.align_ylabels(axes)
        if log.train.radius.size > 1:
            _axle_bar(drawn, axes[: rows - (found.car_force is not None)], log.train.radius.size)
    return drawn


def _broken(log: MeasuredLog, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Time and values with a nan at every gap, so that no line is drawn across one."""
    gaps = np.flatnonzero(np.diff(log.run.part)) + 1
    return np.insert(log.run.time, gaps, np.nan), np.insert(values, gaps, np.nan)


def _speeds(axes: Axes, log: MeasuredLog, shown: NDArray[np.int64], colours: Colours) -> None:
    for i in shown:
        axes.plot(*_broken(log, 3.6 * log.run.rim_speed[:, i]), color=colours[i], linewidth=0.8)
    axes.plot([], [], color=colours[0], linewidth=0.8, label="wheels")
    axes.plot(*_broken(log, 3.6 * log.run.speed), color="black", linestyle="--", label="train")
    axes.set_ylabel("speed [km/h]")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="best")


def _slips(
    axes: Axes, log: MeasuredLog, found: Findings, shown: NDArray[np.int64], colours: Colours
) -> None:
    for i in shown:
        axes.plot(*_broken(log, found.slip_velocity[:, i]), color=colours[i], linewidth=0.8)
    time = log.run.time
    slipping = np.zeros(time.size, dtype=bool)
    for event in found.events:
        slipping |= (time >= event.start) & (time <= event.end)
    for begin, end in spans(slipping).tolist():  # once, however many axles slip
        axes.axvspan(time[begin], time[end - 1], color=FOUND, alpha=0.12, linewidth=0.0)
    marks = []
    for event in found.events:
        inside = (time >= event.start) & (time <= event.end)
        slip = found.slip_velocity[inside, event.axle]
        worst = int(np.nanargmax(np.abs(slip)))
        marks.append((time[inside][worst], slip[worst]))
    _mark(axes, marks, "o", "slip or slide found, at its largest")
    axes.set_ylabel("slip velocity [m/s]")


def _mark(axes: Axes, points: list[tuple[float, float]], marker: str, label: str) -> None:
    if points:
        x, y = zip(*points, strict=True)
        axes.plot(
            x, y, linestyle="none", marker=marker, markersize=4, color=FOUND,
            markerfacecolor="none", label=label,
        )  # fmt: skip
        axes.legend(loc="best")


def _coefficients(
    axes: Axes, log: MeasuredLog, found: Findings, shown: NDArray[np.int64], colours: Colours
) -> None:
    for i in shown:
        axes.plot(*_broken(log, found.coefficient[:, i]), color=colours[i], linewidth=0.8)
    marks = [
        (event.onset_time, (1.0 if event.kind == "slip" else -1.0) * event.onset_coefficient)
        for event in found.events
    ]
    _mark(axes, marks, "D", "as a slip begins: adhesion estimated")
    axes.set_ylabel("coefficient [–]")


def _damage(
    axes: Axes, log: MeasuredLog, found: Findings, shown: NDArray[np.int64], colours: Colours
) -> None:
    for i in shown:
        axes.plot(*_broken(log, 1e-3 * found.damage[:, i]), color=colours[i], linewidth=0.8)
    axes.set_ylabel("wheel damage Q\nper axle [kJ]")
    axes.set_title(f"all axles: {1e-3 * found.total_damage:.4g} kJ")


def _car_forces(axes: Axes, log: MeasuredLog, found: Findings) -> None:
    assert found.car_force is not None
    cars = found.car_force.shape[1]
    for car, colour in enumerate(COLOURS(np.linspace(0.0, 1.0, cars))):
        axes.plot(
            *_broken(log, 1e-3 * found.car_force[:, car]), color=colour, linewidth=0.8,
            label=f"car {car + 1}",
        )  # fmt: skip
    axes.set_ylabel("brake force\nper car [kN]")
    axes.legend(loc="best", ncols=min(cars, 6))


def _axle_bar(drawn: Figure, axes: list[Axes], count: int) -> None:
    levels = COLOURS.resampled(count)
    bar = drawn.colorbar(
        mpl.cm.ScalarMappable(norm=Normalize(vmin=0.5, vmax=count + 0.5), cmap=levels),
        ax=axes, shrink=0.4, aspect=18, pad=0.02,
    )  # fmt: skip
    bar.set_ticks([1, count] if count > 4 else list(range(1, count + 1)))
    bar.set_label("axle from the front")
    bar.outline.set_visible(False)
