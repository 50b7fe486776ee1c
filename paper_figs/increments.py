"""How adhesion grows along the train, JP5484215 Figs. 11 to 13, and how a train learns it."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.estimation import increments as shifting
from alloc.estimation.increments import LEAD_AXLES, SYNTHETIC_TABLE, SlideCounts, read_slide_counts
from alloc.plant.rail import logarithmic_increments
from paper_figs.direct_labels import label_lines
from paper_figs.palette import BLACK, BLUE, GREY, ORANGE, PINK, PURPLE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, study
from paper_figs.style import PAGE, new_panels
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
LEARNERS = {
    "running mean": VERMILION,
    "running mean, held": ORANGE,
    "Gaussian": BLUE,
    "Gaussian, robust": PURPLE,
}
"""Arms that learn, and the colour of each."""
FEW_EVENTS = 12
"""Station starts that are run for the figure where the results have none: six in each direction."""
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
    """Largest error of any unit's increment, a panel per learner and kind of rail and stored values; trains that are sound.

    Thin: each train in each running direction; thick: their mean; dashed: without learning. Noted: how many ended within the
    tolerance, the dotted line.
    """
    table = table[table["case"] == "sound"]
    kinds = table[["rail", "stored"]].drop_duplicates().itertuples(index=False, name=None)
    groups = {
        kind: table[(table["rail"] == kind[0]) & (table["stored"] == kind[1])] for kind in kinds
    }
    shape = {"sharex": True, "sharey": True, "squeeze": False}
    drawn, axes = new_panels(PAGE, 0.8 + 1.15 * len(groups), len(groups), len(LEARNERS), **shape)
    for ((rail, stored), rows), line in zip(groups.items(), axes, strict=True):
        for one, (arm, colour) in zip(line, LEARNERS.items(), strict=True):
            _learner(one, rows, arm, colour)
        line[0].set_title(f"{rail} rail, stored values {stored}", fontweight="bold")
    for one, (arm, colour) in zip(axes[0], LEARNERS.items(), strict=True):
        one.annotate(arm, (0.0, 1.0), (0.0, 13.0), "axes fraction", "offset points", color=colour)
    for one in axes[-1]:
        one.set_xlabel("stations")
    axes[0, 0].set(yscale="log", xlim=(table["station"].min(), table["station"].max()))
    axes[0, 0].yaxis.set_major_formatter("{x:g}")
    axes[0, 0].yaxis.set_minor_formatter(NullFormatter())
    low, high = axes[0, 0].get_ylim()
    axes[0, 0].set_ylim(min(low, 0.5 * TOLERANCE), 1.2 * high)
    axes[len(axes) // 2, 0].set_ylabel("largest error of any unit [–]")
    label_lines(axes[0, 0])
    return drawn


def _learner(axes: Axes, rows: pd.DataFrame, arm: str, colour: str) -> None:
    series = _series(rows, arm)
    for name in series:
        axes.plot(
            series.index, series[name], color=colour, linewidth=0.5, alpha=0.5, label="_train"
        )
    axes.plot(series.index, series.mean(axis=1), color=colour, linewidth=1.8, label="_mean")
    without = _series(rows, "no learning").mean(axis=1)
    axes.plot(without.index, without, color=GREY, linestyle="--", label="no learning")
    axes.plot(series.index, np.full(len(series), TOLERANCE), ":", color=BLACK, label="tolerance")
    within = int((series.iloc[-1] <= TOLERANCE).sum())
    axes.annotate(
        f"{within} of {series.shape[1]} within",
        (0.0, 0.0),
        (2.0, 1.0),
        "axes fraction",
        "offset points",
    )


def _series(rows: pd.DataFrame, arm: str) -> pd.DataFrame:
    """Errors of an arm, (stations, trains and directions)."""
    own = rows[rows["arm"] == arm]
    return own.pivot(index="station", columns=SERIES, values="error")
