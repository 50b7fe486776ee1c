"""Claim (a): does redistribution reach the plan where adhesion on the whole allows it and units alone do not?"""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.claim_panels import bearing_on, claim_table, diagonal, forest
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure, rule_colour, rule_handles, rule_marker
from studies.claims.statements import REACHED, reached_test, within_reach

SHOWN = ("greedy", "exact", "oracle")


def figure(source: Source) -> Figure:
    """The figure, from the sweep `claims`."""
    return draw(claim_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Left: effort under alone against other rules, every event in reach a mark. Right: the claim's mean by part."""
    pairs, events = bearing_on(table, "a")
    reach = pairs[within_reach(pairs)]
    drawn = new_figure(7.1, 3.7)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2, width_ratios=(1.0, 0.8))
        for rule in SHOWN:
            left.plot(
                100 * reach["held_effort@alone"], 100 * reach[f"held_effort@{rule}"], linestyle="none",
                marker=rule_marker(rule), color=rule_colour(rule), markersize=3.0, alpha=0.7,
            )  # fmt: skip
        diagonal(left)
        left.axhline(100 * REACHED, color="#444444", linewidth=0.8, linestyle="--", zorder=0)
        left.axvline(100 * REACHED, color="#444444", linewidth=0.8, linestyle="--", zorder=0)
        left.set_xlabel("effort over plan, alone [%]")
        left.set_ylabel("effort over plan, other rules [%]")
        left.set_title(f"{len(reach)} of {len(pairs)} events within reach")
        left.legend(handles=rule_handles(SHOWN), loc="lower right")
        forest(right, events, reached_test(), "effort over plan, greedy [%]", 100.0)
        right.set_title("alone below the line", loc="left")
    return drawn
