"""Planned coefficients over speed, JP5484215 Fig. 10, and the correction of increments that follows from them."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from alloc.plant.equations import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure

CURVES: dict[str, tuple[str, float, str, str]] = {
    "shinkansen": ("Shinkansen, wet: JP5484215 (12)", 270.0, "#0072b2", "-"),
    "curtius-kniffler": ("conventional: Curtius and Kniffler, dry", 160.0, "#d55e00", "--"),
}
"""Law: label, highest speed [km/h] to which it is drawn, colour, dashes."""


def figure(source: Source) -> Figure:
    """The figure; it needs no data from `source`."""
    return draw()


def draw() -> Figure:
    """Left: the curves. Right: ratio by which increments of the Shinkansen are corrected for conventional lines."""
    drawn = new_figure(7.1, 2.9)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2, gridspec_kw={"wspace": 0.08})
        for name, (label, end, colour, dashes) in CURVES.items():
            speed = np.linspace(0.0, end, 300)
            left.plot(speed, planned(name, speed), color=colour, linestyle=dashes, label=label)
        left.set(
            xlim=(0.0, 270.0), ylim=(0.0, None),
            xlabel="speed [km/h]", ylabel="planned coefficient [–]", title="(a) planned curves",
        )  # fmt: skip
        left.legend(loc="upper right")
        speed = np.linspace(0.0, CURVES["curtius-kniffler"][1], 300)
        right.plot(
            speed,
            planned("curtius-kniffler", speed) / planned("shinkansen", speed),
            color="black",
        )
        right.set(
            xlim=(0.0, speed[-1]), ylim=(0.0, None),
            xlabel="speed [km/h]", ylabel="conventional over Shinkansen [–]",
            title="(b) factor on the increments",
        )  # fmt: skip
    return drawn


def planned(law: str, speed: np.ndarray) -> np.ndarray:
    """Planned coefficient by a law of `SPEED_LAWS` at `speed` [km/h]."""
    return np.asarray(hyperbolic_speed_law(speed / 3.6, *SPEED_LAWS[law]))
