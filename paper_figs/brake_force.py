"""Running tests of the RTRI report, its Figs. 4 to 7, and the car that does not deliver its brake force."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.direct_labels import label_lines
from paper_figs.palette import BLACK, BLUE, DARK, GREEN, ORANGE, PINK, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, study
from paper_figs.style import COLUMN, PAGE, new_panels
from studies.brake_force.accusations import driven_rows
from studies.brake_force.faulty_car import AllocatedStop, Fault, allocated_stops
from studies.brake_force.findings import running_test_row
from studies.brake_force.running_tests import BRAKED_AT, TestResult, estimate, run_test, smooth
from studies.brake_force.statements import CUT_OUT

LOCOMOTIVE, WAGONS, THEORY, OWN, SMOOTHED = VERMILION, BLUE, BLACK, GREEN, PINK
"""Colours of locomotive, wagons, theory or truth, and wagons with their own accelerations, raw and smoothed."""
ESTIMATED, ACCUSED, WRONG = BLUE, VERMILION, BLACK
BEFORE = 1.0
"""Time shown before the driver's command [s]."""
DAY = 0
FEW_DAYS = 3
"""Days of tests with wagons cut out that are run where the results have none."""
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
    """Above: means over days and the line through them. Below: each day's test, with its uncertainty, off that line."""
    chosen = table[table["test"].isin(list(CUT_OUT))]
    count = chosen["test"].map(CUT_OUT).astype(float)
    mean, deviation = chosen["mean"].astype(float), chosen["whole_deviation"].astype(float)
    of_day = chosen["event"].rank(method="dense").astype(float)
    aside = 0.32 * (of_day - (of_day.max() + 1.0) / 2.0) / max(float(of_day.max()) - 1.0, 1.0)
    means = mean.groupby(count).mean()
    slope, intercept = np.polyfit(means.index.to_numpy(dtype=float), means.to_numpy(), 1)
    drawn, (forces, off) = new_panels(COLUMN, 3.9, 2, sharex=True, height_ratios=(1.3, 1.0))
    ends = np.array([0.0, 5.4])
    forces.plot(ends, slope * ends + intercept, color=THEORY, linewidth=0.9, label="line")
    forces.plot(means.index, means, "D", label="mean", color=WAGONS, markersize=4.5)
    forces.annotate(
        f"line through the means:\n{slope:.1f} kN per wagon, {intercept:.1f} kN with none",
        (ends[1], 0.0), (0.0, 6.0), textcoords="offset points", ha="right", va="bottom",
    )  # fmt: skip
    forces.set(
        ylim=(0.0, None), ylabel="averaged brake force [kN]", title="(a) all wagons, mean over days"
    )
    off.axhline(0.0, color=THEORY, linewidth=0.9)
    off.errorbar(
        count + aside, mean - (slope * count + intercept), 1.96 * deviation, fmt="o", color=WAGONS,
        markersize=2.5, elinewidth=0.8, label="a day's test, 95 %",
    )  # fmt: skip
    off.set(xlim=ends, xticks=(0, 1, 2, 2.5, 3, 4, 5), xlabel="braked wagons [–]")
    off.set(
        ylabel="off the line [kN]", title="(b) each day's test with its 95 %, off the line of (a)"
    )
    off.xaxis.set_major_formatter("{x:g}")
    drawn.align_ylabels([forces, off])
    return drawn


@figure("brake-emergency", "emergency brake of 18 cars: estimate, theory and remedies (RTRI report Fig. 7)",
        made(run_test, "emergency", DAY))  # fmt: skip
def brake_emergency(result: TestResult) -> Figure:
    """Left the sum of the wagons, right the first: truth and theory, and below the error of each estimate."""
    found, smoothed, wagons = estimate(result), smooth(result), result.test.wagons
    true, one = result.true_force[:, 1:].sum(axis=1), result.true_force[:, 1]
    ways = (
        ("all by wagon 1's acceleration", WAGONS, found.wagons, found.wagon),
        ("each by its own acceleration", OWN, found.wagons_own, found.wagon),
        ("the same, smoothed", SMOOTHED, smoothed.total(slice(1, None))[0], smoothed.force[:, 1]),
    )
    heights = (1.2, 1.2, 1.0, 1.0)
    drawn, axes = new_panels(PAGE, 5.2, 4, 2, sharex=True, height_ratios=heights)
    time = result.measured.time - BRAKED_AT
    for axis, values, theory, title in (
        (axes[0, 0], true, wagons * found.theory, f"{wagons} wagons"),
        (axes[0, 1], one, found.theory, "wagon 1"),
    ):
        axis.plot(time, values / 1e3, color=BLACK, label="truth")
        axis.plot(time, theory / 1e3, color=VERMILION, linewidth=0.9, label="theory")
        axis.set(title=f"{title}: truth and theory", ylabel="force [kN]")
    for row, (way, colour, whole, first) in zip(axes[1:], ways, strict=True):
        _off_truth(row[0], result, whole - true, way, colour)
        own = " (its own)" if whole is found.wagons else ""
        _off_truth(row[1], result, first - one, way.removeprefix("all ") + own, colour)
    for column in axes.T:
        column[3].set_ylim(column[2].get_ylim())
        column[-1].set(xlabel="time [s]", xlim=(-BEFORE, float(time[result.window.stop])))
    drawn.align_ylabels(axes.ravel().tolist())
    label_lines(*axes[0])
    return drawn


def _off_truth(axes: Axes, result: TestResult, error: np.ndarray, way: str, colour: str) -> None:
    """By how much an estimate is off the truth, with its mean size in the window of comparison."""
    size = np.sqrt(np.mean(error[result.window] ** 2)) / 1e3
    axes.axhline(0.0, color=BLACK, linewidth=0.7)
    axes.plot(result.measured.time - BRAKED_AT, error / 1e3, color=colour, linewidth=0.7)
    axes.set(title=f"{way}: {size:.3g} kN rms", ylabel="off truth [kN]")


@figure("faulty-car", "which car did not deliver its allocated brake force (sweep brake-force)",
        made(allocated_stops, FAULT, DAY), study("brake-force", 1, lambda: pd.DataFrame(driven_rows(DAY))))  # fmt: skip
def faulty_car(stops: Sequence[AllocatedStop], table: pd.DataFrame) -> Figure:
    """Left: shortfall of each car against its threshold, one bogie cut out; right: shares found over the shortfall."""
    drawn, (bars, shares) = new_panels(PAGE, 2.8, 1, 2, width_ratios=(1.4, 1.0))
    _stop(bars, stops[0])
    _shares(shares, table[table["part"] == "driven"])
    label_lines(shares)
    return drawn


def _stop(axes: Axes, stop: AllocatedStop) -> None:
    """Bars of what was estimated to lack, a tick where a car is accused; one whose wheels slid has neither."""
    found = stop.shortfalls()
    allocated = stop.allocated[stop.window].mean(axis=0) / 1e3
    lacks, car = found.shortfall / 1e3, np.arange(1, allocated.size + 1)
    threshold = np.where(np.isfinite(found.threshold), found.threshold, np.nan) / 1e3
    accused = np.isin(car - 1, found.accused)
    axes.bar(car, np.nan_to_num(lacks), 0.7, color=np.where(accused, ACCUSED, ESTIMATED))
    axes.hlines(threshold, car - 0.42, car + 0.42, color=BLACK, linewidth=1.4)
    axes.axhline(0.0, color=BLACK, linewidth=0.7)
    top = float(np.nanmax(np.concatenate([lacks, threshold])))
    for k in np.flatnonzero(accused):
        words = f"car {car[k]} is accused:\n{lacks[k]:.1f} of {allocated[k]:.1f} kN lack"
        axes.text(car[k], lacks[k] + 0.02 * top, words, ha="center", va="bottom", color=ACCUSED)
    for k in np.flatnonzero(np.isnan(lacks)):
        words = "not judged: its wheels slid"
        axes.text(car[k], 0.05 * top, words, ha="center", va="bottom", rotation=90, color=DARK)
    known = np.flatnonzero(np.isfinite(threshold) & ~accused)
    if known.size:
        place = (float(car[known[-1]]) + 0.42, float(np.nanmax(threshold)))
        axes.annotate(
            "accused beyond this",
            place,
            (0.0, 2.0),
            textcoords="offset points",
            ha="right",
            va="bottom",
        )
    axes.set_title(f"(a) a stop with one bogie of car {FAULT.car + 1} cut out")
    axes.set(xlabel="car (1 = foremost)", ylabel="shortfall of brake force [kN]")
    axes.set(xticks=car, ylim=(min(0.0, 1.2 * float(np.nanmin(lacks))), 1.3 * top))
    axes.grid(visible=False, axis="x")


def _shares(axes: Axes, dry: pd.DataFrame) -> None:
    means = dry.groupby("missing")[["found", "wrong", "whole"]].mean() * 100.0
    for column, colour, marker, words in (
        ("found", ESTIMATED, "o", "the faulty car is found"),
        ("wrong", ORANGE, "x", "a car is accused that lacks < 5 %"),
        ("whole", WRONG, "+", "a car is accused that lacks < 1 %"),
    ):
        known = means[means.index > 0.0] if column == "found" else means
        axes.plot(100.0 * known.index, known[column], color=colour, marker=marker, label=words)
    axes.set(
        title="(b) dry stops: what is found, and who is accused",
        xlabel="brake force missing on one car [%]",
    )
    axes.set(ylabel="share of stops [%]", ylim=(-4.0, 104.0))
