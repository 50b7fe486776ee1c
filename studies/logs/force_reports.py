"""Brake force of each car by the smoother, and which car falls short of what it was allocated."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError
from alloc.estimation.brake_force import SmoothedForces, find_shortfalls, smooth_brake_forces
from alloc.estimation.running_resistance import LeastSquaresLearner, RunLog, learn_from_log
from alloc.estimation.series import spans, usual_period
from alloc.onboard.line_memory import EXTENDED_WEIGHTS, LineMemory
from alloc.plant.laws import GRAVITY
from studies.logs.measured_log import MeasuredLog
from studies.logs.measured_run import train_acceleration
from studies.logs.own_samples import noise_of
from studies.logs.train import GradientLine

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


PERIOD = 0.1
"""Time [s] between the samples that are learnt from."""
FILTER_TIME = 1.0
"""Time constant [s] of the source's filter."""
NOISE = 500.0
"""Standard deviation [N] of the force of a sample."""


def resistance_report(log: MeasuredLog, line: GradientLine | None) -> dict[str, Any] | None:
    """Weights of the running resistance after the log, their errors, and which it could teach, for JSON.

    None where no force is known. Without a line the gradient counts as none; positions are those of the log, or the way.
    """
    told = np.asarray(np.isfinite(log.run.applied_force).any(axis=0))
    if not told.any():
        return None
    try:
        return _learnt(log, line, told)
    except EstimationError as error:
        return {"reason": str(error)}


def _learnt(log: MeasuredLog, line: GradientLine | None, told: NDArray[np.bool_]) -> dict[str, Any]:
    run, train = log.run, log.train
    force = run.applied_force[:, told]
    known = np.isfinite(run.speed) & np.isfinite(force).all(axis=1)
    stretches = spans(known)
    if stretches.size == 0:
        raise EstimationError("resistance log: at no instant are speed and all forces known")
    begin, end = stretches[np.argmax(stretches[:, 1] - stretches[:, 0])].tolist()
    time = np.arange(run.time[begin], run.time[end - 1], PERIOD)
    position = _position(log)
    held = LineMemory()
    if line is not None:
        held = LineMemory(tuple(line.station.tolist()), tuple((100.0 * line.rise).tolist()))
    rotating = float((train.inertia / train.radius**2).sum())
    sampled = RunLog(
        time, np.interp(time, run.time, position), np.interp(time, run.time[begin:end], run.speed[begin:end]),
        _mean_force(time, run.time[begin:end], force[begin:end].sum(axis=1)),
    )  # fmt: skip
    mass = float(train.car_mass.sum())
    first = np.array([0.0, 0.0, mass, 0.0, 0.0])
    doubt = np.array([20.0, 20.0, 0.1 * mass, 0.01 * mass, 1e-3 * mass])
    if train.resistance is not None:
        a, b, c = train.resistance.sum(axis=0)
        first = np.array([c, c, mass, a, b])
    learner = LeastSquaresLearner(first, doubt, NOISE)
    learnt = learn_from_log(sampled, held, learner, rotating, FILTER_TIME)
    deviation = learner.posterior()
    return {
        "start_s": float(time[0]),
        "end_s": float(time[-1]),
        "gradient": "of the line" if line is not None else "taken as none",
        "weights": {
            name: {
                "value": float(learner.weights[k]),
                "deviation": float(deviation[k]),
                "learnt": bool(learnt.excitation.learned(name)),
            }
            for k, name in enumerate(EXTENDED_WEIGHTS)
        },
    }


def _mean_force(time: Floats, instants: Floats, force: Floats) -> Floats:
    """Mean force [N] over the interval that begins at each of `time`."""
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(instants))])
    return (
        np.interp(time + PERIOD, instants, impulse) - np.interp(time, instants, impulse)
    ) / PERIOD


def _position(log: MeasuredLog) -> Floats:
    """Station of the train [m]: of the log, or the way since its begin."""
    run = log.run
    if log.position is not None and np.isfinite(log.position).any():
        known = np.isfinite(log.position)
        return np.interp(run.time, run.time[known], log.position[known])
    speed = np.nan_to_num(run.speed)
    return np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(run.time))])
