"""Claim (b): in case A, where the plan is out of reach, does every unit work at about its bound?"""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.claim_panels import bearing_on, claim_table, forest, strips
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.claims.statements import ABOUT_BOUND, bound_test

SHOWN = ("alone", "preset", "sharing", "greedy", "exact", "oracle")


def figure(source: Source) -> Figure:
    """The figure, from the sweep `claims`."""
    return draw(claim_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Left: adhesion used by the unit that uses least, every event of case A a mark. Right: its mean by part."""
    pairs, events = bearing_on(table, "b")
    drawn = new_figure(7.1, 3.7)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2, width_ratios=(1.0, 0.8))
        strips(left, {rule: events[f"unit_use_low@{rule}"] for rule in SHOWN}, 100.0)
        left.axhline(100 * ABOUT_BOUND, color="#444444", linewidth=0.8, linestyle="--", zorder=0)
        left.set_ylabel("adhesion used by the unit that uses least [%]")
        left.set_title(f"{len(events)} of {len(pairs)} events out of reach")
        forest(right, events, bound_test(), "adhesion used, greedy [%]", 100.0)
    return drawn
