"""What must be known of a train to analyse its log."""

import json
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from alloc.display import displayed
from alloc.plant.laws import GRAVITY
from alloc.plant.model import structure_of
from alloc.plant.train import Train
from alloc.sources import write_whole
from studies.files.strict import Strict, parse, read_toml
from studies.scenario.train_file import CouplerKeys

Floats = NDArray[np.float64]


@displayed
@dataclass(frozen=True, eq=False)
class MeasuredTrain:
    """Data of a train that are needed to compute forces from its series; axles and cars from the front."""

    name: str
    car_mass: Floats
    """With load [kg], (cars,)."""
    axle_car: NDArray[np.int64]
    """(axles,)"""
    axle_load: Floats
    """At rest [N], (axles,)."""
    radius: Floats
    """(axles,) [m]"""
    inertia: Floats
    """Of each wheelset with everything geared to it [kg m2], (axles,)."""
    driven: NDArray[np.bool_]
    """(axles,)"""
    resistance: Floats | None = None
    """Running resistance of each car by powers of the speed [N, N s/m, N s2/m2], (cars, 3); None: not known."""
    coupler: Floats | None = None
    """Stiffness, stiffening, damping and slack of each draft gear in SI units, (cars - 1, 4); None: a rigid train."""

    @classmethod
    def of(cls, train: Train) -> "MeasuredTrain":
        """The same of a train of the plant."""
        s, _ = structure_of(train)
        driven = s.axle_unit >= 0
        coupler = s.coupler if s.coupler.size else None
        return cls(
            train.name, s.car_mass, s.axle_car, s.static_load, s.radius, s.inertia, driven,
            s.car_resistance, coupler,
        )  # fmt: skip

    def with_radius(self, radius: Floats) -> "MeasuredTrain":
        """The same with other wheel radii [m], (axles,)."""
        return replace(self, radius=radius)


Mass = Annotated[float, Field(gt=0.5, lt=500.0)]
Radius = Annotated[float, Field(ge=200.0, le=800.0)]
Inertia = Annotated[float, Field(ge=5.0, le=5000.0)]
"""Bounds that no car leaves: a value outside them has another unit."""

RESISTANCE = ("resistance_n", "resistance_ns_per_m", "resistance_ns2_per_m2")
COUPLER = ("stiffness_n_per_m", "stiffening_n_per_m3", "damping_ns_per_m", "slack_mm")
"""Keys in the order of `MeasuredTrain.resistance` and `MeasuredTrain.coupler`."""


class LoggedCar(Strict):
    """A car of the file: `[[cars]]`."""

    mass_t: Mass
    wheel_radius_mm: Radius | tuple[Radius, ...]
    wheel_inertia_kgm2: tuple[Inertia, ...] = Field(min_length=1)
    driven: tuple[bool, ...] | None = None
    axle_load_t: tuple[Mass, ...] | None = None
    resistance_n: float = Field(0.0, ge=0.0)
    resistance_ns_per_m: float = Field(0.0, ge=0.0)
    resistance_ns2_per_m2: float = Field(0.0, ge=0.0)

    @model_validator(mode="after")
    def _one_of_each_axle(self) -> "LoggedCar":
        axles = len(self.wheel_inertia_kgm2)
        for key in ("driven", "axle_load_t", "wheel_radius_mm"):
            given = getattr(self, key)
            if isinstance(given, tuple) and len(given) != axles:
                raise ValueError(f"{key} has {len(given)} entries for {axles} wheel_inertia_kgm2")
        if self.axle_load_t is not None and sum(self.axle_load_t) > 1.001 * self.mass_t:
            raise ValueError(
                f"axle_load_t sums to {sum(self.axle_load_t):g} t, mass_t is {self.mass_t:g}"
            )
        return self


class LoggedTrain(Strict):
    """The file."""

    name: str
    cars: tuple[LoggedCar, ...] = Field(min_length=1)
    couplers: tuple[CouplerKeys, ...] = ()

    @model_validator(mode="after")
    def _one_between_two_cars(self) -> "LoggedTrain":
        if self.couplers and len(self.couplers) != len(self.cars) - 1:
            raise ValueError(f"{len(self.couplers)} couplers for {len(self.cars)} cars")
        return self

    def measured(self) -> MeasuredTrain:
        """The same in SI units."""
        axles = [len(car.wheel_inertia_kgm2) for car in self.cars]
        load = [
            car.axle_load_t or (car.mass_t / n,) * n
            for car, n in zip(self.cars, axles, strict=True)
        ]
        driven = [car.driven or (False,) * n for car, n in zip(self.cars, axles, strict=True)]
        return MeasuredTrain(
            name=self.name,
            car_mass=1e3 * np.array([car.mass_t for car in self.cars]),
            axle_car=np.repeat(np.arange(len(self.cars)), axles),
            axle_load=1e3 * GRAVITY * np.concatenate([np.array(values) for values in load]),
            radius=1e-3
            * np.concatenate(
                [
                    np.broadcast_to(car.wheel_radius_mm, (n,))
                    for car, n in zip(self.cars, axles, strict=True)
                ]
            ),
            inertia=np.concatenate([np.array(car.wheel_inertia_kgm2) for car in self.cars]),
            driven=np.concatenate([np.array(values, dtype=bool) for values in driven]),
            resistance=np.array([[getattr(car, name) for name in RESISTANCE] for car in self.cars]),
            coupler=np.array([astuple(one.coupler()) for one in self.couplers])
            if self.couplers
            else None,
        )


def read_log_train(name_or_path: str) -> MeasuredTrain:
    """Train of a shipped set by name, or from a file: railtoolkit (.yaml), or TOML of a log or of a scenario's train.

    Raises `StudyError` or `PlantError` naming the file, the key and the reason.
    """
    from studies.scenario.train_file import build_train

    if name_or_path.endswith(".toml"):
        data = read_toml(name_or_path, "train", "`readhesion list` names the shipped trains")
        if "formation" not in data:
            return parse(LoggedTrain, data, f"train file {name_or_path!r}").measured()
    return MeasuredTrain.of(build_train(name_or_path, None, None, None, False))


def write_log_train(train: MeasuredTrain, path: Path) -> None:
    """Write a TOML file that `read_log_train` reads back."""
    lines = [f"name = {json.dumps(train.name, ensure_ascii=False)}"]
    for car, mass in enumerate(train.car_mass):
        own = train.axle_car == car
        lines += [
            "",
            "[[cars]]",
            f"mass_t = {float(mass) / 1e3!r}",
            f"wheel_radius_mm = {_list(1e3 * train.radius[own])}",
            f"wheel_inertia_kgm2 = {_list(train.inertia[own])}",
            f"driven = {_list(train.driven[own])}",
            f"axle_load_t = {_list(train.axle_load[own] / (1e3 * GRAVITY))}",
        ]
        if train.resistance is not None:
            lines += _keys(RESISTANCE, train.resistance[car])
    for values in () if train.coupler is None else train.coupler:
        lines += ["", "[[couplers]]", *_keys(COUPLER, values * (1.0, 1.0, 1.0, 1e3))]
    text = "\n".join(lines) + "\n"
    write_whole(path, lambda aside: aside.write_text(text, encoding="utf-8"))


def _keys(names: tuple[str, ...], values: Any) -> list[str]:
    return [f"{name} = {float(value)!r}" for name, value in zip(names, values, strict=True)]


def _list(values: Any) -> str:
    return "[" + ", ".join(str(value).lower() for value in values.tolist()) + "]"


@dataclass(frozen=True, eq=False)
class GradientLine:
    """Rise per run along a line."""

    station: Floats
    """Where each section begins [m], growing, (sections,)."""
    rise: Floats
    """Rise per run of each, (sections,)."""
    start: float | None = None
    """Station of the train's front at the first instant [m], where the log has no position."""
    backwards: bool = False
    """Whether the train runs against the line's stations."""

    def along(self, position: Floats | None, time: Floats, speed: Floats) -> Floats:
        """Rise per run where the train is, (instants,), in its own direction.

        `position` [m] of the log; None: the start, and `speed` [m/s] integrated.
        """
        if position is None:
            way = np.zeros(speed.size)
            v = np.nan_to_num(speed)
            way[1:] = np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time))
            first = self.start if self.start is not None else float(self.station[0])
            position = first + (-way if self.backwards else way)
        known = np.isfinite(position)
        place = np.interp(time, time[known], position[known])
        section = np.clip(
            np.searchsorted(self.station, place, "right") - 1, 0, self.station.size - 1
        )
        sign = -1.0 if self.backwards else 1.0
        moved = place[-1] - place[0]
        if self.start is None and abs(moved) > 1.0:
            sign = float(np.sign(moved))
        return np.asarray(sign * self.rise[section])


def read_gradients(path: Path, start: float | None = None) -> GradientLine:
    """The gradients of a railtoolkit running path; raises `StudyError` where it cannot be read."""
    from studies.railtoolkit.reading import read_path

    found = read_path(path)
    station = np.array([section.start for section in found.sections], dtype=float)
    rise = np.array([section.grade for section in found.sections], dtype=float)
    return GradientLine(station, rise, start)
