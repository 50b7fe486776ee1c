"""A driver who loses no time: full effort, then the limit held, then the service brake on its curve.

For `alloc.driving.drive`. That this order is the fastest is the classical result of running-time calculation (Bruenger and
Dahlhaus, Running Time Estimation, in Hansen and Pachl, Railway Timetabling and Operations, 2014).
"""

from alloc.driving import Controls, TrainSense
from alloc.plant.model import Model
from studies.files.study_error import StudyError
from studies.lines.speed_profile import SpeedProfile
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


class MinimumTimeDriver:
    """Drives `model` along `profile`, as its line and train allow.

    From the acceleration he wants he finds the force by `TrainForces` (feedforward of resistance and gradient); a deviation
    of speed is taken back with `FOLLOWING_TIME`. So he holds a speed with an effort equal to the resistance, without limit
    cycle, and the whole deceleration on the braking curve is the profile's.

    He ends the run at the stop at the end of the line, or where the train rolls back; then `stalled` is true.
    Raises `StudyError` if the train has no air brake.
    """

    def __init__(self, model: Model, profile: SpeedProfile) -> None:
        brakes = [car.air_brake for car in model.train.cars if car.air_brake is not None]
        if not brakes:
            raise StudyError(f"train {model.train.name!r} has no air brake to stop with")
        self.profile, self.forces = profile, TrainForces(model)
        self._greatest_pressure = min(brake.maximum_pressure for brake in brakes)
        self.stalled = False
        self.running_time = 0.0
        """Time [s] at which the train stops, from its last motion at the profile's deceleration."""

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
        force = self.forces.inertia * self.wanted_acceleration(position, speed)
        force += self.forces.resistance(position, speed)
        controls.torque[:] = controls.pressure[:] = 0.0
        if force < 0.0:
            pressure = self.forces.brake_pressure(-force, speed)
            controls.pressure[:] = min(pressure, self._greatest_pressure)
        else:
            available = self.forces.effort(speed)
            # all of it: the plant's own bound, at the speed of the rims, decides
            controls.torque[:] = (
                self.forces.torque(force / available, speed)
                if force < available
                else self.forces.peak_torque
            )
        if speed > STANDSTILL:
            self.running_time = sense.time + speed / self.profile.deceleration
        arrived = self.profile.braking_speed(position) < ARRIVING and speed < STANDSTILL
        self.stalled = speed < ROLLING_BACK and not arrived
        return not (arrived or self.stalled)
