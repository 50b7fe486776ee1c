"""Which car of a commuter train did not deliver its allocated brake force, and how small a shortfall is found."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.brake_force import study as brake_force
from studies.brake_force.faulty_car import Fault, Stop, allocated_stops
from studies.brake_force.findings import driven_rows
from studies.core.collection import sweep_folder

DAY = 0
FAULT = Fault(3, (0,))
ALLOCATED, ESTIMATED, ACCUSED, WRONG = "#b0b0b0", "#0072b2", "#d55e00", "#000000"


def figure(source: Source) -> Figure:
    """The figure: one stop, and shares from what the results hold of the sweep `brake-force`, or from one day."""
    folder = sweep_folder(source.store.folder, "brake-force")
    days = brake_force.stored(folder)
    if days:
        table = brake_force.run(folder, days, 0, source.jobs, source.on_row)
    else:
        table = pd.DataFrame(driven_rows(DAY))
    return draw(allocated_stops(FAULT, DAY), table[table["part"] == "driven"])


def draw(stops: Sequence[Stop], dry: pd.DataFrame) -> Figure:
    """Left: allocated and estimated force of each car, one bogie cut out; right: shares found over the shortfall."""
    drawn = new_figure(7.1, 3.1)
    with mpl.rc_context(fname=STYLE_FILE):
        bars, shares = drawn.subplots(1, 2, width_ratios=(1.5, 1.0))
        _stop(bars, stops[0])
        _shares(shares, dry)
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
    axes.set_xlabel("car (1 = foremost)")
    axes.set_ylabel("brake force at the rails [kN]")
    axes.set_xticks(car)
    axes.set_ylim(0.0, 1.4 * float(allocated.max()))
    axes.legend(loc="upper center", ncols=2)


def _shares(axes: Axes, dry: pd.DataFrame) -> None:
    means = dry.groupby("missing")[["found", "wrong", "whole"]].mean() * 100.0
    asked = means[means.index > 0.0]
    axes.plot(asked.index * 100.0, asked["found"], "o-", color=ESTIMATED, label="faulty car found")
    for column, look, words in (("wrong", "x--", "lacks < 5 %"), ("whole", "+:", "lacks < 1 %")):
        axes.plot(
            means.index * 100.0, means[column], look, color=WRONG, linewidth=0.9,
            label=f"accused, {words}",
        )  # fmt: skip
    axes.set_title("(b) dry stops")
    axes.set_xlabel("brake force missing on one car [%]")
    axes.set_ylabel("share of stops [%]")
    axes.set_ylim(-3.0, 103.0)
    axes.legend(loc="center right")
