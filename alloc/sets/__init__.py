"""Trains as data: the shipped sets, a TOML file each, and how a train follows from the keys of such a file.

A user's own train has the same keys, so a shipped file is a template; `studies.trains` checks it and says what each key
means. `[sources]` says where values come from; "assumed" marks one without a source, with the reason why it is plausible.
"""

import math
import tomllib
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from alloc.laws import GRAVITY, speed_law
from alloc.rail import SPEED_LAWS
from alloc.registry import Registry
from alloc.train import (
    EFFORT_SPEED_STEP,
    EFFORT_TABLE_LENGTH,
    AirBrake,
    Car,
    Coupler,
    Motors,
    TorqueLimit,
    Train,
)
from alloc.units import si

NAMES = (
    "one-axle", "jp4209318-3car", "commuter-8car", "gb-unit-8car", "high-speed-16car", "freight-5", "freight-17", "heavy-70"
)  # fmt: skip
"""Shipped sets, each a file of this folder, from short trains to long ones."""
SETS: Registry[Callable[[], Train]] = Registry("train")
"""Name of a set and the function that builds its train."""


def find_set(name: str) -> Train:
    """The train of the set `name`; raises `InputError` with the nearest known name if there is none."""
    return SETS.find(name)()


@cache
def _shipped(name: str) -> Train:
    """Made once: a study asks for the same train with every event."""
    return train_of(tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text("utf-8")))


for _name in NAMES:
    SETS.register(_name, partial(_shipped, _name))


def train_of(keys: Mapping[str, Any]) -> Train:
    """The train of a file's keys, which are known to be there; raises `InputError` for values that do not fit together."""
    cars: list[Car] = []
    for number, kind in enumerate(keys["formation"], 1):
        distance = sum(car.length for car in cars)
        cars.append(_car(f"car {number} ({kind})", keys["car"][kind], distance))
    coupler = keys.get("coupler")
    return Train(
        name=keys["name"],
        cars=tuple(cars),
        resistance=tuple(keys[f"resistance_{unit}"] for unit in ("n", "ns_per_m", "ns2_per_m2")),
        couplers=None if coupler is None else (Coupler(**si(coupler)),) * (len(cars) - 1),
        planned_acceleration=keys["planned_acceleration_kmhs"] / 3.6,
        source=keys["source"],
        sources=dict(keys["sources"]),
    )


def _car(name: str, keys: Mapping[str, Any], distance: float) -> Car:
    """A car of this kind, `distance` [m] behind the train's head; without `driven` its motors drive every axle."""
    given = si(keys)
    axles, mass = len(given["axle_positions"]), given.pop("mass")
    inertia = (given.pop("wheel_inertia"),) * axles
    driven = given["driven"] = given.get("driven") or ("motors" in keys,) * axles
    if "motors" in keys:  # `Car` refuses one without axles
        on_axle = mass / max(axles, 1)
        given["motors"] = _motors(keys["motors"], given["wheel_radius"], sum(driven), on_axle)
    if "air_brake" in keys:
        given["air_brake"] = _air_brake(keys["air_brake"], distance)
    return Car(name=name, empty_mass=mass, wheel_inertia=inertia, **given)


def _motors(keys: Mapping[str, Any], radius: float, count: int, axle_mass: float) -> Motors:
    """A car's `count` motors; `axle_mass`: empty mass on an axle [kg], on which planned adhesion counts."""
    given, gear_ratio = si(keys), keys["gear_ratio"]
    torque, power = given.get("torque", 0.0), given.get("power", 0.0)
    retard = given.get("brake_torque", torque), given.get("brake_power", power)
    brake = TorqueLimit(*retard, fade_speed=given["fade_speed"])
    if speeds := keys.get("effort_speed_kmh"):  # of the car at its rims, linear between them
        kmh = np.arange(min(EFFORT_TABLE_LENGTH, math.ceil(speeds[-1]) + 1))
        each = radius / (gear_ratio * max(count, 1)) * np.interp(kmh, speeds, given["effort"])
        drive = TorqueLimit(float(each[0]), 0.0, table=tuple(each.tolist()))
    else:
        drive = TorqueLimit(torque, power, given.get("pull_out_speed", np.inf))
    if "planned_adhesion" in keys:
        speed = EFFORT_SPEED_STEP * np.arange(EFFORT_TABLE_LENGTH)
        coefficient = speed_law(speed, *SPEED_LAWS[keys["planned_adhesion"]])
        most = radius / gear_ratio * coefficient * axle_mass * GRAVITY
        drive, brake = (one.within(most, radius, gear_ratio) for one in (drive, brake))
    own = {name: given[name] for name in ("torque_lag", "kind") if name in given}
    return Motors(keys["inverter_group"], gear_ratio, drive, brake, **own)


def _air_brake(keys: Mapping[str, Any], distance: float) -> AirBrake:
    """A car's brake, `distance` [m] of brake pipe behind the train's head."""
    given = si(keys)
    lag, pressure = given.pop("lag"), given.pop("pressure")
    force, wave = given.pop("force"), given.pop("pipe_wave", np.inf)
    return AirBrake(
        maximum_pressure=pressure,
        force_per_pascal=force / pressure,
        fill_time=lag,
        release_time=given.pop("release_lag", lag),
        dead_time=given.pop("dead_time") + distance / wave,
        **given,
    )
