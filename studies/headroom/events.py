"""The random events with headroom as scenarios: units of one train find more and less than the plan asks of them."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.equipment import equipment
from alloc.plant.model import structure_of
from studies.files.units import stated
from studies.headroom.what_makes_room import TRAINS, draw, event_name
from studies.ladder.events import rail_keys
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

DURATION = 12.0
"""Length of an event [s]; at its end the motors still reach the plan."""
BELIEVED_SLOPE = 0.0083 / 0.07
"""Slope of the increments that every train believes in, over its plan: JP5484215 (15), in proportion."""
SPREAD_OF_GROWTH = 0.1
"""Headroom over the growth from the first axle to the last, where it is logarithmic and the mean meets the plan."""
STRONGEST = 0.75
"""Strongest growth over the plan: the first axle finds a bit less than half of it."""
FAR = 1e4
"""Beyond every train [m]."""


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = draw(seed, k)
    base, changes = TRAINS[d["train"]]
    start = shipped_scenario(base).changed(**changes)
    asked = d["demand"] * start.command[0].acceleration_kmhs
    loads = {} if start.load_t is not None else {"load_t": _loads(d, start)}
    loaded = start.changed(**loads)
    event = loaded.event()
    plan = equipment(event.model, event.onboard).planned_share * asked / 3.6
    mean = plan * d["level_ratio"]
    if d["source"] == "failed motors":
        mean *= 1.0 + 1.3 * d["wanted"]
    train = event.model.train
    rail = rail_keys(d["curve"], d["residual_ratio"], mean, train)
    # a curve makes of the increments what it makes of the coefficient at rest
    plan_at_rest = plan * rail["level"] / mean
    growth = d["growth"]
    if d["source"] == "growth":
        growth = min(d["wanted"] / SPREAD_OF_GROWTH, STRONGEST)
    structure = structure_of(train)[0]
    units = int(structure.axle_unit.max()) + 1
    failed = int(d["failed_place"] * units) + 1
    return loaded.changed(
        name=event_name(seed, k),
        title=f"random event {k} with headroom",
        case=None,
        duration_s=duration,
        target_speed_kmh=None,
        variation=None,  # drawn here
        command=[{"time_s": 0.0, "acceleration_kmhs": asked}],
        failures=[{"unit": failed, "time_s": d["failed_at_s"]}] if d["source"] == "failed motors" else [],
        rail=rail
        | {
            "increments": {
                "law": "given",
                "values": tuple((plan_at_rest * growth * _growth(structure.axle_unit)).tolist()),
            },
            "scatter": d["scatter_share"] * plan,
            "scatter_length_m": 20.0,
            "conditioning": d["conditioning"],
            "patches": _patches(d, sum(car.length for car in train.cars)),
        },
        line={"sections": [{"start_m": -FAR, "grade_permille": d["grade_permille"]}]},
        belief={
            "curve": {"kind": "piecewise"},
            "increments": {"law": "logarithmic", "slope": BELIEVED_SLOPE * plan, "offset": 0.0},
        },
        onboard={
            "sensors": {
                "speed_noise_kmh": stated("_kmh", d["speed_noise_kmh"]),
                "load_error": d["load_error"],
            },
            "telegrams": {"jitter_s": 0.03, "loss": d["telegram_loss"]},
        },
    )  # fmt: skip


def _loads(d: dict[str, Any], start: Scenario) -> tuple[float, ...]:
    """Pay load [t] of each car."""
    position = np.linspace(-1.0, 1.0, _cars(start))
    return tuple(
        stated("_t", load) for load in (d["load_t"] * (1.0 + d["tilt"] * position)).tolist()
    )


@cache
def _cars(start: Scenario) -> int:
    return len(start.event().model.train.cars)


def _growth(axle_unit: NDArray[np.int64]) -> NDArray[np.float64]:
    """Logarithmic growth along the train by 1 from the first axle to the last, 0 on the mean of the driven axles."""
    grown = np.log(np.arange(1.0, axle_unit.size + 1.0)) / np.log(axle_unit.size)
    centred: NDArray[np.float64] = grown - grown[axle_unit >= 0].mean()
    return centred


def _patches(d: dict[str, Any], length: float) -> list[dict[str, float]]:
    """Rail better and worse than the mean on either side of a place below the train, and a short bad one ahead."""
    patches = []
    if d["source"] in ("bad front", "bad rear"):
        spread = 2.0 * d["wanted"] * (1.0 if d["source"] == "bad front" else -1.0)
        border = -length * d["border"]
        patches += [
            {"factor": 1.0 + spread, "start_m": -FAR, "end_m": border, "edge_m": 4.0},
            {"factor": 1.0 - spread, "start_m": border, "end_m": FAR, "edge_m": 4.0},
        ]
    if d["patch_factor"] < 1.0:
        end = d["patch_start_m"] + d["patch_length_m"]
        patches.append(
            {"factor": d["patch_factor"], "start_m": d["patch_start_m"], "end_m": end, "edge_m": 4.0}
        )  # fmt: skip
    return patches
