"""Keys of a scenario file on the train."""

import re

from alloc.plant.train import Coupler, DraftGear, InverterGroup, Train
from studies.files.strict import Strict
from studies.files.units import si

FILES = r"\.([yY][aA]?[mM][lL]|[tT][oO][mM][lL])$"
"""Endings of the files of trains."""


class CouplerKeys(Strict):
    """Draft gear between all cars, which makes a rigid train a coupled one: `[coupler]`. Source: assumed."""

    record = Coupler

    stiffness_n_per_m: float
    stiffening_n_per_m3: float | None = None
    damping_ns_per_m: float | None = None
    slack_mm: float | None = None

    def coupler(self) -> Coupler:
        """The plant's draft gear."""
        return Coupler(**si(self))


class DraftGearKeys(Strict):
    """Friction draft gears between all cars in place of `[coupler]`: `[draft_gear]`; a published set if nothing is said."""

    record = DraftGear

    loading_n_per_m: float | None = None
    unloading_n_per_m: float | None = None
    structure_n_per_m: float | None = None
    preload_kn: float | None = None
    restoring_kn: float | None = None
    stroke_mm: float | None = None
    slack_mm: float | None = None
    viscosity_ns_per_m: float | None = None
    damping_ns_per_m: float | None = None
    in_series: int | None = None

    def coupler(self) -> DraftGear:
        """The plant's draft gear."""
        return DraftGear(**si(self))


class FailureKeys(Strict):
    """A traction unit whose motors fail at a time: `[[failures]]`. Source: this project."""

    unit: int
    """Number of the traction unit, 1 = foremost."""
    time_s: float = 0.0
    """Instant of the failure."""


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
) -> Train:
    """The train of that name or file, loaded, coupled, with other inverter groups and turned round as asked."""
    from dataclasses import replace

    from alloc.plant.sets import find_set
    from studies.railtoolkit.reading import read_train
    from studies.scenario.train_file import read_train_file

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
    if inverter_group is not None:
        cars = tuple(
            replace(car, motors=replace(car.motors, group=inverter_group)) if car.motors else car
            for car in built.cars
        )
        built = replace(built, cars=cars)
    return built.reversed() if reverse else built
