"""A train of one's own as a TOML file: kinds of cars, and their order in the formation.

The keys are those of the shipped sets in `alloc/sets`, which are templates. A scenario names such a file as its
`train`; ``--plugin tram.toml`` makes its train known by its name.
"""

from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from alloc.sets import train_of
from alloc.train import AirBrake, Car, Coupler, InverterGroup, MotorKind, Train
from studies import StudyError
from studies.keys import Keys, checked, in_words_of, keys_of, read_toml, told_of


def train_keys(path: str | Path) -> "TrainKeys":
    """The keys of a file, whose train is known to be possible; raises `StudyError` that names the file and the key."""
    with told_of(f"file {str(path)!r}"):
        found = checked(TrainKeys, read_toml(path))
        for kind in found.formation:
            if kind not in found.car:
                told = f"key 'formation' = {found.formation!r:.60}: there is no [car.{kind}]"
                raise StudyError(told)
        for kind, car in found.car.items():
            with in_words_of(car, f"car.{kind}"):
                _ = found.model_copy(update={"formation": kind}).train
        with in_words_of(found):
            _ = found.train
    return found


class MotorChange(Keys):
    """What all motors of a train have in place of their own."""

    kind: MotorKind | None = None
    """How the motors of an inverter divide its torque: torque, equally; induction, at one frequency, by their speeds. A
    single motor has all of it. Left out: the train's own, or torque."""
    torque_lag_s: float | None = Field(default=None, gt=0.0)
    """Time constant of the torque behind its command. Left out: the train's own, or 0.005 s, as of the readhesion paper."""


class MotorKeys(MotorChange):
    """Motors of a kind of car: torque and power of one motor, or the car's tractive effort over the speed.

    The electric brake is as strong as the drive where nothing is said, and missing with a table of effort.
    """

    inverter_group: InverterGroup = "1C4M"
    """Motors per inverter: a traction unit is a car (1C4M), a bogie (1C2M) or an axle (1C1M)."""
    gear_ratio: float = Field(gt=0.0, le=100.0)
    """Turns of the motor per turn of the wheel."""
    torque_nm: float | None = Field(default=None, ge=0.0)
    """Greatest torque of a motor. Left out: effort_speed_kmh and effort_kn are given."""
    power_kw: float | None = Field(default=None, ge=0.0)
    """Greatest power of a motor. Left out: effort_speed_kmh and effort_kn are given."""
    effort_speed_kmh: tuple[float, ...] = Field(default=(), max_length=1000)
    """Speeds of the table of tractive effort, growing from 0 or more. Left out: torque_nm and power_kw are given."""
    effort_kn: tuple[float, ...] = Field(default=(), max_length=1000)
    """Tractive effort of the car at the rims at each of these speeds. Left out: torque_nm and power_kw are given."""
    brake_torque_nm: float | None = Field(default=None, ge=0.0)
    """Greatest braking torque of a motor. Left out: torque_nm; with a table of effort there is no electric brake."""
    brake_power_kw: float | None = Field(default=None, ge=0.0)
    """Greatest braking power of a motor. Left out: power_kw; with a table of effort there is no electric brake."""
    pull_out_speed_kmh: float | None = Field(default=None, gt=0.0)
    """Speed from which the torque falls with the square of the speed. Left out: it never does."""
    fade_speed_kmh: float = Field(default=5.0, ge=0.0)
    """Speed below which the electric brake fades. Source: assumed."""
    planned_adhesion: Literal["shinkansen", "curtius-kniffler"] | None = None
    """Speed law of the coefficient for which drive and brake are planned: they ask no more of a wheel under the empty car.
    Left out: torque and power alone decide."""

    @model_validator(mode="after")
    def _is_one_drive(self) -> "MotorKeys":
        formula = (self.torque_nm, self.power_kw)
        speeds, efforts = self.effort_speed_kmh, self.effort_kn
        if not speeds and not efforts:
            if None in formula:
                raise ValueError("give torque_nm and power_kw, or effort_speed_kmh and effort_kn")
        elif any((*formula, self.pull_out_speed_kmh, self.planned_adhesion)):
            others = "torque_nm, power_kw, pull_out_speed_kmh and planned_adhesion"
            raise ValueError(f"effort_kn takes the place of {others}")
        elif len(speeds) != len(efforts) or len(speeds) < 2:
            given = f"{len(speeds)} effort_speed_kmh and {len(efforts)} effort_kn"
            raise ValueError(f"{given}; give as many, 2 or more")
        elif any(b <= a for a, b in pairwise((-1e-9, *speeds))) or min(efforts) < 0.0:
            raise ValueError("effort_speed_kmh must grow from 0 or more, effort_kn not be negative")
        return self


class AirBrakeKeys(Keys):
    """Friction brake of a kind of car."""

    record = AirBrake
    renamed: ClassVar = {"pressure": "maximum_pressure", "lag": "fill_time"}

    pressure_kpa: float = Field(gt=0.0)
    force_kn: float = Field(ge=0.0)
    """Force of one axle at the rim, at that pressure."""
    lag_s: float = Field(default=1.2, gt=0.0)
    """Time constant of filling and of releasing the cylinders. Source: assumed."""
    release_lag_s: float | None = Field(default=None, gt=0.0)
    """Time constant of releasing the cylinders. Left out: lag_s."""
    dead_time_s: float = Field(default=0.05, ge=0.0)
    pipe_wave_m_per_s: float | None = Field(default=None, gt=0.0)
    """Speed at which the command runs along the brake pipe from the train's head. Left out: it is everywhere at once."""
    friction: tuple[float, float, float] = (0.0, 1.0, 1.0)
    """Friction over the speed, a, b and c of a / (V + b) + c with V in km/h, relative to that with which force_kn holds."""


_Coupler: Any = keys_of(Coupler)
_OF_CARS = (
    "length",
    "axle_positions",
    "bogie_of_axle",
    "axle_load_share",
    "pivot_height",
    "speed_sensors",
)
_Car: Any = keys_of(Car, *_OF_CARS)


class CarKeys(_Car):
    """A kind of car: `[car.X]`, X the letter that stands for it in the formation."""

    renamed: ClassVar = {"mass": "empty_mass"}

    mass_t: float = Field(gt=0.0)
    """Empty mass."""
    load_t: float = Field(default=0.0, ge=0.0)
    wheel_radius_m: float = Field(ge=0.1, le=2.0)
    """Radius of the wheels."""
    wheel_inertia_kgm2: float = Field(gt=0.0)
    """Inertia of a wheelset at the wheel, with everything geared to it."""
    driven: tuple[bool, ...] | None = Field(default=None, max_length=64)
    """Whether each axle has a motor. Left out: every axle, if there are motors."""
    motors: MotorKeys | None = None
    """Traction motors. Left out: none."""
    air_brake: AirBrakeKeys | None = None
    """Friction brake. Left out: none."""


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
    """Where each value comes from, by names of one's own."""
    car: dict[str, CarKeys]
    """Kinds of cars by their letter: `[car.M]`."""

    @field_validator("car")
    @classmethod
    def _have_letters(cls, value: dict[str, Any]) -> dict[str, Any]:
        if any(len(kind) != 1 for kind in value):
            raise ValueError("kinds of cars have one letter each, such as [car.M]")
        return value

    @cached_property
    def train(self) -> Train:
        """The plant's train; raises `PlantError` for values that do not fit together."""
        return train_of(self.model_dump(exclude_none=True))
