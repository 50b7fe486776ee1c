"""Brake force of each car from its acceleration and the coupler forces: RTRI report (2)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.estimation.errors import EstimationError


def car_brake_forces(
    acceleration: ArrayLike, coupler_force: ArrayLike, mass: ArrayLike
) -> NDArray[np.float64]:
    """Brake force f [N] of each car, positive braking, negative driving, (instants, cars): RTRI report (2).

    `acceleration` [m/s2] (instants, cars), or (instants,) where one is taken for all cars; `coupler_force` [N] (instants,
    cars - 1), tension positive; `mass` [kg] (cars,). Running resistance is part of f; what the wheelsets' own deceleration
    takes of the brake is not. Raises `EstimationError`.
    """
    mass = np.asarray(mass, dtype=float)
    rate = np.asarray(acceleration, dtype=float)
    coupler = np.asarray(coupler_force, dtype=float)
    if rate.ndim == 1:
        rate = np.repeat(rate[:, None], mass.size, axis=1)
    for name, array, columns in (
        ("acceleration", rate, mass.size),
        ("coupler_force", coupler, mass.size - 1),
    ):
        if array.shape != (rate.shape[0], columns):
            raise EstimationError(
                f"{name}: shape {array.shape} must be ({rate.shape[0]}, {columns})"
            )
    pull = np.pad(coupler, ((0, 0), (1, 1)))  # nothing pulls at the ends of the train
    return -mass * rate + pull[:, :-1] - pull[:, 1:]
