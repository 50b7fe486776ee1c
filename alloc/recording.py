"""A recorded run as an `xarray.Dataset`: made from what the loop wrote, hashed, saved and loaded."""

import hashlib
import json
import platform
import subprocess
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.canonical import canonical
from alloc.event import Event
from alloc.onboard import memory as om
from alloc.plant.model import Layout, Model
from alloc.recorded_physics import physical_variables
from alloc.recorded_variables import VARIABLES

Floats = NDArray[np.float64]


class Record(NamedTuple):
    """Arrays that the compiled loop writes; first dimension: instants."""

    time: Floats
    state: Floats
    peak: Floats
    body_acceleration: Floats
    command: Floats
    target: Floats
    limit: Floats
    estimate: Floats
    slipping: NDArray[np.bool_]
    fallen_back: NDArray[np.bool_]
    factor: Floats
    seen: Floats
    acceleration: Floats
    air: Floats
    valve: Floats
    car_reference: Floats
    train: Floats

    @classmethod
    def allocate(cls, records: int, n: Layout) -> "Record":
        """Empty record of `records` instants."""

        def unit() -> Floats:
            return np.zeros((records, n.units))

        return cls(
            time=np.zeros(records),
            state=np.zeros((records, n.rows)),
            peak=np.zeros((records, n.axles)),
            body_acceleration=np.zeros((records, n.bodies)),
            command=unit(),
            target=unit(),
            limit=unit(),
            estimate=unit(),
            slipping=np.zeros((records, n.units), dtype=np.bool_),
            fallen_back=np.zeros((records, n.units), dtype=np.bool_),
            factor=unit(),
            seen=unit(),
            acceleration=unit(),
            air=unit(),
            valve=np.zeros((records, n.groups)),
            car_reference=np.zeros((records, n.cars)),
            train=np.zeros((records, 5)),
        )


@dataclass
class Tally:
    """What the Python side of a run counts; times in s."""

    rule_failures: int = 0
    rule_time: float = 0.0
    controller_failures: int = 0
    controller_times: list[float] = field(default_factory=list)
    wall_time: float = 0.0
    messages: dict[str, int] = field(default_factory=dict)

    def note(self, message: str) -> None:
        """Count a message."""
        self.messages[message] = self.messages.get(message, 0) + 1


def to_dataset(
    event: Event,
    rule: str,
    controller: str,
    record: Record,
    counter: NDArray[np.int64],
    tally: Tally,
) -> xr.Dataset:
    """Turn what the loop wrote into the recorded run."""
    model = event.model
    values = physical_variables(model, record.state, record.peak, record.body_acceleration)
    values |= {
        "driver_command": record.train[:, 2],
        "expected": record.train[:, 4],
        "reference_speed": record.train[:, 3],
        "slide_reference": record.car_reference,
        "valve": record.valve.astype(np.int8),
        "case": record.train[:, 0],
        "level": record.train[:, 1],
        "torque_command": record.command,
        "torque_target": record.target,
        "limit": record.limit,
        "coefficient_estimate": record.estimate,
        "slipping": record.slipping.astype(np.int8),
        "fallen_back": record.fallen_back.astype(np.int8),
        "axles_seen": record.seen,
        "torque_factor": record.factor,
        "computed_acceleration": record.acceleration,
        "air_brake_force": record.air,
    }
    attributes: dict[str, Any] = {
        "event": event.name,
        "event_hash": event_hash(event),
        "seed": event.seed,
        "rule": rule,
        "controller": controller,
        "target_speed": np.nan if event.target_speed is None else event.target_speed,
        "train": model.train.name,
        "train_mass": model.train.mass,
        "train_rotating_mass": model.train.rotating_mass,
        "blended_brakes": int(
            model.layout.groups > 0 and (event.onboard.braking.blended or model.layout.units == 0)
        ),
        "detections": int(counter[om.DETECTIONS]),
        "unit_detections": int(counter[om.UNIT_DETECTIONS]),
        "telegrams_sent": int(counter[om.TELEGRAMS]),
        "telegrams_lost": int(counter[om.LOST]),
        "fallbacks": int(counter[om.FALLBACKS]),
        "blinded": int(counter[om.BLINDED]),
        "locks": int(counter[om.LOCKS]),
        "time_outs": int(counter[om.TIME_OUTS]),
        "rule_calls": int(counter[om.RULE_CALLS]),
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
    return _dataset(record.time, values, attributes)


def driven_dataset(
    name: str,
    model: Model,
    time: Floats,
    states: Floats,
    peaks: Floats,
    body_accelerations: Floats,
    torque_command: Floats,
) -> xr.Dataset:
    """A run of `alloc.driving`: the variables that plant and driver decide; first dimension of all arrays: instants."""
    values = physical_variables(model, states, peaks, body_accelerations)
    values["torque_command"] = torque_command
    attributes: dict[str, Any] = {
        "event": name,
        "train": model.train.name,
        "train_mass": model.train.mass,
        "train_rotating_mass": model.train.rotating_mass,
        **provenance(),
    }
    return _dataset(time, values, attributes)


def _dataset(
    time: Floats, values: dict[str, NDArray[Any]], attributes: dict[str, Any]
) -> xr.Dataset:
    data = {
        name: (v.dims, values[name], {"units": v.units, "long_name": v.long_name})
        for name, v in VARIABLES.items()
        if name in values
    }
    coordinates = {"time": ("time", time, {"units": "s", "long_name": "time"})}
    return xr.Dataset(data, coords=coordinates, attrs=attributes)


def event_hash(event: Event) -> str:
    """Hash of everything that defines an event: equal events have equal hashes."""
    model = event.model
    parts = (
        event.name, event.command, event.onboard, event.duration, event.initial_speed,
        event.initial_position, event.step, event.record_period, event.target_speed, event.seed,
        model.train, model.rails, model.line, model.span,
    )  # fmt: skip
    digest = hashlib.sha256(canonical(parts).encode())
    digest.update(model.environment.failure_time.tobytes())
    digest.update(model.environment.receptivity.tobytes())
    return digest.hexdigest()[:16]


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
    """Write a run to netCDF, compressed; it loads back equal with `load`."""
    encoding = {
        name: {"zlib": True, "complevel": 4} for name, v in dataset.variables.items() if v.ndim > 0
    }
    dataset.to_netcdf(path, engine="netcdf4", encoding=encoding)


def load(path: Path) -> xr.Dataset:
    """Read a run written by `save`."""
    with xr.open_dataset(path, engine="netcdf4", decode_times=False) as dataset:
        return dataset.load()
