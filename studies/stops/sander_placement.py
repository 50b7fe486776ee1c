"""Where the same sand stops eight cars soonest, and how the brake force is shared among them: events and arms."""

from typing import Any

from alloc.plant.laws import GRAVITY
from alloc.plant.rail import sanded_peak
from alloc.plant.train import Sander, Train
from alloc.rules import AllocationProblem, find_rule
from studies.core.drawn_events import DrawnEvents, uniform
from studies.stops.sander_trial import (
    AXLES_PER_UNIT,
    CALIBRATED,
    DEMAND,
    FULL_BRAKE,
    GREATEST_RATE,
    INITIAL_SPEED,
    SOURCE,
    VARIABLE_AMOUNT,
    Source,
    brake_event,
    coupled_units,
    equipment,
    measured_stop,
    rail,
    sanded,
)

AMOUNT, RATE = 4 * VARIABLE_AMOUNT, 4 * GREATEST_RATE
"""Sand of the whole train per rail [kg/m, kg/s]: that of two units with two sanders of variable rate each."""
DURATION = 85.0
"""Time [s] longer than any stop here."""
AXLES = 2 * AXLES_PER_UNIT
AXLES_PER_CAR = 4
USUAL = "axles 3 and 7 of each unit"
PLACEMENTS: dict[str, tuple[int, ...]] = {
    "axle 1": (0,),
    "axle 1 of each unit": (0, 16),
    "axle 3 of each unit": (2, 18),
    "axles 1 and 5 of each unit": (0, 4, 16, 20),
    USUAL: (2, 6, 18, 22),
    "axle 1 of each car": tuple(range(0, AXLES, AXLES_PER_CAR)),
    "axle 1 of cars 1 to 4": (0, 4, 8, 12),
    "axle 1 of cars 1 and 4": (0, 12),
    "axle 1 of car 5": (16,),
}
"""Axles ahead of which the sand is laid in equal parts, 0 = foremost of the train."""
SHARINGS = ("equal", "raised", "by sand")
"""How the brake force is shared. First: as planned. Second: raised where sand is believed to carry more than the plan, as
far as the other cars are believed to carry less. Third: in addition, no car is asked for more than it is believed to
carry."""
CURVES = ("slip-ratio", "polach")
"""Curves that events take turns with."""
EVENTS = DrawnEvents(
    "sanders",
    {
        "level": uniform(0.02, 0.06, "", "very low to low adhesion, where slide protection works throughout"),
        "scatter": uniform(0.0, 0.2, " of the level", "standard deviation along the rail"),
        "speed": uniform(60.0, 120.0, " km/h", "about the 55 mph of the trial"),
        "wear": uniform(0.7, 1.3, " of the calibrated saturation", "how much sand is needed is known least"),
    },
    stream=(13,),
)  # fmt: skip


def placed(axles: tuple[int, ...]) -> Train:
    """Eight cars whose sand is laid in equal parts ahead of these axles."""
    one = Sander(0, RATE / len(axles), AMOUNT / len(axles))
    return sanded(coupled_units(), dict.fromkeys(axles, one))


def caps(train: Train, level: float, speed: float) -> list[float]:
    """Mean adhesion coefficient that each car's axles are believed to find at `speed` [m/s], by the calibrated law."""
    law, sanders, found, amount = CALIBRATED, iter(train.sanders), [], 0.0
    for car in train.cars:
        own = {one.axle for one in car.sanders}
        axles = []
        for axle in range(len(car.axle_positions)):
            if axle in own:
                sander = next(sanders)
                amount += min(sander.amount or float("inf"), sander.rate / speed)
            axles.append(
                float(sanded_peak(level, amount, law.sanded_coefficient, law.sand_saturation))
            )
            amount *= 1.0 - law.sand_decay
        found.append(sum(axles) / len(axles))
    return found


def shares(train: Train, level: float, speed: float, sharing: str) -> tuple[float, ...] | None:
    """Brake force asked of each car over the plan, see `SHARINGS`: the exact level over what cars are believed to carry."""
    if sharing == "equal":
        return None
    planned = -DEMAND / GRAVITY
    problem = AllocationProblem(
        cap=caps(train, level, speed),
        expected=planned,
        limit_max=[FULL_BRAKE / GRAVITY] * len(train.cars),
    )
    least = 1.0 if sharing == "raised" else 0.0
    return tuple(max(float(x) / planned, least) for x in find_rule("exact")(problem).limit)


def place_row(
    axles: tuple[int, ...],
    sharing: str,
    drawn: dict[str, Any],
    curve: str,
    seed: int,
    source: Source = SOURCE,
) -> dict[str, float]:
    """One stop: `drawn` as in `EVENTS`; the train believes the mean level and the calibrated law."""
    train, speed = placed(axles), drawn["speed"] / 3.6
    law = CALIBRATED._replace(sand_saturation=CALIBRATED.sand_saturation * drawn["wear"])
    scatter = drawn["scatter"] * drawn["level"]
    own = rail(law, curve, drawn["level"], scatter=scatter, seed=seed)
    onboard = equipment(source, shares(train, drawn["level"], speed, sharing))
    return measured_stop(brake_event(train, own, DURATION, onboard, initial_speed=speed))


NOMINAL: dict[str, Any] = {"level": 0.02, "scatter": 0.0, "speed": 3.6 * INITIAL_SPEED, "wear": 1.0}
"""The trial's rail and speed."""
