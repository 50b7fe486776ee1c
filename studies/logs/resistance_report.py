"""The running resistance that a log teaches: the stand-alone learner of JP H07-322414, claims 6 and 7."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError
from alloc.estimation.running_resistance import LeastSquaresLearner, RunLog, learn_from_log
from alloc.estimation.series import spans
from alloc.onboard.line_memory import EXTENDED_WEIGHTS, LineMemory
from studies.logs.gradients import GradientLine
from studies.logs.measured_log import MeasuredLog

Floats = NDArray[np.float64]

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
