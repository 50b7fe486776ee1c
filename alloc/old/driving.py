"""A run with a driver: torques and brake pressures are set directly, without the train's traction computers.

For brake tests, speed control and minimum-time driving. The plant and its record are as in `alloc.old.simulation`. The driver, a
person or a speed controller, is a Python object that is called once per control period.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import xarray as xr

from alloc.old.balance import check_run
from alloc.old.event import MOST_AXLE_STEPS, STEP, SimulationError, check_size
from alloc.old.loop import DRIVER, ClosedLoop, run_with_driver
from alloc.old.plant.model import Floats, Model
from alloc.old.recording import PlantRecord, driven_dataset


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
    wheel_speed: Floats
    """Speed of each axle's tread [m/s], (axles,)."""


class Controls(NamedTuple):
    """What the driver sets, in place; it stays as set until changed."""

    torque: Floats
    """Torque wanted of each motor of the units [N m], (units,), negative braking."""
    pressure: Floats
    """Brake cylinder pressures wanted [Pa], (groups,); the plant delays them by each brake's dead time."""
    valve: Floats
    """Per brake group, (groups,): 0 the cylinder follows the pressure wanted, 1 it holds, 2 it releases."""
    sand: Floats
    """Sand that each sander lays on each rail [kg/s], (sanders,)."""


class Driver(Protocol):
    """A person or a speed control that drives the train."""

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
    step: float = STEP,
    record_period: float | None = None,
    on_progress: Callable[[float], None] | None = None,
    most_axle_steps: float = MOST_AXLE_STEPS,
) -> xr.Dataset:
    """Let `driver` drive the train for `duration` [s], or until it ends the run; returns the recorded run.

    `period`: control period [s]; `step`: longest integration step [s]; `record_period` [s]: a multiple of `period` (default:
    `period` itself). The run has those of `alloc.old.recording.VARIABLES` that depend on the plant and the driver. More
    than `most_axle_steps` are refused. Raises `SimulationError` for input that cannot be simulated, `PlantError` from the
    model, `UnsoundRun` as `alloc.old.simulation.simulate`.
    """
    record_period = period if record_period is None else record_period
    times = {"duration": duration, "period": period, "step": step, "record_period": record_period}
    SimulationError.check("drive", times, positive=times)
    every = round(record_period / period)
    if every < 1 or abs(every * period - record_period) > 1e-9:
        raise SimulationError(
            f"drive: record_period = {record_period!r} must be a multiple of the control period {period!r}"
        )
    check_size("drive", model, duration, period, step, record_period, most_axle_steps)
    ticks = round(duration / period) + 1  # the last one is recorded, and nobody sees what follows
    loop = ClosedLoop(model, ticks, period, step, record_period, initial_speed, initial_position)
    record = PlantRecord.allocate(loop.records, model.layout)
    part = _DriverInPython(driver, model, loop, np.zeros((loop.records, model.layout.units)))
    go = partial(run_with_driver, loop.plant, loop.timing, loop.progress, record)
    loop.run(go, {DRIVER: part}, on_progress)
    record = record.until(loop.records)
    run = driven_dataset(name, model, record, part.torque[: loop.records])
    check_run(model, record, run)
    return run


class _DriverInPython:
    """A driver answers the loop: he reads, and sets what the plant is commanded."""

    def __init__(self, driver: Driver, model: Model, loop: ClosedLoop, torque: Floats) -> None:
        self.driver, self.timing = driver, loop.timing
        self.torque = torque
        """Torques that he set, (instants, units)."""
        n, state, inputs = model.layout, loop.plant.state, loop.plant.inputs
        self.controls = Controls(*inputs)
        self.position, self.speed = state[n.position], state[n.speed]
        self.motors, self.cylinders = state[n.torque], state[n.pressure]
        self.turning, self.radius = state[n.omega], model.structure.radius
        self.last_speed = float(self.speed[0])

    def __call__(self, tick: int) -> bool:
        time, speed = tick * self.timing.period, float(self.speed[0])
        sense = TrainSense(
            time=time,
            position=float(self.position[0]),
            speed=speed,
            acceleration=(speed - self.last_speed) / self.timing.period,
            torque=self.motors.copy(),
            pressure=self.cylinders.copy(),
            wheel_speed=self.turning * self.radius,
        )
        self.last_speed = speed
        go_on = self.driver(sense, self.controls)
        for label, values in zip(Controls._fields, self.controls, strict=True):
            if not np.isfinite(values).all():
                raise SimulationError(
                    f"drive: at {time:g} s the driver set {label} = {values}; set finite values"
                )
        if tick % self.timing.record_ticks == 0:
            self.torque[tick // self.timing.record_ticks] = self.controls.torque
        return go_on
