"""Claim (d): does the reference rule ride better than dynamic sharing, whose limits wander until they settle?"""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.claim_panels import SEASON_MARKERS, bearing_on, claim_table, diagonal, forest
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.claims.statements import difference


def figure(source: Source) -> Figure:
    """The figure, from the sweep `claims`."""
    return draw(claim_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Left: jerk under sharing against jerk under greedy, every event a mark. Right: paired difference by part."""
    pairs, events = bearing_on(table, "d")
    drawn = new_figure(7.1, 3.7)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2, width_ratios=(1.0, 0.8))
        for season, (marker, colour) in SEASON_MARKERS.items():
            chosen = events[events["season"] == season]
            left.plot(
                chosen["jerk_rms@sharing"], chosen["jerk_rms@greedy"], linestyle="none", marker=marker, color=colour,
                markersize=3.0, alpha=0.7, label=season,
            )  # fmt: skip
        diagonal(left)
        left.set_xlabel("jerk rms, sharing [m/s³]")
        left.set_ylabel("jerk rms, greedy [m/s³]")
        left.set_title(f"{len(events)} of {len(pairs)} events with slip")
        left.legend(loc="lower right")
        test = difference("jerk_rms", "greedy", "sharing", -1.0)
        forest(right, events, test, "jerk rms, greedy less sharing [m/s³]")
    return drawn
