"""Many runs of one driven axle under the torque table, advanced together: for sweeps and calibration.

The closed loop of `alloc.simulation` without the parts that a single axle does not need (allocation, telegrams, slip
detector, couplers, brakes), by the plant's own laws. A lane is one element of a vector: rail and table differ from lane to
lane. The results equal those of separate runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import inlined_jit, jit
from alloc.event import DriverCommand, SimulationError
from alloc.onboard.controllers.simple import TorqueTable, asymmetric_lag, torque_factor
from alloc.onboard.equipment import equipment
from alloc.onboard.laws import differentiate
from alloc.onboard.parameters import Onboard
from alloc.plant.laws import (
    car_drag,
    gradient_force,
    limit_place,
    motor_torque_rate,
    slip_velocity,
    speed_decline,
    tangential_coefficient,
    wheelset,
)
from alloc.plant.model import Model, build
from alloc.plant.operations import WIDTH, load, look_up, spread, store
from alloc.plant.rail import (
    Patch,
    Patches,
    Rail,
    patch_arrays,
    patch_factor,
    peak_coefficient,
    window,
)
from alloc.plant.train import EFFORT_SPEED_STEP, Train

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TableRuns:
    """Recorded runs, (instants, lanes) each; SI units."""

    time: Floats
    """(instants,)"""
    speed: Floats
    slip: Floats
    """Slip velocity of the unit's first axle."""
    peak_slip: Floats
    """Slip velocity of the curve's maximum: the bound between micro and macro slip."""
    coefficient: Floats
    """Tangential force coefficient."""
    peak: Floats
    """Adhesion coefficient."""
    torque: Floats
    """Motor torque."""
    command: Floats
    factor: Floats
    """Torque factor of the table, before its filter."""
    plan: float
    """Torque of the plan: the driver's target."""
    torque_per_coefficient: float
    """Torque for a coefficient of 1 on the axle that accelerates with the train."""


class Axle(NamedTuple):
    """The axle, its motor and what it moves."""

    radius: float
    inertia: float
    gear: float
    load: float
    mass: float
    resistance: Floats  # (3,)
    inverse_lag: float
    drive_table: Floats
    curve_kind: int
    curve: Floats


class Lanes(NamedTuple):
    """What differs from lane to lane; the last dimension, of `WIDTH`."""

    law: Floats  # (3, lanes) speed law
    patch: Patches  # (patches, lanes) each
    table: Floats  # (6, lanes) the settings of the torque table
    downhill: Floats  # (1, lanes) gradient force against the motion [N]


class Drive(NamedTuple):
    """What the driver asks for per control period, and the times of the run."""

    target: Floats  # torque [N m]
    commanded: Floats  # acceleration [m/s2]
    first_tick: int
    period: float
    steps: int
    record_ticks: int


class LaneRecord(NamedTuple):
    """What is recorded, (instants, lanes)."""

    speed: Floats
    slip: Floats
    coefficient: Floats
    peak: Floats
    torque: Floats
    command: Floats
    factor: Floats


@inlined_jit
def _meet(axle, lanes, time, x, v, omega):
    """Peak coefficient, slip velocity [m/s] and coefficient of the axle, at rest anywhere before the train's front."""
    product = spread(1.0)
    patch = lanes.patch
    for p in range(patch.factor.shape[0]):
        weight = window(x, load(patch.start[p], 0), load(patch.end[p], 0), load(patch.edge[p], 0))
        acting = window(
            time, load(patch.begin[p], 0), load(patch.until[p], 0), load(patch.fade[p], 0)
        )
        product = product * patch_factor(weight, acting, load(patch.factor[p], 0))
    decline = speed_decline(v, load(lanes.law[1], 0))
    peak = peak_coefficient(
        decline, load(lanes.law[0], 0), load(lanes.law[2], 0), product, 0.0, 0.0, 0.0
    )
    slip = slip_velocity(omega, axle.radius, v)
    rim = axle.radius * omega
    return peak, slip, tangential_coefficient(axle.curve_kind, axle.curve, slip, v, rim, peak)


@inlined_jit
def _rates(axle, lanes, time, x, v, omega, torque, command):
    """Accelerations of train and wheel, and the rate of the motor's torque."""
    _, _, mu = _meet(axle, lanes, time, x, v, omega)
    force, r, a = mu * axle.load, axle.radius, axle.resistance
    inverse = 1.0 / axle.inertia
    _, turning = wheelset(axle.gear * torque, force, r, omega, spread(0.0), axle.inertia, inverse)
    drag = car_drag(v, a[0], a[1], a[2], 1.0, load(lanes.downhill[0], 0))
    place = limit_place(r * omega, 1.0 / EFFORT_SPEED_STEP, axle.drive_table.size)
    bound = look_up(axle.drive_table, place)
    rising = motor_torque_rate(torque, command, bound, bound, 1.0, axle.inverse_lag)
    return (force - drag) / axle.mass, turning, rising


@inlined_jit
def _step(axle, lanes, time, h, x, v, omega, torque, command):
    """One step of the classical fourth-order method."""
    a1, b1, c1 = _rates(axle, lanes, time, x, v, omega, torque, command)
    half, middle = 0.5 * h, time + 0.5 * h
    v2 = v + half * a1
    a2, b2, c2 = _rates(
        axle, lanes, middle, x + half * v, v2, omega + half * b1, torque + half * c1, command
    )
    v3 = v + half * a2
    a3, b3, c3 = _rates(
        axle, lanes, middle, x + half * v2, v3, omega + half * b2, torque + half * c2, command
    )
    v4 = v + h * a3
    a4, b4, c4 = _rates(
        axle, lanes, time + h, x + h * v3, v4, omega + h * b3, torque + h * c3, command
    )
    sixth = h / 6.0
    return (
        x + sixth * (v + 2.0 * (v2 + v3) + v4),
        v + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        omega + sixth * (b1 + 2.0 * (b2 + b3) + b4),
        torque + sixth * (c1 + 2.0 * (c2 + c3) + c4),
    )


@jit
def _run(axle, lanes, drive, record):
    """A block of lanes from rest to the end."""
    x = v = omega = torque = filtered = lagged = spread(0.0)
    margin, width, pole, gain, rise, fall = (
        load(lanes.table[0], 0), load(lanes.table[1], 0), load(lanes.table[2], 0),
        load(lanes.table[3], 0), load(lanes.table[4], 0), load(lanes.table[5], 0),
    )  # fmt: skip
    h = drive.period / drive.steps
    for k in range(drive.target.size):
        time = (drive.first_tick + k) * drive.period
        filtered, acceleration = differentiate(filtered, axle.radius * omega, pole, gain)
        factor = torque_factor(acceleration - drive.commanded[k], margin, width)
        lagged = asymmetric_lag(lagged, factor * drive.target[k], rise, fall)
        if k % drive.record_ticks == 0:
            n = k // drive.record_ticks
            peak, slip, mu = _meet(axle, lanes, time, x, v, omega)
            store(record.speed[n], 0, v)
            store(record.slip[n], 0, slip)
            store(record.coefficient[n], 0, mu)
            store(record.peak[n], 0, peak)
            store(record.torque[n], 0, torque)
            store(record.command[n], 0, lagged)
            store(record.factor[n], 0, factor)
        for i in range(drive.steps):
            x, v, omega, torque = _step(axle, lanes, time + i * h, h, x, v, omega, torque, lagged)


def _refuse(train: Train, model: Model, rails: Sequence[Rail]) -> None:
    """Raise `SimulationError` for what is no lane."""
    n, s = model.layout, model.structure
    if n.units != 1 or n.axles != 1 or n.bodies != 1 or n.groups or s.unloading.any():
        raise SimulationError(
            f"lanes: train {train.name!r} has {n.units} units and {n.axles} axles; only one unit of one axle fits"
        )
    if any(rail.curve != rails[0].curve for rail in rails):
        raise SimulationError("lanes: all rails of a batch must have the same adhesion curve")
    if any(rail.scatter or rail.conditioning or rail.increments for rail in rails):
        raise SimulationError(
            "lanes: rails differ in level, speed law and patches; use `simulate` for scatter, increments and conditioning"
        )


def _lanes(
    rails: Sequence[Rail], tables: Sequence[TorqueTable], downhill: Floats, period: float
) -> Lanes:
    """What differs, of at most `WIDTH` lanes; the last one fills up."""
    some = [*range(len(rails)), *(len(rails) - 1,) * (WIDTH - len(rails))]
    most = max(len(rail.patches) for rail in rails)
    none = Patch(1.0, fade=1.0)
    own = [patch_arrays([*rail.patches, *[none] * (most - len(rail.patches))]) for rail in rails]
    patch = Patches(*(np.stack([own[k][field] for k in some], axis=1) for field in range(7)))
    return Lanes(
        np.stack([rails[k].axle_laws(1)[:, 0] for k in some], axis=1),
        patch,
        np.array([tables[k].settings(period) for k in some]).T.copy(),
        downhill[some][None].copy(),
    )


def simulate_tables(
    train: Train,
    rails: Sequence[Rail],
    tables: Sequence[TorqueTable],
    command: DriverCommand,
    begin: float,
    end: float,
    period: float = 5e-5,
    record_period: float = 1e-3,
    grades: Sequence[float] = (),
) -> TableRuns:
    """Drive `train` from rest at `begin` to `end` [s] once per lane: rail k under table k, every `period` [s].

    The train must be one rigid unit of one axle, driving only. Rails may differ in level, speed law and patches. `grades`:
    rise per run of each lane's line, which is level where they are left out. Raises
    `SimulationError` where the lanes do not fit together, `PlantError` where train and rail do not.
    """
    if len(rails) != len(tables) or not rails:
        raise SimulationError(
            f"lanes: {len(rails)} rails and {len(tables)} tables; give as many of each, at least one"
        )
    models = [build(train, rail) for rail in dict.fromkeys(rails)]
    model = models[0]
    _refuse(train, model, rails)
    s, e = model.structure, model.environment
    ticks = round((end - begin) / period)
    record_ticks = max(1, round(record_period / period))
    records = (ticks + record_ticks - 1) // record_ticks
    first_tick = round(begin / period)
    eq = equipment(model, Onboard(period=period, rise_time=period))
    commanded = command.sampled(period * (first_tick + np.arange(ticks, dtype=np.float64)))
    if np.any(commanded < 0.0):
        raise SimulationError("lanes: the table's lanes drive only; use `simulate` for braking")
    to_torque = float(eq.axle_load[0] * eq.radius[0] / eq.gear[0] * (1.0 + eq.own_inertia[0]))
    target = commanded * eq.planned_share * to_torque
    axle = Axle(
        float(s.radius[0]),
        float(s.inertia[0]),
        float(s.gear[0]),
        float(s.static_load[0]),
        float(s.body_mass[0]),
        s.car_resistance[0].copy(),
        float(1.0 / s.unit_lag[0]),
        s.drive_table[0].copy(),
        e.curve_kind,
        e.curve,
    )
    steps = max(one.substeps(period) for one in models)
    drive = Drive(target, commanded, first_tick, period, steps, record_ticks)
    slope = np.zeros(len(rails)) if len(grades) == 0 else np.asarray(grades, dtype=float)
    downhill = gradient_force(float(s.body_mass[0]), slope)
    kept = []
    for start in range(0, len(rails), WIDTH):
        own = slice(start, start + WIDTH)
        record = LaneRecord(*np.zeros((len(LaneRecord._fields), records, WIDTH)))
        _run(axle, _lanes(rails[own], tables[own], downhill[own], period), drive, record)
        kept.append(record)
    found = LaneRecord(
        *(np.concatenate(parts, axis=-1)[:, : len(rails)] for parts in zip(*kept, strict=True))
    )
    limit, top = rails[0].curve.limit(found.peak, found.speed)
    return TableRuns(
        time=period * (first_tick + record_ticks * np.arange(records, dtype=np.float64)),
        speed=found.speed,
        slip=found.slip,
        peak_slip=np.broadcast_to(top, found.peak.shape),
        coefficient=found.coefficient,
        peak=limit,
        torque=found.torque,
        command=found.command,
        factor=found.factor,
        plan=float(target.max(initial=0.0)),
        torque_per_coefficient=to_torque,
    )
