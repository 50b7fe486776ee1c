"""The torque table's limit cycle, simulated and predicted from the reduced model; and when wheels run away."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_paper.limit_cycle import critical_width
from studies.readhesion_paper.limit_cycle_comparison import (
    compare_cycles,
    growth_over_widths,
    paper_model,
)

WIDTHS = (0.1, 0.3)
LIMITS = tuple(round(0.112 + 0.004 * k, 3) for k in range(12))
GROWTH_WIDTHS = tuple(round(0.15 + 0.05 * k, 2) for k in range(14))
COLOURS = ("#0072b2", "#d55e00")


def figure(source: Source) -> Figure:
    """The figure; runs and predictions take some seconds."""
    return draw(compare_cycles(WIDTHS, LIMITS, source.jobs), GROWTH_WIDTHS)


def draw(cycles: pd.DataFrame, growth_widths: tuple[float, ...]) -> Figure:
    """Panels: period and swing of slip over mu_lim, and growth of swings about the runaway equilibrium over a_w.

    Simulated cycles are drawn where the wheel readheres.
    """
    drawn = new_figure(7.1, 2.9)
    with mpl.rc_context(fname=STYLE_FILE):
        period, slip, growth = drawn.subplots(1, 3)
        for colour, (width, rows) in zip(COLOURS, cycles.groupby("width"), strict=True):
            for panel, quantity in ((period, "period"), (slip, "slip_swing")):
                panel.plot(
                    rows["limit"], rows[f"predicted_{quantity}"], color=colour,
                    label=f"predicted, $a_w$ = {width:g} km/h/s",
                )  # fmt: skip
                back = rows[rows["possible"]]  # wheels that run away swing as well, elsewhere
                panel.plot(
                    back["limit"], back[quantity], "o", color=colour, markersize=3.5,
                    markerfacecolor="none", label=f"simulated, $a_w$ = {width:g} km/h/s",
                )  # fmt: skip
        for panel in (period, slip):
            panel.set_xlabel(r"$\mu_\mathrm{lim}$ [–]")
            panel.set_ylim(bottom=0.0)
        period.set_title("(a) period")
        period.set_ylabel("period [s]")
        slip.set_title("(b) swing of slip")
        slip.set_ylabel("slip velocity [m/s]")
        sizes = growth_over_widths(growth_widths)
        growth.plot(growth_widths, sizes, ".-", color="#009e73")
        critical = critical_width(paper_model()) * 3.6
        growth.axvline(critical, linestyle="--", color="black", linewidth=0.9)
        growth.axhline(1.0, linestyle=":", color="black", linewidth=0.9)
        growth.annotate(
            f"factor rests\nfrom {critical:.2f} on", (critical, float(np.max(sizes))),
            xytext=(6, 0), textcoords="offset points", va="top",
        )  # fmt: skip
        growth.set_title("(c) swings while running away")
        growth.set_xlabel("$a_w$ [km/h/s]")
        growth.set_ylabel("growth per swing [–]")
        drawn.legend(*period.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return drawn
