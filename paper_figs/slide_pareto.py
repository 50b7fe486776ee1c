"""Distance against Q over the sensitivity of slide protection, beside plain thresholds (JP4209318 Table 4)."""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from paper_figs.slide_data import HERE, PRINTED, slide_table
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.slides.front import front
from studies.slides.targets import TABLE_4

MARKERS = {"low": "v", "medium": "o", "high": "^"}
TICKS = (200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 10000)


def figure(source: Source) -> Figure:
    """The figure, from the sweep `slide-protection`."""
    return draw(slide_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Three cars. Small: every sensitivity tried; line: those that none beats in both; large: the three settings."""
    every = table[table["part"] == "pareto"]
    own, plain = front(every), table[table["part"] == "threshold"].sort_values("damage")
    settings = table[(table["part"] == "tables") & (table["cars"] == 3)].set_index("setting")
    drawn = new_figure(5.2, 3.8)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots()
        axes.plot(every["damage"], every["distance"], ".", color=HERE, markersize=3.5,
                  label="fuzzy, by sensitivity")  # fmt: skip
        axes.plot(own["damage"], own["distance"], "-", color=HERE, linewidth=1.0, label="its front")
        axes.plot(plain["damage"], plain["distance"], "s", color="#e69f00", markersize=4.5,
                  label="threshold, by hold and release")  # fmt: skip
        for setting, marker in MARKERS.items():
            here = settings.loc[setting]
            axes.plot([here["damage"]], [here["distance"]], marker, color=HERE, markersize=8,
                      markeredgecolor="black", label=f"fuzzy, {setting}")  # fmt: skip
            distance, damage = TABLE_4[setting]
            axes.plot([damage], [distance], marker, color="none", markersize=10,
                      markeredgecolor=PRINTED, markeredgewidth=1.4, label=f"source, {setting}")  # fmt: skip
        axes.set(xlabel="wheel damage Q [kJ]", ylabel="braking distance [m]", xscale="log")
        axes.xaxis.set_major_locator(FixedLocator(TICKS))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.legend(loc="upper right", fontsize=7)
    return drawn
