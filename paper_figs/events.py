"""Recorded slip events over time: every axle as a picture, what units have, use and may use, and jerk."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator
from numpy.typing import NDArray

from alloc.metrics import evaluate
from alloc.metrics.use import jerk
from alloc.recording import attributes_of
from paper_figs.drawing import figure, recorded
from paper_figs.style import BLACK, COLUMN, DARK, PAGE, Look, legend_below, new_panels, rule_colour

CONTROLLER = "cut-and-ramp"
MAP_HEIGHTS, STRIP_HEIGHT, NAME_HEIGHT = (1.3, 1.3), 0.95, 0.13
"""Of pictures of all axles, of a unit's strip, and of the name above it [inches]."""
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
AVAILABLE = "#c6dcef"
"""Fill of the adhesion that there is."""
LIMIT: Look = {"color": BLACK, "linewidth": 0.7, "linestyle": (0, (2.5, 1.5))}
USED_WIDTH = 0.9
MOST_INSTANTS = 750
"""Of a strip: more than a page can print."""
SHOWN_UNITS = 2
"""Most units that get a strip of their own: more strips are too low to be read."""
ROOM = 1.3
"""What a strip shows, over the largest limit: adhesion far above it serves nothing."""


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


class AdhesionUse(NamedTuple):
    """Series of some axles over time, each as a coefficient [-], (time,)."""

    time: NDArray[np.float64]
    available: NDArray[np.float64]
    """Adhesion that there is: maximum over the slip, weighted by the axles' loads."""
    used: NDArray[np.float64]
    """Force between wheels and rail over load, its magnitude."""
    limit: NDArray[np.float64]
    """Limit by the rule; of several units the mean weighted by their loads."""


def use_of_units(run: xr.Dataset, units: list[int]) -> AdhesionUse:
    """What these units of a recorded run have, use and may use."""
    own = np.isin(run["axle_unit"].values, units)
    load = run["axle_load"].values[:, own]
    whole = load.sum(axis=1)
    weight = run["unit_static_load"].values[units]
    return AdhesionUse(
        run["time"].values,
        (run["adhesion_limit"].values[:, own] * load).sum(axis=1) / whole,
        np.abs(run["rail_force"].values[:, own].sum(axis=1)) / whole,
        run["limit"].values[:, units] @ weight / weight.sum(),
    )


def shown_units(run: xr.Dataset) -> list[int]:
    """Units that get a strip: all, or `SHOWN_UNITS` from the foremost to the rearmost."""
    count = run.sizes["unit"]
    return sorted(set(np.linspace(0, count - 1, min(count, SHOWN_UNITS)).round().astype(int)))


def draw_use(axes: Axes, use: AdhesionUse, colour: str) -> None:
    """A strip: filled what there is, a line what is used, dashed what is allowed."""
    shown = AdhesionUse(*(values[:: -(-use.time.size // MOST_INSTANTS)] for values in use))
    axes.fill_between(
        shown.time, 0.0, shown.available, color=AVAILABLE, linewidth=0.0, label="available"
    )
    axes.plot(shown.time, shown.limit, label="limit", **LIMIT)
    axes.plot(shown.time, shown.used, color=colour, linewidth=USED_WIDTH, label="used")


@figure("slip-event", "one slip event: adhesion at every axle, slip, and what each unit uses of it under its limit",
        recorded("wet-patch", "alone", CONTROLLER), recorded("wet-patch", "cooperative", CONTROLLER))  # fmt: skip
def slip_event(*runs: xr.Dataset) -> Figure:
    """One column per run, all of the same train.

    Rows: adhesion at every axle, so that a slippery place is seen to pass below the train; slip of every axle; what
    units and train have, use and may use. Possible is what rail and motors allow.
    """
    units = shown_units(runs[0])
    drawn, axes = _columns(runs, MAP_HEIGHTS, len(units) + 1)
    adhesion, slip = _norm(runs, "adhesion_limit"), _norm(runs, "slip_velocity", LEAST_SLIP)
    for column, run in zip(axes.T, runs, strict=True):
        time, limit = run["time"].values, run["adhesion_limit"].values
        rail = axle_map(column[0], time, limit, ADHESION_SHADES, adhesion, np.fmin)
        slips = axle_map(column[1], time, np.abs(run["slip_velocity"].values), SLIP_SHADES, slip)
        use = evaluate(run)["bound_use"]
        known = "" if np.isnan(use) else f": {100.0 * use:.1f} % of the possible is used"
        _use_strips(column[2:], run, units, f"all units{known}")
        for one in column[:2]:
            name_units(one, run["axle_unit"].values, units)
        rule = attributes_of(run)["rule"]
        column[0].set_title(f"{rule}, {attributes_of(run)['controller']}", color=rule_colour(rule))
    axes[0, 0].set_ylabel(AXLE)
    axes[1, 0].set_ylabel(AXLE)
    shade_bar(drawn, rail, axes[0], "adhesion [–]")
    shade_bar(drawn, slips, axes[1], "slip [m/s]")
    return _explained(drawn, axes, axes[2:, 0])


@figure("sharing-wanders", "limits, torque and jerk of dynamic sharing beside the reference rule",
        recorded("very-low-adhesion", "sharing", CONTROLLER),
        recorded("very-low-adhesion", "greedy", CONTROLLER))  # fmt: skip
def sharing_wanders(*runs: xr.Dataset) -> Figure:
    """One column per run. Rows: what each unit has, uses and may use; jerk of the worst car."""
    units = shown_units(runs[0])
    drawn, axes = _columns(runs, (), len(units), (1.1,))
    for column, run in zip(axes.T, runs, strict=True):
        rule, rms = attributes_of(run)["rule"], evaluate(run)["jerk_rms"]
        _use_strips(column[:-1], run, units)
        values = jerk(run)
        worst = values[:, int(np.argmax((values**2).mean(axis=0)))]
        column[-1].plot(run["time"].values, worst, color=rule_colour(rule), linewidth=0.9)
        column[-1].set_title(f"jerk of the worst car; of the train {rms:.2f} m/s³ rms")
        column[0].set_title(rule, color=rule_colour(rule))
    axes[-1, 0].set_ylabel("jerk [m/s³]")
    return _explained(drawn, axes, axes[:-1, 0])


def _columns(
    runs: Sequence[xr.Dataset], above: tuple[float, ...], strips: int, below: tuple[float, ...] = ()
) -> tuple[Figure, Any]:
    """A column per run: panels of heights `above` [inches], so many strips, panels of heights `below`."""
    heights = (*above, *strips * [STRIP_HEIGHT], *below)
    drawn, axes = new_panels(
        PAGE if len(runs) > 1 else COLUMN, 0.9 + sum(heights) + strips * NAME_HEIGHT,
        len(heights), len(runs), sharex=True, sharey="row", squeeze=False, height_ratios=heights,
    )  # fmt: skip
    for axis, run in zip(axes[-1], runs, strict=True):
        axis.set(xlabel="time [s]", xlim=run["time"].values[[0, -1]])
        axis.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    return drawn, axes


def _norm(runs: Sequence[xr.Dataset], name: str, least: float = 0.0) -> Normalize:
    """A scale from 0 to the largest magnitude in any run, or to `least`."""
    return Normalize(0.0, max(least, *(float(np.abs(run[name].values).max()) for run in runs)))


def _use_strips(panels: Sequence[Axes], run: xr.Dataset, units: list[int], train: str = "") -> None:
    """A strip for each of `units`, and one named `train` for all units where it has a name."""
    groups = {f"unit {unit + 1}": [unit] for unit in units}
    if train:
        groups[train] = list(range(run.sizes["unit"]))
    top = ROOM * float(max(np.nanmax(run["limit"].values), np.nanmax(run["expected"].values)))
    for axes, (name, group) in zip(panels, groups.items(), strict=True):
        draw_use(axes, use_of_units(run, group), rule_colour(attributes_of(run)["rule"]))
        axes.set_ylim(0.0, top)
        axes.set_title(name, loc="right", pad=2.0)  # above: inside it would lie on a line


def _explained(drawn: Figure, axes: Any, strips: Sequence[Axes]) -> Figure:
    """With the quantity of the strips of the left column, named once, and a legend of what is drawn in them."""
    strips[len(strips) // 2].set_ylabel("coefficient [–]")
    shown = [
        Patch(facecolor=AVAILABLE, label="adhesion available"),
        Line2D([], [], color=DARK, linewidth=USED_WIDTH, label="used"),
        Line2D([], [], label="limit by the rule", **LIMIT),
    ]
    legend_below(drawn, shown)
    drawn.align_ylabels(axes[:, 0].tolist())
    return drawn
