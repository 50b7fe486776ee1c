"""The record of a run: tables at every control instant, some of them the train's memory too, and the `xarray.Dataset` of it.

Names, units and meanings of its variables are those of the recorded columns (`alloc.onboard.columns`). Axles, cars and units
are counted from 1 at the front.
"""

import errno
import os
import platform
import shutil
import threading
from collections.abc import Callable, Iterator
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from alloc.files import write_whole
from alloc.onboard.columns import RUN, UNIT
from alloc.plant.columns import CAR, CYLINDER, DRIVE, PLANT, WHEELSET
from alloc.plant.curves import find_tops
from alloc.run.world import World
from alloc.schema.errors import InputError, UnsoundRun
from alloc.schema.tables import Rows, Table, memory_words

if TYPE_CHECKING:
    from alloc.run.event import Event


Words = tuple[tuple[NDArray[np.int64], NDArray[np.int64]], ...]
"""Tables as they are now, and their record: in words of 8 bytes, as which compiled code copies numbers of any type."""


class Recording(NamedTuple):
    """The record of a run: of what compiled code looks up in it rows (ticks, rows), of the plant's large tables columns.

    A late telegram or a cylinder's dead time is a look-up. Columns are variables of the recorded run as they stand, so each
    keeps those of its table in memory.
    """

    cylinders: Rows
    units: Rows
    run: Rows
    rows: Words
    """Records (ticks, rows, columns)."""
    columns: Words
    """Records (columns, ticks, rows)."""

    def find_column(self, table: Table, name: str) -> NDArray[Any]:
        """Recorded values, (ticks, rows)."""
        if table in _BY_ROW:
            rows: Any = self[_BY_ROW.index(table)]
            return np.asarray(rows[name])
        columns = self.columns[_BY_COLUMN.index(table)][1]
        return columns[table.recorded.names.index(name)].view(table.recorded[name])


_TABLES = (WHEELSET, CAR, CYLINDER, PLANT, UNIT, RUN)
_BY_ROW, _BY_COLUMN = (CYLINDER, UNIT, RUN), (WHEELSET, CAR, PLANT)


def make_room(w: World) -> Recording:
    """Room for the record of a run."""
    ticks, by_row = w.command.size, (w.cylinders, w.units, w.run)
    rows = [table.record(ticks, live.size) for table, live in zip(_BY_ROW, by_row, strict=True)]
    columns = [
        (memory_words(live), np.zeros((len(table.recorded.names), ticks, live.size), np.int64))
        for table, live in zip(_BY_COLUMN, (w.wheelsets, w.cars, w.plant), strict=True)
    ]
    pairs = zip(map(memory_words, by_row), map(memory_words, rows), strict=True)
    fields: Any = *rows, tuple(pairs), tuple(columns)
    return Recording(*fields)


# the recorded run

Entry = tuple[str, tuple[str, ...], Any, str, str]
"""Name of a variable, its dimensions, values, unit, meaning."""


def make_dataset(
    event: "Event", rule: str, controller: str, w: World, record: Recording, ended: int, wall_time: float
) -> xr.Dataset:  # fmt: skip
    """The recorded run of `ended` ticks; raises `UnsoundRun` where the state has become no number."""
    period = event.onboard.period
    if not np.isfinite(w.state).all():
        speed = record.find_column(PLANT, "speed")[:ended, 0]
        reason = f"the state is no number from {int(np.argmin(np.isfinite(speed))) * period:g} s on"
        raise UnsoundRun(f"event {event.name!r} under {rule} and {controller}: {reason}")
    instants = slice(0, ended, max(1, round(event.record_period / period)))
    kinds, data = [], {}
    for name, dims, values, unit, meaning in (
        *_recorded_entries(record.find_column, instants),
        *_derived_entries(record, instants, w),
    ):
        kinds.append((name, dims, values.shape, values.dtype.str, unit, meaning))
        data[name] = np.ascontiguousarray(values)
    train = w.wheelsets.unit.tobytes(), w.wheelsets.car.tobytes(), w.cars.size, w.units.size
    run = _lay_out(tuple(kinds), data.pop("time").tobytes(), *train).copy(data=data)
    run.attrs = _attributes(event, rule, controller, w, ended, wall_time)
    return run


def _recorded_entries(find_column: Callable[[Table, str], Any], instants: slice) -> Iterator[Entry]:
    for table in _TABLES:
        for name in table.recorded.names:
            values, column = find_column(table, name)[instants], table.columns[name]
            dims: tuple[str, ...] = "time", table.name
            if table in (RUN, PLANT):
                values, dims = values[:, 0], ("time",)
            if name == "coupler_force":  # behind the last car there is none
                values, dims = values[:, :-1], ("time", "coupler")
            yield name, dims, values, column.unit, column.meaning


def _derived_entries(record: Recording, instants: slice, w: World) -> Iterator[Entry]:
    """What follows from the record, and what does not change."""
    plant, a, drives = w.plant[0], w.wheelsets, w.drives
    speed, time = record.find_column(CAR, "car_speed")[instants], record.run.time[instants, 0]
    # of some curves the top costs more than a step of the plant
    offered = record.find_column(WHEELSET, "offered")[instants], a.contact
    most, slip = find_tops(plant.curve_number, w.curve, speed.take(a.car, axis=1), *offered)
    text = "true adhesion coefficient: the largest over the slip"
    yield "adhesion_limit", ("time", "axle"), most, "1", text
    yield "peak_slip", ("time", "axle"), slip, "m s-1", "slip velocity of that largest"
    # motors at the train's speed, and as far as the line takes it; 0 from their failure on
    driven = a.unit >= 0
    inside = (a.unit[:, None] == np.arange(drives.size))[driven]
    kmh = 3.6 * np.abs(speed[:, a.car[driven]] @ (inside / np.maximum(inside.sum(axis=0), 1)))
    works, grid = time[:, None] < drives.failure, np.arange(w.effort.shape[1])
    phase = 2.0 * np.pi * time / plant.receptivity_period + plant.receptivity_phase
    share = plant.receptivity_mean + plant.receptivity_amplitude * np.sin(phase)
    for name, limits, part, more in (
        ("drive_limit", w.effort, np.ones_like(time), "pull with"),
        ("brake_limit", w.retard, np.clip(share, 0.0, 1.0), "brake with, as far as the line takes it"),
    ):  # fmt: skip
        torques = [np.interp(kmh[:, j], grid, limits[j]) for j in range(drives.size)]
        values = np.reshape(torques, (drives.size, time.size)).T * works * part[:, None]
        yield name, ("time", "unit"), values, "N m", f"most that each motor can {more}"
    load = np.bincount(a.unit[driven], a.static_load[driven], drives.size)
    parallel = drives.slip_torque > 0.0
    for table, rows, names in (
        (WHEELSET, a, ("unit", "car", "brake", "contact", "static_load", "radius")),
        (DRIVE, drives, ("gear", "radius", "lag")),
        (CAR, w.cars, ("mass",)),
    ):
        for column in names:
            name = f"{table.name}_{'group' if column == 'brake' else column}"
            unit, meaning = table.columns[column].unit, table.columns[column].meaning
            yield name, (table.name,), rows[column], unit, meaning
    for column in ("fill_time", "dead_time"):  # of the cylinder at an axle; 0 where it has none
        values = np.append(w.cylinders[column], 0.0)[a.brake]
        meaning = CYLINDER.columns[column].meaning
        yield f"axle_{column}", ("axle",), values, "s", f"of its brake cylinder: {meaning}"
    text = "mass that would resist like the turning wheelset"
    yield "axle_turning_mass", ("axle",), a.inertia / a.radius**2, "kg", text
    text = "axle load at rest of the unit's axles, summed"
    yield "unit_static_load", ("unit",), load, "N", text
    yield "unit_parallel", ("unit",), parallel, "1", "whether its motors share a frequency"


@lru_cache(maxsize=16)
def _lay_out(
    kinds: tuple[tuple[Any, ...], ...], time: bytes, unit: bytes, car: bytes, cars: int, units: int
) -> xr.Dataset:
    """A recorded run without values; kept for the next one, since its variables and indexes take longer than the values."""
    variables = {}
    for name, dims, shape, kind, unit_of, meaning in kinds:
        values, attributes = np.zeros((), kind), {"units": unit_of, "long_name": meaning}
        variables[name] = xr.Variable(
            dims, np.broadcast_to(values, shape), attributes, fastpath=True
        )
    # of an array xarray would ask whether it is one of dask's, and import that where it is installed: a third of a second
    index = pd.Index(np.frombuffer(time))
    coordinates: dict[str, Any] = {
        "time": xr.IndexVariable("time", index, variables.pop("time").attrs)
    }
    of_axle, of_car = np.frombuffer(unit, np.int64), np.frombuffer(car, np.int64)
    for name, n in (("axle", of_axle.size), ("car", cars), ("unit", units)):
        text = f"number of the {name}, 1 = foremost"
        coordinates[name] = xr.IndexVariable(
            name, pd.Index(np.arange(1, n + 1)), {"long_name": text}
        )
    for name, values, meaning in (
        ("unit_of_axle", of_axle + 1, "traction unit of the axle, 1 = foremost, 0: none"),
        ("car_of_axle", of_car + 1, "car of the axle, 1 = foremost"),
    ):
        attributes = {"units": "1", "long_name": meaning}
        coordinates[name] = xr.Variable("axle", values, attributes, fastpath=True)
    return xr.Dataset(variables, coordinates)


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
        "axle_count": w.wheelsets.size,
        "target_speed": np.nan if event.target_speed is None else event.target_speed,
        "blended_brakes": int(w.onboard.blended[0]),
        "control_period": float(run.period),
        "rise_time": float(run.rise),
        "rule_calls": int(run.asked),
        "rule_failures": int(run.rule_faults),
        "rule_gap": float(run.rule_gap),
        "controller_calls": ended * w.units.size,
        "controller_failures": int(w.units.faults.sum()),
        "curve": int(plant.curve_number),
        "curve_values": w.curve.copy(),
        "wall_time_s": wall_time,
        **list_versions(),
    }


@lru_cache(maxsize=1)
def list_versions() -> dict[str, str]:
    """Versions that a run was made with."""
    packages = ("readhesion", "numpy", "numba", "casadi", "osqp")
    versions = {f"version_{name}": version(name) for name in packages}
    return versions | {"version_python": platform.python_version()}


APART = 5.0, 0.2
"""How far the front of a train may get from its mean way: slack of couplers [m], and a share of that way."""


def check_whole(run: xr.Dataset) -> None:
    """Raise `InputError` where a run is not as recorded: of a whole train, at all instants, a stretch, or every n-th."""

    def need(fits: Any, reason: str) -> None:
        if not fits:
            raise InputError(f"run: {reason}; evaluate takes whole runs as recorded")

    v = {name: np.asarray(variable.values) for name, variable in run.variables.items()}
    car, unit = (v[name].max(initial=0) for name in ("car_of_axle", "unit_of_axle"))
    counts = {"axle": run.attrs.get("axle_count", v["axle"].size), "car": car, "unit": unit}
    for name, count in counts.items():
        whole = np.array_equal(v[name], np.arange(1, count + 1))
        need(whole, f"{name} has {v[name].size} of {count}, or another order")
    usually = {table: table.rows(1)[None] for table in _TABLES}
    entries = _recorded_entries(lambda table, name: usually[table][name], slice(None))
    for name, dims, usual, of, _ in entries:
        if (variable := run.variables.get(name)) is not None:
            kind = variable.dtype.name.replace("int32", "int64")  # netCDF 3 has no longer ones
            unit_of = variable.attrs.get("units", of)
            for have, want in ((variable.dims, dims), (kind, usual.dtype.name), (unit_of, of)):
                need(have == want, f"{name} is {have}, not {want}")
            need(np.isfinite(v[name]).all() or not np.isfinite(usual).all(), f"{name} has gaps")
    step, way = np.diff(v["time"]), np.trapezoid(v["speed"], v["time"])
    even = np.append((step > 0.0) & np.isclose(step, step[:1]), v["time"].size > 0)
    need(even.all(), f"time does not grow by equal steps, first at instant {even.argmin()}")
    off = abs(v["position"][-1] - v["position"][0] - way)
    need(off <= APART[0] + APART[1] * abs(way), f"position is {off:g} m from what speed gives")
    slip = v["rim_speed"] - v["car_speed"].take(v["axle_car"], axis=1, mode="clip")
    force, mean = v["coefficient"] * v["axle_load"], v["car_speed"] @ v["car_mass"]
    laws = {"slip_velocity": slip, "rail_force": force, "speed": mean / v["car_mass"].sum()}
    for name, expected in laws.items():
        need(np.allclose(v[name], expected), f"{name} does not fit the other variables")


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

        content: dict[str, Any] = {
            str(name): variable.values for name, variable in run.variables.items()
        }
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
    """Read a run written by `save`; raises `OSError` that names the file."""
    with _NETCDF, xr.open_dataset(path, engine="netcdf4", decode_times=False) as stored:
        run = stored.load()
    plain = {
        key: value.item() if isinstance(value, np.generic) else value
        for key, value in run.attrs.items()
    }
    return run.assign_attrs(plain)  # netCDF gives numbers as NumPy's
