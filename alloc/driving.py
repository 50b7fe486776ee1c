"""A run that a driver makes: torques and brake pressures set directly, without the train's traction computers.

For brake tests, speed control and minimum-time driving. The plant and what is recorded of it are as in `alloc.simulation`;
the driver, a person or a speed controller, is a Python object that is asked once per control period.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
import xarray as xr

from alloc.event import SimulationError
from alloc.plant import compiled
from alloc.plant.model import Floats, Model
from alloc.recording import driven_dataset


class TrainSense(NamedTuple):
    """What the driver reads."""

    time: float
    """[s]"""
    position: float
    """Of the train's front [m]."""
    speed: float
    """Of the foremost car [m/s]."""
    acceleration: float
    """Change of that speed over the last control period [m/s2]; 0 at the first."""
    torque: Floats
    """Torque of each motor of the units [N m], (units,)."""
    pressure: Floats
    """Brake cylinder pressures [Pa], (groups,)."""


class Controls(NamedTuple):
    """What the driver sets, in place; it stays as set until changed."""

    torque: Floats
    """Torque wanted of each motor of the units [N m], (units,), negative braking."""
    pressure: Floats
    """Brake cylinder pressures wanted [Pa], (groups,); the plant delays them by each brake's dead time."""
    valve: Floats
    """Per brake group, (groups,): 0 the cylinder follows the pressure wanted, 1 it holds, 2 it releases."""


class Driver(Protocol):
    """Whoever drives the train."""

    def __call__(self, sense: TrainSense, controls: Controls) -> bool:
        """Set `controls` for the coming control period; False ends the run."""


def drive(
    model: Model,
    driver: Driver,
    duration: float,
    name: str = "driven",
    initial_speed: float = 0.0,
    initial_position: float = 0.0,
    period: float = 0.1,
    step: float = 1e-3,
    record_period: float | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Let `driver` drive the train for `duration` [s], or until it ends the run; returns the recorded run.

    `period`: control period [s]; `step`: integration step [s], divided further where the plant needs it; `record_period`
    [s]: a multiple of `period` (default: `period` itself). The run holds those of `alloc.recorded_variables.VARIABLES`
    that the plant and the driver decide. Raises `SimulationError` for what cannot be run, `PlantError` from the model.
    """
    if model.lanes != 1:
        raise SimulationError(f"drive: the model has {model.lanes} lanes; a run takes one")
    record_period = period if record_period is None else record_period
    for label, value in (
        ("duration", duration), ("period", period), ("step", step), ("record_period", record_period)
    ):  # fmt: skip
        if not (math.isfinite(value) and value > 0.0):
            raise SimulationError(f"drive: {label} = {value!r} must be finite and greater than 0")
    every = round(record_period / period)
    if every < 1 or abs(every * period - record_period) > 1e-9:
        raise SimulationError(
            f"drive: record_period = {record_period!r} must be a multiple of the control period {period!r}"
        )
    if step > period * (1.0 + 1e-9):
        raise SimulationError(
            f"drive: step = {step!r} must not exceed the control period {period!r}"
        )
    s, e, n, layout = model.structure, model.environment, model.layout, compiled.rows(model.layout)
    steps = round(period / step)
    steps *= model.substeps(period / steps)
    step = period / steps
    state = model.initial_state(initial_speed, initial_position)
    inputs, w = model.zero_inputs(), compiled.workspace(model, step)
    controls = Controls(
        inputs.torque_command[:, 0], inputs.pressure_target[:, 0], inputs.valve[:, 0]
    )
    ticks = round(duration / period)
    records = ticks // every + 1
    time = np.zeros(records)
    states, peaks = np.zeros((records, n.rows)), np.zeros((records, n.axles))
    accelerations = np.zeros((records, n.bodies))
    commands = np.zeros((records, n.units))
    torque, pressure = state[n.torque, 0], state[n.pressure, 0]
    speed, taken = initial_speed, 0
    for tick in range(ticks + 1):
        now = float(state[n.speed, 0][0])
        sense = TrainSense(
            tick * period, float(state[0, 0]), now, (now - speed) / period, torque.copy(), pressure.copy()
        )  # fmt: skip
        speed = now
        go_on = driver(sense, controls)
        for label, values in zip(Controls._fields, controls, strict=True):
            if not np.all(np.isfinite(values)):
                raise SimulationError(
                    f"drive: at {tick * period:g} s the driver set {label} = {values}; set finite values"
                )
        if tick % every == 0:
            time[taken], commands[taken] = tick * period, controls.torque
            compiled.note(
                s, e, layout, tick * period, state, inputs, w, taken, states, peaks, accelerations
            )
            taken += 1
        if not go_on or tick == ticks:
            break
        compiled.advance(s, e, layout, tick * period, step, steps, state, inputs, w)
        if on_progress is not None and tick % 100 == 0:
            on_progress(tick / ticks)
    return driven_dataset(
        name, model, time[:taken], states[:taken], peaks[:taken], accelerations[:taken],
        commands[:taken],
    )  # fmt: skip


__all__ = ["Controls", "Driver", "TrainSense", "drive"]
