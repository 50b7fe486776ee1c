"""Intervals of a running test against the truth: of means by the report's rule and by own accelerations, of the smoother."""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.brake_force import SeriesMean, SmoothedForces, stop_mean
from studies.brake_force.running_tests import SYSTEM, TestResult, estimate

Floats = NDArray[np.float64]
WIDTH = 1.96
"""Half-width of a 95 % interval in deviations that are known."""


def averages(result: TestResult) -> dict[str, object]:
    """Mean of the wagons' sum, with its uncertainty and the truth [kN], and which 95 % intervals contain it."""
    w, found = result.window, estimate(result)
    truth = float(result.true_force[w, 1:].sum(axis=1).mean())
    first, own = stop_mean(found.wagons[w], moving=True), stop_mean(found.wagons_own[w])
    constant, constant_own = _constant(result, own=False), _constant(result, own=True)
    return {
        "mean": float(first.mean) / 1e3,
        "mean_deviation": float(first.deviation) / 1e3,
        "whole_deviation": float(np.hypot(first.deviation, constant)) / 1e3,
        "own_deviation": float(np.hypot(own.deviation, constant_own)) / 1e3,
        "own_mean": float(own.mean) / 1e3,
        "true_mean": truth / 1e3,
        "covered": _holds(first, constant, truth),
        "covered_own": _holds(own, constant_own, truth),
    }


def _holds(found: SeriesMean, constant: float, truth: float) -> bool:
    low, high = found.interval(0.95, constant)
    return bool(low <= truth <= high)


def _constant(result: TestResult, own: bool) -> float:
    """Deviation [N] of the wagons' sum by what stays constant over the stop.

    Couplers within the sum cancel; their masses are weighed one by one, and accelerometers err one by one too unless the
    first wagon's serves for all.
    """
    errors, w, m = SYSTEM.calibration, result.window, result.measured
    a = m.acceleration[w, 1:].mean(axis=0) if own else m.acceleration[w, 1].mean()
    mass = m.mass[1:]
    offset = float(np.sqrt(np.sum(mass**2)) if own else mass.sum()) * errors.acceleration_offset
    coupler = np.hypot(errors.coupler_offset, errors.coupler_gain * m.coupler_force[w, 0].mean())
    weighed = errors.mass * float(np.sqrt(np.sum((a * m.bare_mass[1:]) ** 2)))
    return float(np.sqrt(offset**2 + coupler**2 + weighed**2))


def smoothed_intervals(result: TestResult, found: SmoothedForces) -> dict[str, float]:
    """Accuracy of the smoother's intervals within the window.

    `covered_smooth`: share of instants and cars whose 95 % interval contains the true force; `smooth_ratio`: root mean
    square of its changing errors over the deviation stated for them.
    """
    w, m = result.window, result.measured
    # the noise of a reading is nothing beside what a weighing has wrong of a mass
    constant = SYSTEM.calibration.deviation(
        m.bare_mass, m.acceleration[w].mean(axis=0), m.coupler_force[w].mean(axis=0)
    )
    error, noise = (found.force - result.true_force)[w], found.deviation[w]
    changing = error - error.mean(axis=0)
    return {
        "covered_smooth": float(np.mean(np.abs(error) <= WIDTH * np.hypot(noise, constant))),
        "smooth_ratio": float(np.sqrt(np.mean(np.square(changing / noise)))),
    }
