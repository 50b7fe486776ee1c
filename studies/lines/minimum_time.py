"""A driver who loses no time: full effort, then the limit held, then the service brake on its curve.

For `alloc.driving.drive`. That this order is the fastest is the classical result of running-time calculation (Bruenger and
Dahlhaus, Running Time Estimation, in Hansen and Pachl, Railway Timetabling and Operations, 2014). With another driving style
he pulls with a share of the effort, and coasts before he brakes.
"""

from collections.abc import Sequence
from typing import NamedTuple

from alloc.driving import Controls, TrainSense
from alloc.plant.laws import GRAVITY
from alloc.plant.model import Model
from studies.files.study_error import StudyError
from studies.lines.driving_style import FASTEST, Coasting, DrivingStyle, Leg
from studies.lines.train_forces import TrainForces

FOLLOWING_TIME = 1.0
"""Time constant [s] with which the driver takes back what he is off his target speed. Five times the lag of the assumed
brake, so that he approaches without overshoot."""
STANDSTILL = 0.02
"""Speed [m/s] at which the train counts as stopped: half a millimetre before rest."""
ARRIVING = 0.2
"""Speed [m/s] of the braking curve below which standing still means having arrived."""
ROLLING_BACK = -0.05
"""Speed [m/s] at which a train that cannot climb is seen to be lost."""
HANDING_OVER = 0.2
"""Time [s] by which the air brake is commanded ahead of the electric brake's fading: the lag of the assumed brake."""
HOLDING = 0.01
"""Brake force that holds the train at a stop, beyond that against the gradient, as a share of the weight."""


class Halt(NamedTuple):
    """A stop: when the train stood [s] and where [m], and when it left [s]; it does not leave the last one."""

    arrival: float
    position: float
    departure: float


class MinimumTimeDriver:
    """Drives `model` along its `legs`, within the bounds of line and train and of the `style`.

    From the wanted acceleration he computes the force by `TrainForces` (feedforward of resistance and gradient);
    `FOLLOWING_TIME` corrects a deviation of speed. So he holds a speed with an effort equal to the resistance, without limit
    cycle, and follows the braking curve with the full deceleration of the profile. The electric brake gives what it can, the
    air brake the rest.

    He ends the run at the stop at the end of the line, or where the train rolls back; then `stalled` is true. Raises
    `StudyError` if the train has no air brake.
    """

    def __init__(self, model: Model, legs: Sequence[Leg], style: DrivingStyle = FASTEST) -> None:
        brakes = [car.air_brake for car in model.train.cars if car.air_brake is not None]
        if not brakes:
            raise StudyError(f"train {model.train.name!r} has no air brake to stop with")
        self.forces, self.style = TrainForces(model), style
        self._to_come = list(legs)
        self._greatest_pressure = min(brake.maximum_pressure for brake in brakes)
        self._weight = GRAVITY * model.train.mass
        self._standing_until = 0.0
        self.halts: list[Halt] = []
        self.stalled = False
        self.running_time = 0.0
        """Time [s] at which the train stops, from its last motion at the profile's deceleration."""
        self._next_leg()

    def _next_leg(self) -> None:
        self.leg = self._to_come.pop(0)
        self.profile = self.leg.profile
        self.coasting = Coasting(self.style)

    def wanted_acceleration(self, position: float, speed: float) -> float:
        """Acceleration [m/s2] that leads to the permitted speed; far above what the train can do if it is far below."""
        holding = (self.profile.limit(position) - speed) / FOLLOWING_TIME
        curve = self.profile.braking_speed(position)
        # along the curve, at a speed below it, less deceleration keeps the relative distance
        along = self.profile.deceleration * (speed / curve if curve > max(speed, 0.0) else 1.0)
        return min(holding, (curve - speed) / FOLLOWING_TIME - along)

    def __call__(self, sense: TrainSense, controls: Controls) -> bool:
        """Set torques and pressures for the coming control period; False at the end of the run."""
        speed, position = sense.speed, sense.position
        controls.torque[:] = controls.pressure[:] = 0.0
        if sense.time < self._standing_until:
            self._hold(position, controls)
            return True
        force = self.forces.inertia * self.wanted_acceleration(position, speed)
        force += self.forces.resistance(position, speed)
        if force < 0.0:
            self._brake(-force, speed, controls)
        elif not self.coasting(self.profile, position, speed):
            self._pull(force, speed, controls)
        if speed > STANDSTILL:
            self.running_time = sense.time + speed / self.profile.deceleration
        arrived = self.profile.braking_speed(position) < ARRIVING and speed < STANDSTILL
        self.stalled = speed < ROLLING_BACK and not arrived
        if arrived:
            leaving = self.running_time + (self.leg.stop.dwell or 0.0)
            self.halts.append(Halt(self.running_time, position, leaving))
            if self._to_come:
                self._standing_until = leaving
                self._next_leg()
                self._hold(position, controls)
                return True
        return not (arrived or self.stalled)

    def _pull(self, force: float, speed: float, controls: Controls) -> None:
        available = self.forces.effort(speed)
        share = force / available if force < available else 1.0
        if share < self.style.effort or self.style.effort < 1.0:
            controls.torque[:] = self.forces.torque(min(share, self.style.effort), speed)
        else:
            # all of it: the plant's own bound, at the speed of the rims, decides
            controls.torque[:] = self.forces.peak_torque

    def _brake(self, force: float, speed: float, controls: Controls) -> None:
        # what the electric brake will give when the air brake has answered: it fades towards standstill
        soon = speed - HANDING_OVER * self.profile.deceleration
        electric = min(force, self.forces.electric_brake(soon))
        if electric > 0.0:
            share = electric / self.forces.electric_brake(speed)
            controls.torque[:] = self.forces.torque(-share, speed)
        pressure = self.forces.brake_pressure(force - electric, speed)
        controls.pressure[:] = min(pressure, self._greatest_pressure)

    def _hold(self, position: float, controls: Controls) -> None:
        """Stand at a stop, with little more than is needed, so that the brake is soon released."""
        force = abs(self.forces.resistance(position, 0.0)) + HOLDING * self._weight
        pressure = self.forces.brake_pressure(force, 0.0)
        controls.pressure[:] = min(pressure, self._greatest_pressure)
        controls.torque[:] = 0.0
