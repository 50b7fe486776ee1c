"""A slip event as it happens: the train over its rail, force against limit of every unit, and slip."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from alloc.recording import attributes_of
from paper_figs.drawing import figure, made, recorded
from paper_figs.events import (
    ADHESION_SHADES,
    AVAILABLE,
    LEAST_SLIP,
    LIMIT,
    ROOM,
    SLIP_SHADES,
    UNKNOWN,
    AdhesionUse,
    draw_use,
    use_of_units,
)
from paper_figs.saving import Motion, MovingFigure
from paper_figs.style import BLACK, COLUMN, DARK, NOTE, Look, rule_colour
from studies.report.replay import drawing
from studies.scenario.scenario import load_scenario

SCENARIO, RULE, CONTROLLER = "wet-patch", "cooperative", "cut-and-ramp"
INSTANTS, RATE = 80, 9
"""Shown, in all and in a second."""
BEFORE = 1.5
"""Time before the first slip at which it begins [s]."""
STILL = 0.45
"""Share of the time that is shown where the figure stands still."""
PLACES = 700
"""Places along the line at which the rail is shown."""
CAR, WHEEL, RAIL = (0.42, 0.5), 0.3, 0.16
"""Bottom and height of a car, place of its wheels, and height of the rail, in the height of their panel."""
MOTOR_CAR = "#eef2f6"
MOST_WHEELS = 32
"""Axles that have room beside each other; wheels of longer trains are drawn smaller."""
MOST_NAMED = 10
"""Cars of a train up to which the name of a unit has room in its cars."""

Floats = NDArray[np.float64]
Train = Mapping[str, Any]
"""What a train is drawn from, see `studies.report.replay.drawing`."""


class RecordedSeries(NamedTuple):
    """Series of a run at its recorded instants."""

    time: Floats
    position: Floats
    speed: Floats
    slip: Floats
    """Magnitude of the slip velocity of every axle [m/s], (time, axle)."""
    units: Sequence[AdhesionUse]
    train: AdhesionUse
    """All units together."""
    worst: Floats
    """Slip of the worst axle of each unit [m/s], (time, unit)."""


@figure("slip-replay", "a slip event as it happens: train, rail, force against limit of every unit, slip",
        made(lambda: drawing(load_scenario(SCENARIO).event().model)), recorded(SCENARIO, RULE, CONTROLLER))  # fmt: skip
def slip_replay(train: Train, run: xr.Dataset) -> MovingFigure:
    """From above: the train on its rail, the front at the right; per unit coefficients and slip; the whole train over time.

    The rail is darker where it is slipperier, as the first wheel finds it; wheels are darker where they slip more.
    """
    recorded_event = event_of(run)
    chosen = shown_instants(recorded_event)
    event = with_slip_since(recorded_event, chosen)
    rule = attributes_of(run)["rule"]
    colour = rule_colour(rule)
    drawn = MovingFigure(figsize=(COLUMN.value, 3.5), layout="constrained")
    line, forces, slips, whole = drawn.subplots(4, 1, height_ratios=(0.75, 1.0, 0.6, 0.7))
    movers = [
        _line(line, event, train, rail_found(run, train)),
        _forces(forces, event, train, colour),
        _slips(slips, event, train),
        _whole(whole, event, colour, float(event.time[chosen[0]])),
    ]
    for axes in (line, forces, slips):
        length = float(train["cars"][-1][1])
        axes.set_xlim(-1.02 * length, 0.02 * length)

    def show(instant: int) -> None:
        k = int(chosen[instant])
        for move in movers:
            move(k)
        line.set_title(
            f"{rule}, {attributes_of(run)['controller']}:  {event.time[k]:4.1f} s, {3.6 * event.speed[k]:2.0f} km/h",
            loc="left",
        )

    drawn.motion = Motion(show, chosen.size, RATE, round(STILL * (chosen.size - 1)))
    drawn.align_ylabels([line, forces, slips, whole])
    show(drawn.motion.still)
    return drawn


def event_of(run: xr.Dataset) -> RecordedSeries:
    """The series that are shown of a recorded run."""
    units, axle_unit = range(run.sizes["unit"]), run["axle_unit"].values
    slip = np.abs(run["slip_velocity"].values)
    return RecordedSeries(
        run["time"].values,
        run["position"].values,
        run["speed"].values,
        slip,
        [use_of_units(run, [unit]) for unit in units],
        use_of_units(run, list(units)),
        np.stack([slip[:, axle_unit == unit].max(axis=1) for unit in units], axis=1),
    )


def shown_instants(event: RecordedSeries) -> NDArray[np.int64]:
    """Numbers of the instants that are shown: evenly from shortly before the first strong slip to the end."""
    strong = event.worst.max(axis=1) > 0.5 * event.worst.max()
    first = event.time[int(strong.argmax())] - BEFORE
    begin = int(np.searchsorted(event.time, max(first, event.time[0])))
    count = min(INSTANTS, event.time.size - begin)
    return np.linspace(begin, event.time.size - 1, count).round().astype(np.int64)


def with_slip_since(event: RecordedSeries, chosen: NDArray[np.int64]) -> RecordedSeries:
    """The same; slips at the chosen instants are the largest since the one before, so that no short slip is passed over."""
    slip, worst = event.slip.copy(), event.worst.copy()
    for before, now in pairwise(chosen.tolist()):
        slip[now], worst[now] = (
            values[before + 1 : now + 1].max(axis=0) for values in (event.slip, event.worst)
        )
    return event._replace(slip=slip, worst=worst)


def rail_found(run: xr.Dataset, train: Train) -> tuple[Floats, Floats]:
    """Places along the line [m] and the adhesion that the first wheel finds there; nan where none comes."""
    position, limit = run["position"].values, run["adhesion_limit"].values
    behind = np.asarray(train["axles"])
    places = np.linspace(position[0] - behind[-1], position[-1], PLACES)
    # the foremost axle that starts behind the place comes to it first
    first = np.minimum(np.searchsorted(behind, position[0] - places), behind.size - 1)
    found = [
        np.interp(place + behind[axle], position, limit[:, axle], right=np.nan)
        for place, axle in zip(places, first, strict=True)
    ]
    return places, np.asarray(found)


Mover = Callable[[int], object]
"""Makes a panel show the instant of this number of the run."""


def _line(axes: Axes, event: RecordedSeries, train: Train, rail: tuple[Floats, Floats]) -> Mover:
    """Cars and wheels stand still, the rail moves below them."""
    places, found = rail
    axle_unit, behind = np.asarray(train["axle_unit"]), -np.asarray(train["axles"])
    axes.add_patch(Rectangle((-1e5, 0.0), 2e5, RAIL, facecolor=UNKNOWN))
    below = axes.imshow(
        np.ma.masked_invalid(found[None, :]), cmap=ADHESION_SHADES.with_extremes(bad=UNKNOWN), aspect="auto",
        norm=Normalize(0.0, float(np.nanmax(found))), interpolation="nearest", zorder=2,
    )  # fmt: skip
    for begin, end in train["cars"]:
        own = axle_unit[(-behind > begin) & (-behind < end)]
        driven = own[own >= 0] + 1
        colour = MOTOR_CAR if driven.size else "white"
        corner, length = (-end + 0.4, CAR[0]), end - begin - 0.8
        axes.add_patch(Rectangle(corner, length, CAR[1], facecolor=colour, edgecolor=DARK))
        if driven.size and len(train["cars"]) <= MOST_NAMED:
            first, last = int(driven.min()), int(driven.max())
            name = f"unit {first}" if first == last else f"{first}–{last}"
            place = -0.5 * (begin + end), CAR[0] + 0.5 * CAR[1]
            axes.text(*place, name, fontsize=NOTE, ha="center", va="center_baseline")
    size = min(1.0, MOST_WHEELS / behind.size)
    wheels = axes.scatter(
        behind, np.full(behind.size, WHEEL), s=size * np.where(axle_unit >= 0, 13.0, 6.0), c=event.slip[0],
        cmap=SLIP_SHADES, norm=Normalize(0.0, _most(event.slip)), edgecolors=BLACK, linewidths=0.5,
        zorder=3,
    )  # fmt: skip
    axes.set_ylim(0.0, 1.0)
    axes.set_axis_off()
    axes.annotate(
        "darker wheels slip more, darker rail is slipperier", (0.5, 0.0), (0.0, -1.0), "axes fraction",
        "offset points", ha="center", va="top", fontsize=NOTE, color=DARK,
    )  # fmt: skip

    def move(k: int) -> None:
        below.set_extent((places[0] - event.position[k], places[-1] - event.position[k], 0.0, RAIL))
        wheels.set_array(event.slip[k])

    return move


def _most(slip: Floats) -> float:
    """End of a scale of slip velocities [m/s]."""
    return max(LEAST_SLIP, float(slip.max()))


def _centres(train: Train, units: int) -> tuple[Floats, Floats]:
    """Middle of each unit in the train and its width [m]."""
    axle_unit, behind = np.asarray(train["axle_unit"]), np.asarray(train["axles"])
    own = [behind[axle_unit == unit] for unit in range(units)]
    return np.array([-one.mean() for one in own]), np.array([max(np.ptp(one), 3.0) for one in own])


def _forces(axes: Axes, event: RecordedSeries, train: Train, colour: str) -> Mover:
    """Of each unit, below its cars: what there is, what is used, and the limit."""
    centre, width = _centres(train, len(event.units))
    there = axes.bar(centre, 0.0, width, color=AVAILABLE, label="available")
    used = axes.bar(centre, 0.0, 0.55 * width, color=colour, label="used")
    limits = [
        axes.plot([x - 0.6 * w, x + 0.6 * w], [0.0, 0.0], **(LIMIT | {"linestyle": "-", "linewidth": 1.3}))[0]
        for x, w in zip(centre, width, strict=True)
    ]  # fmt: skip
    limits[0].set_label("limit by the rule")
    top = ROOM * max(float(np.nanmax(unit.limit)) for unit in event.units)
    axes.set(ylim=(0.0, top), ylabel="coefficient [–]", xticks=[])
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=3)

    def move(k: int) -> None:
        for unit, use in enumerate(event.units):
            there[unit].set_height(use.available[k])
            used[unit].set_height(use.used[k])
            limits[unit].set_ydata([use.limit[k]] * 2)

    return move


def _slips(axes: Axes, event: RecordedSeries, train: Train) -> Mover:
    """Slip of the worst axle of each unit."""
    centre, width = _centres(train, len(event.units))
    top = _most(event.worst)
    bars = axes.bar(centre, 0.0, 0.55 * width)
    axes.set(ylim=(0.0, 1.05 * top), ylabel="slip [m/s]", xticks=[])

    def move(k: int) -> None:
        for bar, value in zip(bars, event.worst[k], strict=True):
            bar.set_height(value)
            bar.set_facecolor(SLIP_SHADES(0.25 + 0.75 * value / top))

    return move


def _whole(axes: Axes, event: RecordedSeries, colour: str, begin: float) -> Mover:
    """All units over time, up to now."""
    draw_use(axes, event.train, colour)
    end = float(event.time[-1])
    look: Look = {"facecolor": "white", "alpha": 0.85, "zorder": 5}
    veil = Rectangle((0.0, 0.0), 0.0, 1.0, transform=axes.get_xaxis_transform(), **look)
    axes.add_patch(veil)
    axes.set(
        xlim=(begin, end), ylim=(0.0, ROOM * float(np.nanmax(event.train.limit))),
        xlabel="time [s]", ylabel="all units [–]",
    )  # fmt: skip

    def move(k: int) -> None:
        veil.set_bounds(float(event.time[k]), 0.0, end - float(event.time[k]), 1.0)

    return move
