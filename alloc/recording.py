"""A recorded run as an `xarray.Dataset`: made from the loop's record, saved and loaded."""

import errno
import json
import os
import platform
import shutil
import subprocess
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.event import Event
from alloc.onboard.increment_learning import Increments, LearningSeries
from alloc.onboard.memory import Counters, TrainMemory, UnitMemory
from alloc.plant.model import Floats, Layout, Model
from alloc.recorded_physics import PlantRecord, physical_variables
from alloc.recorded_variables import VARIABLES
from alloc.whole_file import write_whole


class Record(NamedTuple):
    """What the loop records of plant and computers; first dimension: instants."""

    plant: PlantRecord
    unit: Floats  # (instants, fields of `UnitMemory`, units)
    train: Floats  # (instants, fields of `TrainMemory`, 1)
    valve: Floats  # (instants, groups)
    slide_reference: Floats  # (instants, cars)
    sand_rate: Floats  # (instants, sanders)
    learning: (
        Floats  # (instants, fields of `LearningSeries`, units); no instants where nothing is learnt
    )

    @classmethod
    def allocate(cls, records: int, n: Layout, learns: bool = False) -> "Record":
        """Empty record of `records` instants; `learns`: whether increments are learnt."""
        return cls(
            PlantRecord.allocate(records, n),
            np.zeros((records, len(UnitMemory._fields), n.units)),
            np.zeros((records, len(TrainMemory._fields), 1)),
            np.zeros((records, n.groups)),
            np.zeros((records, n.cars)),
            np.zeros((records, n.sanders)),
            np.zeros((records if learns else 0, len(LearningSeries._fields), n.units)),
        )

    def until(self, records: int) -> "Record":
        """The first `records` instants of the record."""
        return Record(self.plant.until(records), *(values[:records] for values in self[1:]))


@dataclass
class Tally:
    """What the Python side of a run counts; times in s."""

    rule_failures: int = 0
    rule_time: float = 0.0
    controller_failures: int = 0
    controller_times: list[float] = field(default_factory=list)
    wall_time: float = 0.0
    messages: dict[str, int] = field(default_factory=dict)

    def note(self, message: str, number: int = 1) -> None:
        """Count a message that came `number` times."""
        self.messages[message] = self.messages.get(message, 0) + number


def to_dataset(
    event: Event, rule: str, controller: str, record: Record, counters: Counters, tally: Tally,
    learnt: Increments | None = None,
) -> xr.Dataset:  # fmt: skip
    """Turn the loop's record into the recorded run, see `alloc.run_attributes`; `learnt`: values learnt by its end."""
    model = event.model
    values = physical_variables(model, record.plant)
    values |= dict(zip(TrainMemory._fields, record.train[:, :, 0].T, strict=True))
    values |= dict(zip(UnitMemory._fields, record.unit.transpose(1, 0, 2), strict=True))
    values["valve"] = record.valve
    if model.layout.bodies > 1:  # else it is the train's reference speed
        values["slide_reference"] = record.slide_reference
    if learnt is not None:
        values |= dict(zip(LearningSeries._fields, record.learning.transpose(1, 0, 2), strict=True))
        values |= {f"learnt_{name}": found for name, found in learnt._asdict().items()}
    if model.layout.sanders:
        values["sand_rate"] = record.sand_rate
    attributes: dict[str, Any] = {
        "event": event.name,
        "event_hash": event.hash,
        "seed": event.seed,
        "rule": rule,
        "controller": controller,
        "target_speed": np.nan if event.target_speed is None else event.target_speed,
        **_train_attributes(model),
        "blended_brakes": int(
            model.layout.groups > 0 and (event.onboard.braking.blended or model.layout.units == 0)
        ),
        **{name: int(count[0]) for name, count in counters._asdict().items()},
        "rule_failures": tally.rule_failures,
        "rule_time_s": tally.rule_time,
        "controller_calls": len(tally.controller_times),
        "controller_failures": tally.controller_failures,
        "controller_time_s": float(sum(tally.controller_times)),
        "controller_median_s": float(np.median(tally.controller_times or [0.0])),
        "controller_p99_s": float(np.quantile(tally.controller_times or [0.0], 0.99)),
        "wall_time_s": tally.wall_time,
        "messages": json.dumps(tally.messages),
        **provenance(),
    }
    return _dataset(record.plant.time, values, attributes)


def driven_dataset(
    name: str, model: Model, record: PlantRecord, torque_command: Floats
) -> xr.Dataset:
    """A run of `alloc.driving`: variables of plant and driver; `torque_command` (instants, units)."""
    values = physical_variables(model, record) | {"torque_command": torque_command}
    attributes = {"event": name, **_train_attributes(model), **provenance()}
    return _dataset(record.time, values, attributes)


def _train_attributes(model: Model) -> dict[str, Any]:
    train = model.train
    return {
        "train": train.name,
        "train_mass": train.mass,
        "train_rotating_mass": train.rotating_mass,
    }


def _dataset(
    time: Floats, values: dict[str, NDArray[Any]], attributes: dict[str, Any]
) -> xr.Dataset:
    if unknown := values.keys() - VARIABLES.keys():
        raise KeyError(f"recorded, but not in VARIABLES: {', '.join(sorted(unknown))}")
    data = {
        name: xr.Variable(
            v.dims,
            values[name] if v.kind is None else values[name].astype(v.kind),
            {"units": v.units, "long_name": v.long_name},
            fastpath=True,  # these are arrays of numbers: to look for dates in them takes half of this function
        )
        for name, v in VARIABLES.items()
        if name in values
    }
    coordinates = {"time": ("time", time, {"units": "s", "long_name": "time"})}
    return xr.Dataset(data, coords=coordinates, attrs=attributes)


@lru_cache(maxsize=1)
def provenance() -> dict[str, str]:
    """Versions and git revision that a run was made with."""
    packages = ("readhesion", "numpy", "numba", "casadi", "osqp")
    found = {f"version_{name}": version(name) for name in packages}
    try:
        revision = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        revision = "unknown"
    return {**found, "version_python": platform.python_version(), "git_revision": revision}


def save(dataset: xr.Dataset, path: Path) -> None:
    """Write a run to netCDF, compressed; it loads back equal with `load`. Raises `OSError` naming the file."""
    encoding = {
        name: {"zlib": True, "complevel": 4} for name, v in dataset.variables.items() if v.ndim > 0
    }

    def write(aside: Path) -> None:
        try:
            dataset.to_netcdf(aside, engine="netcdf4", encoding=encoding)
        except RuntimeError:  # the library does not say that the disk is full
            if shutil.disk_usage(aside.parent).free > dataset.nbytes:
                raise
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from None

    write_whole(path, write)


def load(path: Path) -> xr.Dataset:
    """Read a run written by `save`."""
    with xr.open_dataset(path, engine="netcdf4", decode_times=False) as dataset:
        run = dataset.load()
    plain = {
        key: one.item() if isinstance(one, np.generic) else one for key, one in run.attrs.items()
    }
    return run.assign_attrs(plain)  # netCDF gives numbers as NumPy's
