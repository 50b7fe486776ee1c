"""Force of motors and brakes at the rim of each axle of a recorded run: what a log of a real train has as its torques."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.errors import EstimationError
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Train

Floats = NDArray[np.float64]


def applied_force(run: xr.Dataset, train: Train) -> Floats:
    """Force [N] of motors and shoes at the rim, (instants, axles), positive in traction.

    `train` is the one that the run was made with; raises `EstimationError` for any other number of axles.
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
    return np.asarray(motor / s.radius - run["brake_force"].values)
