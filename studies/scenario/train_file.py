"""A train of one's own as a TOML file: kinds of cars, and the formation that they stand in."""

import math
from typing import Any

from pydantic import Field, field_validator

from alloc.errors import PlantError
from alloc.plant.train import AirBrake, Car, InverterGroup, Motors, Sander, TorqueLimit, Train
from studies.files.strict import Strict, parse, read_toml
from studies.files.study_error import StudyError
from studies.files.units import si


class MotorKeys(Strict):
    """Traction motors of a kind of car: `[car.X.motors]`; torque and power of one motor."""

    inverter_group: InverterGroup = "1C4M"
    gear_ratio: float = Field(gt=0.0, le=100.0)
    torque_nm: float
    power_kw: float
    brake_torque_nm: float | None = None
    brake_power_kw: float | None = None
    pull_out_speed_kmh: float | None = None
    fade_speed_kmh: float = 5.0

    def motors(self) -> Motors:
        """The plant's motors; without other values the brake is as strong as the drive."""
        pull_out = math.inf if self.pull_out_speed_kmh is None else self.pull_out_speed_kmh / 3.6
        brake_torque = self.torque_nm if self.brake_torque_nm is None else self.brake_torque_nm
        brake_power = self.power_kw if self.brake_power_kw is None else self.brake_power_kw
        return Motors(
            self.inverter_group,
            self.gear_ratio,
            TorqueLimit(self.torque_nm, 1e3 * self.power_kw, pull_out),
            TorqueLimit(brake_torque, 1e3 * brake_power, fade_speed=self.fade_speed_kmh / 3.6),
        )


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
        return Car(
            name=name,
            length=self.length_m,
            empty_mass=1e3 * self.mass_t,
            load=1e3 * self.load_t,
            axle_positions=self.axle_positions_m,
            bogie_of_axle=self.bogie_of_axle,
            wheel_radius=self.wheel_radius_m,
            wheel_inertia=(self.wheel_inertia_kgm2,) * axles,
            driven=self.driven or (self.motors is not None,) * axles,
            motors=None if self.motors is None else self.motors.motors(),
            air_brake=None if self.air_brake is None else self.air_brake.air_brake(),
            speed_sensors=self.speed_sensors,
            sanders=tuple(one.sander() for one in self.sanders),
        )


class TrainKeys(Strict):
    """The file: the train's name, its formation from the front, its running resistance A + B v + C v2."""

    name: str = Field(pattern=r"^[\w.+-]+$")
    formation: str = Field(min_length=1, max_length=500)
    car: dict[str, CarKeys]
    planned_acceleration_kmhs: float
    resistance_n: float = 0.0
    resistance_ns_per_m: float = 0.0
    resistance_ns2_per_m2: float = 0.0

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
        )


def read_train_file(path: str) -> Train:
    """The train of a TOML file; raises `StudyError` naming the file and the key."""
    data = read_toml(path, "train", "give the path of a TOML file such as docs/plugins/tram.toml")
    try:
        return parse(TrainKeys, data, path).train()
    except PlantError as error:
        raise StudyError(f"{path}: {error}") from None
