"""What JP4209318 prints of its demonstration, as targets with tolerances, and what counts as plausible."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from studies.core.claims import ABOUT, AT_MOST, Claim, meets
from studies.slides.jp4209318 import Undisclosed, brake, brake_event, measures

TABLE_3 = {1: 458.1, 2: 414.0, 3: 385.7}
"""Braking distance [m] by number of cars, sensitivity medium."""
TABLE_4 = {"low": (385.4, 1673.0), "medium": (385.7, 1518.0), "high": (392.9, 525.8)}
"""Braking distance [m] and Q [kJ] of three cars by sensitivity."""

PRINTED_NUMBERS = 8
"""Different numbers in both tables: five distances, three values of Q."""

LEAST_PEAK, GREATEST_PEAK = 0.05, 0.15
"""Plausible adhesion coefficients on wet rail, conditioning included."""


def logarithm(cars: float) -> float:
    """Distance [m] by the curve a + b ln(cars) through one and three cars of Table 3."""
    slope = (TABLE_3[3] - TABLE_3[1]) / math.log(3.0)
    return TABLE_3[1] + slope * math.log(cars)


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

REACHED = {
    name: Claim(f"reached: {name}", mean=f"'{name}'", side=AT_MOST, exact=True, reason="the source finds it no longer")
    if name == "longer low" else
    Claim(f"reached: {name}", mean=f"'{name}'", side=ABOUT, value=target.value, tolerance=target.tolerance, exact=True,
          reason="as near as the undisclosed values let one hope for")
    for name, target in TARGETS.items()
}  # fmt: skip
"""What counts as near enough to each target."""

OUTCOMES = (*TARGETS, "locked", "time-outs", "slides")
"""Names of the results of `outcomes`."""
HOLD_OUT = "distance 2"
"""Left out of a fit to be predicted by it."""
HOLD_OUT_TOLERANCE = 0.01 * TABLE_3[2]


RUNS = ((3, "medium"), (3, "high"), (3, "low"), (1, "medium"), (2, "medium"))
"""Cars and setting of every stop in the tables; those that reveal a bad set soonest come first."""
CAP = 15.0
"""Most tolerances that one deviation counts, so that none hides the others."""


def target_numbers(stops: Mapping[tuple[int, str], Mapping[str, float]]) -> dict[str, float]:
    """The targets' numbers from the `measures` of stops by number of cars and setting; those of stops that are there."""
    medium = stops.get((3, "medium"), {})
    found = {
        f"distance {cars}": stops[cars, "medium"]["distance"]
        for cars in TABLE_3
        if (cars, "medium") in stops
    }
    if medium:
        found["Q medium"] = medium["damage"]
    for name, measure, setting in (
        ("Q low", "damage", "low"), ("Q high", "damage", "high"),
        ("longer high", "distance", "high"), ("longer low", "distance", "low"),
    ):  # fmt: skip
        if medium and (3, setting) in stops:
            ratio = stops[3, setting][measure] / medium[measure]
            found[name] = ratio if measure == "damage" else 100.0 * (ratio - 1.0)
    return found


def outcomes(undisclosed: Undisclosed) -> dict[str, float]:
    """The targets' numbers as this set gives them, and locked time [s] and time-outs of all five runs together."""
    return _found({run: _stop(undisclosed, *run) for run in RUNS})


def misfit_up_to(
    undisclosed: Undisclosed, most: float = math.inf, leave_out: str | None = None
) -> tuple[float, dict[str, float] | None]:
    """The `misfit` of a set and its outcomes; once the stops run so far miss by more than `most`, by how much, and None."""
    stops: dict[tuple[int, str], dict[str, float]] = {}
    for run in RUNS:
        stops[run] = _stop(undisclosed, *run)
        known = target_numbers(stops)
        so_far = _squares([_deviation(name, known[name]) for name in known if name != leave_out])
        if so_far > most:
            return so_far, None
    found = _found(stops)
    return misfit(undisclosed, found, leave_out), found


def _stop(undisclosed: Undisclosed, cars: int, setting: str) -> dict[str, float]:
    sensitivity = undisclosed.sensitivities[setting]
    return measures(brake(brake_event(undisclosed, cars, sensitivity)))


def _found(stops: Mapping[tuple[int, str], Mapping[str, float]]) -> dict[str, float]:
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


def unreached(found: Mapping[str, float]) -> list[str]:
    """Names of the targets that `found` misses; locked wheels and slips out of order count too."""
    missed = [name for name in TARGETS if not meets(REACHED[name], found[name])]
    return missed + [name for name in ("locked", "slides") if found[name] > 0.0]


def implausible(undisclosed: Undisclosed) -> float:
    """Amount by which adhesion leaves `LEAST_PEAK` to `GREATEST_PEAK` (0: nowhere), plus the shortfall of `slip_large`.

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
    deviations = [0.0 if name == leave_out else _deviation(name, found[name]) for name in TARGETS]
    penalties = [1e3 * implausible(undisclosed), min(found["locked"], 5.0), 10.0 * found["slides"]]
    return [value if math.isfinite(value) else 1e3 for value in (*deviations, *penalties)]


def _deviation(name: str, value: float) -> float:
    target = TARGETS[name]
    return (value - target.value) / target.tolerance


def misfit(
    undisclosed: Undisclosed, found: Mapping[str, float], leave_out: str | None = None
) -> float:
    """Sum of the squared deviations from the targets, each in its tolerance and at most `CAP`."""
    return _squares(residuals(undisclosed, found, leave_out))


def _squares(deviations: Sequence[float]) -> float:
    known = np.nan_to_num(np.abs(np.array(deviations)), nan=CAP)
    return float((np.minimum(known, CAP) ** 2).sum())
