"""Trains as data: the shipped sets, a TOML file each, and how a train follows from the keys of such a file.

A user's own train has the same keys, so a shipped file is a template; `studies.trains` checks it and says what
each key means. The table `[sources]` says where values come from; "assumed" marks one without a source, with the reason why
it is plausible.
"""

import tomllib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from alloc.old.errors import PlantError
from alloc.old.plant.laws import GRAVITY, hyperbolic_speed_law
from alloc.old.plant.rail import SPEED_LAWS
from alloc.old.plant.train import (
    EFFORT_SPEED_STEP,
    EFFORT_TABLE_LENGTH,
    AirBrake,
    Car,
    Coupler,
    DraftGear,
    Motors,
    Sander,
    TorqueLimit,
    Train,
)
from alloc.old.registry import Registry
from alloc.old.units import si

NAMES = (
    "one-axle", "jp4209318-3car", "commuter-8car", "gb-unit-8car", "high-speed-16car", "freight-5", "freight-17", "heavy-70"
)  # fmt: skip
"""Shipped sets, each a file of this folder, from short trains to long ones."""
SETS: Registry[Callable[[], Train]] = Registry(
    "train", "readhesion.trains", PlantError, "alloc.old.plant.sets", NAMES
)
"""Name of a set and the function that builds its train."""


def find_set(name: str) -> Train:
    """The train of the set `name`; raises `PlantError` with the nearest known name if there is none."""
    return SETS.find(name)()


@dataclass(frozen=True)
class TrainFile:
    """Builds the train of a shipped file."""

    path: Path

    @property
    def description(self) -> str:
        """First line of the file."""
        return self.path.read_text("utf-8").partition("\n")[0].lstrip("# ")

    @cached_property
    def train(self) -> Train:
        """The train, made once: a study asks for the same one with every event."""
        return train_of(tomllib.loads(self.path.read_text("utf-8")))

    def __call__(self) -> Train:
        """The train."""
        return self.train


for _name in NAMES:
    SETS.register(_name, TrainFile(Path(__file__).with_name(f"{_name}.toml")))


def train_of(keys: Mapping[str, Any]) -> Train:
    """The train of a file's keys, which are known to be there; raises `PlantError` for values that do not fit together."""
    cars: list[Car] = []
    ahead: Counter[float] = Counter()  # cars by their length
    for number, kind in enumerate(keys["formation"], 1):
        described = keys["car"][kind]
        distance = sum(length * count for length, count in ahead.items())
        cars.append(_car(f"car {number} ({kind})", described, distance))
        ahead[described["length_m"]] += 1
    gear: Coupler | DraftGear | None = None
    if "coupler" in keys:
        gear = Coupler(**si(keys["coupler"]))
    elif "draft_gear" in keys:
        gear = DraftGear(**si(keys["draft_gear"]))
    return Train(
        name=keys["name"],
        cars=tuple(cars),
        resistance=(
            keys["resistance_n"], keys["resistance_ns_per_m"], keys["resistance_ns2_per_m2"]
        ),
        couplers=None if gear is None else (gear,) * (len(cars) - 1),
        planned_acceleration=keys["planned_acceleration_kmhs"] / 3.6,
        source=keys["source"],
        sources=dict(keys["sources"]),
    )  # fmt: skip


def _car(name: str, keys: Mapping[str, Any], distance: float) -> Car:
    """A car of this kind, `distance` [m] behind the train's head; without `driven` its motors drive every axle."""
    given = si(keys)
    axles = len(given["axle_positions"])
    motors, brake = keys.get("motors"), keys.get("air_brake")
    driven = given.pop("driven", None) or (motors is not None,) * axles
    mass = given.pop("mass")
    return Car(
        name=name,
        empty_mass=mass,
        wheel_inertia=(given.pop("wheel_inertia"),) * axles,
        driven=driven,
        # `Car` refuses one without axles
        motors=motors and _motors(motors, given["wheel_radius"], sum(driven), mass / max(axles, 1)),
        air_brake=brake and _air_brake(brake, distance),
        sanders=tuple(Sander(**si(one)) for one in given.pop("sanders", ())),
        **given,
    )


def _motors(keys: Mapping[str, Any], radius: float, count: int, axle_mass: float) -> Motors:
    """A car's `count` motors; `axle_mass`: empty mass on an axle [kg], on which planned adhesion counts."""
    given, gear_ratio = si(keys), keys["gear_ratio"]
    torque, power = given.get("torque", 0.0), given.get("power", 0.0)
    brake_torque, brake_power = given.get("brake_torque", torque), given.get("brake_power", power)
    brake = TorqueLimit(brake_torque, brake_power, fade_speed=keys["fade_speed_kmh"] / 3.6)
    if keys.get("effort_speed_kmh"):
        drive = TorqueLimit.of_effort(
            keys["effort_speed_kmh"], given["effort"], radius, gear_ratio, max(count, 1)
        )
    else:
        pull_out = keys.get("pull_out_speed_kmh", np.inf) / 3.6
        drive = TorqueLimit(torque, power, pull_out)
    if "planned_adhesion" in keys:
        law = SPEED_LAWS[keys["planned_adhesion"]]
        drive, brake = (
            _within_adhesion(one, law, radius / gear_ratio, axle_mass) for one in (drive, brake)
        )
    further = [item.name for item in fields(Motors)[4:]]  # those beside inverters, gear and limits
    own = {name: given[name] for name in further if name in given}
    return Motors(keys["inverter_group"], gear_ratio, drive, brake, **own)


def _within_adhesion(
    limit: TorqueLimit, law: tuple[float, float, float], shaft: float, axle_mass: float
) -> TorqueLimit:
    """`limit` [N m] over the speed, at most what `law` transmits on an axle; `shaft`: torque per force at the rim [m]."""
    speed = EFFORT_SPEED_STEP * np.arange(EFFORT_TABLE_LENGTH)
    adhesion = shaft * hyperbolic_speed_law(speed, *law) * axle_mass * GRAVITY
    torque = np.minimum(
        np.minimum(limit.peak, adhesion), shaft * limit.power / np.maximum(speed, 0.1)
    )
    if limit.fade_speed > 0.0:
        torque = torque * np.minimum(1.0, speed / limit.fade_speed)
    return replace(limit, table=tuple(torque.tolist()))


def _air_brake(keys: Mapping[str, Any], distance: float) -> AirBrake:
    """A car's brake, `distance` [m] of brake pipe behind the train's head."""
    given = si(keys)
    lag, wave = given.pop("lag"), given.pop("pipe_wave", np.inf)
    return AirBrake(
        maximum_pressure=given.pop("pressure"),
        force_per_pascal=keys["force_kn"] / keys["pressure_kpa"],
        fill_time=lag,
        release_time=given.pop("release_lag", lag),
        dead_time=given.pop("dead_time") + distance / wave,
        **{name: value for name, value in given.items() if name != "force"},
    )
