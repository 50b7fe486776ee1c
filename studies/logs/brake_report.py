"""Brake force of each car by the smoother, and which car falls short of what it was allocated."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError
from alloc.estimation.brake_force import SmoothedForces, find_shortfalls, smooth_brake_forces
from alloc.estimation.series import spans, usual_period
from alloc.plant.laws import GRAVITY
from studies.logs.measured_log import MeasuredLog
from studies.logs.measured_run import train_acceleration
from studies.logs.own_samples import noise_of

Floats = NDArray[np.float64]

BRAKING = 0.1
"""Deceleration [m/s2] above which a train counts as braking."""
SHORTEST = 2.0
"""Time [s] that a braking must last."""
LEAST_NOISE = {"acceleration": 1e-3, "coupler": 10.0}
"""Noise that sensors have at least [m/s2, N]."""
MOST = 200_000
"""Samples that are smoothed; of a longer braking, the first."""


def brake_report(log: MeasuredLog) -> dict[str, Any] | None:
    """Smoothed brake force of every car while the train brakes, its error, and cars that fall short, for JSON.

    None where couplers or cars' accelerations are not measured, or where the train never brakes. Each car is allocated the
    share of the train's brake force that it has of the mass.
    """
    run, train = log.run, log.train
    if run.coupler_force is None or run.car_acceleration is None:
        return None
    inside = _longest_braking(log)
    if inside is None:
        return None
    acceleration, coupler = run.car_acceleration[inside], run.coupler_force[inside]
    resistance = _resistance(log, inside)
    noise = {
        "acceleration": max(_noise(acceleration), LEAST_NOISE["acceleration"]),
        "coupler": max(_noise(coupler), LEAST_NOISE["coupler"]),
    }
    try:
        smoothed = smooth_brake_forces(
            acceleration, coupler, train.car_mass, usual_period(run.time[inside]),
            noise["acceleration"], noise["coupler"], resistance=resistance,
        )  # fmt: skip
        short = _shortfall(smoothed, train.car_mass)
    except EstimationError as error:
        return {"reason": str(error)}
    return {
        "start_s": float(run.time[inside][0]),
        "end_s": float(run.time[inside][-1]),
        "acceleration_noise_ms2": noise["acceleration"],
        "coupler_noise_kn": 1e-3 * noise["coupler"],
        "cars": [
            {
                "car": car + 1,
                "brake_force_kn": float(1e-3 * smoothed.force[:, car].mean()),
                "deviation_kn": float(1e-3 * smoothed.deviation[:, car].mean()),
                "shortfall_kn": float(1e-3 * short.shortfall[car]),
                "threshold_kn": float(1e-3 * short.threshold[car]),
                "accused": bool(car in short.accused),
            }
            for car in range(train.car_mass.size)
        ],
    }


def _shortfall(smoothed: SmoothedForces, mass: Floats) -> Any:
    total = smoothed.force.sum(axis=1)
    return find_shortfalls(total[:, None] * mass / mass.sum(), smoothed.force)


def _longest_braking(log: MeasuredLog) -> slice | None:
    run = log.run
    assert run.coupler_force is not None
    assert run.car_acceleration is not None
    known = np.isfinite(run.coupler_force).all(axis=1) & np.isfinite(run.car_acceleration).all(
        axis=1
    )
    braking = train_acceleration(run, 1.0) < -BRAKING
    stretches = spans(known & braking & np.isfinite(run.speed))
    if stretches.size == 0:
        return None
    begin, end = stretches[np.argmax(stretches[:, 1] - stretches[:, 0])].tolist()
    if run.time[end - 1] - run.time[begin] < SHORTEST:
        return None
    return slice(begin, min(end, begin + MOST))


def _resistance(log: MeasuredLog, inside: slice) -> Any:
    """Running resistance and gradient of each car [N], (instants, cars)."""
    speed, train = log.run.speed[inside, None], log.train
    drag = np.zeros((speed.shape[0], train.car_mass.size))
    if train.resistance is not None:
        a, b, c = train.resistance.T
        drag += a + b * speed + c * speed**2
    if log.grade is not None:
        drag += GRAVITY * np.nan_to_num(log.grade[inside, None]) * train.car_mass
    return drag


def _noise(values: Floats) -> float:
    return float(np.median([noise_of(column) for column in values.T]))
