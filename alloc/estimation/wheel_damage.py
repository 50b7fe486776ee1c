"""Tangential force of each axle and wheel damage Q from measured series, JP4209318 (2) to (4) and (28).

Signs as in the plant: speeds >= 0, forces on the train positive in traction and negative in braking, slip velocity
R omega - v. The source counts the brake force F_b and the tangential force F^_m as magnitudes and speeds negative; with
speeds made positive its bracket F_b - (J/R) d omega/dt reads F_b + (J/R) d omega/dt, and so it does here with F = -F_b:

    tangential force  F_t = F - (J/R) d omega/dt                                        (2), (4)
    wheel damage      Q = sum_i integral of F_t (R omega - v) dt, >= 0 driving and braking     (28)

No measured speed is differentiated. The mean of F_t over a window is the impulse of F less the wheelset's gain of
momentum, and the inertia's part of Q is the Stieltjes integral of the slip velocity over omega.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.errors import EstimationError

Floats = NDArray[np.float64]


def _series(name: str, values: ArrayLike, instants: int, axles: int | None = None) -> Floats:
    """`values` as (instants, axles), of one column if `axles` is None; raises `EstimationError`."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 1 and axles is None:
        array = array[:, None]
    wanted = (instants, axles) if axles is not None else (instants, array.shape[-1])
    if array.ndim != 2 or array.shape != wanted:
        raise EstimationError(f"{name}: shape {array.shape} must be {wanted} (instants, axles)")
    if not np.all(np.isfinite(array)):
        row, column = np.argwhere(~np.isfinite(array))[0]
        raise EstimationError(
            f"{name}: {array[row, column]} at instant {row}, column {column}; give the parts "
            "before and after it separately"
        )
    return array


def _positive(name: str, values: ArrayLike, axles: int) -> Floats:
    array = np.asarray(values, dtype=float)
    if array.shape not in ((), (axles,)):
        raise EstimationError(f"{name}: shape {array.shape} must be () or ({axles},)")
    if not np.all(np.isfinite(array) & (array > 0.0)):
        raise EstimationError(f"{name} = {array} must be finite and greater than 0")
    return np.broadcast_to(array, (axles,))


def _growing(time: ArrayLike) -> Floats:
    array = np.asarray(time, dtype=float)
    if array.ndim != 1 or array.size < 2:
        raise EstimationError(f"time: shape {array.shape}; give two instants or more")
    if not np.all(np.isfinite(array)) or not np.all(np.diff(array) > 0.0):
        raise EstimationError("time must be finite and grow from instant to instant")
    return array


def tangential_force(
    time: ArrayLike,
    applied_force: ArrayLike,
    angular_speed: ArrayLike,
    inertia: ArrayLike,
    radius: ArrayLike,
    window: float,
) -> Floats:
    """Force [N] that the rail exerts on each axle, mean over `window` [s] around each instant, (instants, axles).

    `time` [s] (instants,); `applied_force` [N] (instants, axles): motors and brakes together at the rim, positive in
    traction; `angular_speed` [rad/s] (instants, axles); `inertia` [kg m2] of the wheelset with everything geared to it and
    `radius` [m], () or (axles,). At the ends the window is what there is of it.

    The mean is exact for series that are linear between instants. White noise of the rim speed with standard deviation s
    passes into the force as sqrt(2) J s / (R^2 window). Raises `EstimationError`. Source: JP4209318 (2), (4).
    """
    time = _growing(time)
    applied = _series("applied_force", applied_force, time.size)
    omega = _series("angular_speed", angular_speed, time.size, applied.shape[1])
    inertia = _positive("inertia", inertia, applied.shape[1])
    radius = _positive("radius", radius, applied.shape[1])
    shortest = float(np.diff(time).max())
    if not window >= shortest * (1.0 - 1e-9):
        raise EstimationError(
            f"window = {window!r} s must not be shorter than the sampling, {shortest:g} s"
        )
    step = np.diff(time)[:, None]
    given = np.zeros_like(applied)
    np.cumsum(0.5 * (applied[1:] + applied[:-1]) * step, axis=0, out=given[1:])
    impulse = given - inertia / radius * omega
    begin = np.maximum(time - 0.5 * window, time[0])
    end = np.minimum(time + 0.5 * window, time[-1])
    force = np.empty_like(impulse)
    for i, column in enumerate(impulse.T):
        force[:, i] = (np.interp(end, time, column) - np.interp(begin, time, column)) / (
            end - begin
        )
    return force


def wheel_damage(
    time: ArrayLike,
    applied_force: ArrayLike,
    angular_speed: ArrayLike,
    speed: ArrayLike,
    inertia: ArrayLike,
    radius: ArrayLike,
) -> Floats:
    """Wheel damage Q [J] of each axle accumulated since the first instant, (instants, axles); JP4209318 (28).

    `speed` [m/s] of the train (instants,), or at each axle (instants, axles); the rest as in `tangential_force`. The
    train's Q is the sum over the axles of the last row. Without slide, R omega = v, it is 0 (29).

    Exact for series that are linear between instants; the error of smooth ones falls with the square of the sampling: in
    braked runs of the plant 2e-5 at records of 10 ms and 9e-4 at 100 ms. A force that jumps between two instants adds half
    the jump over that time: 6e-4 and 2e-2 where a driver cuts the torque of slipping wheels. Independent white noise of the
    speeds does not bias Q, since no noise is multiplied by its own change. A relative error of the radius or of the train's
    speed does: it adds as much of the work of F_t. Raises `EstimationError`.
    """
    time = _growing(time)
    applied = _series("applied_force", applied_force, time.size)
    axles = applied.shape[1]
    omega = _series("angular_speed", angular_speed, time.size, axles)
    train = _series("speed", speed, time.size, None if np.ndim(speed) == 1 else axles)
    inertia, radius = _positive("inertia", inertia, axles), _positive("radius", radius, axles)
    slip = radius * omega - train
    step = np.diff(time)[:, None]
    # product of two straight lines, integrated
    given = (
        applied[:-1] * (2.0 * slip[:-1] + slip[1:]) + applied[1:] * (slip[:-1] + 2.0 * slip[1:])
    ) * (step / 6.0)
    # integral of slip d omega along a straight line; its R omega d omega is exactly the gain of omega^2 R / 2
    turned = inertia / radius * 0.5 * (slip[1:] + slip[:-1]) * np.diff(omega, axis=0)
    damage = np.zeros_like(applied)
    np.cumsum(given - turned, axis=0, out=damage[1:])
    return damage
