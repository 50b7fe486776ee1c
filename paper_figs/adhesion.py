"""Adhesion curves: parts and peak (JP5484215 Fig. 17, readhesion paper Fig. 1), and Polach's law here and in Open Rails."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from alloc.plant.adhesion import (
    CYLINDER,
    HALF_WIDTH,
    POLACH_DRY,
    POLACH_WET,
    SHEAR_MODULUS,
    YOUNGS_MODULUS,
    AdhesionCurve,
    PiecewiseCurve,
    PolachByFrictionCurve,
    SlipRatioCurve,
    longitudinal_coefficient,
)
from paper_figs.drawing import figure
from paper_figs.style import BLACK, BLUE, GREEN, GREY, ORANGE, PAGE, VERMILION, new_panels

PEAK = 0.18
"""Adhesion coefficient of the readhesion paper's scenario before the drop (its Table 2)."""
CAR_SPEED = 30.0 / 3.6
"""Car speed [m/s] at which the creepage-based curves are drawn."""
CURVES: dict[str, tuple[AdhesionCurve, str, str]] = {
    "piecewise (readhesion paper)": (PiecewiseCurve(), BLUE, "-"),
    "Polach, wet": (POLACH_WET, ORANGE, "--"),
    "Polach, dry": (POLACH_DRY, VERMILION, "-."),
    "slip ratio (flat beyond peak)": (SlipRatioCurve(), GREEN, ":"),
}
SLIP, FORCE = "slip velocity [m/s]", "tangential force coefficient [–]"


@figure("adhesion-curve",
        "adhesion curves with regions and peak (JP5484215 Fig. 17, readhesion paper Fig. 1)")  # fmt: skip
def adhesion_curve(peak: float = PEAK) -> Figure:
    """Left: parts and regions of the piecewise curve for a `peak`. Right: the plant's curves at equal peak."""
    drawn, (left, right) = new_panels(PAGE, 3.1, 1, 2)
    _parts(left, PiecewiseCurve(), peak)
    slip = np.concatenate([np.linspace(0.0, 0.2, 400), np.linspace(0.2, 4.0, 800)])
    for name, (curve, colour, dashes) in CURVES.items():
        # Polach's parameter is the friction coefficient; scaled so that the maxima agree
        own = peak * (peak / float(curve.limit(peak, CAR_SPEED)[0]))
        for _ in range(20):
            own *= peak / float(curve.limit(own, CAR_SPEED)[0])
        mu = curve.coefficient(slip, own, CAR_SPEED)
        right.plot(slip, mu, color=colour, linestyle=dashes, label=name)
        limit, top = curve.limit(own, CAR_SPEED)
        right.plot([float(top)], [float(limit)], "o", color=colour, markersize=4)
    title = f"(b) the plant's curves at {3.6 * CAR_SPEED:.0f} km/h, equal peaks"
    right.set(xlim=(0.0, 4.0), title=title)
    right.legend(loc="lower right")
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


FRICTION, SPEED, LOAD, RADIUS = 0.30, 20.0, 1e5, 0.5
"""Friction coefficient at rest, speed [m/s], wheel load [N] and radius [m] of the comparison."""
CONSTANT = 186.0
"""Creep stiffness of the curve without load and radius."""


def open_rails_stiffness(load: NDArray[np.float64]) -> NDArray[np.float64]:
    """G pi a b C11 / (4 Q) by Open Rails: C11 follows a / b of the load, while b stays."""
    a = CYLINDER * np.sqrt(load * RADIUS / (2.0 * HALF_WIDTH * YOUNGS_MODULUS))
    ratio = a / HALF_WIDTH
    c11 = np.array([longitudinal_coefficient(float(one)) for one in ratio])
    return SHEAR_MODULUS * np.pi * a * HALF_WIDTH * c11 / (4.0 * load)


def open_rails_coefficient(slip: NDArray[np.float64], coded: bool) -> NDArray[np.float64]:
    """Tangential coefficient over the slip velocity, right or as `coded`: a b in mm2, and kA not squared."""
    curve = PolachByFrictionCurve()
    fall = curve.ratio_at_infinity + (1.0 - curve.ratio_at_infinity) * np.exp(-0.2 * slip)
    stiffness = float(open_rails_stiffness(np.array([LOAD]))[0]) * (1e6 if coded else 1.0)
    a = CYLINDER * np.sqrt(LOAD * RADIUS / (2.0 * HALF_WIDTH * YOUNGS_MODULUS))
    creepage = slip / SPEED
    with_spin = np.hypot(creepage, a * np.sin(np.deg2rad(3.0)) / RADIUS)
    gradient = stiffness * with_spin / (FRICTION * fall)
    below = 1.0 + (0.3 if coded else 0.3**2) * gradient**2
    total = 0.3 * gradient / below + np.arctan(0.1 * gradient)
    return np.asarray(2.0 / np.pi * FRICTION * fall * total * creepage / with_spin)


@figure("open-rails", "Polach's law in Open Rails, as coded and corrected, and in this plant")
def open_rails() -> Figure:
    """Left: coefficients over the slip velocity on wet rail, with their peaks.

    Right: creep stiffness over the wheel load.
    """
    drawn, (left, right) = new_panels(PAGE, 3.0, 1, 2)
    slip = np.geomspace(1e-3, SPEED, 1000)
    curve = PolachByFrictionCurve()
    plant = -curve.coefficient(-slip, FRICTION, SPEED, curve.contact(LOAD, RADIUS))
    for label, values, colour, dashes, size in (
        ("Open Rails as coded", open_rails_coefficient(slip, True), VERMILION, "-", 4),
        ("Open Rails corrected", open_rails_coefficient(slip, False), BLACK, "-", 7),
        ("this plant", plant, BLUE, "--", 4),
    ):
        left.semilogx(slip, values, color=colour, linestyle=dashes, label=label)
        top = int(values.argmax())
        left.plot(slip[top], values[top], "o", color=colour, markersize=size, gid=f"{label}, peak")
    left.set(
        xlim=(slip[0], slip[-1]), ylim=(0.0, 0.32), xlabel=SLIP, ylabel=FORCE,
        title="(a) wet rail, 72 km/h, 100 kN per wheel",
    )  # fmt: skip
    left.legend(loc="lower right")
    load = np.geomspace(10e3, 150e3, 200)
    kept = [curve.on(float(one), RADIUS).q[4] for one in load]
    right.loglog(load / 1e3, open_rails_stiffness(load), color=BLACK, label="Open Rails corrected")
    right.loglog(load / 1e3, kept, "--", color=BLUE, label="this plant")
    right.axhline(CONSTANT, color=GREY, linestyle=":", label="one constant")
    ticks = [10, 20, 50, 100, 150]
    right.set_xticks(ticks, [f"{tick}" for tick in ticks], minor=False)
    right.set_yticks([100, 200, 300, 400], ["100", "200", "300", "400"])
    right.minorticks_off()
    right.set(
        xlim=(10.0, 150.0), ylim=(90.0, 450.0), xlabel="wheel load [kN]",
        ylabel="creep stiffness [–]", title="(b) wheel of 0.5 m radius",
    )  # fmt: skip
    right.legend(loc="upper right")
    return drawn
