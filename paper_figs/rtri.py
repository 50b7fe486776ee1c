"""Figures of the RTRI report: running tests over time (4, 5), wagons cut out (6), estimate beside theory (7)."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.style import NARROW, WIDE, Drawing
from studies.rtri import BRAKED_AT, CUT_OUT, TESTS, measure_test, tabulate_days

DAY, TYPICAL_DAY = 0, 1
"""Of the tests that are shown, and of theory: on the second the first wagon's shoes are as theory has them."""
LOCOMOTIVE, WAGONS, THEORY = "#0072b2", "#e69f00", "black"


def draw_over_time() -> Figure:
    """A column for each test: speed, accelerations of locomotive and first wagon, first coupler, estimated forces."""
    drawn = Figure(figsize=(WIDE, 5.4), layout="constrained")
    panels = drawn.subplots(4, 2, sharex="col", sharey="row")
    titles = {"locomotive": "(a) only the locomotive braked", "all": "(b) all cars braked"}
    for column, (name, title) in zip(panels.T, titles.items(), strict=True):
        m, e = measure_test(name, DAY)
        shown = slice(0, e.window.stop)
        time = m.time[shown] - BRAKED_AT
        speed, acceleration, coupler, force = column
        speed.plot(time, 3.6 * m.speed[shown], color=THEORY)
        pairs = (("locomotive", LOCOMOTIVE, e.locomotive), ("wagons", WAGONS, e.wagons))
        for k, (who, colour, estimate) in enumerate(pairs):
            label = who if k == 0 else "first wagon"
            acceleration.plot(time, m.acceleration[shown, k], color=colour, lw=0.6, label=label)
            label = f"{who}, ({'35'[k]})"
            force.plot(time, estimate[shown] / 1e3, color=colour, lw=0.7, label=label)
        coupler.plot(time, m.coupler[shown, 0] / 1e3, color=THEORY, lw=0.7)
        speed.set_title(title)
        force.set_xlabel("time [s]")
    panels[0, 0].set(ylabel="speed [km/h]", ylim=(0.0, None))
    panels[1, 0].set_ylabel("acceleration [m/s²]")
    panels[2, 0].set_ylabel("first coupler [kN]")
    panels[3, 0].set_ylabel("brake force [kN]")
    panels[1, 0].legend(loc="lower right", ncols=2)
    panels[3, 0].legend(loc="upper right", ncols=2)
    drawn.align_ylabels(panels[:, 0])
    return drawn


def draw_cut_out(rows: pd.DataFrame) -> Figure:
    """Averaged estimate of every day, and the line through the means over days."""
    numbers = tabulate_days(rows)
    drawn = Figure(figsize=(NARROW, 2.6), layout="constrained")
    axes = drawn.subplots()
    for k, name in enumerate(CUT_OUT):
        values = numbers["mean", name]
        x = np.full(len(values), TESTS[name].braked)
        label = "a day's test" if k == 0 else None
        axes.plot(x, values, "_", color=LOCOMOTIVE, ms=10, mew=0.5, alpha=0.6, label=label)
    slope, intercept = numbers["slope", "line"].mean(), numbers["intercept", "line"].mean()
    ends = np.array([0.0, 5.4])
    label = f"{slope:.1f} kN per wagon + {intercept:.1f} kN"
    axes.plot(ends, intercept + slope * ends, "--", color=THEORY, lw=0.9, label=label)
    axes.set(xlabel="wagons braked", ylabel="mean brake force of all wagons [kN]")
    axes.set(xlim=(0.0, 5.4), ylim=(0.0, None))
    axes.legend(loc="upper left")
    return drawn


def draw_theory() -> Figure:
    """Emergency brake of 18 cars: (a) all wagons by (5) and (8), (b) the first wagon by (9) and (7)."""
    m, e = measure_test("emergency", TYPICAL_DAY)
    shown = slice(0, e.window.stop)
    wagons, time = TESTS["emergency"].wagons, m.time[shown] - BRAKED_AT
    drawn = Figure(figsize=(WIDE, 2.4), layout="constrained")
    for axes, title, estimate, cars in zip(
        drawn.subplots(1, 2),
        (f"(a) all {wagons} wagons", "(b) the first wagon"),
        (e.wagons, e.wagon),
        (wagons, 1),
        strict=True,
    ):
        axes.plot(time, estimate[shown] / 1e3, color=WAGONS, lw=0.7, label="estimate")
        axes.plot(time, cars * e.theory[shown] / 1e3, color=THEORY, label="theory")
        axes.set(title=title, xlabel="time [s]", ylabel="brake force [kN]")
        axes.legend(loc="lower right")
    return drawn


FIGURES = {
    "brake-tests": Drawing(
        draw_over_time,
        "Figs. 4 and 5: the locomotive's estimate is smooth from the beginning, and rises as its cylinders fill; that of "
        "the wagons swings until relative motion has died out, and with the spikes of the coupler.",
        source="rtri",
    ),
    "brake-cut-out": Drawing(
        draw_cut_out,
        "Fig. 6: the averaged estimate is linear in the wagons braked, with an intercept that the true forces have too.",
        study="rtri",
        source="rtri",
    ),
    "brake-theory": Drawing(
        draw_theory,
        "Fig. 7: the estimates of 17 wagons and of the first follow the theoretical force, within 1 % on this day; as shoes "
        "scatter by 5 %, which theory does not know, the first wagon is 9 % below to 14 % above it on single days of 60.",
        source="rtri",
    ),
}
