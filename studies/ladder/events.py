"""Random slip events for the ladder of readhesion controllers: what each of them meets, drawn quantity by quantity."""

from functools import lru_cache
from typing import Any

from alloc.plant.train import Train
from studies.core import drawn_scenarios as shared
from studies.core.drawn_events import DrawnEvents, Quantity, in_turn, sometimes, uniform
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

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
