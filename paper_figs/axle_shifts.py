"""How adhesion grows from axle to axle, JP5484215 Figs. 11 and 12, from the synthetic table that is shipped."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import norm

from alloc.estimation.increments import axle_shifts, fit_increments
from alloc.estimation.slide_counts import (
    LEAD_AXLES,
    SYNTHETIC_TABLE,
    SlideCounts,
    read_slide_counts,
)
from alloc.plant.rail import logarithmic_increments
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure

CONFIDENCE = 0.95
COUNT_COLOUR, FIT_COLOUR, TRUE_COLOUR = "#7f7f7f", "#0072b2", "#d55e00"


def figure(source: Source) -> Figure:
    """The figure, from the shipped table; it needs no data from `source`."""
    return draw(read_slide_counts(SYNTHETIC_TABLE))


def draw(counts: SlideCounts) -> Figure:
    """Left: slides per axle. Right: k_j sigma by (14), the fit with its band, and (15).

    A table whose source says SYNTHETIC is labelled so across both.
    """
    drawn = new_figure(7.1, 3.4)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2, width_ratios=(2.0, 3.0))
        axle = np.arange(1, counts.axle_count + 1)
        left.bar(axle, counts.slides, width=1.0, color=COUNT_COLOUR, alpha=0.75)
        left.axhline(
            counts.lead_mean, color="black", linestyle="--", linewidth=1.0,
            label=f"mean of axles 1 to {LEAD_AXLES}",
        )  # fmt: skip
        left.legend(loc="upper right")
        left.set(
            xlim=(0.0, counts.axle_count + 1.0), xlabel="axle from the front", ylabel="slides",
            title="(a) slides counted",
        )  # fmt: skip
        _shifts(right, counts)
        if counts.source.startswith("SYNTHETIC"):
            drawn.suptitle(
                "SYNTHETIC counts, drawn from JP5484215 (14) and (15): not measured", fontsize=8.5
            )
    return drawn


def _shifts(axes: Axes, counts: SlideCounts) -> None:
    shifts = axle_shifts(counts)
    fit = fit_increments(shifts)
    axle = np.arange(1, counts.axle_count + 1)
    quantile = float(norm.ppf(0.5 + 0.5 * CONFIDENCE))
    axes.errorbar(
        axle, shifts.shift, quantile * shifts.deviation, fmt="o", color=COUNT_COLOUR,
        markersize=2.5, linewidth=0.7, label="each axle, with its counting error (95 %)",
    )  # fmt: skip
    low, high = fit.band(CONFIDENCE)
    axes.fill_between(axle, low, high, color=FIT_COLOUR, alpha=0.25, linewidth=0)
    axes.plot(
        axle, fit.increments(), color=FIT_COLOUR,
        label=f"fit: ({1e3 * fit.slope:.2f} ± {1e3 * quantile * fit.slope_deviation:.2f})"
        f"·10⁻³ ln j − {-1e3 * fit.offset:.2f}·10⁻³",
    )  # fmt: skip
    axes.plot(
        axle, logarithmic_increments(counts.axle_count), color=TRUE_COLOUR, linestyle="--",
        label="JP5484215 (15): 8.3·10⁻³ ln j − 6.6·10⁻³",
    )  # fmt: skip
    axes.set(
        xlim=(0.0, counts.axle_count + 1.0), xlabel="axle from the front",
        ylabel=r"shift $k_j\sigma$ [–]", title="(b) shift of the mean coefficient",
    )  # fmt: skip
    axes.legend(loc="lower right")
