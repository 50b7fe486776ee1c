"""The random events with headroom: what is drawn, and their scenarios. Units find more and less than the plan asks."""

from functools import cache
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.use import train_bounds
from alloc.onboard.equipment import equipment
from alloc.plant.model import structure_of
from studies.core import drawn_scenarios as shared
from studies.core.drawn_events import DrawnEvents, Quantity, in_turn, one_of, uniform
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
TRAINS: dict[str, tuple[str, dict[str, Any]]] = {
    "8 cars, 4 units": ("wet-start", {"inverter_group": "1C4M"}),
    "16 cars, 14 units": ("wet-start", {"train": "high-speed-16car", "command": [
        {"time_s": 0.0, "acceleration_kmhs": 2.2}]}),
    "8 cars, 16 units": ("wet-start", {"inverter_group": "1C1M"}),
    "locomotive, 6 units": ("freight-start", {}),
    "8 cars, 8 units": ("wet-start", {"inverter_group": "1C2M"}),
}  # fmt: skip
"""Train -> the shipped scenario whose train and command it has, and the changes to it. The 16 cars are asked for less than
2.6 km/h/s, at which motors have a reserve of a tenth."""
SOURCES = ("growth", "bad front", "bad rear", "failed motors")
"""What makes most of the headroom."""
WANTED = ((0.0, 0.015), (0.025, 0.05), (0.065, 0.10), (0.10, 0.18))
"""Headroom that the source is to make, by class; a train that moves over the rail meets less."""

QUANTITIES: dict[str, Quantity] = {
    "train": in_turn(
        list(TRAINS), "each of five in its turn",
        "few units and many, trailers between them or none, a torque for four axles, for two, for one",
    ),
    "wanted": Quantity(
        f"uniform in each of {', '.join(f'{a:g} ... {b:g}' for a, b in WANTED)}, each for five events in its turn",
        "small and large headroom alike; the random events of the claims have 0.0014 in the median",
        lambda g, d: float(g.uniform(*WANTED[d["number"] // len(TRAINS) % len(WANTED)])),
    ),
    "source": one_of(
        SOURCES,
        "growth along the train 40 %, bad rail in front, bad rail at the rear, failed motors 20 % each",
        "JP5484215 (15); a shower or leaves that begin below the train; rail cleaned or sanded as far as there",
        [0.4, 0.2, 0.2, 0.2],
    ),
    "growth": uniform(
        -0.05, 0.2, " of the plan from the first axle to the last, where something else makes the headroom",
        "JP5484215 (15): 0.0083 ln 16 where the plan needs 0.07 is a third",
    ),
    "border": uniform(0.1, 0.9, " of the train's length behind its head", "where good and bad rail meet at the start"),
    "failed_place": uniform(0.0, 1.0, " of the units, from the front", "any unit may fail"),
    "failed_at_s": uniform(1.0, 5.0, " s", "before and after the torque is up"),
    "level_ratio": uniform(
        0.96, 1.06, " times the plan's coefficient, on the mean of the driven axles",
        "the train as a whole reaches the plan or nearly so: where it is far above or below, nothing can be gained",
    ),
    "demand": uniform(0.85, 1.0, " of the usual acceleration", "motors have 17 to 70 % in hand"),
    "curve": one_of(
        shared.TWO_PEAKS,
        "piecewise and Polach's of wet rail, equally likely",
        "a narrow peak and a wide one; the train believes in the narrow one",
    ),
    "residual_ratio": shared.RESIDUAL_RATIO,
    "scatter_share": shared.SCATTER_SHARE,
    "conditioning": shared.CONDITIONING,
    "patch_factor": shared.BAD_PATCH,
    "patch_start_m": uniform(5.0, 30.0, " m", "met during the event"),
    "patch_length_m": uniform(10.0, 60.0, " m", "half a car to three cars"),
    "load_t": uniform(0.0, 6.0, " t per car on the mean (not the locomotive's train)", "motors reach the plan throughout"),
    "tilt": shared.TILT,
    "load_error": shared.LOAD_ERROR,
    "speed_noise_kmh": shared.SPEED_NOISE,
    "telegram_loss": shared.TELEGRAM_LOSS,
    "grade_permille": shared.UPHILL,
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("headroom", QUANTITIES, stream=(14,), numbered=True)
draw, event_name = EVENTS.draw, EVENTS.event_name


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = draw(seed, k)
    base, changes = TRAINS[d["train"]]
    start = shipped_scenario(base).changed(**changes)
    asked = d["demand"] * start.command[0].acceleration_kmhs
    loaded = start.changed(
        **({} if start.load_t is not None else {"load_t": shared.tilted_loads(d, _cars(start))})
    )
    event = loaded.event()
    plan = equipment(event.model, event.onboard).planned_share * asked / 3.6
    mean = plan * d["level_ratio"]
    fails = d["source"] == "failed motors"
    if fails:
        mean *= 1.0 + 1.3 * d["wanted"]
    train = event.model.train
    rail = shared.rail_offering(shared.drawn_curve(d["curve"], d), mean, shared.START_SPEED, train)
    # a curve makes of the increments what it makes of the coefficient at rest
    plan_at_rest = plan * rail["level"] / mean
    growth = d["growth"]
    if d["source"] == "growth":
        growth = min(d["wanted"] / SPREAD_OF_GROWTH, STRONGEST)
    structure = structure_of(train)[0]
    units = int(structure.axle_unit.max()) + 1
    increments = tuple((plan_at_rest * growth * _growth(structure.axle_unit)).tolist())
    length = sum(car.length for car in train.cars)
    return shared.drawn_scenario(
        loaded, event_name(seed, k), f"random event {k} with headroom", duration,
        rail
        | {"increments": {"law": "given", "values": increments}, "conditioning": d["conditioning"]}
        | shared.uneven(d["scatter_share"] * plan, *_sides(d, length), shared.drawn_patch(d)),
        d,
        target_speed_kmh=None,
        command=[{"time_s": 0.0, "acceleration_kmhs": asked}],
        failures=[{"unit": int(d["failed_place"] * units) + 1, "time_s": d["failed_at_s"]}] if fails else [],
        line=shared.graded(d, -FAR),
        belief={
            "curve": {"kind": "piecewise"},
            "increments": {"law": "logarithmic", "slope": BELIEVED_SLOPE * plan, "offset": 0.0},
        },
    )  # fmt: skip


@cache
def _cars(start: Scenario) -> int:
    return len(start.event().model.train.cars)


def _growth(axle_unit: NDArray[np.int64]) -> NDArray[np.float64]:
    """Logarithmic growth along the train by 1 from the first axle to the last, 0 on the mean of the driven axles."""
    grown = np.log(np.arange(1.0, axle_unit.size + 1.0)) / np.log(axle_unit.size)
    centred: NDArray[np.float64] = grown - grown[axle_unit >= 0].mean()
    return centred


def _sides(d: dict[str, Any], length: float) -> tuple[shared.Keys | None, ...]:
    """Rail better and worse than the mean on either side of a place below the train."""
    if d["source"] not in ("bad front", "bad rear"):
        return ()
    spread = 2.0 * d["wanted"] * (1.0 if d["source"] == "bad front" else -1.0)
    border = -length * d["border"]
    return shared.stretch(1.0 + spread, -FAR, border), shared.stretch(1.0 - spread, border, FAR)


def measure(run: xr.Dataset) -> dict[str, float]:
    """plan_use: effort, instant by instant the plan at most, over the plan; `headroom` has the same scale."""
    found = train_bounds(run)
    return {"plan_use": float(np.minimum(found.force, found.plan).sum() / found.plan.sum())}
