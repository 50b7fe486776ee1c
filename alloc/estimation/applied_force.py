"""Force of motors and brakes at the rim of each axle of a recorded run: what a log of a real train has as its torques."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.estimation.errors import EstimationError
from alloc.plant.equations import hyperbolic_speed_law, shoe_torque
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Train

Floats = NDArray[np.float64]


def applied_force(run: xr.Dataset, train: Train) -> Floats:
    """Force [N] of motors and shoes at the rim, (instants, axles), positive in traction.

    `train` is the one that the run was made with; raises `EstimationError` for any other number of axles. The shoe force
    is the run's `brake_force` where it is recorded, otherwise the plant's law at the recorded cylinder pressure.
    """
    s = build(train, Rail(0.3)).structure
    if run.sizes["axle"] != s.radius.size:
        raise EstimationError(
            f"run of {run.sizes['axle']} axles: train {train.name!r} has {s.radius.size}"
        )
    driven = s.axle_unit >= 0
    motor = np.zeros(run["rail_force"].shape)
    if driven.any():
        motor[:, driven] = run["motor_torque"].values[:, s.axle_unit[driven]] * s.gear[driven]
    if "brake_force" in run:
        return np.asarray(motor / s.radius - run["brake_force"].values)
    braked = s.axle_group >= 0
    shoe = np.zeros_like(motor)
    if braked.any():
        speed = run["car_speed"].values[:, s.axle_car]
        friction = hyperbolic_speed_law(speed, *s.shoe_friction.T)
        pressure = run["cylinder_pressure"].values[:, s.axle_group]
        limit = s.shoe_gain * s.radius * np.where(braked, pressure, 0.0) * friction
        omega = run["rim_speed"].values / s.radius
        rail = s.radius * run["rail_force"].values
        shoe = np.asarray(shoe_torque(motor - rail, omega, limit, s.inertia))
    return np.asarray((motor - shoe) / s.radius)
