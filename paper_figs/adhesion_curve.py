"""Adhesion curve: JP5484215 Fig. 17 and Fig. 1 of the readhesion paper, and the plant's three curves side by side."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    AdhesionCurve,
    PiecewiseCurve,
    SlipRatioCurve,
)
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure

PEAK = 0.18
"""Adhesion coefficient of the readhesion paper's scenario before the drop (its Table 2)."""
SPEED = 30.0 / 3.6
"""Car speed [m/s] at which the creepage-based curves are drawn."""
CURVES: dict[str, tuple[AdhesionCurve, str, str]] = {
    "piecewise (readhesion paper)": (PiecewiseCurve(), "#0072b2", "-"),
    "Polach, wet": (POLACH_WET, "#e69f00", "--"),
    "Polach, dry": (POLACH_DRY, "#d55e00", "-."),
    "slip ratio (flat beyond peak)": (SlipRatioCurve(), "#009e73", ":"),
}


def figure(source: Source) -> Figure:
    """The figure; it needs no data from `source`."""
    return draw()


def draw(peak: float = PEAK) -> Figure:
    """Left: parts and regions of the piecewise curve for a `peak`. Right: the three curves at equal peak."""
    drawn = new_figure(7.1, 3.1)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2)
        _parts(left, PiecewiseCurve(), peak)
        _curves(right, peak)
    return drawn


def _parts(axes: Axes, curve: PiecewiseCurve, peak: float) -> None:
    half_width = curve.micro_slope / (4.0 * curve.top_curvature)
    line_end = peak / curve.micro_slope - half_width
    top = float(curve.limit(peak)[1])
    tail = top + curve.macro_slope / (2.0 * curve.top_curvature)
    end = 0.20
    slip = np.linspace(0.0, end, 1200)
    mu = curve.coefficient(slip, peak)
    axes.axvspan(0.0, top, color="#0072b2", alpha=0.10, linewidth=0)
    axes.axvspan(top, end, color="#d55e00", alpha=0.10, linewidth=0)
    parts = (
        ("line", slip <= line_end, "#0072b2"),
        ("parabola", (slip > line_end) & (slip <= tail), "#000000"),
        ("exponential", slip > tail, "#d55e00"),
    )
    for name, inside, colour in parts:
        axes.plot(slip[inside], mu[inside], color=colour, linewidth=2.0, label=name)
    axes.plot([top], [peak], "o", color="black", markersize=4.5)
    axes.annotate(
        rf"peak $\mu_\mathrm{{max}}$ = {peak:g}" + f"\nat {top:.3f} m/s",
        (top, peak), xytext=(top + 0.02, peak * 1.13), va="center",
        arrowprops={"arrowstyle": "-", "linewidth": 0.7},
    )  # fmt: skip
    axes.text(
        0.58 * top, 0.03 * peak, "micro slip\nstable", ha="center", va="bottom", color="#00456b"
    )
    axes.text(
        0.5 * (top + end),
        0.03 * peak,
        "macro slip\nunstable",
        ha="center",
        va="bottom",
        color="#8a3d00",
    )
    axes.set(
        xlim=(0.0, end),
        ylim=(0.0, 1.25 * peak),
        xlabel="slip velocity [m/s]",
        ylabel="tangential force coefficient [–]",
        title="(a) parts of the piecewise curve",
    )
    axes.xaxis.set_major_locator(MultipleLocator(0.05))
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.45))


def _curves(axes: Axes, peak: float) -> None:
    slip = np.concatenate([np.linspace(0.0, 0.2, 400), np.linspace(0.2, 4.0, 800)])
    for name, (curve, colour, dashes) in CURVES.items():
        # Polach's parameter is the friction coefficient; scaled so that the maxima agree
        scale = peak / float(curve.limit(peak, SPEED)[0])
        own = peak * scale
        for _ in range(20):
            own *= peak / float(curve.limit(own, SPEED)[0])
        axes.plot(
            slip, curve.coefficient(slip, own, SPEED), color=colour, linestyle=dashes, label=name
        )
        limit, top = curve.limit(own, SPEED)
        axes.plot([float(top)], [float(limit)], "o", color=colour, markersize=4)
    axes.set(
        xlim=(0.0, 4.0),
        ylim=(0.0, 1.25 * peak),
        xlabel="slip velocity [m/s]",
        ylabel="tangential force coefficient [–]",
        title=f"(b) the plant's curves at {3.6 * SPEED:.0f} km/h, equal peaks",
    )
    axes.legend(loc="lower right")
