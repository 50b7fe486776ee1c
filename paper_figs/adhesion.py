"""Adhesion curves and planned coefficients: JP5484215 Figs. 10 and 17, readhesion paper Figs. 1 and 6."""

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
from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
from paper_figs.palette import BLACK, BLUE, GREEN, ORANGE, VERMILION
from paper_figs.registry import figure
from paper_figs.style import PAGE, new_panels
from studies.readhesion_paper.paper import CALIBRATED, CASE_A, Unprinted

PEAK = 0.18
"""Adhesion coefficient of the readhesion paper's scenario before the drop (its Table 2)."""
PLAN = 0.17
"""Planned coefficient of Table 2."""
SPEED = 30.0 / 3.6
"""Car speed [m/s] at which the creepage-based curves are drawn."""
CURVES: dict[str, tuple[AdhesionCurve, str, str]] = {
    "piecewise (readhesion paper)": (PiecewiseCurve(), BLUE, "-"),
    "Polach, wet": (POLACH_WET, ORANGE, "--"),
    "Polach, dry": (POLACH_DRY, VERMILION, "-."),
    "slip ratio (flat beyond peak)": (SlipRatioCurve(), GREEN, ":"),
}
PLANNED: dict[str, tuple[str, float, str, str]] = {
    "shinkansen": ("Shinkansen, wet: JP5484215 (12)", 270.0, BLUE, "-"),
    "curtius-kniffler": ("conventional: Curtius and Kniffler, dry", 160.0, VERMILION, "--"),
}
"""Law: label, highest speed [km/h] to which it is drawn, colour, dashes."""
SLIP, FORCE = "slip velocity [m/s]", "tangential force coefficient [–]"


@figure("adhesion-curve",
        "adhesion curves with regions and peak (JP5484215 Fig. 17, readhesion paper Fig. 1)")  # fmt: skip
def adhesion_curve(peak: float = PEAK) -> Figure:
    """Left: parts and regions of the piecewise curve for a `peak`. Right: the plant's curves at equal peak."""
    drawn, (left, right) = new_panels(PAGE, 3.1, 1, 2)
    _parts(left, PiecewiseCurve(), peak)
    _curves(right, peak)
    for axes in (left, right):
        axes.set(ylim=(0.0, 1.25 * peak), xlabel=SLIP, ylabel=FORCE)
    return drawn


def _parts(axes: Axes, curve: PiecewiseCurve, peak: float) -> None:
    half_width = curve.micro_slope / (4.0 * curve.top_curvature)
    line_end = peak / curve.micro_slope - half_width
    top = float(curve.limit(peak)[1])
    tail = top + curve.macro_slope / (2.0 * curve.top_curvature)
    end = 0.20
    slip = np.linspace(0.0, end, 1200)
    mu = curve.coefficient(slip, peak)
    axes.axvspan(0.0, top, color=BLUE, alpha=0.10, linewidth=0)
    axes.axvspan(top, end, color=VERMILION, alpha=0.10, linewidth=0)
    for name, inside, colour in (
        ("line", slip <= line_end, BLUE),
        ("parabola", (slip > line_end) & (slip <= tail), BLACK),
        ("exponential", slip > tail, VERMILION),
    ):
        axes.plot(slip[inside], mu[inside], color=colour, linewidth=2.0, label=name)
    axes.plot([top], [peak], "o", color="black", markersize=4.5)
    axes.annotate(
        rf"peak $\mu_\mathrm{{max}}$ = {peak:g}" + f"\nat {top:.3f} m/s",
        (top, peak), xytext=(top + 0.02, peak * 1.13), va="center",
        arrowprops={"arrowstyle": "-", "linewidth": 0.7},
    )  # fmt: skip
    for x, region, colour in (
        (0.58 * top, "micro slip\nstable", "#00456b"),
        (0.5 * (top + end), "macro slip\nunstable", "#8a3d00"),
    ):
        axes.text(x, 0.03 * peak, region, ha="center", va="bottom", color=colour)
    axes.set(xlim=(0.0, end), title="(a) parts of the piecewise curve")
    axes.xaxis.set_major_locator(MultipleLocator(0.05))
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.45))


def _curves(axes: Axes, peak: float) -> None:
    slip = np.concatenate([np.linspace(0.0, 0.2, 400), np.linspace(0.2, 4.0, 800)])
    for name, (curve, colour, dashes) in CURVES.items():
        # Polach's parameter is the friction coefficient; scaled so that the maxima agree
        own = peak * (peak / float(curve.limit(peak, SPEED)[0]))
        for _ in range(20):
            own *= peak / float(curve.limit(own, SPEED)[0])
        mu = curve.coefficient(slip, own, SPEED)
        axes.plot(slip, mu, color=colour, linestyle=dashes, label=name)
        limit, top = curve.limit(own, SPEED)
        axes.plot([float(top)], [float(limit)], "o", color=colour, markersize=4)
    title = f"(b) the plant's curves at {3.6 * SPEED:.0f} km/h, equal peaks"
    axes.set(xlim=(0.0, 4.0), title=title)
    axes.legend(loc="lower right")


@figure("adhesion-drop",
        "adhesion curve before and after the rail's change (readhesion paper Fig. 6)")  # fmt: skip
def adhesion_drop(unprinted: Unprinted = CALIBRATED, low: float = CASE_A.limit) -> Figure:
    """Both curves with their peaks. Left: the peaks. Right: all slips that case B reaches."""
    curve = PiecewiseCurve(residual_ratio=unprinted.residual_ratio)
    drawn, panels = new_panels(PAGE, 2.9, 1, 2, sharey=True)
    for axes, end in zip(panels, (0.2, 4.0), strict=True):
        slip = np.linspace(0.0, end, 1500)
        for peak, dashes, colour in ((PEAK, "-", BLUE), (low, "--", VERMILION)):
            label = rf"$\mu_\mathrm{{max}}$ = {peak:g}"
            axes.plot(slip, curve.coefficient(slip, peak), dashes, color=colour, label=label)
            axes.plot([float(curve.limit(peak)[1])], [peak], "o", color=colour, markersize=4)
        axes.axhline(PLAN, color=BLACK, linestyle=":", linewidth=0.9, label="plan")
        axes.xaxis.set_major_locator(MultipleLocator(end / 4.0))
        axes.set(xlim=(0.0, end), ylim=(0.0, 0.2), xlabel=SLIP)
    panels[0].set(ylabel=FORCE, title="(a) around the peaks")
    panels[1].set_title(
        rf"(b) towards $\mu_\infty$ = {unprinted.residual_ratio:.3g} $\mu_\mathrm{{max}}$"
    )
    panels[1].legend(loc="lower right")
    return drawn


@figure("planned-curves", "planned coefficients over speed (JP5484215 Fig. 10)")
def planned_curves() -> Figure:
    """Left: the curves. Right: ratio by which increments of the Shinkansen are corrected for conventional lines."""
    drawn, (left, right) = new_panels(PAGE, 2.9, 1, 2, gridspec_kw={"wspace": 0.08})
    for name, (label, end, colour, dashes) in PLANNED.items():
        speed = np.linspace(0.0, end, 300)
        left.plot(speed, planned(name, speed), color=colour, linestyle=dashes, label=label)
    left.set(xlim=(0.0, 270.0), ylabel="planned coefficient [–]", title="(a) planned curves")
    left.legend(loc="upper right")
    speed = np.linspace(0.0, PLANNED["curtius-kniffler"][1], 300)
    ratio = planned("curtius-kniffler", speed) / planned("shinkansen", speed)
    right.plot(speed, ratio, color="black")
    right.set(
        xlim=(0.0, speed[-1]), ylabel="conventional over Shinkansen [–]",
        title="(b) factor on the increments",
    )  # fmt: skip
    for axes in (left, right):
        axes.set(ylim=(0.0, None), xlabel="speed [km/h]")
    return drawn


def planned(law: str, speed: np.ndarray) -> np.ndarray:
    """Planned coefficient by a law of `SPEED_LAWS` at `speed` [km/h]."""
    return np.asarray(hyperbolic_speed_law(speed / 3.6, *SPEED_LAWS[law]))
