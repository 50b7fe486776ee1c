"""Tangential force of each axle and wheel damage Q from measured series, JP4209318 (2) to (4) and (28).

Signs as in the plant: speeds >= 0, forces on the train positive in traction and negative in braking, slip velocity R omega -
v. The source counts the brake force F_b and the tangential force F^_m as magnitudes and speeds negative. With positive
speeds its bracket F_b - (J/R) d omega/dt reads F_b + (J/R) d omega/dt, and so it does here with F = -F_b:

    tangential force  F_t = F - (J/R) d omega/dt                                        (2), (4)
    wheel damage      Q = sum_i integral of F_t (R omega - v) dt, >= 0 driving and braking     (28)

No measured speed is differentiated. The mean of F_t over a window is the impulse of F less the wheelset's gain of momentum,
and the inertia's part of Q is the Stieltjes integral of the slip velocity over omega.
"""

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.evaluation.measured_series import finite_series, positive_series
from alloc.schema.errors import EstimationError

Floats = NDArray[np.float64]

SAMPLED, LONGEST, GAP, SHORTEST = 0.1, 1.0, 10.0, 5e-5
"""Steps of a log of three instants or more that are doubtful [s]: above 1 s, of a clock in ms; above 0.1 s and ten median
ones, where samples are left out; median ones below 50 us, of a clock in hours or days."""
ROLLING = 0.5
"""A wheel whose slip is at most this share of the train's speed rolls, as each does at some time."""


NEGATIVE, NOISE = 0.01, 1.0
"""Share of the sum of all, and Q [J], by which an axle's Q below 0 is no noise: friction takes work, driving or braking."""


def check_series(
    time: ArrayLike, applied: ArrayLike, omega: ArrayLike, inertia: ArrayLike, radius: ArrayLike
) -> tuple[Floats, ...]:
    """The arguments that both functions have, as arrays that fit together; raises `EstimationError`, and warns of gaps."""
    time = finite_series("time", time, (None,))
    if time.size < 2 or not np.all(np.diff(time) > 0.0):
        raise EstimationError(
            "time must grow from each instant to the next; give two instants or more"
        )
    step = np.diff(time)
    usual, k = float(np.median(step)), int(step.argmax())
    if time.size > 2 and (usual < SHORTEST or step[k] > min(LONGEST, max(SAMPLED, GAP * usual))):
        steps = f"time steps by {step[k]:g} s at {time[k]:g} s, by {usual:g} s as a rule"
        warnings.warn(f"{steps}: are these seconds, and all samples there?", stacklevel=3)
    applied = finite_series("applied_force", applied, (time.size, None))
    omega = finite_series("angular_speed", omega, applied.shape)
    inertia = positive_series("inertia", inertia, (), applied.shape[1:])
    radius = positive_series("radius", radius, (), applied.shape[1:])
    finite_series("angular_speed times radius", radius * omega)
    return time, applied, omega, inertia, radius


def tangential_force(
    time: ArrayLike,
    applied_force: ArrayLike,
    angular_speed: ArrayLike,
    inertia: ArrayLike,
    radius: ArrayLike,
    window: float,
) -> Floats:
    """Force [N] that the rail exerts on each axle, mean over `window` [s] around each instant, (instants, axles).

    `time` (instants,): [s] or time stamps of any type; `applied_force` [N] (instants, axles): motors and brakes together at
    the rim, positive in traction; `angular_speed` [rad/s] (instants, axles); `inertia` [kg m2] of the wheelset with
    everything geared to it and `radius` [m], () or (axles,). At the ends of the series the window is shortened.

    The mean is exact for series that are linear between instants. White noise of the rim speed with standard deviation s
    gives a noise of the force of sqrt(2) J s / (R^2 window). Raises `EstimationError`, warns of gaps. JP4209318 (2), (4).
    """
    time, applied, omega, inertia, radius = check_series(
        time, applied_force, angular_speed, inertia, radius
    )
    window = float(finite_series("window", window, ()))
    shortest = float(np.diff(time).max())
    if not window >= shortest * (1.0 - 1e-9):
        raise EstimationError(f"window = {window!r} s is shorter than the sampling, {shortest:g} s")
    step = np.diff(time)[:, None]
    impulse = np.zeros_like(applied)
    np.cumsum(0.5 * (applied[1:] + applied[:-1]) * step, axis=0, out=impulse[1:])
    impulse -= inertia / radius * omega
    begin = np.maximum(time - 0.5 * window, time[0])
    end = np.minimum(time + 0.5 * window, time[-1])
    gained = [np.interp(end, time, axle) - np.interp(begin, time, axle) for axle in impulse.T]
    return np.stack(gained, axis=1) / (end - begin)[:, None]


def wheel_damage(
    time: ArrayLike,
    applied_force: ArrayLike,
    angular_speed: ArrayLike,
    speed: ArrayLike,
    inertia: ArrayLike,
    radius: ArrayLike,
) -> Floats:
    """Wheel damage Q [J] of each axle accumulated since the first instant, (instants, axles); JP4209318 (28).

    `speed` [m/s] of the train (instants,), or at each axle (instants, axles); the rest as in `tangential_force`. The train's
    Q is the sum over the axles of the last row. Without slide, R omega = v, it is 0 (29).

    Exact for series that are linear between instants; in braked runs of the plant 2e-5 off at records of 10 ms and 9e-4 at
    100 ms. White noise of the speeds does not bias Q: no noise is multiplied by its own change. A relative error of the
    radius or of the train's speed does: it adds as much of the work of F_t. Raises `EstimationError`, warns of doubts.
    """
    time, applied, omega, inertia, radius = check_series(
        time, applied_force, angular_speed, inertia, radius
    )
    train = finite_series("speed", speed, time.shape, applied.shape)
    train = train if train.ndim == 2 else train[:, None]
    slip = radius * omega - train
    for k in np.flatnonzero(~(abs(slip) <= ROLLING * abs(train)).any(axis=0))[:1]:
        extent = f"slip of {slip[:, k].min():g} to {slip[:, k].max():g} m/s"
        warnings.warn(f"axle {k} never rolls: {extent}; have all speeds their units?", stacklevel=2)
    step = np.diff(time)[:, None]
    # product of two straight lines, integrated
    supplied = (
        applied[:-1] * (2.0 * slip[:-1] + slip[1:]) + applied[1:] * (slip[:-1] + 2.0 * slip[1:])
    ) * (step / 6.0)
    # integral of slip d omega along a straight line; its R omega d omega is exactly the gain of omega^2 R / 2
    turned = inertia / radius * 0.5 * (slip[1:] + slip[:-1]) * np.diff(omega, axis=0)
    damage = np.zeros_like(applied)
    np.cumsum(supplied - turned, axis=0, out=damage[1:])
    k, total = int(damage[-1].argmin()), float(abs(damage[-1]).sum())
    if damage[-1, k] < -NEGATIVE * total - NOISE:
        share = f"axle {k} has a Q of {damage[-1, k]:g} J, of {total:g} J of all"
        warnings.warn(f"{share}: are the signs right, and all samples measured?", stacklevel=2)
    return damage
