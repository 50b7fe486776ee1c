"""Distances and Q of the demonstration beside the source's numbers (JP4209318 Tables 3 and 4)."""

from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.slide_data import HERE, PRINTED, slide_table
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.slides.targets import TABLE_3, TABLE_4

WIDTH = 0.38


def figure(source: Source) -> Figure:
    """The figure, from the sweep `slide-protection`."""
    return draw(slide_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Left: distance by number of cars, with what a fit to one and three predicts of two. Right: by sensitivity."""
    rows = table[table["part"] == "tables"]

    def here(cars: int, setting: str, column: str) -> float:
        chosen = (rows["cars"] == cars) & (rows["setting"] == setting)
        return float(rows.loc[chosen, column].iloc[0])

    drawn = new_figure(7.1, 3.0)
    with mpl.rc_context(fname=STYLE_FILE):
        length, distance, damage = drawn.subplots(1, 3)
        of_length = [here(cars, "medium", "distance") for cars in TABLE_3]
        _bars(length, [f"{cars}" for cars in TABLE_3], list(TABLE_3.values()), of_length, "{:.1f}")
        predicted = float(table.loc[table["part"] == "held out", "distance 2"].iloc[0])
        length.plot([1.0], [predicted], "D", color="#d55e00", markersize=5,
                    label="predicted by a fit to 1 and 3 cars")  # fmt: skip
        for k, axes in enumerate((distance, damage)):
            column, text = (("distance", "{:.1f}"), ("damage", "{:.0f}"))[k]
            printed = [numbers[k] for numbers in TABLE_4.values()]
            of_setting = [here(3, setting, column) for setting in TABLE_4]
            _bars(axes, list(TABLE_4), printed, of_setting, text)
        length.set(ylabel="braking distance [m]", xlabel="cars", title="(a) Table 3", ylim=(0, 545))
        distance.set(
            ylabel="braking distance [m]", xlabel="sensitivity", title="(b) Table 4", ylim=(0, 545)
        )
        damage.set(
            ylabel="wheel damage Q [kJ]", xlabel="sensitivity", title="(c) Table 4", ylim=(0, 2000)
        )
        handles, labels = length.get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower center", ncols=3)
    return drawn


def _bars(axes: Any, names: list[str], printed: list[float], here: list[float], text: str) -> None:
    place = np.arange(len(names), dtype=float)
    for offset, values, colour, label in (
        (-0.5 * WIDTH, printed, PRINTED, "printed in the source"),
        (0.5 * WIDTH, here, HERE, "calibrated here"),
    ):
        bars = axes.bar(place + offset, values, WIDTH, color=colour, label=label)
        axes.bar_label(
            bars, [text.format(value) for value in values], rotation=90, padding=3, fontsize=6.5
        )
    axes.set_xticks(place, names)
