"""A recorded run as an `xarray.Dataset`: its variables and attributes, made from the loop's record, saved and loaded.

In: states and values that the loop wrote down. Out: a dataset with dimensions time, axle, car and unit (the last three are
counted from 1 at the front), CF units and long names, from one registry (`VARIABLES`). Forces and coefficients are those
that the plant computed on its way.
"""

import errno
import json
import os
import platform
import shutil
import subprocess
import threading
from dataclasses import dataclass, field, fields
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.old.event import Event
from alloc.old.onboard.increment_learning import Increments, LearningSeries
from alloc.old.onboard.state import Counters, TrainMemory, UnitMemory
from alloc.old.plant.engine import find_limits
from alloc.old.plant.laws import limit_place, swing_torque
from alloc.old.plant.model import Floats, Layout, Model
from alloc.old.plant.operations import look_up, padded
from alloc.old.plant.rail import power_taken
from alloc.old.plant.train import EFFORT_SPEED_STEP
from alloc.old.plant.workspace import Noted
from alloc.old.sources import write_whole

# Variables of a recorded run: one registry, from which dimensions, units and names follow.


class Variable(NamedTuple):
    """Dimensions, CF unit and description of a recorded variable."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    kind: str | None = None
    """Type of its numbers where it differs from that of the loop."""


_BY_DIMENSIONS: dict[tuple[str, ...], dict[str, tuple[str, ...]]] = {
    ("time",): {
        "position": ("m", "position of the train's front"),
        "speed": ("m s-1", "mean speed of the train"),
        "acceleration": ("m s-2", "mean acceleration of the train"),
        "driver_command": ("m s-2", "acceleration asked for on level track"),
        "planned_coefficient": (
            "1",
            "coefficient that the driver's command needs of every acting axle, by the train's true masses",
        ),
        "expected": (
            "1",
            "coefficient that the plan needs of every unit, as the train computes it",
        ),
        "reference_deviation": (
            "m s-1",
            "standard deviation of the reference speed by its estimate",
        ),
        "reference_speed": (
            "m s-1",
            "reference speed of the foremost traction unit; the train's if it has none",
        ),
        "case": ("1", "case of the allocation: 0 none, 1 A, 2 B"),
        "level": ("1", "level of the last allocation"),
        "motor_work": ("J", "work of the motors at the wheels"),
        "shoe_work": ("J", "work lost in brake shoes"),
        "resistance_work": ("J", "work against resistance and gradient"),
        "coupler_work": ("J", "work lost in couplers and drives"),
    },
    ("time", "car"): {
        "slide_reference": ("m s-1", "reference speed of the car, where cars move apart"),
        "car_speed": ("m s-1", "speed of the car"),
        "car_acceleration": ("m s-2", "acceleration of the car"),
    },
    ("time", "axle"): {
        "rim_speed": ("m s-1", "circumferential speed of the wheels"),
        "slip_velocity": ("m s-1", "slip velocity, positive driving"),
        "coefficient": ("1", "tangential force coefficient"),
        "adhesion_limit": ("1", "true adhesion coefficient: maximum over the slip"),
        "peak_slip": ("m s-1", "slip velocity of that maximum"),
        "rail_force": ("N", "tangential force between wheel and rail"),
        "brake_force": ("N", "force of the brake shoes at the rim, against its rotation"),
        "axle_load": ("N", "axle load"),
        "friction_work": ("J", "work dissipated between wheel and rail"),
        "shaft_torque": ("N m", "torque that a twisting drive hands on to the wheelset"),
        "shaft_swing": ("N m", "largest torque that the drive's oscillation reaches"),
        "recovery": ("1", "degree to which its own slip has cleaned the contact"),
    },
    ("time", "unit"): {
        "motor_torque": ("N m", "torque of each motor of the unit"),
        "drive_limit": ("N m", "most that each motor can pull with at the train's speed"),
        "brake_limit": (
            "N m",
            "most that each motor can brake with, as far as the line takes it up",
        ),
        "torque_command": ("N m", "torque command to each motor"),
        "torque_target": ("N m", "torque wanted of each motor under the limit"),
        "limit": ("1", "limit in force, as a coefficient"),
        "coefficient_estimate": ("1", "observer's estimate of the coefficient"),
        "slipping": ("1", "signal of the slip detector", "int8"),
        "fallen_back": ("1", "unit has heard nothing for too long and keeps the plan", "int8"),
        "axles_seen": ("1", "axles of the unit whose speed is known"),
        "torque_factor": ("1", "share of its target that the readhesion controller leaves a unit"),
        "computed_acceleration": (
            "m s-2",
            "acceleration of the unit's axles as its slip detector computes it",
        ),
        "air_brake_force": ("N", "air brake force commanded per axle of the unit, at the rim"),
        "increment": ("1", "increment of adhesion over the foremost unit, as learnt so far"),
        "increment_data": ("1", "data of the unit's increment that the run has given so far"),
        "increment_datum": ("1", "last datum of the unit's increment, nan before the first"),
    },
    ("time", "brake_group"): {
        "cylinder_pressure": ("Pa", "brake cylinder pressure"),
        "valve": ("1", "slide protection's valves: 0 supply, 1 hold, 2 release", "int8"),
    },
    ("time", "sander"): {"sand_rate": ("kg s-1", "sand that the sander lays on each rail")},
    ("time", "coupler"): {"coupler_force": ("N", "coupler force, tension positive")},
    ("axle",): {
        "axle_unit": ("1", "traction unit of the axle, 0 = foremost, -1: none"),
        "axle_car": ("1", "car of the axle, 0 = foremost"),
        "axle_group": ("1", "air brake group of the axle, 0 = foremost, -1: none"),
        "axle_static_load": ("N", "axle load at rest"),
        "axle_radius": ("m", "wheel radius"),
        "axle_turning_mass": ("kg", "mass that would resist like the turning wheelset"),
    },
    ("brake_group",): {"group_volume": ("m3", "volume of the group's brake cylinders")},
    ("unit",): {
        "unit_static_load": ("N", "axle load of the unit's axles, summed"),
        "unit_gear": ("1", "gear ratio"),
        "unit_radius": ("m", "wheel radius"),
        "unit_parallel": ("1", "whether its motors share an inverter or a voltage", "int8"),
        "learnt_increment": ("1", "increment of adhesion over the foremost unit by the run's end"),
        "learnt_deviation": ("1", "standard deviation of that, where the learner states one"),
        "learnt_behind": ("1", "data behind that"),
        "learnt_waiting_sum": ("1", "sum of the data that wait to be used"),
        "learnt_waiting": ("1", "number of the data that wait to be used"),
        "learnt_updates": ("1", "how often the stored increment was changed"),
    },
    ("body",): {"body_mass": ("kg", "mass of a car, or of the whole train where it is rigid")},
}

VARIABLES: dict[str, Variable] = {
    name: Variable(dims, *rest)
    for dims, some in _BY_DIMENSIONS.items()
    for name, rest in some.items()
}


# What the plant computed on its way, and what follows from it: forces, coefficients, limits.


MOST_IN_PRODUCT = 8192
"""Numbers of a matrix that meets a vector at once: BLAS starts threads for more, which cost more than they save."""


class PlantRecord(NamedTuple):
    """What the loop writes of the plant; first dimension: instants."""

    time: Floats
    state: Floats  # without deflections of contacts
    noted: Noted

    @classmethod
    def allocate(cls, records: int, n: Layout) -> "PlantRecord":
        """Empty record of `records` instants."""
        state = np.zeros((records, n.deflection.start))
        return cls(np.zeros(records), state, Noted.of(n, records))

    def until(self, records: int) -> "PlantRecord":
        """The first instants of the record."""
        noted = Noted(*(values[:records] for values in self.noted))
        return PlantRecord(self.time[:records], self.state[:records], noted)


def _mean_of_bodies(share: Floats, values: Floats) -> Floats:
    """Mean over the bodies of `values` (instants, bodies), weighted by `share`; in parts, see `MOST_IN_PRODUCT`."""
    step = max(1, MOST_IN_PRODUCT // share.size)
    parts = [values[k : k + step] @ share for k in range(0, len(values), step)]
    return np.concatenate(parts)


def _motor_limits(model: Model, time: Floats, speed: Floats) -> tuple[Floats, Floats]:
    """Most that each motor can drive and brake with [N m], (instants, units), without slip at `speed` (instants, bodies)."""
    s, n, e = model.structure, model.layout, model.environment
    taken = power_taken(time, e.receptivity)
    works = e.failure_time > time[:, None]
    drive, brake = np.zeros((2, time.size, n.units))
    for j in range(n.units):
        own = speed[:, s.axle_body[s.axle_unit == j][0]]
        place = limit_place(own, 1.0 / EFFORT_SPEED_STEP, s.drive_table.shape[1])
        drive[:, j] = look_up(s.drive_table[j], place)
        brake[:, j] = taken * look_up(s.brake_table[j], place)
    return drive * works, brake * works


AT_ONCE = 4096
"""Contacts whose adhesion limit is found at once: what lies between record and result stays in the cache."""


def _adhesion_limits(model: Model, peak: Floats, speed: Floats) -> tuple[Floats, Floats]:
    """Adhesion limit and the slip velocity [m/s] there, at `peak` (instants, axles) and `speed` (instants, bodies)."""
    s, e = model.structure, model.environment
    axles = peak.shape[1]
    rows = max(1, AT_ONCE // axles)
    given, curve = np.ones((5, padded(rows * axles))), np.array(e.curve)
    blocks = given[:, : rows * axles].reshape(5, rows, axles)
    blocks[2] = e.contact
    found = np.empty((2, *peak.shape))
    for k in range(0, len(peak), rows):
        some = slice(k, k + rows)
        own = blocks[:, : len(peak[some])]
        own[0], own[1] = peak[some], speed[some][:, s.axle_body]
        find_limits(e.curve_kind, curve, *given)
        found[:, some] = own[3:]
    return found[0], found[1]


def _swings(model: Model, noted: Noted, omega: Floats, rotor_speed: Floats) -> Floats:
    """Largest torque [N m] that the oscillation of each drive that twists reaches, (instants, axles)."""
    s = model.structure
    rotor, stiffness, _ = s.axle_shaft
    wheel = s.inertia - rotor
    other = s.radius * (noted.force + noted.brake)
    settled = (wheel * noted.motor + rotor * other) / (rotor + wheel)
    rate, reduced = rotor_speed - omega, rotor * wheel / (rotor + wheel)
    swing = swing_torque(noted.shaft, settled, rate, stiffness, reduced)
    return np.where(rotor > 0.0, swing, np.abs(noted.shaft))


def physical_variables(model: Model, record: PlantRecord) -> dict[str, NDArray[Any]]:
    """The plant's part of a recorded run; first dimension: instants.

    Forces are those that its right side computed. What it does not need follows here: adhesion limits, motor limits, swings.
    """
    n, s = model.layout, model.structure
    state, noted = record.state, record.noted
    speed, omega, work = state[:, n.speed], state[:, n.omega], state[:, n.work].T
    share = s.body_mass / s.body_mass.sum()
    # of what is long-lived the short-lived is made first, so memory peaks lower; what is the same for all instants, or for
    # all cars, takes no memory of its own
    rim = s.radius * omega
    slip = rim - (speed if n.bodies == 1 else speed[:, s.axle_body])
    limit, top = _adhesion_limits(model, noted.peak, speed)

    def of_cars(values: Floats) -> Floats:
        if n.bodies == 1:
            return np.broadcast_to(values, (len(values), n.cars))
        return values[:, s.car_body]

    driven = s.axle_unit >= 0
    unit_load, unit_radius = (
        np.bincount(s.axle_unit[driven], values[driven], minlength=n.units)
        for values in (s.static_load, s.radius)
    )
    drive_limit, brake_limit = _motor_limits(model, record.time, speed)
    optional = {"recovery": state[:, n.recovery]} if n.recoveries else {}
    if n.shafts:
        optional["shaft_torque"] = noted.shaft
        optional["shaft_swing"] = _swings(model, noted, omega, state[:, n.rotor])
    return {
        "position": state[:, 0],
        "speed": _mean_of_bodies(share, speed),
        "acceleration": _mean_of_bodies(share, noted.acceleration),
        "car_speed": of_cars(speed),
        "car_acceleration": of_cars(noted.acceleration),
        "rim_speed": rim,
        "slip_velocity": slip,
        "coefficient": noted.coefficient,
        "adhesion_limit": limit,
        "peak_slip": top,
        "rail_force": noted.force,
        "brake_force": noted.brake,
        "axle_load": noted.load if n.pitching else np.broadcast_to(s.static_load, slip.shape),
        "friction_work": state[:, n.friction_work],
        "motor_torque": state[:, n.torque],
        "drive_limit": drive_limit,
        "brake_limit": brake_limit,
        "cylinder_pressure": state[:, n.pressure],
        "coupler_force": noted.tension,
        "motor_work": work[0],
        "shoe_work": work[1],
        "resistance_work": work[2],
        "coupler_work": work[3],
        "axle_unit": s.axle_unit,
        "axle_car": s.axle_car,
        "axle_group": s.axle_group,
        "axle_static_load": s.static_load,
        "axle_radius": s.radius,
        "axle_turning_mass": s.inertia / s.radius**2,
        "group_volume": np.array([brake.cylinder_volume for brake in model.train.brake_groups]),
        "unit_static_load": unit_load,
        "unit_gear": s.unit_gear,
        "unit_radius": unit_radius / np.maximum(s.unit_axles, 1.0),
        "unit_parallel": np.bincount(s.axle_unit[driven], s.axle_motor[0, driven] > 0.0, n.units)
        > 0.0,
        "body_mass": s.body_mass,
        **optional,
    }


# Attributes of a recorded run, with their types: what is one value for the whole run.


class DrivenAttributes(TypedDict):
    """Attributes of every recorded run: train, and versions that it was made with."""

    event: str
    train: str
    train_mass: float
    """[kg]"""
    train_rotating_mass: float
    """[kg]"""
    adhesion_curve: str
    """JSON: class of the rail's curve and its values."""
    version_readhesion: str
    version_numpy: str
    version_numba: str
    version_casadi: str
    version_osqp: str
    version_python: str
    git_revision: str


class RunAttributes(DrivenAttributes):
    """Attributes of a run of `alloc.old.simulation.simulate`: event, rule and controller, what was counted, and times taken."""

    event_hash: str
    seed: int
    rule: str
    controller: str
    target_speed: float
    """Speed to which time and distance are measured [m/s]; nan: neither is."""
    blended_brakes: int
    """1: every car brakes itself; 0: the motors brake the train."""
    detections: int
    """Slips detected by the foremost unit."""
    unit_detections: int
    """Slips detected by all units."""
    telegrams_sent: int
    telegrams_lost: int
    fallbacks: int
    """Units fallen back to the plan in silence."""
    blinded: int
    """Units that lost the speed of their last axle."""
    locks: int
    """Axles that slide protection found standing."""
    time_outs: int
    """Valves made to supply by their time-out."""
    rule_calls: int
    rule_failures: int
    rule_time_s: float
    controller_calls: int
    controller_failures: int
    controller_time_s: float
    controller_median_s: float
    controller_p99_s: float
    wall_time_s: float
    messages: str
    """JSON: message of rule or controller -> number of times that it came."""


def attributes_of(run: xr.Dataset) -> RunAttributes:
    """The attributes of a run of `simulate`, typed; they are those in `run.attrs`, which may hold more."""
    return cast(RunAttributes, run.attrs)


class Record(NamedTuple):
    """What the loop records of plant and computers; first dimension: instants."""

    plant: PlantRecord
    unit: Floats  # (instants, fields of `UnitMemory`, units)
    train: Floats  # (instants, fields of `TrainMemory`, 1)
    valve: Floats  # (instants, groups)
    slide_reference: Floats  # (instants, cars); (instants, 0) where cars do not move apart
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
            np.zeros((records, n.cars if n.bodies > 1 else 0)),
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
    """Turn the loop's record into the recorded run, see `alloc.old.recording`; `learnt`: values learnt by its end."""
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
    median, most = 0.0, 0.0
    if tally.controller_times:
        median, most = map(float, np.quantile(tally.controller_times, (0.5, 0.99)))
    blended = model.layout.groups > 0 and (event.onboard.braking.blended or model.layout.units == 0)
    values["planned_coefficient"] = planned_coefficient(model, values["driver_command"], blended)
    attributes: dict[str, Any] = {
        "event": event.name,
        "event_hash": event.hash,
        "seed": event.seed,
        "rule": rule,
        "controller": controller,
        "target_speed": np.nan if event.target_speed is None else event.target_speed,
        **_train_attributes(model),
        "blended_brakes": int(blended),
        **{name: int(count[0]) for name, count in counters._asdict().items()},
        "rule_failures": tally.rule_failures,
        "rule_time_s": tally.rule_time,
        "controller_calls": len(tally.controller_times),
        "controller_failures": tally.controller_failures,
        "controller_time_s": float(sum(tally.controller_times)),
        "controller_median_s": median,
        "controller_p99_s": most,
        "wall_time_s": tally.wall_time,
        "messages": json.dumps(tally.messages),
        **provenance(),
    }
    return _dataset(record.plant.time, values, attributes)


def planned_coefficient(model: Model, command: Floats, blended: bool) -> Floats:
    """Coefficient that `command` (time,) [m/s2] needs of every axle that acts on it, (time,), by the plant's masses.

    The rail carries what accelerates the train, and what turns the wheelsets that do not act. What turns the others comes
    from their own motors or shoes. Metrics judge by this plan, whatever the train itself computes (`expected`).
    """
    s = model.structure
    driven = s.axle_unit >= 0
    found = np.zeros(command.shape)
    for chosen, acting in (
        (command > 0.0, driven),
        (command < 0.0, driven | (s.axle_group >= 0) if blended else driven),
    ):
        if acting.any():
            mass = model.train.mass + (s.inertia / s.radius**2)[~acting].sum()
            found[chosen] = np.abs(command[chosen]) * mass / s.static_load[acting].sum()
    return found


def driven_dataset(
    name: str, model: Model, record: PlantRecord, torque_command: Floats
) -> xr.Dataset:
    """A run of `alloc.old.driving`: variables of plant and driver; `torque_command` (instants, units)."""
    values = physical_variables(model, record) | {"torque_command": torque_command}
    attributes = {"event": name, **_train_attributes(model), **provenance()}
    return _dataset(record.time, values, attributes)


def _train_attributes(model: Model) -> dict[str, Any]:
    train, curve = model.train, model.rail.curve
    values = {one.name: getattr(curve, one.name) for one in fields(curve)}
    return {
        "train": train.name,
        "train_mass": train.mass,
        "train_rotating_mass": train.rotating_mass,
        "adhesion_curve": json.dumps({"class": type(curve).__name__, "values": values}),
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
    data["time"] = xr.IndexVariable("time", time, {"units": "s", "long_name": "time"})
    sizes = tuple(values[name].shape[1] for name in ("car_speed", "motor_torque"))
    numbers = _numbers(
        tuple(values["axle_unit"].tolist()), tuple(values["axle_car"].tolist()), *sizes
    )
    return xr.Dataset(data, coords=numbers, attrs=attributes)


@lru_cache(maxsize=16)
def _numbers(unit: tuple[int, ...], car: tuple[int, ...], cars: int, units: int) -> xr.Coordinates:
    """Numbers of axles, cars and units, counted from 1 at the front, and those of the unit and the car of each axle.

    Kept for the next run: to make indexes takes as long as the rest of the dataset.
    """
    counted = {"axle": len(car), "car": cars, "unit": units}
    of_axles = {"unit_of_axle": (unit, "traction unit of the axle, 1 = foremost, 0: none"),
                "car_of_axle": (car, "car of the axle, 1 = foremost")}  # fmt: skip
    return xr.Coordinates(
        {name: (name, np.arange(1, size + 1), {"long_name": f"number of the {name}, 1 = foremost"})
         for name, size in counted.items()}
        | {name: ("axle", np.array(given, dtype=np.int64) + 1, {"long_name": meaning})
           for name, (given, meaning) in of_axles.items()}
    )  # fmt: skip


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


MATLAB, ATTRIBUTES = ".mat", "attributes"
"""Ending of MATLAB's files, and the variable of one that has a run's attributes."""
_NETCDF = threading.Lock()
"""The netCDF library keeps state of its own: two threads in it at once crash the interpreter."""


def save(dataset: xr.Dataset, path: Path) -> None:
    """Write a run to netCDF, compressed, or for MATLAB where the ending is `.mat`; it loads back equal with `load`.

    A file for MATLAB (version 5) has a matrix per variable, such as (time, axle), and the attributes as a struct. Raises
    `OSError` naming the file.
    """
    if path.suffix.lower() == MATLAB:
        from scipy.io import savemat

        content: dict[str, Any] = {str(name): v.values for name, v in dataset.variables.items()}
        content[ATTRIBUTES] = dict(dataset.attrs)
        options: dict[str, Any] = {"oned_as": "column", "do_compression": True}
        write_whole(path, lambda aside: savemat(aside, content, **options))
        return
    encoding = {
        name: {"zlib": True, "complevel": 4} for name, v in dataset.variables.items() if v.ndim > 0
    }

    def write(aside: Path) -> None:
        try:
            with _NETCDF:
                dataset.to_netcdf(aside, engine="netcdf4", encoding=encoding)
        except RuntimeError:  # the library does not say that the disk is full
            if shutil.disk_usage(aside.parent).free > dataset.nbytes:
                raise
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from None

    write_whole(path, write)


def load(path: Path) -> xr.Dataset:
    """Read a run written by `save`."""
    if path.suffix.lower() == MATLAB:
        from scipy.io import loadmat

        stored = loadmat(path)
        values = {name: stored[name] for name in VARIABLES if name in stored}
        values = {
            name: one.ravel() if len(VARIABLES[name].dims) == 1 else one
            for name, one in values.items()
        }
        attributes = loadmat(path, variable_names=[ATTRIBUTES], simplify_cells=True)[ATTRIBUTES]
        return _dataset(stored["time"].ravel(), values, attributes)
    with _NETCDF, xr.open_dataset(path, engine="netcdf4", decode_times=False) as dataset:
        run = dataset.load()
    plain = {
        key: one.item() if isinstance(one, np.generic) else one for key, one in run.attrs.items()
    }
    return run.assign_attrs(plain)  # netCDF gives numbers as NumPy's
