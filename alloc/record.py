"""The record of a run: rows of every control instant, which are the train's memory too, and the `xarray.Dataset` of them.

Names, units and meanings of its variables are those of the recorded columns (`alloc.columns`). Axles, cars and units are
counted from 1 at the front.
"""

import errno
import os
import platform
import shutil
import threading
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.columns import AXLE, BRAKE, CAR, RUN, UNIT
from alloc.curves import tops
from alloc.errors import UnsoundRun
from alloc.sources import write_whole
from alloc.tables import Rows, words
from alloc.world import World

if TYPE_CHECKING:
    from alloc.event import Event


class Record(NamedTuple):
    """Recorded rows (ticks, rows), and the same memory in words of 8 bytes, with that of the rows as they are now.

    A late telegram, a cylinder's dead time, a delayed computation is a look-up in it.
    """

    axles: Rows
    cars: Rows
    units: Rows
    brakes: Rows
    run: Rows
    axles_in: NDArray[np.int64]
    cars_in: NDArray[np.int64]
    units_in: NDArray[np.int64]
    brakes_in: NDArray[np.int64]
    run_in: NDArray[np.int64]
    axle_words: NDArray[np.int64]
    car_words: NDArray[np.int64]
    unit_words: NDArray[np.int64]
    brake_words: NDArray[np.int64]
    run_words: NDArray[np.int64]


_TABLES = (AXLE, CAR, UNIT, BRAKE, RUN)


def room(w: World) -> Record:
    """Room for the record of a run."""
    live = w.axles, w.cars, w.units, w.brakes, w.run
    tables = zip(_TABLES, live, strict=True)
    rows = [table.record(w.command.size, one.size) for table, one in tables]
    return Record(*rows, *map(words, rows), *map(words, live))


# the recorded run


def dataset(
    event: "Event", rule: str, controller: str, w: World, record: Record, ended: int, wall_time: float
) -> xr.Dataset:  # fmt: skip
    """The recorded run of `ended` ticks; raises `UnsoundRun` where the state has become no number."""
    if not np.isfinite(w.state).all():
        first = int(np.argmin(np.isfinite(record.run.speed[:ended, 0])))
        raise UnsoundRun(
            f"event {event.name!r} under {rule} and {controller}: the state is no number from "
            f"{first * event.onboard.period:g} s on"
        )
    every = max(1, round(event.record_period / event.onboard.period))
    kept = slice(0, ended, every)
    recorded: tuple[Any, ...] = record[: len(_TABLES)]
    parts = zip(_TABLES, recorded, strict=True)
    dims: tuple[str, ...]
    data: dict[str, Any] = {}
    for table, rows in parts:
        for name, column in table.columns.items():
            if not column.recorded:
                continue
            values, dims = rows[name][kept], ("time", table.name)
            if table is RUN:
                values, dims = values[:, 0], ("time",)
            if name == "coupler_force":  # behind the last car there is none
                values, dims = values[:, :-1], ("time", "coupler")
            data[name] = _variable(dims, values, column.unit, column.meaning)
    instants = data.pop("time")
    _add_tops(data, w)
    _add_limits(data, instants.values, w)
    for name, (dims, values, unit, meaning) in _fixed(w).items():
        data[name] = _variable(dims, values, unit, meaning)
    coordinates = {
        "time": xr.IndexVariable("time", instants.values, instants.attrs),
        **_numbers(w.axles.unit.tobytes(), w.axles.car.tobytes(), w.cars.size, w.units.size),
    }
    return xr.Dataset(data, coordinates, _attributes(event, rule, controller, w, ended, wall_time))


def _variable(dims: tuple[str, ...], values: Any, unit: str, meaning: str) -> xr.Variable:
    attributes = {"units": unit, "long_name": meaning}
    # numbers throughout: to look for dates in them would take half of the time
    return xr.Variable(dims, np.ascontiguousarray(values), attributes, fastpath=True)


def _add_tops(data: dict[str, Any], w: World) -> None:
    """What the curve's top is at every instant: of some curves it costs more than a step of the plant."""
    plant, speed = w.plant[0], data["car_speed"].values[:, w.axles.car]
    offered = data["offered"].values
    most, slip = tops(
        plant.curve_number, w.curve, np.ascontiguousarray(speed), offered, w.axles.contact
    )
    about = "true adhesion coefficient: the largest over the slip", "slip velocity of that largest"
    for name, values, unit, meaning in (
        ("adhesion_limit", most, "1", about[0]),
        ("peak_slip", slip, "m s-1", about[1]),
    ):
        data[name] = _variable(("time", "axle"), values, unit, meaning)


def _add_limits(data: dict[str, Any], time: NDArray[np.float64], w: World) -> None:
    """What motors can at the train's speed, and as far as the line takes it; 0 from their failure on."""
    plant, driven = w.plant[0], w.axles.unit >= 0
    inside = (w.axles.unit[:, None] == np.arange(w.units.size))[driven]
    share = inside / np.maximum(inside.sum(axis=0), 1)
    kmh = 3.6 * np.abs(data["car_speed"].values[:, w.axles.car[driven]] @ share)
    works = time[:, None] < w.units.failure
    phase = 2.0 * np.pi * time / plant.receptivity_period + plant.receptivity_phase
    taken = np.clip(plant.receptivity_mean + plant.receptivity_amplitude * np.sin(phase), 0.0, 1.0)
    for name, table, part, meaning in (
        ("drive_limit", w.effort, np.ones_like(time), "most that each motor can pull with"),
        (
            "brake_limit",
            w.retard,
            taken,
            "most that each motor can brake with, as far as the line takes it",
        ),
    ):
        speeds = np.arange(table.shape[1])
        found = [np.interp(kmh[:, j], speeds, table[j]) for j in range(w.units.size)]
        values = np.reshape(found, (w.units.size, time.size)).T * works * part[:, None]
        data[name] = _variable(("time", "unit"), values, "N m", meaning)


def _fixed(w: World) -> dict[str, tuple[tuple[str, ...], Any, str, str]]:
    """What does not change: dimensions, values, unit, meaning."""
    a, driven = w.axles, w.axles.unit >= 0
    load = np.bincount(a.unit[driven], a.static_load[driven], w.units.size)
    turning = a.inertia / a.radius**2
    of_axle, of_unit = ("axle",), ("unit",)
    return {
        "axle_unit": (of_axle, a.unit, "1", AXLE.columns["unit"].meaning),
        "axle_car": (of_axle, a.car, "1", AXLE.columns["car"].meaning),
        "axle_group": (of_axle, a.brake, "1", AXLE.columns["brake"].meaning),
        "axle_contact": (of_axle, a.contact, "1", AXLE.columns["contact"].meaning),
        "axle_static_load": (of_axle, a.static_load, "N", AXLE.columns["static_load"].meaning),
        "axle_radius": (of_axle, a.radius, "m", AXLE.columns["radius"].meaning),
        "axle_turning_mass": (of_axle, turning, "kg", "mass that would resist like the turning wheelset"),
        "unit_static_load": (of_unit, load, "N", "axle load at rest of the unit's axles, summed"),
        "unit_gear": (of_unit, w.units.gear, "1", UNIT.columns["gear"].meaning),
        "unit_radius": (of_unit, w.units.true_radius, "m", UNIT.columns["true_radius"].meaning),
        "unit_parallel": (of_unit, w.units.slip_torque > 0.0, "1", "whether its motors share a frequency"),
        "car_mass": (("car",), w.cars.mass, "kg", CAR.columns["mass"].meaning),
    }  # fmt: skip


@lru_cache(maxsize=16)
def _numbers(unit: bytes, car: bytes, cars: int, units: int) -> dict[str, xr.Variable]:
    """Numbers of axles, cars and units; kept for the next run, since indexes take as long as the rest of the dataset."""
    of_axle, of_car = np.frombuffer(unit, np.int64), np.frombuffer(car, np.int64)
    counted = {"axle": of_axle.size, "car": cars, "unit": units}
    found: dict[str, Any] = {
        name: xr.IndexVariable(
            name, np.arange(1, n + 1), {"long_name": f"number of the {name}, 1 = foremost"}
        )
        for name, n in counted.items()
    }
    for name, values, meaning in (
        ("unit_of_axle", of_axle + 1, "traction unit of the axle, 1 = foremost, 0: none"),
        ("car_of_axle", of_car + 1, "car of the axle, 1 = foremost"),
    ):
        found[name] = xr.Variable("axle", values, {"units": "1", "long_name": meaning})
    return found


def _attributes(
    event: "Event", rule: str, controller: str, w: World, ended: int, wall_time: float
) -> dict[str, Any]:
    run, plant = w.run[0], w.plant[0]
    return {
        "event": event.name,
        "event_hash": event.hash,
        "seed": event.seed,
        "rule": rule,
        "controller": controller,
        "train": event.train.name,
        "train_mass": float(w.cars.mass.sum()),
        "target_speed": np.nan if event.target_speed is None else event.target_speed,
        "blended_brakes": int(w.onboard.blended[0]),
        "rule_calls": int(run.asked),
        "rule_failures": int(run.rule_faults),
        "rule_gap": float(run.rule_gap),
        "controller_calls": ended * w.units.size,
        "controller_failures": int(w.units.faults.sum()),
        "curve": int(plant.curve_number),
        "curve_values": w.curve.copy(),
        "wall_time_s": wall_time,
        **provenance(),
    }


@lru_cache(maxsize=1)
def provenance() -> dict[str, str]:
    """Versions that a run was made with."""
    packages = ("readhesion", "numpy", "numba", "casadi", "osqp")
    found = {f"version_{name}": version(name) for name in packages}
    return found | {"version_python": platform.python_version()}


# files

_NETCDF = threading.Lock()
"""The netCDF library keeps state of its own: two threads in it at once crash the interpreter."""


def save(run: xr.Dataset, path: Path | str) -> None:
    """Write a run to netCDF, compressed; `load` reads it whole. Raises `OSError` naming the file.

    Where the ending is `.mat` it is written for MATLAB: a matrix for each variable, and the attributes as a struct.
    """
    path = Path(path)
    if path.suffix.lower() == ".mat":
        from scipy.io import savemat

        content: dict[str, Any] = {str(name): one.values for name, one in run.variables.items()}
        content["attributes"] = dict(run.attrs)
        write_whole(path, lambda aside: savemat(aside, content, oned_as="column"))
        return
    encoding = {name: {"zlib": True, "complevel": 4} for name, v in run.variables.items() if v.ndim}

    def write(aside: Path) -> None:
        try:
            with _NETCDF:
                run.to_netcdf(aside, engine="netcdf4", encoding=encoding)
        except RuntimeError:  # the library does not say that the disk is full
            if shutil.disk_usage(aside.parent).free > run.nbytes:
                raise
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from None

    write_whole(path, write)


def load(path: Path | str) -> xr.Dataset:
    """Read a run written by `save`."""
    with _NETCDF, xr.open_dataset(path, engine="netcdf4", decode_times=False) as stored:
        run = stored.load()
    plain = {
        key: one.item() if isinstance(one, np.generic) else one for key, one in run.attrs.items()
    }
    return run.assign_attrs(plain)  # netCDF gives numbers as NumPy's
