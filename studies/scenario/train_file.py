"""A train of one's own as a TOML file: kinds of cars, and the formation that they stand in."""

import math
from itertools import pairwise
from typing import Any

from pydantic import Field, field_validator, model_validator

from alloc.errors import PlantError
from alloc.plant.train import AirBrake, Car, InverterGroup, Motors, Sander, TorqueLimit, Train
from studies.files.effort import effort_limit
from studies.files.strict import Strict, parse, read_toml
from studies.files.study_error import StudyError
from studies.files.units import si


class MotorKeys(Strict):
    """Traction motors of a kind of car: `[car.X.motors]`.

    Either torque and power of one motor, or the car's tractive effort at the rims as a table over speed. The electric brake
    has torque and power of its own; it is as strong as the drive where nothing is said, and missing with a table.
    """

    inverter_group: InverterGroup = "1C4M"
    gear_ratio: float = Field(gt=0.0, le=100.0)
    torque_nm: float | None = None
    power_kw: float | None = None
    effort_speed_kmh: tuple[float, ...] = Field(default=(), max_length=1000)
    effort_kn: tuple[float, ...] = Field(default=(), max_length=1000)
    brake_torque_nm: float | None = None
    brake_power_kw: float | None = None
    pull_out_speed_kmh: float | None = None
    fade_speed_kmh: float = 5.0

    @model_validator(mode="after")
    def _one_drive(self) -> "MotorKeys":
        speeds, efforts = self.effort_speed_kmh, self.effort_kn
        formula = (self.torque_nm, self.power_kw)
        if speeds or efforts:
            if any(value is not None for value in (*formula, self.pull_out_speed_kmh)):
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

    def motors(self, radius: float, count: int) -> Motors:
        """The plant's motors of a car with so many, on wheels of `radius` [m]."""
        if self.effort_speed_kmh:
            efforts = [1e3 * effort for effort in self.effort_kn]
            speeds = self.effort_speed_kmh
            drive = effort_limit(speeds, efforts, radius, self.gear_ratio, max(count, 1))
        else:
            pull_out = (
                math.inf if self.pull_out_speed_kmh is None else self.pull_out_speed_kmh / 3.6
            )
            drive = TorqueLimit(self.torque_nm or 0.0, 1e3 * (self.power_kw or 0.0), pull_out)
        torque = (self.torque_nm or 0.0) if self.brake_torque_nm is None else self.brake_torque_nm
        power = (self.power_kw or 0.0) if self.brake_power_kw is None else self.brake_power_kw
        brake = TorqueLimit(torque, 1e3 * power, fade_speed=self.fade_speed_kmh / 3.6)
        return Motors(self.inverter_group, self.gear_ratio, drive, brake)


class AirBrakeKeys(Strict):
    """Friction brake of a kind of car: `[car.X.air_brake]`; the force is that of one axle at the rim, at full pressure."""

    pressure_kpa: float = Field(gt=0.0)
    force_kn: float
    lag_s: float = 1.2
    dead_time_s: float = 0.05
    friction_factor: float = 1.0

    def air_brake(self) -> AirBrake:
        """The plant's brake."""
        pressure = 1e3 * self.pressure_kpa
        return AirBrake(
            pressure,
            1e3 * self.force_kn / pressure,
            self.lag_s,
            self.lag_s,
            self.dead_time_s,
            friction_factor=self.friction_factor,
        )


class SanderKeys(Strict):
    """A sander of a kind of car: `[[car.X.sanders]]`; `axle` 0 = the car's foremost, rate and amount per rail.

    With an amount its rate varies: it keeps to the amount as long as the rate given here allows.
    """

    axle: int
    rate_kg_per_min: float
    amount_g_per_m: float | None = None

    def sander(self) -> Sander:
        """The plant's sander."""
        return Sander(**si(self))


class CarKeys(Strict):
    """A kind of car: `[car.X]`, X the letter that stands for it in the formation."""

    length_m: float
    mass_t: float
    load_t: float = 0.0
    axle_positions_m: tuple[float, ...] = Field(max_length=64)
    bogie_of_axle: tuple[int, ...]
    wheel_radius_m: float = Field(ge=0.1, le=2.0)
    wheel_inertia_kgm2: float
    driven: tuple[bool, ...] | None = None
    motors: MotorKeys | None = None
    air_brake: AirBrakeKeys | None = None
    speed_sensors: bool = True
    sanders: tuple[SanderKeys, ...] = Field(default=(), max_length=64)

    def car(self, name: str) -> Car:
        """The plant's car; every axle is driven where there are motors and nothing is said."""
        axles = len(self.axle_positions_m)
        driven = self.driven or (self.motors is not None,) * axles
        return Car(
            name=name,
            length=self.length_m,
            empty_mass=1e3 * self.mass_t,
            load=1e3 * self.load_t,
            axle_positions=self.axle_positions_m,
            bogie_of_axle=self.bogie_of_axle,
            wheel_radius=self.wheel_radius_m,
            wheel_inertia=(self.wheel_inertia_kgm2,) * axles,
            driven=driven,
            motors=None
            if self.motors is None
            else self.motors.motors(self.wheel_radius_m, sum(driven)),
            air_brake=None if self.air_brake is None else self.air_brake.air_brake(),
            speed_sensors=self.speed_sensors,
            sanders=tuple(one.sander() for one in self.sanders),
        )


class TrainKeys(Strict):
    """The file: the train's name, its formation from the front, its running resistance A + B v + C v2.

    For a run over a line: its greatest speed, and the deceleration under the service brake, in total.
    """

    name: str = Field(pattern=r"^[\w.+-]+$")
    formation: str = Field(min_length=1, max_length=500)
    car: dict[str, CarKeys]
    planned_acceleration_kmhs: float
    resistance_n: float = 0.0
    resistance_ns_per_m: float = 0.0
    resistance_ns2_per_m2: float = 0.0
    speed_limit_kmh: float | None = Field(default=None, gt=0.0)
    service_deceleration_kmhs: float | None = Field(default=None, gt=0.0)
    source: str = ""

    @field_validator("car")
    @classmethod
    def _one_letter(cls, value: dict[str, Any]) -> dict[str, Any]:
        if any(len(kind) != 1 for kind in value):
            raise ValueError("the kinds of cars have one letter each, such as [car.M]")
        return value

    def train(self) -> Train:
        """The plant's train; raises `StudyError` where the formation names a kind that the file does not describe."""
        unknown = [kind for kind in self.formation if kind not in self.car]
        if unknown:
            raise StudyError(
                f"train {self.name!r}: formation {self.formation!r} has a car {unknown[0]!r}; describe it as "
                f"[car.{unknown[0]}], or use {', '.join(self.car)}"
            )
        return Train(
            name=self.name,
            cars=tuple(
                self.car[kind].car(f"car {k} ({kind})") for k, kind in enumerate(self.formation, 1)
            ),
            resistance=(self.resistance_n, self.resistance_ns_per_m, self.resistance_ns2_per_m2),
            planned_acceleration=self.planned_acceleration_kmhs / 3.6,
            source=self.source,
        )


def read_train_file(path: str) -> Train:
    """The train of a TOML file; raises `StudyError` naming the file and the key."""
    return read_train_keys(path)[1]


def read_train_keys(path: str) -> tuple[TrainKeys, Train]:
    """The keys of a TOML file, and their train; raises `StudyError` naming the file and the key."""
    data = read_toml(path, "train", "give the path of a TOML file such as docs/plugins/tram.toml")
    try:
        keys = parse(TrainKeys, data, path)
        return keys, keys.train()
    except PlantError as error:
        raise StudyError(f"{path}: {error}") from None
