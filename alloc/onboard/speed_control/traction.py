"""Current, force and torque: from the speed control's current to all motors of the train."""

from dataclasses import dataclass

import numpy as np

from alloc.errors import OnboardError
from alloc.plant.model import Floats
from alloc.plant.train import EFFORT_SPEED_STEP, Train


@dataclass(frozen=True)
class Traction:
    """Every motor of the train gets the same torque within its limits; force F = I / K_i [N], braking electrically too.

    `rim_force` (units,) [N] at the rims of a unit per N m of each of its motors; `drive_limit`, `brake_limit`
    (units, EFFORT_TABLE_LENGTH) [N m]; `current_per_force` K_i [A/N].
    """

    rim_force: Floats
    drive_limit: Floats
    brake_limit: Floats
    current_per_force: float = 1e-3

    def __post_init__(self) -> None:
        OnboardError.check("traction", self, positive=("current_per_force",))

    @classmethod
    def of(cls, train: Train, current_per_force: float = 1e-3) -> "Traction":
        """The traction of `train`; raises `OnboardError` where it has no motors. K_i = 1 A per kN is assumed."""
        force, drive, brake = [], [], []
        for car in train.cars:
            for axles in car.units():
                assert car.motors is not None
                force.append(len(axles) * car.motors.gear_ratio / car.wheel_radius)
                drive.append(car.motors.drive.tabulate(car.wheel_radius, car.motors.gear_ratio))
                brake.append(car.motors.brake.tabulate(car.wheel_radius, car.motors.gear_ratio))
        if not force:
            raise OnboardError(f"traction: train {train.name!r} has no motors")
        return cls(np.array(force), np.stack(drive), np.stack(brake), current_per_force)

    def limit(self, speed: float, braking: bool) -> Floats:
        """Largest torque of each unit's motors [N m] at `speed` [m/s], (units,)."""
        table = self.brake_limit if braking else self.drive_limit
        x = min(max(abs(speed) / EFFORT_SPEED_STEP, 0.0), table.shape[1] - 1.000001)
        k = int(x)
        return table[:, k] + (table[:, k + 1] - table[:, k]) * (x - k)

    def torques(self, current: float, speed: float) -> tuple[Floats, float]:
        """Torques [N m] (units,) for `current` [A] at `speed` [m/s], and the current that these stand for [A].

        Where a unit is at its limit the others do not take over what it lacks.
        """
        torque = current / self.current_per_force / float(self.rim_force.sum())
        limit = self.limit(speed, torque < 0.0)
        torques = np.minimum(np.maximum(torque, -limit), limit)
        return torques, float(self.rim_force @ torques) * self.current_per_force
