"""A run with a driver: he sets torques and brake pressures directly, without the train's traction computers.

For brake tests, speed control, minimum-time driving. The driver, a person or a speed controller, is a function that is
called once per control period.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr

from alloc.compilation import jit
from alloc.errors import SimulationError, UnsoundRun
from alloc.event import DriverCommand, Event
from alloc.plant import advance, derivative, note
from alloc.record import dataset, room
from alloc.simulation import keep
from alloc.tables import Rows


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
    axles: Rows
    """As recorded an instant before (`alloc.columns.AXLE`)."""
    units: Rows
    brakes: Rows


NO_COMMAND = DriverCommand((0.0,), (0.0,))
"""That of an event that somebody drives."""
Driver = Callable[[TrainSense, Rows, Rows], bool | None]
"""`driver(sense, units, brakes)` sets `units.applied` [N m], positive driving, and `brakes.pressure_target` [Pa] for the
coming control period; they stay until changed. False ends the run."""


def drive(event: Event, driver: Driver) -> xr.Dataset:
    """Let `driver` drive the train of `event` to its end, or until he ends it; returns the recorded run.

    The event's command is not read. Raises `SimulationError` where he sets what is no number, `UnsoundRun` as
    `alloc.simulation.simulate`.
    """
    w = event.world()
    record, run, last, ended = room(w), w.run[0], float(w.state[_first_speed(w.cars, w.plant)]), 0
    period = event.onboard.period
    for k in range(w.command.size):
        run.time = time = k * period
        speed = float(w.state[_first_speed(w.cars, w.plant)])
        rate = (speed - last) / period
        sense = TrainSense(time, float(w.state[0]), speed, rate, w.axles, w.units, w.brakes)
        last, go_on = speed, driver(sense, w.units, w.brakes)
        for label, values in (
            ("applied", w.units.applied),
            ("pressure_target", w.brakes.pressure_target),
        ):
            if not np.isfinite(values).all():
                raise SimulationError(f"drive: at {time:g} s {label} = {values}; set finite values")
        _go(k, w, record)
        ended = k + 1
        if go_on is False:
            break
    if not np.isfinite(w.state).all():
        raise UnsoundRun(f"event {event.name!r}: the state is no number at {run.time:g} s")
    return dataset(event, "driver", "driver", w, record, ended, 0.0)


def _first_speed(cars: Rows, plant: Rows) -> int:
    return 1 if plant.body_mass[0] > 0.0 else int(cars.size)


@jit
def _go(k, w, record):
    plant, run = w.plant[0], w.run[0]
    for u in w.units:
        u.torque_command = u.applied
    derivative(
        run.time, w.state, w.stages[0], w.axles, w.cars, w.units, w.brakes, w.patches, w.line, w.effort, w.retard,
        w.own_curve, w.scatter, plant,
    )  # fmt: skip
    note(w.state, w.stages[0], w.axles, w.cars, w.units, w.brakes, plant, run)
    for j in range(w.units.size):  # as the sensing of an automatic run does
        w.units[j].motor_torque = w.state[
            w.state.size - 4 - w.axles.size - w.brakes.size - w.units.size + j
        ]
    keep(record.axle_words, record.axles_in[k])
    keep(record.car_words, record.cars_in[k])
    keep(record.unit_words, record.units_in[k])
    keep(record.brake_words, record.brakes_in[k])
    keep(record.run_words, record.run_in[k])
    advance(
        run.time, w.state, w.stages, w.axles, w.cars, w.units, w.brakes, w.patches, w.line, w.effort, w.retard, w.own_curve,
        w.scatter, w.rail, plant, record.brakes,
    )  # fmt: skip
