"""Random slip events for the ladder of readhesion controllers, and what is read from a run beside the metrics.

What is read: whether slip moves towards the peak, on rail that changes or not.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.search import shortage, unit_shares
from alloc.plant.train import Train
from studies.core import drawn_events as shared
from studies.core.drawn_events import DrawnEvents, Quantity, in_turn, sometimes, uniform
from studies.scenario.scenario import Scenario, shipped_scenario

DURATION = 12.0
"""Length of an event [s]."""

TRAINS: dict[str, tuple[str, dict[str, Any]]] = {
    "one inverter per car": ("wet-start", {"inverter_group": "1C4M"}),
    "one inverter per axle": ("wet-start", {"inverter_group": "1C1M"}),
    "locomotive and wagons": ("freight-start", {}),
}
"""Train -> the shipped scenario whose train, command and draft gear it is, and what is changed of it."""

QUANTITIES: dict[str, Quantity] = {
    "train": in_turn(
        list(TRAINS), "each of three in its turn",
        "one torque for four axles, one for each, and one for each of a locomotive that couplers shake",
    ),
    "curve": in_turn(
        shared.TWO_PEAKS,
        "piecewise and Polach's of wet rail, each for three events in its turn",
        "a peak at 0.05 m/s with a fall behind it, and one at 0.2 ... 0.6 m/s, wide and moving with speed",
        after=len(TRAINS),
    ),
    "residual_ratio": shared.RESIDUAL_RATIO,
    "level": uniform(
        0.13, 0.19, ", at 15 km/h",
        "about the planned 0.16: in a third of the events the plan is within reach before the drop",
    ),
    "drop_factor": uniform(0.5, 0.8, "", "readhesion paper, Table 2: 0.12 of 0.18"),
    "drop_begin_s": uniform(2.5, 4.0, " s", "after the torque is up"),
    "drop_length_s": uniform(3.0, 5.0, " s", "long enough for a search"),
    "scatter": sometimes(
        0.6, 0.002, 0.008, ", correlated over 20 m", 0.0,
        "JP5484215 par. on (12)-(15): 0.012 over all its measurements; none: a rail that keeps still for a search",
    ),
    "patch_factor": sometimes(
        0.4, 0.6, 0.9, " times the coefficient, from 10 to 40 m", 1.0, "assumed: met after some seconds, axle after axle"
    ),
    "speed_noise_kmh": shared.SPEED_NOISE,
    "grade_permille": shared.UPHILL,
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("ladder", QUANTITIES, stream=(7,), numbered=True)
draw, event_name = EVENTS.draw, EVENTS.event_name


@lru_cache
def train_of(name: str) -> Train:
    """The train called `name` in `TRAINS`, as it runs."""
    base, changes = TRAINS[name]
    return shipped_scenario(base).changed(**changes).event().model.train


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]. The train believes in the piecewise curve whatever the rail's is."""
    d = draw(seed, k)
    base, changes = TRAINS[d["train"]]
    rail = shared.rail_offering(
        shared.drawn_curve(d["curve"], d), d["level"], shared.START_SPEED, train_of(d["train"])
    )
    patches = shared.drawn_drop(d, 0.1), shared.stretch(d["patch_factor"], 10.0, 40.0)
    return shared.drawn_scenario(
        base, event_name(seed, k), f"random event {k} of the ladder", duration,
        rail | {"increments": {"law": "logarithmic"}} | shared.uneven(d["scatter"], *patches), d,
        line=shared.graded(d), belief={"curve": {"kind": "piecewise"}}, **changes,
    )  # fmt: skip


INTERVAL = 0.3
"""Time [s] over which slip is averaged: that of a searching controller's step."""
OFF_PEAK = 0.3
"""Distance from the peak, as a share of its slip, above which a step has a right direction."""
NOTICEABLE = 2e-3
"""Change of the mean slip [m/s] below which nothing has moved."""
CHANGED = 0.01
"""Change of the adhesion from interval to interval, as a share of it, above which the rail counts as changing."""

Floats = NDArray[np.float64]


def measure(run: xr.Dataset) -> dict[str, float]:
    """Shares of the steps of slip that lead away from the peak, of units that are short of adhesion.

    A step is the change of the unit's largest slip between the means of two intervals. It has a right direction where the
    first mean lies off the peak by `OFF_PEAK` or more.

    - wrong_steps_still, wrong_steps_changing: share of wrong steps where the adhesion stayed within `CHANGED`, and where
      it did not; nan where there are no steps.
    - steps_still, steps_changing: number of such steps.
    """
    time = run["time"].values
    ticks = max(1, round(INTERVAL / float(time[1] - time[0])))
    slip, peak = _largest_slip(run)
    short = _means(shortage(run).astype(float), ticks) == 1.0
    slip, peak = _means(slip, ticks), _means(peak, ticks)
    available = _means(unit_shares(run)[2], ticks)
    step = np.diff(slip, axis=0)
    ahead = peak[:-1] - slip[:-1]
    counted = short[1:] & short[:-1] & (np.abs(step) > NOTICEABLE)
    counted &= np.abs(ahead) > OFF_PEAK * peak[:-1]
    changing = np.abs(np.diff(available, axis=0)) > CHANGED * available[:-1]
    wrong = step * ahead < 0.0
    result = {}
    for name, chosen in (("still", counted & ~changing), ("changing", counted & changing)):
        result[f"steps_{name}"] = float(chosen.sum())
        result[f"wrong_steps_{name}"] = float(wrong[chosen].mean()) if chosen.any() else np.nan
    return result


def _largest_slip(run: xr.Dataset) -> tuple[Floats, Floats]:
    """Slip of each unit's worst axle in the direction of the demand, and the slip of that axle's peak, (time, unit)."""
    sign = np.sign(run["driver_command"].values)[:, None]
    slip, peak = sign * run["slip_velocity"].values, run["peak_slip"].values
    unit_of_axle = run["axle_unit"].values
    rows = np.arange(slip.shape[0])
    largest, tops = [], []
    for unit in range(run.sizes["unit"]):
        own = unit_of_axle == unit
        worst = slip[:, own].argmax(axis=1)
        largest.append(slip[:, own][rows, worst])
        tops.append(peak[:, own][rows, worst])
    return np.stack(largest, axis=1), np.stack(tops, axis=1)


def _means(values: Floats, ticks: int) -> Floats:
    """Means over intervals of `ticks` rows; what does not fill one is left out."""
    count = values.shape[0] // ticks
    means: Floats = values[: count * ticks].reshape(count, ticks, -1).mean(axis=1)
    return means
