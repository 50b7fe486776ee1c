"""Polach's law as Open Rails has it, as it should be, and as this plant has it; creep stiffness over the wheel load."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.plant.adhesion import (
    CYLINDER,
    HALF_WIDTH,
    SHEAR_MODULUS,
    YOUNGS_MODULUS,
    PolachByFrictionCurve,
    longitudinal_coefficient,
)
from paper_figs.palette import BLACK, BLUE, GREY, VERMILION
from paper_figs.registry import figure
from paper_figs.style import PAGE, new_panels

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
        xlim=(slip[0], slip[-1]), ylim=(0.0, 0.32), xlabel="slip velocity [m/s]",
        ylabel="tangential force coefficient [–]", title="(a) wet rail, 72 km/h, 100 kN per wheel",
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
