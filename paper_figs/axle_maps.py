"""A quantity of every axle over time as a picture: a row per axle, so that no axle hides another."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import FixedFormatter, FixedLocator
from numpy.typing import NDArray

ADHESION_SHADES = LinearSegmentedColormap.from_list("adhesion", ["#08306b", "#6baed6", "#f4f9fd"])
"""From a slippery rail (dark) to a good one (nearly white)."""
SLIP_SHADES = LinearSegmentedColormap.from_list(
    "slip", ["#ffffff", "#fdae61", "#a63603", "#4d1a00"]
)
"""From a wheel that rolls (white) to one that spins or slides (dark)."""
LEAST_SLIP = 0.1
"""Slip velocity [m/s] that the darkest shade stands for at least: less is creep, and no wheel spins."""
COEFFICIENT_SHADES = LinearSegmentedColormap.from_list(
    "coefficient", ["#ffffff", "#74c0a8", "#00441b"]
)
"""From no force (white) to much (dark)."""
AXLE = "axle from the front"
UNKNOWN = "#dcdcdc"
"""Where nothing is known."""
MOST_NAMES = 9
"""Names that have room above each other; of those that are too near to another, the foremost stands."""
MOST_COLUMNS = 360
"""Instants of a picture: what a page can print."""


def axle_map(
    axes: Axes,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    shades: LinearSegmentedColormap,
    norm: Normalize,
    gather: np.ufunc = np.fmax,
) -> AxesImage:
    """Draw `values` (time, axle), the foremost axle at the top; several instants that share a column are gathered.

    `np.fmax` keeps peaks, `np.fmin` keeps dips. Where `time` has a gap, nothing is known.
    """
    span, count = float(time[-1] - time[0]), values.shape[1]
    period = float(np.median(np.diff(time))) if time.size > 1 else 1.0
    width = max((span + period) / MOST_COLUMNS, period)
    column = np.floor((time - time[0]) / width + 1e-6).astype(int)
    first = np.flatnonzero(np.diff(column, prepend=-1))
    kept = np.full((int(column[-1]) + 1, count), np.nan)
    kept[column[first]] = gather.reduceat(values, first, axis=0)
    begin, end = float(time[0]), float(time[0]) + width * len(kept)
    image = axes.imshow(
        np.ma.masked_invalid(kept.T), cmap=shades.with_extremes(bad=UNKNOWN), norm=norm, aspect="auto",
        interpolation="nearest", extent=(begin, end, count + 0.5, 0.5),
    )  # fmt: skip
    axes.grid(visible=False)
    step = max(1, -(-count // 4))
    axes.yaxis.set_major_locator(FixedLocator(sorted({1, *range(step, count + 1, step)})))
    return image


def shade_bar(drawn: Figure, image: AxesImage, panels: Sequence[Axes], label: str) -> None:
    """The scale of a picture's shades, at the right of `panels`."""
    bar = drawn.colorbar(image, ax=list(panels), aspect=12, pad=0.02, fraction=0.05)
    bar.set_label(label)
    bar.outline.set_visible(False)
    bar.locator = FixedLocator(bar.ax.yaxis.get_major_locator()())


def name_units(axes: Axes, axle_unit: NDArray[np.int64], units: Sequence[int]) -> None:
    """Name some traction units with their axles, and the train's first and last axle where there is room.

    Ticks part all units; `axle_unit` (axle,): -1 for none.
    """
    count = axle_unit.size
    room = count / MOST_NAMES
    edges = np.flatnonzero(np.diff(axle_unit, prepend=-2, append=-2)) + 0.5
    named: dict[float, str] = {}
    for unit in units:
        own = np.flatnonzero(axle_unit == unit) + 1
        place = float(own.mean())
        if not named or place - max(named) >= room:
            axles = f"{own[0]}" if own.size == 1 else f"{own[0]}–{own[-1]}"
            named[place] = f"unit {unit + 1}: {axles}"
    for axle in (1, count):
        if all(abs(axle - place) >= room for place in named):
            named[float(axle)] = f"{axle}"
    axes.yaxis.set_major_locator(FixedLocator(list(named)))
    axes.yaxis.set_major_formatter(FixedFormatter(list(named.values())))
    axes.yaxis.set_minor_locator(FixedLocator(edges.tolist()))
    axes.tick_params(axis="y", which="major", length=0)
    axes.tick_params(axis="y", which="minor", length=4)
