"""Increments per traction unit, JP5484215 Fig. 13: for every drive, and corrected for conventional lines."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.estimation.increments import conventional_increments, unit_increments
from alloc.plant.rail import logarithmic_increments
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure

AXLES = 32
"""Axles of a train of eight cars, all driven."""
DRIVES: dict[str, tuple[int, str, str]] = {
    "1C4M": (4, "#000000", "-"),
    "1C2M": (2, "#d55e00", "-"),
    "1C1M": (1, "#56b4e9", "-"),
}
"""Motors per inverter, which is axles per unit; colour, dashes."""
LINES: dict[str, tuple[float | None, str, str]] = {
    "Shinkansen (15)": (None, "#000000", "-"),
    "conventional, 30 km/h": (30.0, "#e69f00", "--"),
    "conventional, 80 km/h": (80.0, "#d55e00", "-."),
    "conventional, 130 km/h": (130.0, "#cc79a7", ":"),
}
"""Speed [km/h] at which the increments are corrected by the planned curves, None: not at all; colour, dashes."""


def figure(source: Source) -> Figure:
    """The figure; it needs no data from `source`."""
    return draw()


def draw() -> Figure:
    """Left: one line per unit over the axles that it drives, by drive. Right: 1C4M on conventional lines, by speed."""
    drawn = new_figure(7.1, 3.0)
    with mpl.rc_context(fname=STYLE_FILE):
        left, right = drawn.subplots(1, 2, gridspec_kw={"wspace": 0.08})
        per_axle = logarithmic_increments(AXLES)
        for name, (axles, colour, dashes) in DRIVES.items():
            _units(left, increments(per_axle, axles), axles, name, colour, dashes)
        left.set_title("(a) Shinkansen, by motors per inverter")
        for name, (speed, colour, dashes) in LINES.items():
            corrected = (
                per_axle if speed is None else conventional_increments(per_axle, speed / 3.6)
            )
            _units(right, increments(corrected, 4), 4, name, colour, dashes)
        right.set_title("(b) 1C4M, by line and speed")
        for axes in (left, right):
            axes.set(
                xlim=(0.5, AXLES + 0.5), xlabel="axle from the front",
                ylabel="increment over the foremost unit [–]",
            )  # fmt: skip
            axes.set_xticks([1, *range(4, AXLES + 1, 4)])
        left.legend(loc="lower right")
        right.set_ylim(top=0.095)  # room for the legend
        right.legend(loc="upper left")
    return drawn


def increments(per_axle: NDArray[np.float64], axles: int) -> NDArray[np.float64]:
    """Increments of units that drive `axles` neighbouring axles each, (units,)."""
    return unit_increments(per_axle, np.arange(per_axle.size) // axles)


def _units(
    axes: Axes, values: NDArray[np.float64], axles: int, name: str, colour: str, dashes: str
) -> None:
    edges = 0.5 + axles * np.arange(values.size + 1)
    # pieces parted by nan: a unit is a level of its own, and nothing lies between two units
    x = np.stack([edges[:-1] + 0.12, edges[1:] - 0.12, np.full(values.size, np.nan)], axis=1)
    y = np.stack([values, values, values], axis=1)
    axes.plot(x.ravel(), y.ravel(), color=colour, linestyle=dashes, linewidth=1.6, label=name)
