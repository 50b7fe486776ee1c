"""Claim (e): is redistribution better than a preset pattern where adhesion is not what the preset assumed?"""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.claim_panels import SEASON_MARKERS, bearing_on, claim_table, forest
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.claims.parts import PARTS
from studies.claims.statements import REACH_PARTS, difference


def figure(source: Source) -> Figure:
    """The figure, from the sweep `claims`."""
    return draw(claim_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Left: paired difference of effort by the adhesion that there is, an event a mark. Right: effort and slip by part."""
    pairs, events = bearing_on(table, "e")
    drawn = new_figure(7.1, 3.7)
    parts = {**PARTS, **REACH_PARTS}
    effort = difference("held_effort", "greedy", "preset")
    slip = difference("slip_time", "greedy", "preset", -1.0)
    with mpl.rc_context(fname=STYLE_FILE):
        left, middle, right = drawn.subplots(1, 3, width_ratios=(1.0, 0.55, 0.55))
        for season, (marker, colour) in SEASON_MARKERS.items():
            chosen = events[events["season"] == season]
            left.plot(
                100 * chosen["reach_low@oracle"], 100 * effort.quantity(chosen), linestyle="none", marker=marker,
                color=colour, markersize=3.0, alpha=0.7, label=season,
            )  # fmt: skip
        left.axhline(0.0, color="#444444", linewidth=0.8, linestyle="--", zorder=0)
        left.axvline(100.0, color="#444444", linewidth=0.8, zorder=0)
        left.set_xlabel("adhesion of all units over plan [%]")
        left.set_ylabel("effort over plan, greedy less preset [%]")
        left.set_title(f"{len(events)} of {len(pairs)} events")
        left.legend(loc="lower right")
        forest(middle, events, effort, "effort [%]", 100.0, parts=parts)
        forest(right, events, slip, "slip, axle seconds [s]", parts=parts)
        right.set_yticklabels([])
        for narrow in (middle, right):
            narrow.locator_params(axis="x", nbins=3)
    return drawn
