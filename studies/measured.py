"""Measured slip beside the plant: a rig's creep curve, a slide under slide protection, and a stop that overran.

Only the level of the rail is fitted, once a run, to the mean coefficient or the distance. What sources leave open is drawn
between assumed bounds. docs/limits.md has the sources and how they were read.

- curve: roller rig, one wheel, scale 1:4. ``measured_creep.csv`` is the middle of a figure's cloud of points, by pixels of
  16 N; their residuals are 219 N. The load is read from another figure; the rail is taken as dry.
- slide: two cars, from a picture; coefficients are means of 1 s while valves act. Sand lay on the rail.
- stop: an overrun, as told in the press; neither slip nor gradient is told.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq, least_squares

from alloc.onboard.settings import Onboard, SlideLaw, SlideProtection
from alloc.plant.curves import PolachCurve
from alloc.plant.rail import Line, Rail, logarithmic_increments
from alloc.plant.trains import find_train
from alloc.run.event import DriverCommand, Event
from alloc.run.simulation import simulate
from studies.runner.study import Cell, Row, Study

CREEP = pd.read_csv(Path(__file__).with_name("measured_creep.csv"))
MILE, START, STATION, STOPPED = 1609.344, 64.0, 0.77, 3.22
"""Of the stop: speed at its start [mph]; miles from there to the station and to standstill."""
MEASURED = {
    "dry: coefficient at 1.97 %": 0.509, "dry: creepage at half of it [%]": 0.355,
    "dry: RMS error": 0.0, "wet: RMS error": 0.0, "three numbers fitted: RMS error": 0.0,
    "slide: rear car used over lead": 1.03, "slide: the same with growth (15)": 1.03,
    "slide: lowest used over mean, axle 1": 0.62, "slide: releases per s": 0.7,
    "stop: speed at the station [mph]": 50.0, "stop: time [s]": 390.0,
}  # fmt: skip
WHOLE = find_train("gb-unit-8car")
CARS = (replace(WHOLE.cars[0], mass=45144.0),) * 2
TRAIN = replace(WHOLE, cars=CARS, resistance=(1250.0, 37.5, 3.5))  # masses of the slide's cars


def fit_curve(speed: float, load: float) -> list[float]:
    """Polach's curves at the rig's creepages, at `speed` [m/s] under a wheel load [N]; friction, kA and kS fitted."""
    creepage, measured = CREEP["creepage_percent"].to_numpy(), CREEP["force_n"].to_numpy() / load
    contact = PolachCurve().contact(16.0 * load, 0.46)  # at full size; the radius is assumed

    def residuals(x: Any, decay: float = 0.6) -> Any:
        polach = PolachCurve(decay=decay, adhesion_factor=x[1], slip_factor=x[2])
        return polach(0.01 * speed * creepage, x[0], speed, contact) - measured

    dry, wet = residuals((0.55, 1.0, 0.4)), residuals((0.3, 0.3, 0.1), 0.2)  # Polach's sets
    fitted = least_squares(residuals, (0.55, 1.0, 0.4), bounds=(0.01, 9.0)).fun
    used, errors = dry + measured, np.sqrt(np.mean(np.square((dry, wet, fitted)), axis=1))
    return [used[-1], np.interp(0.5 * used[-1], used, creepage), *errors]


def brake_train(law: SlideLaw, level: float, rate: float, growth: bool = False, **keys: Any) -> Any:
    """The run of a train, braked by air alone with a deceleration of `rate` [m/s2], on wet rail; `keys` as for `Event`."""
    settings = {"braking.release_speed": 0.0, "braking.slide_protection": SlideProtection(law=law)}
    increments = tuple(logarithmic_increments(8).tolist()) if growth else None
    rail = Rail(level=level, curve=PolachCurve(), increments=increments)
    command, onboard = DriverCommand((0.0,), (-rate,)), Onboard().with_settings(settings)
    return simulate(Event("measured", TRAIN, rail, command, onboard, **keys), "alone", "none")


def measure_slide(law: SlideLaw, speed: float, growth: bool) -> list[float]:
    """Of two cars that slide from `speed` [m/s]: use of the rear car, the lowest of axle 1, releases of its valve per s."""

    def find_use(level: float) -> tuple[Any, float, float]:
        run = brake_train(law, level, 0.7, growth, duration=15.0, initial_speed=speed)
        valve, sums = run["valve"].values, np.cumsum(-run["coefficient"].values, axis=0)
        mean = 0.01 * (sums[100:] - sums[:-100])  # of 1 s
        acts = (valve[100:] > 0.0) & (run["time"].values[100:, None] > 2.0)
        means = [mean[acts[:, i // 2], i] for i in range(8)]
        released = (np.diff(1.0 * (valve[:, 0] == 2.0)) > 0.0).sum() / 13.0
        return np.array([values.mean() for values in means]), means[0].min(), released

    # measured: 0.0325, mean of all axles
    level = brentq(lambda x: find_use(x)[0].mean() - 0.0325, 0.025, 0.06, xtol=2e-4)
    mean, lowest, released = find_use(level)
    return [mean[4:].mean() / mean[:4].mean(), lowest / mean[0], released]


def measure_stop(law: SlideLaw, fall: float) -> list[float]:
    """Of a train that stops where the train did, on a line that falls by `fall`: speed at the station, and time."""
    start: Row = {"initial_speed": START * MILE / 3600.0, "record_period": 0.1}

    def find_way(level: float) -> tuple[Any, Any]:
        run = brake_train(law, level, 1.2, line=Line(grades=(-fall,)), duration=500.0, **start)
        return run, run["position"].values - float(run["position"][0])

    level = brentq(lambda x: find_way(x)[1][-1] - STOPPED * MILE, 0.003, 0.06, xtol=2e-4)
    run, place = find_way(level)
    speed = np.interp(STATION * MILE, place, run["speed"].values) * 3600.0 / MILE
    return [speed, run["time"].values[np.argmax(run["speed"].values < 0.3)]]


def run(seed: int, event: int) -> Row:
    """All numbers with what sources leave open as this event draws it."""
    draw = np.random.default_rng((seed, event))
    law: SlideLaw = "threshold" if event % 2 else "fuzzy"
    rig = fit_curve(15.0 ** draw.uniform(), draw.uniform(9300.0, 9900.0))
    speed, fall = draw.uniform(60.0, 100.0) / 3.6, draw.uniform(0.0, 0.01)
    use, *valves = measure_slide(law, speed, False)
    numbers = [*rig, use, measure_slide(law, speed, True)[0], *valves, *measure_stop(law, fall)]
    return dict(zip(MEASURED, map(float, numbers), strict=True))


def cells(events: int, seed: int) -> list[Cell]:
    """One an event."""
    return [Cell(str(k), (seed, k), {"event": k}) for k in range(events)]


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Of each number what was measured, and of the plant the median and the range over events."""
    numbers = rows.reindex(columns=list(MEASURED)).astype(float).agg(["median", "min", "max"]).T
    return numbers.reset_index(names="number").assign(measured=MEASURED.values())


STUDY = Study("measured", "How far is the plant from measured slip?", cells, run, table, events=6)
