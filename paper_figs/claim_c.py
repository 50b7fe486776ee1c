"""Claim (c): is about 95 % of the adhesion used under readhesion control when a cap is somewhat too high?"""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.claim_panels import bearing_on, claim_table, forest
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure, rule_colour, rule_handles, rule_marker
from studies.claims.measures import EXCESS_EDGES, excess_column
from studies.claims.statements import ABOUT_95, over_test
from studies.core.statement import mean_interval
from studies.core.verdict import LEAST_EVENTS

SHOWN = ("greedy", "exact")
CLAIMED = 0.95


def figure(source: Source) -> Figure:
    """The figure, from the sweep `claims`."""
    return draw(claim_table(source))


def draw(table: pd.DataFrame) -> Figure:
    """Left: adhesion used by how much too high a limit is, every event a mark. Right: its mean by part."""
    pairs, events = bearing_on(table, "c")
    drawn = new_figure(7.1, 3.7)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2, width_ratios=(1.0, 0.8))
        for shift, rule in zip((-0.7, 0.7), SHOWN, strict=True):
            for k in range(len(EXCESS_EDGES) - 1):
                centre = 50.0 * (EXCESS_EDGES[k] + EXCESS_EDGES[k + 1]) + shift
                values = 100.0 * events[f"{excess_column(k)}@{rule}"].dropna()
                left.plot(
                    [centre] * len(values), values, linestyle="none", marker="_", color=rule_colour(rule), alpha=0.15,
                )  # fmt: skip
                mean = mean_interval(values)
                if mean.count >= LEAST_EVENTS:
                    left.errorbar(
                        centre, mean.value, yerr=mean.high - mean.value, color=rule_colour(rule),
                        marker=rule_marker(rule), markersize=5.0, elinewidth=1.2,
                    )  # fmt: skip
        left.axhline(100 * CLAIMED, color="black", linewidth=0.8, zorder=0)
        left.axhline(100 * ABOUT_95, color="#444444", linewidth=0.8, linestyle="--", zorder=0)
        left.set_xticks([100 * edge for edge in EXCESS_EDGES])
        left.set_xlabel("limit above the true adhesion by [%]")
        left.set_ylabel("adhesion used there [%]")
        left.set_ylim(75.0, 101.0)
        left.set_title(f"{len(events)} of {len(pairs)} events")
        left.legend(handles=rule_handles(SHOWN), loc="lower right")
        right.set_title("limit up to 15 % too high", loc="left")
        forest(right, events, over_test(), "adhesion used, greedy [%]", 100.0)
    return drawn
