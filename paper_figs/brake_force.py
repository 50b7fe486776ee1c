"""Running tests of the RTRI report, its Figs. 4 to 7, and the car that does not deliver its brake force."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.palette import BLACK, BLUE, GREEN, PINK, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, study
from paper_figs.style import COLUMN, PAGE, new_panels
from studies.brake_force.accusations import driven_rows
from studies.brake_force.faulty_car import Fault, Stop, allocated_stops
from studies.brake_force.findings import running_test_row
from studies.brake_force.running_tests import BRAKED_AT, TestResult, estimate, run_test, smooth
from studies.brake_force.statements import CUT_OUT

LOCOMOTIVE, WAGONS, THEORY, OWN, SMOOTHED = VERMILION, BLUE, BLACK, GREEN, PINK
"""Colours of locomotive, wagons, theory or truth, and wagons with their own accelerations, raw and smoothed."""
ALLOCATED, ESTIMATED, ACCUSED, WRONG = "#b0b0b0", BLUE, VERMILION, BLACK
BEFORE = 1.0
"""Time shown before the driver's command [s]."""
DAY = 0
FEW_DAYS = 3
"""Days of tests with wagons cut out that are run where the results hold none."""
FAULT = Fault(3, (0,))


@figure("brake-locomotive-only", "running test with only the locomotive braked: brake force per car (RTRI report Fig. 4)",
        made(run_test, "locomotive", DAY))  # fmt: skip
def brake_locomotive_only(result: TestResult) -> Figure:
    """Speed, accelerations, coupler force and brake forces over time."""
    return _test(result)


@figure("brake-all-cars", "running test with locomotive and wagons braked (RTRI report Fig. 5)",
        made(run_test, "all", DAY))  # fmt: skip
def brake_all_cars(result: TestResult) -> Figure:
    """Speed, accelerations, coupler force and brake forces over time."""
    return _test(result)


def _test(result: TestResult) -> Figure:
    """Rows: speed, accelerations of locomotive and first wagon, force of the coupler between them, brake forces."""
    m, found, true = result.measured, estimate(result), result.true_force / 1e3
    time = m.time - BRAKED_AT
    heights = (0.8, 1.0, 1.0, 1.3)
    drawn, axes = new_panels(PAGE, 6.6, 4, sharex=True, height_ratios=heights)
    speed, acceleration, coupler, force = axes
    speed.plot(time, 3.6 * m.speed, color="black")
    speed.set(ylabel="speed [km/h]", ylim=(0.0, None))
    # beneath: the wagon's, whose noise and swings are the larger
    for car, colour, label in ((1, WAGONS, "wagon 1"), (0, LOCOMOTIVE, "locomotive")):
        acceleration.plot(time, m.acceleration[:, car], color=colour, linewidth=0.8, label=label)
    acceleration.set_ylabel("acceleration [m/s²]")
    coupler.plot(time, m.coupler_force[:, 0] / 1e3, color="black", linewidth=0.9)
    coupler.set_ylabel("coupler force [kN]")
    coupler.set_title("between locomotive and wagon 1, tension positive")
    for values, dashes, colour, label in (
        (found.wagons / 1e3, "-", WAGONS, "all wagons"),
        (found.locomotive / 1e3, "-", LOCOMOTIVE, "locomotive"),
        (true[:, 1:].sum(axis=1), "--", THEORY, "truth"),
        (true[:, 0], "--", THEORY, "_truth"),
    ):
        force.plot(time, values, dashes, color=colour, linewidth=0.8, label=label)
    force.set(ylabel="brake force [kN]", xlabel="time [s]")
    force.set_xlim(-BEFORE, float(time[result.window.stop]))
    above = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    acceleration.legend(ncols=2, **above)
    force.legend(ncols=3, **above)
    drawn.align_ylabels(axes.tolist())
    return drawn


def _few_days() -> pd.DataFrame:
    """Rows of the tests with wagons cut out on `FEW_DAYS` days."""
    days = range(FEW_DAYS)
    return pd.DataFrame(
        [running_test_row(name, k) | {"event": k} for k in days for name in CUT_OUT]
    )


@figure("brake-cut-out", "averaged brake force over the number of braked wagons (RTRI report Fig. 6)",
        study("brake-force", 1, _few_days))  # fmt: skip
def brake_cut_out(table: pd.DataFrame) -> Figure:
    """Each day's averages with their uncertainty, mean over days, and the line through the means."""
    chosen = table[table["test"].isin(list(CUT_OUT))]
    count = chosen["test"].map(CUT_OUT).astype(float)
    mean, deviation = chosen["mean"].astype(float), chosen["whole_deviation"].astype(float)
    of_day = chosen["event"].rank(method="dense").astype(float)
    aside = 0.3 * (of_day - (of_day.max() + 1.0) / 2.0) / max(float(of_day.max()) - 1.0, 1.0)
    means = mean.groupby(count).mean()
    slope, intercept = np.polyfit(means.index.to_numpy(dtype=float), means.to_numpy(), 1)
    drawn, axes = new_panels(COLUMN, 3.4)
    axes.errorbar(
        count + aside, mean, 1.96 * deviation, fmt="o", color=WAGONS, markersize=2.5,
        elinewidth=0.6, alpha=0.7, label="a day's test, 95 %",
    )  # fmt: skip
    ends = np.array([0.0, 5.4])
    line = f"line through the means: {slope:.1f} kN per wagon"
    axes.plot(ends, slope * ends + intercept, color=THEORY, linewidth=0.9, label=line)
    look = {"color": THEORY, "markersize": 5, "markerfacecolor": "none", "zorder": 4}
    axes.plot(means.index, means, "D", label="mean over days", **look)
    axes.set(xlim=ends, ylim=(0.0, None), xticks=(0, 1, 2, 2.5, 3, 4, 5))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(xlabel="braked wagons [–]", ylabel="averaged brake force of all wagons [kN]")
    axes.legend(loc="upper left")
    return drawn


@figure("brake-emergency", "emergency brake of 18 cars: estimate, theory and remedies (RTRI report Fig. 7)",
        made(run_test, "emergency", DAY))  # fmt: skip
def brake_emergency(result: TestResult) -> Figure:
    """Left, sum of the wagons and first wagon against theory; right, the same with own accelerations, smoothed."""
    found, smoothed = estimate(result), smooth(result)
    time, wagons = result.measured.time - BRAKED_AT, result.test.wagons
    total, deviation = smoothed.total(slice(1, None))
    drawn, axes = new_panels(PAGE, 4.6, 2, 2, sharex=True, sharey="row")
    for (left, right), plain, own, force, band, scale, title in (
        (axes[0], found.wagons, found.wagons_own, total, deviation, wagons, f"(a) {wagons} wagons"),
        (axes[1], found.wagon, found.wagon, smoothed.force[:, 1], smoothed.deviation[:, 1], 1, "(b) wagon 1"),
    ):  # fmt: skip
        left.plot(time, plain / 1e3, color=WAGONS, linewidth=0.7, label="wagon 1's acceleration")
        raw = {"color": OWN, "linewidth": 0.5, "alpha": 0.6, "label": "own accelerations"}
        right.plot(time, own / 1e3, **raw)
        low, high = force - 1.96 * band, force + 1.96 * band
        shade = {"color": SMOOTHED, "alpha": 0.4, "linewidth": 0.0}
        right.fill_between(time, low / 1e3, high / 1e3, **shade)
        right.plot(time, force / 1e3, color=SMOOTHED, linewidth=1.1, label="smoothed, 95 %")
        theory = scale * found.theory / 1e3
        for axis in (left, right):
            axis.plot(time, theory, "--", color=THEORY, linewidth=0.9, label="theory")
        left.set(title=title, ylabel="brake force [kN]")
        right.set_title("remedies")
    top = 1.02 * float(found.wagons[result.window].max() / 1e3)
    axes[0, 0].set_ylim(min(0.0, 1.05 * float(found.wagons.min() / 1e3)), top)
    for axis in axes[1]:
        axis.set(xlabel="time [s]", xlim=(-BEFORE, float(time[result.window.stop])))
    for axis in axes[0]:
        axis.legend(loc="lower right")
    drawn.align_ylabels(axes[:, 0].tolist())
    return drawn


@figure("faulty-car", "which car did not deliver its allocated brake force (sweep brake-force)",
        made(allocated_stops, FAULT, DAY), study("brake-force", 1, lambda: pd.DataFrame(driven_rows(DAY))))  # fmt: skip
def faulty_car(stops: Sequence[Stop], table: pd.DataFrame) -> Figure:
    """Left: allocated and estimated force of each car, one bogie cut out; right: shares found over the shortfall."""
    drawn, (bars, shares) = new_panels(PAGE, 3.1, 1, 2, width_ratios=(1.5, 1.0))
    _stop(bars, stops[0])
    _shares(shares, table[table["part"] == "driven"])
    return drawn


def _stop(axes: Axes, stop: Stop) -> None:
    shortfalls, w = stop.shortfalls(), stop.window
    allocated, estimated = (
        values[w].mean(axis=0) / 1e3 for values in (stop.allocated, stop.estimated)
    )
    car = np.arange(1, allocated.size + 1)
    accused = np.isin(car - 1, shortfalls.accused)
    axes.bar(car - 0.2, allocated, 0.38, color=ALLOCATED, label="allocated")
    axes.bar(car[~accused] + 0.2, estimated[~accused], 0.38, color=ESTIMATED, label="estimated")
    axes.bar(
        car[accused] + 0.2, estimated[accused], 0.38, color=ACCUSED, hatch="///",
        edgecolor="white", linewidth=0.0, label="estimated, accused",
    )  # fmt: skip
    axes.errorbar(
        car + 0.2, estimated, shortfalls.threshold / 1e3, fmt="none", color="black", elinewidth=0.8,
        capsize=2.0, label="threshold",
    )  # fmt: skip
    axes.set_title(f"(a) a stop with one bogie of car {FAULT.car + 1} cut out")
    axes.set(xlabel="car (1 = foremost)", ylabel="brake force at the rails [kN]")
    axes.set(xticks=car, ylim=(0.0, 1.4 * float(allocated.max())))
    axes.legend(loc="upper center", ncols=2)


def _shares(axes: Axes, dry: pd.DataFrame) -> None:
    means = dry.groupby("missing")[["found", "wrong", "whole"]].mean() * 100.0
    asked = means[means.index > 0.0]
    axes.plot(asked.index * 100.0, asked["found"], "o-", color=ESTIMATED, label="faulty car found")
    for column, form, words in (("wrong", "x--", "lacks < 5 %"), ("whole", "+:", "lacks < 1 %")):
        x, label = means.index * 100.0, f"accused, {words}"
        axes.plot(x, means[column], form, color=WRONG, linewidth=0.9, label=label)
    axes.set(title="(b) dry stops", xlabel="brake force missing on one car [%]")
    axes.set(ylabel="share of stops [%]", ylim=(-3.0, 103.0))
    axes.legend(loc="center right")
