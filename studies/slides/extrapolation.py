"""What the tables of JP4209318 do not have: stops from other speeds, of longer trains, on other rail."""

import math
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from alloc.event import Event
from alloc.plant.model import build
from studies.core.claims import AT_LEAST, Claim, conjunction
from studies.core.ensemble_range import median_of
from studies.core.statement import Interval, Statement
from studies.slides.jp4209318 import INITIAL_SPEED, Undisclosed, brake, brake_event, measures

PART = "beyond"
AGREED_DISTANCE, AGREED_DAMAGE = 0.02, 0.20
"""Sets agree about a stop where half their range is at most this share of its middle; chosen before any was run."""
DURATION = 80.0
"""Time [s] longer than any of these stops."""


@dataclass(frozen=True)
class Beyond:
    """What a stop changes of three cars from 100 km/h at medium sensitivity."""

    cars: int = 3
    speed: float = INITIAL_SPEED
    """m/s"""
    adhesion: float = 1.0
    """Over that of the set."""
    sensitivity: float = 1.0


STOPS: dict[str, Beyond] = {
    "from 60 km/h": Beyond(speed=60.0 / 3.6),
    "from 80 km/h": Beyond(speed=80.0 / 3.6),
    "from 130 km/h": Beyond(speed=130.0 / 3.6),
    "4 cars": Beyond(cars=4),
    "8 cars": Beyond(cars=8),
    "adhesion 20 % lower": Beyond(adhesion=0.8),
    "adhesion 20 % higher": Beyond(adhesion=1.2),
    "sensitivity 2": Beyond(sensitivity=2.0),
}
"""Stops by name."""


def beyond_event(undisclosed: Undisclosed, stop: Beyond) -> Event:
    """The stop of a train after this set."""
    event = brake_event(undisclosed, stop.cars, stop.sensitivity)
    rail = replace(event.model.rail, level=stop.adhesion)
    model = build(event.model.train, rail, span=(0.0, 3000.0))
    return replace(event, model=model, duration=DURATION, initial_speed=stop.speed)


def beyond_row(undisclosed: Undisclosed, name: str) -> dict[str, Any]:
    """Measures of the stop; `stopped`: whether the train came to a stand in time."""
    run = brake(beyond_event(undisclosed, STOPS[name]))
    stopped = float(run["speed"][-1]) < 0.1
    return {"part": PART, "stop": name, "stopped": stopped, **measures(run)}


BEYOND = Claim(
    "beyond", "the sets that reach the tables agree about stops that the tables do not have",
    f"measure == distance and half <= {AGREED_DISTANCE} or measure == Q and half <= {AGREED_DAMAGE}", AT_LEAST, 1.0,
    each="about", some=True, exact=True, reason="chosen before any was run",
    method=f"median and 5 to 95 % of the ensemble; agreed: half of that width at most {100 * AGREED_DISTANCE:g} % of the "
    f"distance and {100 * AGREED_DAMAGE:g} % of Q; three cars from 100 km/h but for what is named",
)  # fmt: skip


def beyond_statement(table: pd.DataFrame) -> Statement:
    """Whether the ensemble agrees about stops that no table has."""
    rows = table[(table["part"] == PART) & table["member"].notna()]
    cases: list[tuple[str, str, float]] = []
    numbers: dict[str, Interval] = {}
    for name, own in rows.groupby("stop", sort=False):
        for word, column, unit in (("distance", "distance", "m"), ("Q", "damage", "kJ")):
            found = median_of(own[column])
            half = (found.high - found.low) / (found.high + found.low)
            cases.append((f"about the {word} {name}: half width {100.0 * half:.1f} %", word, half))
            numbers[f"{name}: {word} [{unit}]"] = found
    stopped = float(rows["stopped"].mean()) if len(rows) else 1.0
    numbers["share of the stops that end"] = Interval(stopped, math.nan, math.nan, len(rows))
    return conjunction(
        pd.DataFrame(cases, columns=["about", "measure", "half"]), BEYOND, numbers=numbers
    )
