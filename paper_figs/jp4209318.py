"""Figures of JP4209318: adhesion by slip, speed and axle (Fig. 2), a stop under slide protection (Fig. 3), both tables."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.evaluation.metrics import damage, distance
from alloc.laws import speed_law
from alloc.plant.columns import PLANT, WHEELSET
from paper_figs.sharing import study_figure
from paper_figs.style import WIDE, Drawing
from studies.jp4209318 import CALIBRATED, TABLE_3, TABLE_4, run_stop

AXLES = ("#d55e00", "#e69f00", "#0072b2", "#56b4e9")
"""Colours of a car's axles from its front."""
BOGIES = {"front": "#009e73", "rear": "#8e4aa0"}


def draw_adhesion() -> Figure:
    """Left over slip ratio, right over speed; above the first axle, below the twelfth."""
    rail, axles, plant = CALIBRATED.make_rail(), WHEELSET.rows(12), PLANT.rows(1)[0]
    rail.put_under(axles, plant)
    drawn = Figure(figsize=(WIDE, 3.2), layout="constrained")
    panels = drawn.subplots(2, 2, sharex="col", sharey=True)
    ratio, speeds = np.linspace(0.0, 0.2, 401), np.linspace(0.0, 100.0, 101)
    for (over_slip, over_speed), axle, letters in zip(panels, (0, 11), ("ab", "cd"), strict=True):
        law = axles[axle].law_numerator, plant.law_offset, axles[axle].law_constant
        for kmh, colour in ((20.0, AXLES[3]), (60.0, AXLES[2]), (100.0, "black")):
            v, peak = kmh / 3.6, float(speed_law(kmh / 3.6, *law))
            mu = -rail.curve(-ratio * v, peak, v)
            over_slip.plot(100.0 * ratio, mu, color=colour, label=f"{kmh:.0f} km/h")
        over_speed.plot(speeds, speed_law(speeds / 3.6, *law), color="black")
        over_slip.set(ylabel="adhesion coefficient [–]", title=f"({letters[0]}) axle {axle + 1}")
        over_speed.set_title(f"({letters[1]}) axle {axle + 1}")
    panels[0, 0].legend(loc="lower right")
    panels[1, 0].set(xlabel="slip ratio [%]", xticks=range(0, 21, 5), ylim=(0.0, None))
    panels[1, 1].set_xlabel("train speed [km/h]")
    return drawn


def draw_control() -> Figure:
    """A column for each car: speeds, cylinder pressures, and what the valves of its two bogies do."""
    run = run_stop(CALIBRATED, 3, CALIBRATED.make_protection())
    stands = int(np.argmax(run["speed"].values < 0.1))
    run = run.isel(time=slice(None, stands + 50))
    time, valve = run["time"].values, run["valve"].values
    drawn = Figure(figsize=(WIDE, 4.6), layout="constrained")
    panels = drawn.subplots(3, 3, sharex=True, sharey="row", height_ratios=(5, 3, 1.3))
    for car, (speeds, pressures, valves) in enumerate(panels.T):
        for k, axle in enumerate(np.flatnonzero(run["axle_car"].values == car)):
            rim = 3.6 * run["rim_speed"].values[:, axle]
            speeds.plot(time, rim, color=AXLES[k], lw=0.7, label=f"axle {k + 1}")
        speeds.plot(time, 3.6 * run["speed"].values, "k", label="train")
        for k, (place, colour) in enumerate(BOGIES.items()):
            group = 2 * car + k
            pressure = run["cylinder_pressure"].values[:, group] / 1e3
            pressures.plot(time, pressure, color=colour, label=f"{place} bogie")
            for action, alpha, effect in ((1, 0.35, "hold"), (2, 1.0, "release")):
                look = {"alpha": alpha, "color": colour, "lw": 0.0, "step": "post"}
                look |= {"where": valve[:, group] == action, "label": f"{place} valves {effect}"}
                valves.fill_between(time, 0.6 - k, 1.4 - k, **look)
        speeds.set_title(f"car {car + 1}")
        valves.set(xlabel="time [s]", yticks=[0, 1], yticklabels=["rear", "front"])
        valves.grid(visible=False)
    panels[0, 0].set(ylabel="speed [km/h]", ylim=(0.0, None))
    panels[1, 0].set(ylabel="pressure [kPa]", ylim=(0.0, None))
    panels[2, 0].set_ylabel("bogie")
    handles = [handle for axes in panels[:, 0] for handle in axes.get_legend_handles_labels()[0]]
    drawn.legend(handles=handles, loc="outside lower center", ncols=6)
    metres, damaged = TABLE_4["medium"]
    title = f"braking distance {distance(run):.1f} m (printed: {metres}), wheel damage {damage(run):.0f} kJ"
    drawn.suptitle(f"{title} (printed: {damaged:.0f})")
    return drawn


def draw_tables(rows: pd.DataFrame) -> Figure:
    """Printed numbers, those of the calibrated set, and of all sets that reach both tables."""
    five = rows[(rows["part"] == "member") & (rows["kind"] == "tables")]
    by_cars = five[five["setting"] == "medium"].set_index("cars")
    by_setting = five[five["cars"] == 3].set_index("setting")
    metres, q = ({name: row[k] for name, row in TABLE_4.items()} for k in (0, 1))
    drawn = Figure(figsize=(WIDE, 2.5), layout="constrained")
    left, middle, right = drawn.subplots(1, 3)
    _draw_compared(left, by_cars, "distance", TABLE_3)
    _draw_compared(middle, by_setting, "distance", metres)
    _draw_compared(right, by_setting, "Q", q)
    left.set(title="(a) Table 3", xlabel="number of cars", ylabel="braking distance [m]")
    for axes, letter in ((middle, "b"), (right, "c")):
        axes.set(title=f"({letter}) Table 4, 3 cars", xlabel="detection sensitivity")
    middle.set_ylabel("braking distance [m]")
    right.set_ylabel("wheel damage Q [kJ]")
    drawn.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return drawn


def _draw_compared(axes: Axes, rows: pd.DataFrame, column: str, printed: dict[Any, float]) -> None:
    at = pd.Series(np.arange(3.0), list(printed))
    first = rows.loc[rows["set"] == 0, column]
    label = "sets that reach both tables"
    axes.plot(at[rows.index] + 0.2, rows[column], "_", color="0.6", ms=8, label=label)
    axes.plot(at[first.index] + 0.2, first, "o", color=AXLES[2], label="calibrated set")
    axes.plot(at - 0.2, list(printed.values()), "kx", label="printed")
    for x, value in zip(at - 0.2, printed.values(), strict=True):
        axes.annotate(f"{value:.1f}", (x, value), (0, 4), textcoords="offset points", ha="center")
    axes.set(xlim=(-0.7, 2.5), xticks=at, xticklabels=at.index)
    axes.margins(y=0.12)


FIGURES = {
    "slide-adhesion": Drawing(
        draw_adhesion,
        "Fig. 2, calibrated since the source's curves are not printed: the twelfth axle finds more adhesion than the first, "
        "and it falls less with speed.",
        source="jp4209318",
    ),
    "slide-control": Drawing(
        draw_control,
        "Fig. 3: three cars stop from 100 km/h under fuzzy slide protection; front axles of a bogie slide more than rear "
        "ones, and cars in front more than those behind.",
        source="jp4209318",
    ),
    "slide-tables": Drawing(
        draw_tables,
        "Tables 3 and 4: braking distance and wheel damage, printed, by the calibrated set, and by all sets.",
        study="jp4209318",
        source="jp4209318",
    ),
    "cleaned-rail": Drawing(
        study_figure("conditioning"),
        "Par. 0051, a train of four units in balance at 10 m/s where wheels clean the rail: slip of the foremost units over "
        "the others' at the optimum; white: effort that it wins at equal damage over one slip for all; above orange "
        "all should slide.",
        study="conditioning",
        source="jp4209318",
    ),
}
