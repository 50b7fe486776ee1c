"""Adhesion of the demonstration of JP4209318 over speed, slip ratio and axle position, calibrated (its Fig. 2)."""

from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.slides.jp4209318 import CALIBRATED, Undisclosed

SPEEDS = {10.0: "#0072b2", 50.0: "#009e73", 100.0: "#d55e00"}
"""Speed [km/h] and its colour."""
AXLES: dict[int, Literal["-", "--"]] = {1: "-", 12: "--"}
"""Axle from the front and its line."""


def figure(source: Source) -> Figure:
    """The figure; it needs no results."""
    return draw(CALIBRATED)


def draw(undisclosed: Undisclosed) -> Figure:
    """Left: over slip ratio. Middle: over speed; the upper end of each band is on fully conditioned rail. Right: by axle."""
    curve = undisclosed.rail().curve
    drawn = new_figure(7.1, 3.0)
    with mpl.rc_context(fname=STYLE_FILE):
        by_slip, by_speed, by_axle = drawn.subplots(1, 3, sharey=True)
        ratio = np.linspace(0.0, 0.12, 241)
        for kmh, colour in SPEEDS.items():
            peaks = undisclosed.peaks(np.array([kmh]))[:, 0]
            for axle, line in AXLES.items():
                speed = kmh / 3.6
                mu = curve.coefficient(-ratio * speed, peaks[axle - 1], speed)
                by_slip.plot(100.0 * ratio, -mu, line, color=colour)
            axles = np.arange(1, peaks.size + 1)
            by_axle.plot(axles, peaks, "o-", color=colour, markersize=3.5)
            raised = peaks[1:] * (1.0 + undisclosed.conditioning)
            by_axle.plot(
                axles[1:], raised, "o", color=colour, markersize=3.5, markerfacecolor="white"
            )
        speeds = np.linspace(0.0, 100.0, 101)
        peaks = undisclosed.peaks(speeds)
        for axle, line in AXLES.items():
            by_speed.plot(speeds, peaks[axle - 1], line, color="black")
        rear = peaks[11]
        by_speed.fill_between(
            speeds, rear, rear * (1.0 + undisclosed.conditioning), color="black", alpha=0.12, lw=0
        )
        by_slip.set(
            xlabel="slip ratio [%]",
            ylabel="adhesion coefficient [–]",
            ylim=(0.0, 0.16),
            xlim=(0.0, 12.0),
        )
        by_slip.set_xticks([0, 3, 6, 9, 12])
        by_slip.set_title("(a) over slip")
        by_speed.set(xlabel="train speed [km/h]", title="(b) over speed")
        by_axle.set(xlabel="axle from the front", title="(c) along the train")
        by_axle.set_xticks([1, 4, 8, 12])
        drawn.legend(handles=_handles(), loc="outside lower center", ncols=4)
    return drawn


def _handles() -> list[Line2D]:
    grey: dict[str, Any] = {"color": "#444444"}
    return [
        *(Line2D([], [], color=c, label=f"{kmh:.0f} km/h") for kmh, c in SPEEDS.items()),
        Line2D([], [], linestyle="none", marker="o", label="not conditioned", **grey),
        *(Line2D([], [], linestyle=line, label=f"axle {a}", **grey) for a, line in AXLES.items()),
        Line2D([], [], linewidth=6, alpha=0.3, label="up to fully conditioned", **grey),
        Line2D([], [], linestyle="none", marker="o", markerfacecolor="white",
               label="fully conditioned", **grey),
    ]  # fmt: skip
