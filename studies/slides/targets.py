"""What JP4209318 prints of its demonstration, as targets with tolerances, and what counts as plausible."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from studies.slides.jp4209318 import Undisclosed, brake, brake_event, measures

TABLE_3 = {1: 458.1, 2: 414.0, 3: 385.7}
"""Braking distance [m] by number of cars, sensitivity medium."""
TABLE_4 = {"low": (385.4, 1673.0), "medium": (385.7, 1518.0), "high": (392.9, 525.8)}
"""Braking distance [m] and Q [kJ] of three cars by sensitivity."""

LEAST_PEAK, GREATEST_PEAK = 0.05, 0.15
"""Plausible adhesion coefficients on wet rail, conditioning included."""


class Target(NamedTuple):
    """A number of the source and how near to it counts as reached."""

    value: float
    tolerance: float
    unit: str
    meaning: str


def _ratio(sensitivity: str, column: int) -> float:
    return TABLE_4[sensitivity][column] / TABLE_4["medium"][column]


TARGETS: dict[str, Target] = {
    **{
        f"distance {cars}": Target(
            metres, 0.003 * metres, "m", f"Table 3: braking distance, {cars} cars"
        )
        for cars, metres in TABLE_3.items()
    },
    "Q medium": Target(1518.0, 0.03 * 1518.0, "kJ", "Table 4: Q at medium sensitivity"),
    "Q low": Target(1.10, 0.03, "1", "Table 4: Q at low over medium sensitivity"),
    "Q high": Target(0.346, 0.02, "1", "Table 4: Q at high over medium sensitivity"),
    "longer high": Target(
        1.9, 0.5, "%", "Table 4: by how much high sensitivity brakes longer than medium"
    ),
    "longer low": Target(
        100.0 * (_ratio("low", 0) - 1.0), 0.08, "%",
        "Table 4: by how much low sensitivity brakes longer than medium; not at all",
    ),
}  # fmt: skip
"""Every target by name. That of "longer low" is reached wherever low does not brake longer."""

HOLD_OUT = "distance 2"
"""Left out of a fit to be predicted by it."""
HOLD_OUT_TOLERANCE = 0.01 * TABLE_3[2]


def target_numbers(stops: Mapping[tuple[int, str], Mapping[str, float]]) -> dict[str, float]:
    """The targets' numbers from the `measures` of stops by number of cars and setting."""

    def over_medium(measure: str, setting: str) -> float:
        return stops[3, setting][measure] / stops[3, "medium"][measure]

    return {
        **{f"distance {cars}": stops[cars, "medium"]["distance"] for cars in TABLE_3},
        "Q medium": stops[3, "medium"]["damage"],
        **{f"Q {setting}": over_medium("damage", setting) for setting in ("low", "high")},
        **{f"longer {setting}": 100.0 * (over_medium("distance", setting) - 1.0) for setting in ("high", "low")},
    }  # fmt: skip


def outcomes(undisclosed: Undisclosed) -> dict[str, float]:
    """The targets' numbers as this set gives them, and locked time [s] and time-outs of all five runs together."""
    settings = undisclosed.sensitivities
    runs = [(1, "medium"), (2, "medium"), *((3, setting) for setting in settings)]
    stops = {
        (cars, setting): measures(brake(brake_event(undisclosed, cars, settings[setting])))
        for cars, setting in runs
    }
    return {
        **target_numbers(stops),
        "locked": sum(stop["locked_time"] for stop in stops.values()),
        "time-outs": sum(stop["time_outs"] for stop in stops.values()),
        "slides": _slide_faults(stops[3, "medium"]),
    }


def front(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of runs that no other run beats in both distance and Q, by growing distance."""
    ordered = rows.sort_values(["distance", "damage"])
    return ordered[ordered["damage"] < ordered["damage"].cummin().shift(fill_value=np.inf)]


def _slide_faults(medium: Mapping[str, float]) -> float:
    """By how much the slips of the axles miss the source's order, as a share of the mean slip; 0: in order.

    Axle 1 slides most, further cars slide less, and within a bogie the rear axle less than the front one.
    """
    slip = np.array([medium[f"slip_{i + 1}"] for i in range(12)])
    cars = slip.reshape(3, 4).mean(axis=1)
    faults = [
        max(slip[1:].max() - slip[0], 0.0),
        *np.maximum(np.diff(cars), 0.0),
        *np.maximum(slip[1::2] - slip[0::2], 0.0),
    ]
    return float(sum(faults) / slip.mean())


def reached(name: str, value: float) -> bool:
    """Whether a target's number is near enough."""
    target = TARGETS[name]
    if name == "longer low":
        return value <= 0.0
    return abs(value - target.value) <= target.tolerance


def unreached(found: Mapping[str, float]) -> list[str]:
    """Names of the targets that `found` misses; locked wheels and slips out of order count too."""
    missed = [name for name in TARGETS if not reached(name, found[name])]
    return missed + [name for name in ("locked", "slides") if found[name] > 0.0]


def implausible(undisclosed: Undisclosed) -> float:
    """By how much adhesion leaves `LEAST_PEAK` to `GREATEST_PEAK` (0: nowhere), plus what `slip_large` lacks.

    The orderings (lower in front, less dependent on speed further back, raised by conditioning) hold by construction for
    every set within its bounds.
    """
    least, greatest = undisclosed.peak_range()
    order = max(1.2 * undisclosed.slip_medium - undisclosed.slip_large, 0.0)
    return max(LEAST_PEAK - least, 0.0) + max(greatest - GREATEST_PEAK, 0.0) + order


def residuals(
    undisclosed: Undisclosed, found: Mapping[str, float], leave_out: str | None = None
) -> list[float]:
    """Deviations of `found` from the targets, in tolerances, and penalties; 0 is as printed."""
    deviations = [
        0.0 if name == leave_out else (found[name] - target.value) / target.tolerance
        for name, target in TARGETS.items()
    ]
    penalties = [1e3 * implausible(undisclosed), min(found["locked"], 5.0), 10.0 * found["slides"]]
    return [value if math.isfinite(value) else 1e3 for value in (*deviations, *penalties)]
