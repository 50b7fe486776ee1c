"""Drawn stops: controllers and rules under blended brakes, and where the same sand stops eight cars soonest."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator

from alloc.metrics.registry import range_of
from paper_figs.drawing import figure, study
from paper_figs.style import (
    BLUE,
    BOUND,
    DARK,
    GREEN,
    GREY,
    PAGE,
    PURPLE,
    SKY,
    VERMILION,
    WORSE_TO_BETTER,
    Look,
    bare_rows,
    bare_table,
    controller_look,
    handle,
    interval_mark,
    legend_below,
    name_rows,
    new_figure,
    number_cell,
    plain_ticks,
    remark,
    rule_look,
    zero_line,
)
from studies.core.claims import quantity
from studies.core.drawn_events import Arm
from studies.core.statement import column_interval, mean_interval
from studies.stops.blended_events import CURVES, TRAINS
from studies.stops.blended_study import (
    CONTROLLERS,
    ERROR,
    ESTIMATE,
    LOST,
    RULES,
    TRUTH,
    arm_name,
    less,
    pairs_of,
)
from studies.stops.sander_trial import DISTANCES, PLACEMENTS, SHARINGS, USUAL
from studies.stops.sanders_study import CARS, TRIALS, arms

FEW_EVENTS = 2
"""Events that are run for the figure where the results have fewer."""
SHIFTS = (-0.24, 0.0, 0.24)
"""Places of the rules in a controller's row."""
MEAN: Look = {"markersize": 4.0, "elinewidth": 0.9}
SHOWN_RULE = "cooperative"
"""Rule of the lower panels."""
FULL = 15.0
"""Difference [points] of full colour."""
SHORT_NAMES = {
    "exponential-difference": "double\nexponential",
    "polach-by-friction": "polach\nby friction",
}


@figure("blended", "drawn stops with motors and air brakes: controllers, rules, error of the speed (sweep blended)",
        study("blended", FEW_EVENTS), events="stops")  # fmt: skip
def blended(table: pd.DataFrame) -> Figure:
    """Above: means with intervals by controller and rule, open marks with the true speed, and single stops of the estimate
    under all rules. Below: bound used in per cent under one rule by train and by curve; blue is more and orange less than
    cut-and-ramp."""
    events = pairs_of(table)
    drawn = new_figure(PAGE, 5.2)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.0, 1.3])).tolist()
    upper = above.subplots(1, 4)
    used, lost, error, ratio = upper
    for y, controller in enumerate(CONTROLLERS):
        for rule, shift in zip(RULES, SHIFTS, strict=True):
            arm, look = Arm(rule, controller), {**rule_look(rule), **MEAN}
            for source, face, off in ((ESTIMATE, look["color"], -0.04), (TRUTH, "white", 0.06)):
                found = column_interval(events, f"bound_use@{arm_name(arm, source)}")
                own = {"markerfacecolor": face, "gid": f"{rule}, {source}"}
                interval_mark(used, found, y + shift + off, 100.0, look | own)
            cost = mean_interval(
                quantity(events, less("bound_use", arm_name(arm, TRUTH), arm_name(arm)))
            )
            interval_mark(lost, cost, y + shift, 100.0, look)
    used.set_xlabel("bound used [%]")
    zero_line(lost)
    lost.axvline(100.0 * LOST, **BOUND)
    lost.set_xlabel("lost to the estimate,\nof the bound [%]")
    _stops(error, events, "reference_error", ERROR)
    error.set_xlabel("largest error of the\nreference speed [m/s]")
    _stops(ratio, events, "reference_ratio", 1.0)
    ratio.set_xlabel("error over stated\ndeviation, rms [–]")
    for one in upper:
        name_rows(one, CONTROLLERS if one is used else [""] * len(CONTROLLERS))
        bare_rows(one)
    by_train, by_curve = below.subplots(1, 2)
    _cells(by_train, events, "train", list(TRAINS))
    _cells(by_curve, events, "curve", list(CURVES))
    dot = {"linestyle": "none", "marker": "o", "color": DARK}
    handles = [handle(rule, **{**rule_look(rule), "gid": None}) for rule in RULES]
    handles += [
        handle("estimated speed", **dot),
        handle("true speed", **dot, markerfacecolor="white"),
    ]
    legend_below(below, handles)
    return drawn


def _stops(axes: Axes, events: pd.DataFrame, metric: str, bound: float) -> None:
    """Every stop under every rule as a tick, their mean or median as a mark."""
    for y, controller in enumerate(CONTROLLERS):
        columns = [f"{metric}@{arm_name(Arm(rule, controller))}" for rule in RULES]
        values = events[columns].astype(float).to_numpy().ravel()
        values = values[np.isfinite(values)]
        look = controller_look(controller)
        pale = look | {"marker": "|", "markersize": 5.0, "alpha": 0.3}
        axes.plot(values, np.full(values.size, y + 0.17), **pale)
        found = mean_interval(events[columns].astype(float).mean(axis=1), within=range_of(metric))
        interval_mark(axes, found, y - 0.17, 1.0, look | MEAN)
    axes.set_xscale("log")
    plain_ticks(axes.xaxis, LogLocator(base=10.0))
    axes.axvline(bound, **BOUND)


def _cells(axes: Axes, events: pd.DataFrame, column: str, names: Sequence[str]) -> None:
    """A cell per controller and kind of stop: the mean as a number, its difference from cut-and-ramp as a colour."""
    scale = Normalize(-FULL, FULL)
    used = [f"bound_use@{arm_name(Arm(SHOWN_RULE, one))}" for one in CONTROLLERS]
    for y, name in enumerate(names):
        own = events[events[column] == name]
        if own.empty:
            continue
        means = [100.0 * float(own[one].mean()) for one in used]
        for x, mean in enumerate(means):
            worth = float(scale(mean - means[0]))
            number_cell(axes, x, y, (0.96, 0.94), worth, WORSE_TO_BETTER, f"{mean:.0f}")
    count = events[column].value_counts()
    name_rows(axes, [f"{SHORT_NAMES.get(name, name)} (n = {count.get(name, 0)})" for name in names])
    axes.set_xticks(range(len(CONTROLLERS)), [one.replace("-", "-\n", 1) for one in CONTROLLERS])
    axes.set_xlim(-0.6, len(CONTROLLERS) - 0.4)
    bare_table(axes)
    axes.set_title(f"used by {column}, {SHOWN_RULE} [%]", loc="left")


TRIAL_LOOKS: dict[tuple[int, str], Look] = dict(
    zip(TRIALS, (
        {"color": DARK, "marker": "o"}, {"color": SKY, "marker": "s"}, {"color": PURPLE, "marker": "^"},
    ), strict=True)
)  # fmt: skip
TRIAL_NAMES = ("here, two units", "here, one unit", "here, two units, Polach's curve")
SHARING_LOOKS: dict[str, Look] = {
    "equal": {"color": BLUE, "marker": "o"},
    "raised": {"color": GREEN, "marker": "s"},
    "by sand": {"color": VERMILION, "marker": "D"},
}
SHADES = (450, 600, 900)
"""Ticks of the scale of stopping distances [m]."""
BLANK: Look = {"linestyle": "none", "markersize": 4.5}


@figure("sanders", "sanders: trials of RSSB T1107, places of the same sand, and sharing of the brake force",
        study("sanders"))  # fmt: skip
def sanders(table: pd.DataFrame) -> Figure:
    """(a) Stopping distances of the trial; that without sanders did not end. (b) Half of the sand at each of two cars.

    The star has the shortest distance. (c) Placement and sharing.
    """
    drawn = new_figure(PAGE, 3.4)
    trial, pairs, places = drawn.subplots(1, 3, width_ratios=[1.0, 1.05, 1.1])
    ok = table[table["status"] == "ok"]
    _draw_trial(ok[ok["part"] == "trial"], trial)
    _draw_pairs(drawn, ok[ok["part"] == "pair"], pairs)
    _draw_places(ok, places)
    trials = zip(TRIAL_NAMES, TRIAL_LOOKS.values(), strict=True)
    handles = [handle("trial", color=GREY, linewidth=6, alpha=0.6)]
    handles += [handle(name, **look, **BLANK) for name, look in trials]
    handles += [
        handle(f"brake force shared: {name}", **look, **BLANK)
        for name, look in SHARING_LOOKS.items()
    ]
    legend_below(drawn, handles, 4)
    remark(trial, "(a) and (b): one stop for each mark and each cell; nothing is drawn at random.")
    return drawn


def _draw_trial(rows: pd.DataFrame, axes: Axes) -> None:
    """Bars of the trial; that without sanders has no end."""
    axes.barh(range(len(DISTANCES)), list(DISTANCES.values()), color=GREY, alpha=0.45, height=0.6)
    axes.annotate("", (1300.0, 0.0), (1195.0, 0.0), arrowprops={"arrowstyle": "->", "color": GREY})
    for k, ((units, curve), look) in enumerate(TRIAL_LOOKS.items()):
        found = rows[(rows["units"] == units) & (rows["curve"] == curve)].set_index("kind")
        metres = found["distance"].reindex(list(DISTANCES))
        axes.plot(metres, np.arange(len(DISTANCES)) + 0.2 * (k - 1), **look, **BLANK)
    name_rows(axes, list(DISTANCES))
    bare_rows(axes)
    axes.set(xlabel="stopping distance [m]", title="(a) 55 mph, friction 0.02", xlim=(0.0, None))


def _draw_pairs(drawn: Figure, rows: pd.DataFrame, axes: Axes) -> None:
    """Distance with half of the sand at the first axle of each of two cars; on the diagonal all at one."""
    metres = np.full((CARS, CARS), np.nan)
    metres[rows["second"].astype(int), rows["first"].astype(int)] = rows["distance"]
    image = axes.imshow(metres, cmap="cividis_r", origin="upper", norm=LogNorm())
    if np.isfinite(metres).any():
        best = np.unravel_index(np.nanargmin(metres), metres.shape)
        axes.plot(best[1], best[0], "*", color="white", markersize=9, markeredgecolor="black")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks(range(CARS), [str(car) for car in range(1, CARS + 1)])
    axes.grid(visible=False)
    axes.set(xlabel="first half ahead of car", ylabel="second half ahead of car")
    axes.set_title("(b) halves of the sand")
    inside = axes.inset_axes((0.3, 0.91, 0.66, 0.07))  # where the triangle leaves room
    bar = drawn.colorbar(image, cax=inside, orientation="horizontal")
    plain_ticks(bar.ax.xaxis, FixedLocator(SHADES))
    bar.set_label("distance [m]")
    bar.outline.set_visible(False)


def _draw_places(table: pd.DataFrame, axes: Axes) -> None:
    """Distance over that of the usual placement with equal sharing, with 95 % intervals over events."""
    found = arms(table)
    for k, sharing in enumerate(SHARINGS):
        for row, place in enumerate(PLACEMENTS):
            look = SHARING_LOOKS[sharing] | {"markersize": 3.0, "capsize": 2.0, "linewidth": 0.9}
            interval_mark(axes, found[(place, sharing)], row + 0.25 * (k - 1), 1.0, look)
    axes.axvline(1.0, **BOUND)
    name_rows(axes, list(PLACEMENTS))
    bare_rows(axes)
    axes.set(xlabel=f"distance over that of\n{USUAL} [–]", title="(c) the same sand")
