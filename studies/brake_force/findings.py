"""Numbers of the RTRI report's findings, read from the running tests as they are, and by estimators that err."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.brake_force import (
    SeriesMean,
    SmoothedForces,
    coupler_force_between,
    stop_mean,
)
from studies.brake_force.measurement import (
    BELIEFS,
    BRAKED_AT,
    SYSTEM,
    TestResult,
    estimate,
    run_test,
    smooth,
)

# Intervals of a running test against the truth: of means by the report's rule and by own accelerations, of the
# smoother.

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


Row = dict[str, object]

CONTACT = 5e3
"""Coupler force [N] beyond which two cars press or pull: five times the sensor's noise."""
AGREEMENT = 0.05
"""Difference of accelerations [m/s2], root mean square over a second, below which relative motion counts as died out; two
sensors' noise alone gives 0.028."""
BUILT_UP = 0.95
"""Share of the steady pressure from which a brake force counts as steady."""


def rms(values: Floats) -> float:
    """Root mean square; nan of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


def running_test_row(name: str, seed: int) -> Row:
    """Numbers of the running test called `name` on the day of `seed`."""
    return row_of_test(name, run_test(name, seed))


def row_of_test(name: str, result: TestResult) -> Row:
    """Numbers of the test called `name`, forces in kN; which ones depends on the test."""
    parts = {
        "locomotive": (_shock, _locomotive, _settled),
        "all": (_locomotive, _settled, _spikes, _opposite, _by_wheel),
        "emergency": (_theory, _by_wheel),
    }
    row: Row = {"part": "test", "test": name}
    for part in (averages, _errors, *parts.get(name, ())):
        row |= part(result)
    return row


def _errors(result: TestResult) -> Row:
    """Error of the wagons' sum within the report's window: at an instant, with the remedies, and of means."""
    w, found = result.window, estimate(result)
    truth = result.true_force[:, 1:].sum(axis=1)
    smooth_forces = smooth(result)
    smoothed, _ = smooth_forces.total(slice(1, None))
    series = {"first": found.wagons, "own": found.wagons_own, "smooth": smoothed}
    errors = {name: (values - truth)[w] / 1e3 for name, values in series.items()}
    return {
        **{f"error_{name}": rms(values) for name, values in errors.items()},
        **{f"mean_error_{name}": float(abs(values.mean())) for name, values in errors.items()},
        **smoothed_intervals(result, smooth_forces),
        "force": float(truth[w].mean() / 1e3),
    }


def _shock(result: TestResult) -> Row:
    """The first coupler as the wagons run up: peak against (6), and how oscillation about (6) decays."""
    m, end = result.measured, result.window.stop
    true = result.true_force + m.resistance
    steady = coupler_force_between(true[:, 0], m.mass[0], true[:, 1:].sum(axis=1), m.mass[1:].sum())
    first = m.coupler_force[:, 0]
    contact = int(np.argmax(first < -CONTACT))
    second = round(1.0 / SYSTEM.period)
    peak = contact + int(np.argmin(first[contact : contact + 2 * second]))
    about = first - steady
    noise = SYSTEM.coupler_noise

    def swing(part: slice) -> float:
        """Standard deviation without the sensor's noise [kN]."""
        return float(np.sqrt(max(float(np.var(about[part])) - noise**2, 0.0)) / 1e3)

    return {
        "contact": float(m.time[contact] - BRAKED_AT),
        "shock": float(-first[peak] / 1e3),
        "shock_ratio": float(first[peak] / steady[peak]),
        "swing_early": swing(slice(contact, contact + 4 * second)),
        "swing_late": swing(slice(end - 10 * second, end)),
        "compression": float(-first[end - 10 * second : end].mean() / 1e3),
    }


def _settling(result: TestResult) -> int:
    """Sample from which the accelerations of locomotive and first wagon agree until the end."""
    m, end = result.measured, result.window.stop
    second = round(1.0 / SYSTEM.period)
    apart = np.square(m.acceleration[:end, 0] - m.acceleration[:end, 1])
    running = np.sqrt(np.convolve(apart, np.ones(second) / second, "valid"))
    above = np.flatnonzero(running > AGREEMENT)
    return int(above[-1]) + second if above.size else 0


def _settled(result: TestResult) -> Row:
    """Errors of locomotive and wagons before and after relative motion has died out."""
    m, found, end = result.measured, estimate(result), result.window.stop
    start = int(np.searchsorted(m.time, BRAKED_AT))
    at = max(_settling(result), start + 1)
    truth = result.true_force
    locomotive = (found.locomotive - truth[:, 0]) / 1e3
    wagons = (found.wagons - truth[:, 1:].sum(axis=1)) / 1e3
    return {
        "settled": float(m.time[at] - BRAKED_AT) if at < end else float("nan"),
        "locomotive_before": rms(locomotive[start:at]),
        "locomotive_after": rms(locomotive[at:end]),
        "wagons_before": rms(wagons[start:at]),
        "wagons_after": rms(wagons[at:end]),
        "wagons_mean_after": float(np.mean(found.wagons[at:end]) / 1e3) if at < end else np.nan,
        "wagons_peak": float(np.abs(wagons[start:end]).max()),
    }


def _locomotive(result: TestResult) -> Row:
    """The locomotive's estimate while its pressure is steady."""
    m, end = result.measured, result.window.stop
    pressure = m.pressure[:end, 0]
    built = int(np.argmax(pressure >= BUILT_UP * np.median(pressure[(3 * end) // 4 :])))
    return {"locomotive": float(estimate(result).locomotive[built:end].mean() / 1e3)}


def _spikes(result: TestResult) -> Row:
    """The first coupler's force while all brake, and the wagons' error in and between its spikes."""
    w, m = result.window, result.measured
    first = m.coupler_force[w, 0]
    pressed = np.abs(first) > CONTACT
    error = (estimate(result).wagons - result.true_force[:, 1:].sum(axis=1))[w] / 1e3
    return {
        "coupler_median": float(np.median(np.abs(first)) / 1e3),
        "coupler_peak": float(np.abs(m.coupler_force[: w.stop, 0]).max() / 1e3),
        "spikes": int(np.sum(np.diff(pressed.astype(int)) == 1) + pressed[0]),
        "spike_share": float(pressed.mean()),
        "error_in_spikes": rms(error[pressed]),
        "error_between": rms(error[~pressed]),
    }


def _opposite(result: TestResult) -> Row:
    """Whether the cars beside the first coupler accelerate in opposite directions, in its spikes and between them (3.2.2).

    Both brake, so directions are those relative to the train: its acceleration is the mean of its cars' by mass. Errors are
    of the wagons' sum.
    """
    w, m = result.window, result.measured
    first, a = m.coupler_force[w, 0], m.acceleration[w]
    beside = a[:, :2] - (a @ m.mass / m.mass.sum())[:, None]
    opposite = beside[:, 0] * beside[:, 1] < 0.0
    apart = beside[:, 0] - beside[:, 1]
    pressed = np.abs(first) > CONTACT
    ends = np.flatnonzero(np.diff(np.concatenate([[False], pressed, [False]]).astype(int)))
    peaks = [start + int(np.argmax(np.abs(first[start:end]))) for start, end in ends.reshape(-1, 2)]
    error = (estimate(result).wagons - result.true_force[:, 1:].sum(axis=1))[w] / 1e3
    return {
        "opposite_at_spikes": float(opposite[peaks].mean()) if peaks else float("nan"),
        "opposite_between": float(opposite[~pressed].mean()),
        "coupler_opposite": rms(first[opposite]) / 1e3,
        "coupler_alike": rms(first[~opposite]) / 1e3,
        "apart_in_spikes": rms(apart[pressed]),
        "apart_between": rms(apart[~pressed]),
        "error_opposite": rms(error[opposite]),
        "error_alike": rms(error[~opposite]),
    }


def _by_wheel(result: TestResult) -> Row:
    """Estimate and theory by the speed of the foremost wheel, and by how much that is slower than the car [m/s]."""
    other = result.by_wheel()
    w, found = other.window, estimate(other)
    mean = float(found.wagons[w].mean())
    return {
        "wheel_mean": mean / 1e3,
        "wheel_over_theory": mean / float(other.test.wagons * found.theory[w].mean()),
        "wheel_slower": float((result.measured.speed - other.measured.speed)[w].mean()),
    }


def _theory(result: TestResult) -> Row:
    """Wagons' sum and first wagon against (8) and (7), over the window and its thirds."""
    w, found, wagons = result.window, estimate(result), result.test.wagons
    row: Row = {}
    for name, one, theory in (
        ("sum", found.wagons[w], wagons * found.theory[w]),
        ("wagon", found.wagon[w], found.theory[w]),
    ):
        thirds = [
            float(a.mean() / b.mean())
            for a, b in zip(np.array_split(one, 3), np.array_split(theory, 3), strict=True)
        ]
        row |= {
            f"{name}_over_theory": float(one.mean() / theory.mean()),
            f"{name}_theory_off": float(max(abs(ratio - 1.0) for ratio in thirds)),
            f"{name}_swing": rms(one - theory) / float(theory.mean()),
            f"{name}_force": float(theory.mean() / 1e3),
        }
    parts = np.array_split(found.theory[w], 3)
    row["theory_growth"] = float(parts[-1].mean() / parts[0].mean())
    true = result.true_force[w].mean(axis=0)
    row["true_sum_over_theory"] = float(true[1:].sum() / (wagons * found.theory[w].mean()))
    row["true_wagon_over_theory"] = float(true[1] / found.theory[w].mean())
    return row


def budget_rows(name: str, seed: int, beliefs: Sequence[str] = tuple(BELIEFS)) -> list[Row]:
    """Numbers of a running test as estimators see it that have one thing wrong."""
    runs: dict[float, TestResult] = {}
    rows = []
    for belief in beliefs:
        one = BELIEFS[belief]
        if one.grade not in runs:
            runs[one.grade] = run_test(name, seed, one.grade)
        row = row_of_test(name, runs[one.grade].believed(one, seed))
        rows.append(row | {"part": "budget", "belief": belief})
    return rows
