"""A recorded run as an `xarray.Dataset`: one registry of variables, from which units and names follow."""

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

from alloc.event import Event
from alloc.onboard import memory as om
from alloc.plant.array_model import ArrayModel
from alloc.plant.equations import coupler_damper_force, coupler_spring_force, coupler_stretch
from alloc.plant.model import Layout, Model

Floats = NDArray[np.float64]


class Variable(NamedTuple):
    """Dimensions, CF unit and description of a recorded variable."""

    dims: tuple[str, ...]
    units: str
    long_name: str


VARIABLES: dict[str, Variable] = {
    "position": Variable(("time",), "m", "position of the train's front"),
    "speed": Variable(("time",), "m s-1", "mean speed of the train"),
    "acceleration": Variable(("time",), "m s-2", "mean acceleration of the train"),
    "driver_command": Variable(("time",), "m s-2", "acceleration asked for on level track"),
    "expected": Variable(("time",), "1", "coefficient that the plan needs of every unit"),
    "reference_speed": Variable(
        ("time",),
        "m s-1",
        "reference speed of the foremost traction unit; the train's if it has none",
    ),
    "slide_reference": Variable(
        ("time", "car"), "m s-1", "speed from which the car's slide protection measures slip"
    ),
    "case": Variable(("time",), "1", "case of the allocation: 0 none, 1 A, 2 B"),
    "level": Variable(("time",), "1", "level of the last allocation"),
    "car_speed": Variable(("time", "car"), "m s-1", "speed of the car"),
    "car_acceleration": Variable(("time", "car"), "m s-2", "acceleration of the car"),
    "rim_speed": Variable(("time", "axle"), "m s-1", "circumferential speed of the wheels"),
    "slip_velocity": Variable(("time", "axle"), "m s-1", "slip velocity, positive driving"),
    "coefficient": Variable(("time", "axle"), "1", "tangential force coefficient"),
    "adhesion_limit": Variable(
        ("time", "axle"), "1", "true adhesion coefficient: maximum over the slip"
    ),
    "peak_slip": Variable(("time", "axle"), "m s-1", "slip velocity of that maximum"),
    "rail_force": Variable(("time", "axle"), "N", "tangential force between wheel and rail"),
    "brake_force": Variable(
        ("time", "axle"), "N", "force of the brake shoes at the rim, against its rotation"
    ),
    "axle_load": Variable(("time", "axle"), "N", "axle load"),
    "friction_work": Variable(("time", "axle"), "J", "work dissipated between wheel and rail"),
    "motor_torque": Variable(("time", "unit"), "N m", "torque of each motor of the unit"),
    "torque_command": Variable(("time", "unit"), "N m", "torque command to each motor"),
    "torque_target": Variable(
        ("time", "unit"), "N m", "torque wanted of each motor under the limit"
    ),
    "limit": Variable(("time", "unit"), "1", "limit in force, as a coefficient"),
    "coefficient_estimate": Variable(
        ("time", "unit"), "1", "observer's estimate of the coefficient"
    ),
    "slipping": Variable(("time", "unit"), "1", "signal of the slip detector"),
    "fallen_back": Variable(
        ("time", "unit"), "1", "unit has heard nothing for too long and keeps the plan"
    ),
    "axles_seen": Variable(("time", "unit"), "1", "axles of the unit whose speed is known"),
    "torque_factor": Variable(
        ("time", "unit"), "1", "share of its target that the readhesion controller leaves a unit"
    ),
    "computed_acceleration": Variable(
        ("time", "unit"),
        "m s-2",
        "acceleration of the unit's axles as its slip detector computes it",
    ),
    "air_brake_force": Variable(
        ("time", "unit"), "N", "air brake force commanded per axle of the unit, at the rim"
    ),
    "cylinder_pressure": Variable(("time", "brake_group"), "Pa", "brake cylinder pressure"),
    "valve": Variable(
        ("time", "brake_group"), "1", "slide protection's valves: 0 supply, 1 hold, 2 release"
    ),
    "coupler_force": Variable(("time", "coupler"), "N", "coupler force, tension positive"),
    "motor_work": Variable(("time",), "J", "work of the motors at the wheels"),
    "shoe_work": Variable(("time",), "J", "work lost in brake shoes"),
    "resistance_work": Variable(("time",), "J", "work against resistance and gradient"),
    "coupler_work": Variable(("time",), "J", "work lost in couplers"),
    "axle_unit": Variable(("axle",), "1", "traction unit of the axle, 0 = foremost, -1: none"),
    "axle_car": Variable(("axle",), "1", "car of the axle, 0 = foremost"),
    "axle_group": Variable(("axle",), "1", "air brake group of the axle, 0 = foremost, -1: none"),
    "group_volume": Variable(("brake_group",), "m3", "volume of the group's brake cylinders"),
    "unit_static_load": Variable(("unit",), "N", "axle load of the unit's axles, summed"),
    "unit_gear": Variable(("unit",), "1", "gear ratio"),
    "unit_radius": Variable(("unit",), "m", "wheel radius"),
    "body_mass": Variable(
        ("body",), "kg", "mass of a car, or of the whole train where it is rigid"
    ),
}


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
    values = _physical(model, record)
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
    data = {
        name: (v.dims, values[name], {"units": v.units, "long_name": v.long_name})
        for name, v in VARIABLES.items()
    }
    coordinates = {"time": ("time", record.time, {"units": "s", "long_name": "time"})}
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
    return xr.Dataset(data, coords=coordinates, attrs=attributes)


def _physical(model: Model, record: Record) -> dict[str, NDArray[Any]]:
    """Everything that follows from the recorded states by the plant's own laws."""
    n, s = model.layout, model.structure
    arrays = ArrayModel.of(model)
    state, peak = record.state.T, record.peak.T
    slip, mu, force = arrays.forces(state, peak)
    speed = state[n.speed]
    share = s.body_mass / s.body_mass.sum()
    limit, top = model.rails[0].curve.limit(peak, arrays.body_of_axle @ speed)
    stiffness, stiffening, damping, slack = (s.coupler[:, k][:, None] for k in range(4))
    stretch = coupler_stretch(arrays.stretch_of_body @ state[n.position], slack)
    rate = arrays.stretch_of_body @ speed
    tension = coupler_spring_force(stretch, stiffness, stiffening) + coupler_damper_force(
        stretch, rate, damping
    )
    work = state[n.work]
    with np.errstate(divide="ignore", invalid="ignore"):
        load = np.where(mu != 0.0, force / mu, s.static_load[:, None])
    unit_load = np.bincount(
        s.axle_unit[s.axle_unit >= 0], s.static_load[s.axle_unit >= 0], minlength=n.units
    )
    unit_radius = np.bincount(
        s.axle_unit[s.axle_unit >= 0], s.radius[s.axle_unit >= 0], minlength=n.units
    )
    return {
        "position": state[n.position][0],
        "speed": share @ speed,
        "acceleration": record.body_acceleration @ share,
        "car_speed": (arrays.body_of_car @ speed).T,
        "car_acceleration": record.body_acceleration @ arrays.body_of_car.T,
        "rim_speed": (s.radius[:, None] * state[n.omega]).T,
        "slip_velocity": slip.T,
        "coefficient": mu.T,
        "adhesion_limit": limit.T,
        "peak_slip": np.broadcast_to(top, limit.shape).T,
        "rail_force": force.T,
        "brake_force": (arrays.shoe_torques(state, force) / s.radius[:, None]).T,
        "axle_load": load.T,
        "friction_work": state[n.friction_work].T,
        "motor_torque": state[n.torque].T,
        "cylinder_pressure": state[n.pressure].T,
        "coupler_force": tension.T,
        "motor_work": work[0],
        "shoe_work": work[1],
        "resistance_work": work[2],
        "coupler_work": work[3],
        "axle_unit": s.axle_unit,
        "axle_car": s.axle_car,
        "axle_group": s.axle_group,
        "group_volume": np.array(
            [
                car.air_brake.cylinder_volume
                for car in model.train.cars
                if car.air_brake is not None
                for _ in range(max(car.bogie_of_axle) + 1)
            ]
        ),
        "unit_static_load": unit_load,
        "unit_gear": s.unit_gear,
        "unit_radius": unit_radius / np.maximum(s.unit_axles, 1.0),
        "body_mass": s.body_mass,
    }


def event_hash(event: Event) -> str:
    """Hash of everything that defines an event: equal events have equal hashes."""
    model = event.model
    parts = (
        event.name, event.command, event.onboard, event.duration, event.initial_speed,
        event.initial_position, event.step, event.record_period, event.target_speed, event.seed,
        model.train, model.rails, model.line, model.span,
    )  # fmt: skip
    digest = hashlib.sha256(repr(parts).encode())
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
