"""Distance against Q: readhesion controllers on an electric brake beside the front of slide protection by valves."""

from typing import Any, Literal

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator

from paper_figs.slide_data import slide_table
from paper_figs.slide_pareto import TICKS
from paper_figs.source import Source
from paper_figs.style import (
    CONTROLLER_COLOURS,
    CONTROLLER_MARKERS,
    RULE_COLOURS,
    STYLE_FILE,
    new_figure,
)
from studies.slides.electric import CONTROLLERS, GROUPS, PART
from studies.slides.front import front

VALVES = RULE_COLOURS["alone"]
FILLS: dict[str, Literal["full", "none"]] = {"1C4M": "full", "1C1M": "none"}
LABELS = {"1C4M": "one inverter a car", "1C1M": "one inverter an axle"}

assert set(FILLS) == set(LABELS) == set(GROUPS)


def figure(source: Source) -> Figure:
    """The figure, from the sweep `slide-protection`."""
    return draw(slide_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Three cars; line: fuzzy slide protection over its sensitivity; filled: an inverter per car, hollow: per axle."""
    own = front(table[table["part"] == "pareto"])
    electric = table[table["part"] == PART]
    drawn = new_figure(5.2, 3.8)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots()
        (valves,) = axes.plot(own["damage"], own["distance"], ".-", color=VALVES, markersize=4,
                              label="valves, fuzzy, by sensitivity")  # fmt: skip
        handles = [valves]
        for controller in CONTROLLERS:
            rows = electric[electric["controller"] == controller].set_index("group")
            look: dict[str, Any] = {
                "color": CONTROLLER_COLOURS[controller],
                "marker": CONTROLLER_MARKERS[controller],
                "markersize": 7,
                "linestyle": "none",
            }
            for group, fill in FILLS.items():
                here = rows.loc[group]
                axes.plot([here["damage"]], [here["distance"]], fillstyle=fill, **look)
            handles.append(Line2D([], [], label=controller, **look))
        handles += [
            Line2D([], [], linestyle="none", marker="o", color="#444444", fillstyle=fill,
                   label=LABELS[group])
            for group, fill in FILLS.items()
        ]  # fmt: skip
        axes.set(xlabel="wheel damage Q [kJ]", ylabel="braking distance [m]", xscale="log")
        axes.xaxis.set_major_locator(FixedLocator(TICKS))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.legend(handles=handles, loc="best", fontsize=7)
    return drawn
