"""A user's train as a TOML file: kinds of cars, and their order in the formation.

The keys are those of the shipped sets in `alloc/plant/trains`, which are templates. A scenario names such a file as its
`train`; ``--plugin tram.toml`` makes its train known by its name.
"""

from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import Field, field_validator

from alloc.plant.train import Car, Coupler, MotorKind, Train
from alloc.plant.trains import train_of
from studies import StudyError
from studies.files.toml_keys import Keys, check_keys, make_table, name_keys, name_source, read_toml


def read_train(path: str | Path) -> "TrainKeys":
    """The keys of a file, whose train is known to be possible; raises `StudyError` that names the file and the key."""
    with name_source(f"file {str(path)!r}"):
        keys = check_keys(TrainKeys, read_toml(path))
        for kind in keys.formation:
            if kind not in keys.car:
                fault = f"key 'formation' = {keys.formation!r:.60}: there is no [car.{kind}]"
                raise StudyError(fault)
        for kind, car in keys.car.items():
            with name_keys(car, f"car.{kind}"):
                _ = keys.model_copy(update={"formation": kind}).train
        with name_keys(keys):
            _ = keys.train
    return keys


class MotorChange(Keys):
    """What all motors of a train have in place of their own."""

    kind: MotorKind | None = None
    """How the motors of an inverter divide its torque: torque, equally; induction, at one frequency, by their speeds. A
    single motor has all of it. Left out: the train's own, or torque."""
    torque_lag_s: float | None = Field(default=None, gt=0.0)
    """Time constant of the torque behind its command. Left out: the train's own, or 0.005 s, as of the readhesion paper."""


_Coupler: Any = make_table(Coupler)
_Car: Any = make_table(Car)


class TrainKeys(Keys):
    """A train: its name, its formation from the front, its running resistance A + B v + C v2 over the speed."""

    name: str = Field(pattern=r"^[\w.+-]+$", max_length=100)
    """Name of the train: letters, digits, and . + - _."""
    formation: str = Field(min_length=1, max_length=500)
    """Letters of its cars from the front, such as "MTTM"."""
    planned_acceleration_kmhs: float = Field(ge=0.0)
    """Acceleration that the plan asks for on level track."""
    resistance_n: float = Field(default=0.0, ge=0.0)
    """Running resistance of the train, A."""
    resistance_ns_per_m: float = Field(default=0.0, ge=0.0)
    """Running resistance of the train over the speed, B."""
    resistance_ns2_per_m2: float = Field(default=0.0, ge=0.0)
    """Running resistance of the train over the square of the speed, C."""
    coupler: _Coupler | None = None
    """Draft gear between all cars. Left out: a rigid train."""
    source: str = ""
    """Where its figures come from."""
    sources: dict[str, str] = Field(default={})
    """Where each value comes from, by names that the file chooses."""
    car: dict[str, _Car]
    """Kinds of cars by their letter: `[car.M]`."""

    @field_validator("car")
    @classmethod
    def _check_letters(cls, value: dict[str, Any]) -> dict[str, Any]:
        if any(len(kind) != 1 for kind in value):
            raise ValueError("kinds of cars have one letter each, such as [car.M]")
        return value

    @cached_property
    def train(self) -> Train:
        """The plant's train; raises `PlantError` for values that do not fit together."""
        return train_of(self.model_dump(exclude_none=True))
