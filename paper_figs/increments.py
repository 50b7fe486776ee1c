"""How adhesion grows along the train, JP5484215 Figs. 11 to 13, and how a train learns it."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from alloc.estimation import increments as shifting
from alloc.estimation.slide_counts import (
    LEAD_AXLES,
    SYNTHETIC_TABLE,
    SlideCounts,
    read_slide_counts,
)
from alloc.plant.rail import logarithmic_increments
from paper_figs.palette import BLACK, BLUE, GREY, ORANGE, PINK, PURPLE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, study
from paper_figs.style import PAGE, legend_below, new_panels
from studies.core.statement import CONFIDENCE
from studies.learning.series import SERIES, TOLERANCE

AXLES = 32
"""Axles of a train of eight cars, all driven."""
DRIVES: dict[str, tuple[int, str, str]] = {
    "1C4M": (4, BLACK, "-"),
    "1C2M": (2, VERMILION, "-"),
    "1C1M": (1, SKY, "-"),
}
"""Motors per inverter, which is axles per unit; colour, dashes."""
LINES: dict[str, tuple[float | None, str, str]] = {
    "Shinkansen (15)": (None, BLACK, "-"),
    "conventional, 30 km/h": (30.0, ORANGE, "--"),
    "conventional, 80 km/h": (80.0, VERMILION, "-."),
    "conventional, 130 km/h": (130.0, PINK, ":"),
}
"""Speed [km/h] at which the increments are corrected by the planned curves, None: not at all; colour, dashes."""
ARM_STYLES: dict[str, tuple[str, str]] = {
    "no learning": (GREY, ":"),
    "running mean": (VERMILION, "-"),
    "running mean, held": (ORANGE, "--"),
    "Gaussian": (BLUE, "-"),
    "Gaussian, robust": (PURPLE, "--"),
}
"""Colour and dashes of each arm."""
FEW_EVENTS = 12
"""Station starts that are run for the figure where the results hold none: six in each direction."""
AXLE = "axle from the front"


@figure("axle-shifts", "shift of each axle's coefficient, synthetic counts (JP5484215 Figs. 11, 12)",
        made(read_slide_counts, SYNTHETIC_TABLE))  # fmt: skip
def axle_shifts(counts: SlideCounts) -> Figure:
    """Left: slides per axle. Right: k_j sigma by (14), the fit with its band, and (15).

    A table whose source says SYNTHETIC is labelled so across both.
    """
    drawn, (left, right) = new_panels(PAGE, 3.4, 1, 2, width_ratios=(2.0, 3.0))
    axle = np.arange(1, counts.axle_count + 1)
    left.bar(axle, counts.slides, width=1.0, color=GREY, alpha=0.75)
    mean = f"mean of axles 1 to {LEAD_AXLES}"
    left.axhline(counts.lead_mean, color="black", linestyle="--", linewidth=1.0, label=mean)
    left.legend(loc="upper right")
    left.set(ylabel="slides", title="(a) slides counted")
    _shifts(right, counts, axle)
    for axes in (left, right):
        axes.set(xlim=(0.0, counts.axle_count + 1.0), xlabel=AXLE)
    if counts.source.startswith("SYNTHETIC"):
        drawn.suptitle("SYNTHETIC counts, drawn from JP5484215 (14) and (15): not measured")
    return drawn


def _shifts(axes: Axes, counts: SlideCounts, axle: NDArray[np.int64]) -> None:
    shifts = shifting.axle_shifts(counts)
    fit = shifting.fit_increments(shifts)
    quantile = float(norm.ppf(0.5 + 0.5 * CONFIDENCE))
    axes.errorbar(
        axle, shifts.shift, quantile * shifts.deviation, fmt="o", color=GREY, markersize=2.5,
        linewidth=0.7, label="each axle, with its counting error (95 %)",
    )  # fmt: skip
    axes.fill_between(axle, *fit.band(CONFIDENCE), color=BLUE, alpha=0.25, linewidth=0)
    axes.plot(
        axle, fit.increments(), color=BLUE,
        label=f"fit: ({1e3 * fit.slope:.2f} ± {1e3 * quantile * fit.slope_deviation:.2f})"
        f"·10⁻³ ln j − {-1e3 * fit.offset:.2f}·10⁻³",
    )  # fmt: skip
    axes.plot(
        axle, logarithmic_increments(counts.axle_count), color=VERMILION, linestyle="--",
        label="JP5484215 (15): 8.3·10⁻³ ln j − 6.6·10⁻³",
    )  # fmt: skip
    axes.set(ylabel=r"shift $k_j\sigma$ [–]", title="(b) shift of the mean coefficient")
    axes.legend(loc="lower right")


@figure("unit-increments", "increments per unit by drive and line (JP5484215 Fig. 13)")
def unit_increments() -> Figure:
    """Left: one line per unit over the axles that it drives, by drive. Right: 1C4M on conventional lines, by speed."""
    drawn, (left, right) = new_panels(PAGE, 3.0, 1, 2, gridspec_kw={"wspace": 0.08})
    per_axle = logarithmic_increments(AXLES)
    for name, (axles, colour, dashes) in DRIVES.items():
        _units(left, per_axle, axles, color=colour, linestyle=dashes, label=name)
    left.set_title("(a) Shinkansen, by motors per inverter")
    for name, (speed, colour, dashes) in LINES.items():
        own = per_axle
        if speed is not None:
            own = shifting.conventional_increments(per_axle, speed / 3.6)
        _units(right, own, 4, color=colour, linestyle=dashes, label=name)
    right.set_title("(b) 1C4M, by line and speed")
    for axes in (left, right):
        axes.set(
            xlim=(0.5, AXLES + 0.5), xlabel=AXLE, ylabel="increment over the foremost unit [–]"
        )
        axes.set_xticks([1, *range(4, AXLES + 1, 4)])
    left.legend(loc="lower right")
    right.set_ylim(top=0.095)  # room for the legend
    right.legend(loc="upper left")
    return drawn


def _units(axes: Axes, per_axle: NDArray[np.float64], axles: int, **look: str) -> None:
    """A level per unit that drives `axles` neighbouring axles."""
    values = shifting.unit_increments(per_axle, np.arange(per_axle.size) // axles)
    edges = 0.5 + axles * np.arange(values.size + 1)
    # pieces parted by nan: a unit is a level of its own, and nothing lies between two units
    x = np.stack([edges[:-1] + 0.12, edges[1:] - 0.12, np.full(values.size, np.nan)], axis=1)
    axes.plot(x.ravel(), np.repeat(values, 3), linewidth=1.6, **look)  # type: ignore[arg-type]


@figure("learning", "error of the increments against stations, by learner (sweep learning)",
        study("learning", FEW_EVENTS))  # fmt: skip
def learning(table: pd.DataFrame) -> Figure:
    """One panel per kind of rail and kind of stored values: largest error of any unit, mean of the trains that are sound."""
    table = table[table["case"] == "sound"]
    rails, stored = list(table["rail"].unique()), list(table["stored"].unique())
    shape = {"sharex": True, "sharey": True, "squeeze": False}
    drawn, axes = new_panels(PAGE, 4.8, len(rails), len(stored), **shape)
    for rail, row in zip(rails, axes, strict=True):
        for kind, one in zip(stored, row, strict=True):
            chosen = table[(table["rail"] == rail) & (table["stored"] == kind)]
            for arm in ARM_STYLES:
                _arm(one, chosen[chosen["arm"] == arm], arm)
            one.axhline(TOLERANCE, color="black", linewidth=0.9, linestyle=(0, (1, 2)))
            one.set_title(f"{rail} rail, stored values {kind}")
            one.set(xlim=(table["station"].min(), table["station"].max()), ylim=(0.0, None))
        row[0].set_ylabel("largest error of any unit [–]")
    for one in axes[-1]:
        one.set_xlabel("stations")
    first = axes[0, 0]
    first.text(
        0.99, TOLERANCE, f"{TOLERANCE:g}", transform=first.get_yaxis_transform(),
        ha="right", va="bottom",
    )  # fmt: skip
    legend_below(drawn, len(ARM_STYLES), first)
    return drawn


def _arm(axes: Axes, rows: pd.DataFrame, arm: str) -> None:
    series = rows.pivot(index="station", columns=SERIES, values="error")
    mean, n = series.mean(axis=1), series.shape[1]
    colour, dashes = ARM_STYLES[arm]
    axes.plot(series.index, mean, color=colour, linestyle=dashes, label=arm)
    if n > 1 and arm != "no learning":
        half = float(student.ppf(0.5 + 0.5 * CONFIDENCE, n - 1)) * series.std(axis=1) / np.sqrt(n)
        low, high = mean - half, mean + half
        axes.fill_between(series.index, low, high, color=colour, alpha=0.15, linewidth=0)
