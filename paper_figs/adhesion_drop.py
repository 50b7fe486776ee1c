"""The adhesion curve before and after the rail's change: readhesion paper Fig. 6."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from alloc.plant.adhesion import PiecewiseCurve
from paper_figs.readhesion_cases import SECOND
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.readhesion_paper.paper import CALIBRATED, CASE_A, Unprinted

HIGH = 0.18
"""Adhesion coefficient of Table 2 before the drop."""
PLAN = 0.17
"""Planned coefficient of Table 2."""


def figure(source: Source) -> Figure:
    """The figure; it needs no data from `source`."""
    return draw()


def draw(unprinted: Unprinted = CALIBRATED, low: float = CASE_A.limit) -> Figure:
    """Both curves with their peaks; left the peaks, right as far as slip goes in case B."""
    curve = PiecewiseCurve(residual_ratio=unprinted.residual_ratio)
    drawn = new_figure(7.1, 2.9)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(1, 2, sharey=True)
        for axes, end in zip(panels, (0.2, 4.0), strict=True):
            slip = np.linspace(0.0, end, 1500)
            for peak, dashes, colour in ((HIGH, "-", "#0072b2"), (low, "--", "#d55e00")):
                axes.plot(
                    slip, curve.coefficient(slip, peak), dashes, color=colour,
                    label=rf"$\mu_\mathrm{{max}}$ = {peak:g}",
                )  # fmt: skip
                top = float(curve.limit(peak)[1])
                axes.plot([top], [peak], "o", color=colour, markersize=4)
            axes.axhline(PLAN, color=SECOND, linestyle=":", linewidth=0.9, label="plan")
            axes.xaxis.set_major_locator(MultipleLocator(end / 4.0))
            axes.set(xlim=(0.0, end), ylim=(0.0, 0.2), xlabel="slip velocity [m/s]")
        panels[0].set_ylabel("tangential force coefficient [–]")
        panels[0].set_title("(a) around the peaks")
        panels[1].set_title(
            rf"(b) towards $\mu_\infty$ = {unprinted.residual_ratio:.3g} $\mu_\mathrm{{max}}$"
        )
        panels[1].legend(loc="lower right")
    return drawn
