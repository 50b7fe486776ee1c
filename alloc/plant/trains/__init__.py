"""Trains as data: the shipped sets, a TOML file each, and how a train follows from the keys of such a file.

A user's own train has the same keys, so a shipped file is a template; `studies.files.train_keys` checks it and says what
each key means. `[sources]` says where values come from; "assumed" marks one without a source, with the reason why it is
plausible.
"""

import tomllib
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

from alloc.plant.train import AirBrake, Car, Coupler, Motors, Train
from alloc.schema.registry import Registry
from alloc.schema.units import to_si

NAMES = (
    "one-axle", "jp4209318-3car", "commuter-8car", "gb-unit-8car", "high-speed-16car", "freight-5", "freight-17", "heavy-70"
)  # fmt: skip
"""Shipped sets, each a file of this folder, from short trains to long ones."""
TRAINS: Registry[Callable[[], Train]] = Registry("train")
"""Name of a set and the function that builds its train."""


def find_train(name: str) -> Train:
    """The train of the set `name`; raises `InputError` with the nearest known name if there is none."""
    return TRAINS.find(name)()


@cache
def _shipped(name: str) -> Train:
    """Made once: a study asks for the same train with every event."""
    return train_of(tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text("utf-8")))


for _name in NAMES:
    TRAINS.register(_name, partial(_shipped, _name))


def train_of(keys: Mapping[str, Any]) -> Train:
    """The train of a file's keys, which are known to be there; raises `InputError` for values that do not fit together."""
    coupler, kinds = (
        keys.get("coupler"),
        {letter: to_si(car) for letter, car in keys["car"].items()},
    )
    for letter, values in kinds.items():
        for name, kind in (("motors", Motors), ("air_brake", AirBrake)):
            if name in keys["car"][letter]:
                values[name] = kind(**to_si(keys["car"][letter][name]))
    cars = [
        Car(**kinds[letter], name=f"car {k} ({letter})")
        for k, letter in enumerate(keys["formation"], 1)
    ]
    return Train(
        name=keys["name"],
        cars=tuple(cars),
        resistance=tuple(keys[f"resistance_{unit}"] for unit in ("n", "ns_per_m", "ns2_per_m2")),
        couplers=None if coupler is None else (Coupler(**to_si(coupler)),) * (len(cars) - 1),
        planned_acceleration=keys["planned_acceleration_kmhs"] / 3.6,
        source=keys["source"],
        sources=dict(keys["sources"]),
    )
