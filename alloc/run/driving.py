"""A run with a driver: he sets torques and brake pressures directly, without the train's traction computers.

For brake tests, speed control, minimum-time driving. The driver, a person or a speed controller, is a function that is
called once per control period.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr

from alloc.compilation import jit
from alloc.plant.dynamics import state_places
from alloc.run.event import DriverCommand, Event
from alloc.run.recording import make_dataset, make_room
from alloc.run.simulation import record_and_advance
from alloc.schema.errors import SimulationError
from alloc.schema.tables import Rows


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
    """As recorded an instant before (`alloc.plant.columns.WHEELSET`)."""
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
    `alloc.run.simulation.simulate`.
    """
    w = event.world()
    recording, run, ended = make_room(w), w.run[0], 0
    bodies = state_places(w.wheelsets, w.cars, w.drives, w.cylinders, w.plant[0])[0]
    last = float(w.state[bodies])
    period = event.onboard.period
    for k in range(w.command.size):
        run.time = time = k * period
        speed = float(w.state[bodies])
        rate = (speed - last) / period
        sense = TrainSense(time, float(w.state[0]), speed, rate, w.wheelsets, w.units, w.cylinders)
        last, go_on = speed, driver(sense, w.units, w.brakes)
        for rows, name in ((w.units, "applied"), (w.brakes, "pressure_target")):
            if not np.isfinite(values := rows[name]).all():
                raise SimulationError(f"drive: at {time:g} s {name} = {values}; set finite values")
        _advance_instant(k, w, recording)
        ended = k + 1
        if go_on is False:
            break
    return make_dataset(event, "driver", "driver", w, recording, ended, 0.0)


@jit
def _advance_instant(k, w, recording):
    torque = state_places(w.wheelsets, w.cars, w.drives, w.cylinders, w.plant[0])[2]
    for j in range(w.units.size):
        u = w.units[j]
        u.torque_command = u.applied
        u.motor_torque = w.state[torque + j]  # as the sensing of an automatic run does
    record_and_advance(
        k, w.state, w.stages, w.wheelsets, w.cars, w.drives, w.cylinders, w.patches, w.line, w.effort, w.retard,
        w.curve, w.scatter, w.rail, w.plant[0], w.units, w.brakes, w.run[0], recording,
    )  # fmt: skip
