"""Many runs of one driven unit under the torque table, advanced together: for sweeps and calibration.

The closed loop of `alloc.simulation` without what a single unit lacks (allocation, telegrams, slip detector), over the
plant's lanes: rail and table differ from lane to lane. A lane costs a tenth of a run by itself; the results are the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.event import DriverCommand, SimulationError
from alloc.loop import Plant, Timing
from alloc.onboard.controllers.torque_table import TorqueTable, asymmetric_lag, torque_factor
from alloc.onboard.detector import differentiate
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard
from alloc.plant import compiled
from alloc.plant.array_model import ArrayModel
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.right_side import peak_field
from alloc.plant.train import Train

Floats = NDArray[np.float64]

LANES_TOGETHER = 32
"""Lanes advanced by one call: enough for vector code, few enough for the fast caches."""


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
    """Torque that holds a coefficient of 1 on the axle that accelerates with the train."""


class TableLanes(NamedTuple):
    """A table per lane and what it remembers, (lanes,) each."""

    margin: Floats
    width: Floats
    pole: Floats
    gain: Floats
    rise_share: Floats
    fall_share: Floats
    speed: Floats  # behind the differentiator's filter [m/s]
    torque: Floats  # behind the table's [N m]
    factor: Floats


class LaneRecord(NamedTuple):
    """What is recorded; first dimension: instants, last: lanes."""

    state: Floats
    peak: Floats
    command: Floats
    factor: Floats


class Drive(NamedTuple):
    """What the driver asks for, per control period, and the wheels that it is asked of."""

    target: Floats  # torque [N m]
    commanded: Floats  # acceleration [m/s2]
    first_tick: int
    radius: float


@jit
def _run(plant, timing, tables, drive, record):
    s, e, rows, state, inputs, w = (
        plant.structure, plant.environment, plant.rows, plant.state, plant.inputs, plant.workspace
    )  # fmt: skip
    omega = 2 * rows.bodies
    lanes = state.shape[1]
    for k in range(drive.target.size):
        time = (drive.first_tick + k) * timing.period
        a = drive.commanded[k]
        for b in range(lanes):
            speed = drive.radius * state[omega, b]
            tables.speed[b], acceleration = differentiate(
                tables.speed[b], speed, tables.pole[b], tables.gain[b]
            )
            factor = torque_factor(acceleration - a, tables.margin[b], tables.width[b])
            tables.torque[b] = asymmetric_lag(
                tables.torque[b],
                factor * drive.target[k],
                tables.rise_share[b],
                tables.fall_share[b],
            )
            tables.factor[b] = factor
            inputs.torque_command[0, b] = tables.torque[b]
        if k % timing.record_ticks == 0:
            n = k // timing.record_ticks
            peak_field(s, e, rows, time, state, inputs.cleaning, w, w.peak)
            for b in range(lanes):
                for i in range(state.shape[0]):
                    record.state[n, i, b] = state[i, b]
                record.peak[n, b] = w.peak[0, b]
                record.command[n, b] = tables.torque[b]
                record.factor[n, b] = tables.factor[b]
        compiled.advance(s, e, rows, time, timing.step, timing.steps, state, inputs, w)


def simulate_tables(
    train: Train,
    rails: Sequence[Rail],
    tables: Sequence[TorqueTable],
    command: DriverCommand,
    begin: float,
    end: float,
    period: float = 5e-5,
    record_period: float = 1e-3,
) -> TableRuns:
    """Drive `train` from rest at `begin` to `end` [s] once per lane: rail k under table k, every `period` [s].

    The train must be one rigid unit of one axle, driving only. Rails may differ in all but their curve. Raises
    `SimulationError` where the lanes do not fit together, `PlantError` where train and rail do not.
    """
    if len(rails) != len(tables) or not rails:
        raise SimulationError(
            f"lanes: {len(rails)} rails and {len(tables)} tables; give as many of each, at least one"
        )
    if any(rail.curve != rails[0].curve for rail in rails):
        raise SimulationError("lanes: all rails of a batch must have the same adhesion curve")
    model = build(train, tuple(rails))
    n = model.layout
    if n.units != 1 or n.axles != 1 or n.bodies != 1:
        raise SimulationError(
            f"lanes: train {train.name!r} has {n.units} units and {n.axles} axles; only one unit of one axle fits"
        )
    ticks = round((end - begin) / period)
    record_ticks = max(1, round(record_period / period))
    records = (ticks + record_ticks - 1) // record_ticks
    first_tick = round(begin / period)
    onboard = Onboard(period=period, rise_time=period)
    eq = equipment(model, onboard)
    commanded = command.sampled(period * (first_tick + np.arange(ticks, dtype=np.float64)))
    if np.any(commanded < 0.0):
        raise SimulationError("lanes: the table's lanes drive only; use `simulate` for braking")
    to_torque = float(eq.axle_load[0] * eq.radius[0] / eq.gear[0] * (1.0 + eq.own_inertia[0]))
    target = commanded * eq.planned_share * to_torque
    steps = model.substeps(period)
    lanes = len(rails)
    constants = np.array([table.constants(period) for table in tables]).T
    timing = Timing(period, period / steps, steps, record_ticks)
    drive = Drive(target, commanded, first_tick, float(eq.radius[0]))
    kept = []
    for start in range(0, lanes, LANES_TOGETHER):
        part = slice(start, min(start + LANES_TOGETHER, lanes))
        own = model.select_lanes(part)
        memory = (np.zeros(own.lanes) for _ in range(3))
        states = np.zeros((records, n.rows, own.lanes))
        record = LaneRecord(states, *(np.zeros((records, own.lanes)) for _ in range(3)))
        plant = Plant(
            own.structure, own.environment, n, own.initial_state(), own.zero_inputs(),
            compiled.workspace(own, timing.step),
        )  # fmt: skip
        _run(plant, timing, TableLanes(*constants[:, part].copy(), *memory), drive, record)
        kept.append(record)
    states, peaks, commands, factors = (
        np.concatenate(parts, axis=-1) for parts in zip(*kept, strict=True)
    )
    arrays = ArrayModel.of(model)
    flat = states.transpose(1, 0, 2).reshape(n.rows, -1)
    slip, mu, _ = arrays.forces(flat, peaks.reshape(1, -1))
    speed = states[:, n.speed.start, :]
    limit, top = rails[0].curve.limit(peaks, speed)
    return TableRuns(
        time=period * (first_tick + record_ticks * np.arange(records, dtype=np.float64)),
        speed=speed,
        slip=slip.reshape(records, lanes),
        peak_slip=np.broadcast_to(top, peaks.shape),
        coefficient=mu.reshape(records, lanes),
        peak=limit,
        torque=states[:, n.torque.start, :],
        command=commands,
        factor=factors,
        plan=float(target.max(initial=0.0)),
        torque_per_coefficient=to_torque,
    )
