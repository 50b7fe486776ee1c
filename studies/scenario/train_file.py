"""A user's own train as a TOML file: kinds of cars, and their order in the formation."""

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from alloc.errors import PlantError
from alloc.plant.sets import train_of
from alloc.plant.train import Car, Coupler, DraftGear, InverterGroup, MotorKind, Sander, Train
from studies.files.strict import Strict, in_file_words, parse, read_toml
from studies.files.study_error import StudyError
from studies.files.units import si
from studies.scenario.record_keys import built, keys_of

# Keys of a scenario file on the train.

FILES = r"\.([yY][aA]?[mM][lL]|[tT][oO][mM][lL])$"
"""Endings of the files of trains."""


_Coupler: Any = keys_of(Coupler)
_DraftGear: Any = keys_of(DraftGear)


class CouplerKeys(_Coupler):
    """Draft gear between all cars, which makes a rigid train a coupled one: `[coupler]`. Source: assumed."""

    def coupler(self) -> Coupler:
        """The plant's draft gear."""
        return built(self, Coupler)


class DraftGearKeys(_DraftGear):
    """Friction draft gears between all cars in place of `[coupler]`: `[draft_gear]`; a published set if nothing is said."""

    def coupler(self) -> DraftGear:
        """The plant's draft gear."""
        return built(self, DraftGear)


class FailureKeys(Strict):
    """A traction unit whose motors fail at a time: `[[failures]]`. Source: this project."""

    unit: int
    """Number of the traction unit, 1 = foremost."""
    time_s: float = 0.0
    """Instant of the failure."""


class MotorChangeKeys(Strict):
    """What all motors of the train have in place of their own: `[motors]`. Source: assumed, or the vehicle's."""

    torque_lag_s: float | None = Field(default=None, gt=0.0)
    """Time constant of the torque behind its command. Left out: the train's own, or 0.005 s, as of the readhesion paper."""
    kind: MotorKind | None = None
    """How the motors of an inverter divide its torque: torque, equally; induction, by Kloss's equation at one frequency;
    series, direct-current motors on one voltage. A single motor on its inverter has all of the torque. Left out: the train's
    own, or torque."""
    breakdown_torque_nm: float | None = Field(default=None, gt=0.0)
    """Largest torque of an induction motor. Left out: 2.5 times the greatest torque that is asked of it."""
    slip_speed_rpm: float | None = Field(default=None, gt=0.0)
    """Of an induction motor: slip of the shaft at the breakdown torque. Of a series motor: speed of the shaft at which its
    resistance takes half of the voltage. Left out: 300 and 120."""
    rotor_inertia_kgm2: float | None = Field(default=None, gt=0.0)
    """Inertia of a rotor at its shaft, on a drive that twists; it is a part of wheel_inertia_kgm2. Left out: drives are
    rigid."""
    shaft_stiffness_nm_per_rad: float | None = Field(default=None, gt=0.0)
    """Stiffness of that drive between rotor and wheelset, at the wheel. Left out: 5e6, a steel axle of 160 mm, 1 m."""
    shaft_damping: float | None = Field(default=None, ge=0.0, lt=1.0)
    """Damping of its oscillation over the critical one. Left out: 0.01."""


def is_file(train: str) -> bool:
    """Whether a train is given as a file, of railtoolkit or as TOML, and not by the name of a parameter set."""
    return re.search(FILES, train) is not None


def build_train(
    train: str,
    load_t: tuple[float, ...] | None,
    coupler: CouplerKeys | DraftGearKeys | None,
    load_transfer: bool | None,
    reverse: bool,
    inverter_group: InverterGroup | None = None,
    motors: MotorChangeKeys | None = None,
) -> Train:
    """The train of that name or file, loaded, coupled, with other inverter groups and motors and turned round as asked."""
    from dataclasses import replace

    from alloc.plant.sets import find_set
    from studies.railtoolkit.reading import read_train

    if not is_file(train):
        built = find_set(train)
    else:
        built = read_train_file(train) if train.lower().endswith(".toml") else read_train(train)
    if load_t is not None:
        built = built.loaded(tuple(1e3 * load for load in load_t))
    if coupler is not None:
        built = built.coupled(coupler.coupler())
    if load_transfer is not None:
        built = replace(built, load_transfer=load_transfer)
    changes: dict[str, Any] = {} if motors is None else si(motors)
    if inverter_group is not None:
        changes["group"] = inverter_group
    if changes:
        cars = tuple(
            replace(car, motors=replace(car.motors, **changes)) if car.motors else car
            for car in built.cars
        )
        built = replace(built, cars=cars)
    return built.reversed() if reverse else built


class MotorKeys(MotorChangeKeys):
    """Traction motors of a kind of car: `[car.X.motors]`.

    Either torque and power of one motor, or the car's tractive effort at the rims as a table over speed. The electric brake
    has torque and power of its own; it is as strong as the drive where nothing is said, and missing with a table.

    Source: the vehicle's.
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
    pull_out_speed_kmh: float | None = None
    """Speed from which the torque falls with the square of the speed. Left out: it never does."""
    fade_speed_kmh: float = 5.0
    """Speed below which the electric brake fades. Source: assumed."""
    planned_adhesion: Literal["shinkansen", "curtius-kniffler"] | None = None
    """Coefficient over the speed for which drive and brake are planned: they ask no more of a wheel under the empty car.
    Left out: torque and power alone decide. Source: shinkansen: JP5484215 (12); curtius-kniffler: Curtius and Kniffler,
    1950."""

    @model_validator(mode="after")
    def _one_drive(self) -> "MotorKeys":
        speeds, efforts = self.effort_speed_kmh, self.effort_kn
        formula = (self.torque_nm, self.power_kw)
        if speeds or efforts:
            others = (*formula, self.pull_out_speed_kmh, self.planned_adhesion)
            if any(value is not None for value in others):
                raise ValueError(
                    "give torque_nm and power_kw, or effort_speed_kmh and effort_kn, not both"
                )
            if len(speeds) != len(efforts) or len(speeds) < 2:
                raise ValueError(
                    f"effort_speed_kmh has {len(speeds)} entries, effort_kn {len(efforts)}; give as many, 2 or more"
                )
            if speeds[0] < 0.0 or min(efforts) < 0.0 or any(b <= a for a, b in pairwise(speeds)):
                raise ValueError(
                    "effort_speed_kmh must grow from 0 or more; effort_kn must not be negative"
                )
        elif self.torque_nm is None or self.power_kw is None:
            missing = "torque_nm" if self.torque_nm is None else "power_kw"
            raise ValueError(f"{missing} is missing; or give effort_speed_kmh and effort_kn")
        return self


class AirBrakeKeys(Strict):
    """Friction brake of a kind of car: `[car.X.air_brake]`. Source: the vehicle's."""

    pressure_kpa: float = Field(gt=0.0)
    """Greatest pressure of the cylinders."""
    force_kn: float = Field(ge=0.0)
    """Force of one axle at the rim, at that pressure."""
    lag_s: float = Field(default=1.2, gt=0.0)
    """Time constant of filling and of releasing the cylinders. Source: assumed."""
    release_lag_s: float | None = Field(default=None, gt=0.0)
    """Time constant of releasing the cylinders where it is another. Left out: lag_s."""
    dead_time_s: float = 0.05
    """Time from the command to the first change of pressure. Source: assumed."""
    pipe_wave_m_per_s: float | None = Field(default=None, gt=0.0)
    """Speed at which the command runs along the brake pipe from the train's head. Left out: it is everywhere at once."""
    friction: tuple[float, float, float] = (0.0, 1.0, 1.0)
    """Friction over the speed, a, b and c of a / (V + b) + c with V in km/h, relative to that with which force_kn holds."""
    friction_factor: float = Field(default=1.0, le=10.0)
    """Friction of the shoes over that of the design; the train's computers have no information on it."""


class SanderKeys(Strict):
    """A sander of a kind of car: `[[car.X.sanders]]`; `axle` 0 = the car's foremost, rate and amount per rail.

    With an amount its rate varies: it keeps to the amount as long as the rate given here allows.
    """

    record = Sander

    axle: int
    rate_kg_per_min: float
    amount_g_per_m: float | None = None


class CarKeys(Strict):
    """A kind of car: `[car.X]`, X the letter that stands for it in the formation. Source: the vehicle's."""

    record = Car
    fields_of_keys: ClassVar[Mapping[str, str]] = {"mass_t": "empty_mass"}

    length_m: float
    """Length over couplers."""
    mass_t: float
    """Empty mass."""
    load_t: float = 0.0
    """Pay load."""
    axle_positions_m: tuple[float, ...] = Field(max_length=64)
    """Distance of each axle from the car's front end, growing."""
    bogie_of_axle: tuple[int, ...]
    """Number of each axle's bogie, from 0."""
    wheel_radius_m: float = Field(ge=0.1, le=2.0)
    """Radius of the wheels."""
    wheel_inertia_kgm2: float
    """Inertia of a wheelset at the wheel, with everything geared to it."""
    axle_load_share: tuple[float, ...] | None = Field(default=None, max_length=64)
    """Share of the car's weight on each axle; in sum below 1 where axles that are not modelled carry the rest. Left out:
    equal shares."""
    pivot_height_m: float | None = None
    """Height above the rail at which bogies pull the body. Source: assumed."""
    driven: tuple[bool, ...] | None = None
    """Whether each axle has a motor. Left out: every axle, if there are motors."""
    motors: MotorKeys | None = None
    """Traction motors. Left out: none."""
    air_brake: AirBrakeKeys | None = None
    """Friction brake. Left out: none."""
    speed_sensors: bool = True
    """Whether the train's computers know the speed of its axles."""
    sanders: tuple[SanderKeys, ...] = Field(default=(), max_length=64)
    """Sanders. Left out: none."""


class TrainKeys(Strict):
    """The file: the train's name, its formation from the front, its running resistance A + B v + C v2. Source: the
    vehicle's."""

    name: str = Field(pattern=r"^[\w.+-]+$")
    """Name of the train: letters, digits, and . + - _."""
    formation: str = Field(min_length=1, max_length=500)
    """Letters of its cars from the front, such as "MTTM"."""
    car: dict[str, CarKeys]
    """Kinds of cars by their letter: `[car.M]`."""
    planned_acceleration_kmhs: float
    """Acceleration that the plan asks for on level track."""
    resistance_n: float = 0.0
    """Running resistance of the train, A."""
    resistance_ns_per_m: float = 0.0
    """Running resistance of the train over the speed, B."""
    resistance_ns2_per_m2: float = 0.0
    """Running resistance of the train over the square of the speed, C."""
    speed_limit_kmh: float | None = Field(default=None, gt=0.0)
    """Greatest speed, for a run over a line. Left out: none."""
    service_deceleration_kmhs: float | None = Field(default=None, gt=0.0)
    """Deceleration under the service brake in total, for a run over a line. Left out: one that is usual for its kind of
    train, with a warning."""
    coupler: CouplerKeys | None = None
    """Linear draft gear between all cars. Left out: none, a rigid train."""
    draft_gear: DraftGearKeys | None = None
    """Friction draft gear between all cars in place of `coupler`; an empty table is a published set. Left out: none."""
    source: str = ""
    """Where its figures come from."""
    sources: dict[str, str] = Field(default={})
    """Where each value comes from, by names of one's own: `readhesion cite` shows them. Left out: nothing is said."""

    @field_validator("car")
    @classmethod
    def _one_letter(cls, value: dict[str, Any]) -> dict[str, Any]:
        if any(len(kind) != 1 for kind in value):
            raise ValueError("the kinds of cars have one letter each, such as [car.M]")
        return value

    @model_validator(mode="after")
    def _one_coupler(self) -> "TrainKeys":
        if self.coupler is not None and self.draft_gear is not None:
            raise ValueError("give either coupler or draft_gear, not both")
        return self

    def train(self) -> Train:
        """The plant's train; raises `StudyError` where the formation names a kind that the file does not describe."""
        unknown = [kind for kind in self.formation if kind not in self.car]
        if unknown:
            raise StudyError(
                f"train {self.name!r}: formation {self.formation!r} has a car {unknown[0]!r}; describe it as "
                f"[car.{unknown[0]}], or use {', '.join(self.car)}"
            )
        return train_of(self.model_dump(exclude_none=True))


def read_train_file(path: str) -> Train:
    """The train of a TOML file; raises `StudyError` naming the file and the key."""
    return read_train_keys(path)[1]


def read_train_keys(path: str) -> tuple[TrainKeys, Train]:
    """The keys of a TOML file, and their train; raises `StudyError` naming the file and the key."""
    data = read_toml(path, "train", "give the path of a TOML file such as docs/plugins/tram.toml")
    keys = parse(TrainKeys, data, path)
    try:
        return keys, keys.train()
    except PlantError as error:
        raise StudyError(f"{path}: {in_file_words(str(error), keys)}") from None
