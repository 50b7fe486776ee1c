"""What is wrong with a log: faults that make it useless end the analysis, all others are reported and cut out.

Nothing is repaired: no value is interpolated, sorted, scaled or filled in. A stretch that cannot be used is left out, and
the parts before and after it are analysed each by itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.estimation.measured_run import MeasuredTrain
from alloc.plant.equations import GRAVITY
from alloc.spans import spans
from studies.files.study_error import StudyError

Floats = NDArray[np.float64]

FEWEST_ROWS = 10
GAP_EVEN, GAP_UNEVEN = 1.5, 2.5
"""Sampling periods between two rows that make a gap: a single lost row, or more where the sampling is uneven anyway."""
EVEN = 0.95
"""Share of the steps within a tenth of the period from which on sampling is even."""
COARSE = 0.25
"""Sampling period [s] above which slips are missed."""
FASTEST = 160.0
"""Speed [m/s] that no train on wheels has exceeded in service or on test."""
BACKWARDS = -0.5
"""Speed [m/s] down to which a negative one passes as a sensor's noise at standstill."""
STUCK_TIME = 1.0
"""Time [s] for which a speed may stay exactly the same while others change by `STUCK_CHANGE` [m/s]."""
STUCK_CHANGE = 0.5
CONSTANT_TIME = 10.0
"""Time [s] for which a measured force never is exactly constant."""
RADIUS_ERROR = 0.005
"""Deviation of a rolling wheel's speed from the train's that its radius explains and that spoils Q."""
LARGEST_COEFFICIENT = 1.0
"""Force over axle load that no wheel on a rail carries (dry rail: 0.3 to 0.6)."""
BALANCE = (0.6, 1.6)
"""Momentum gained over impulse of the forces, between which a log agrees with itself."""
BALANCE_WINDOW = 1.0
LEAST_EFFORT = 0.02
"""Sum of forces over weight from which the balance is drawn: below it gradients and resistance count as much."""


@dataclass(frozen=True)
class Remark:
    """Something that is wrong with a log and does not prevent its analysis; times in s, rows from 1 below the header."""

    kind: str
    column: str
    text: str
    row: int | None = None
    time: float | None = None


class Faulty(StudyError):
    """A log that cannot be analysed."""


def faulty(source: str, column: str, row: int | None, reason: str) -> Faulty:
    """The error for a log: one line with file, column and row."""
    where = "" if row is None else f", row {row}"
    return Faulty(f"log {source!r}: column {column!r}{where}: {reason}")


def check_numbers(table: pd.DataFrame, columns: list[str], source: str) -> None:
    """Raise for too few rows, and for what is not a number, or infinite; empty cells pass as nan."""
    if len(table) < FEWEST_ROWS:
        text = f"{len(table)} rows; give {FEWEST_ROWS} or more to be analysed"
        raise faulty(source, "time_s", None, text)
    for name in columns:
        values = table[name]
        if not pd.api.types.is_numeric_dtype(values) or pd.api.types.is_bool_dtype(values):
            numbers = pd.to_numeric(values, errors="coerce")
            bad = np.flatnonzero(numbers.isna() & values.notna())
            row = int(bad[0]) if bad.size else 0
            raise faulty(source, name, row + 1, f"{str(values.iloc[row])!r} is not a number")
        infinite = np.flatnonzero(np.isinf(values.to_numpy(float)))
        if infinite.size:
            raise faulty(source, name, int(infinite[0]) + 1, "is infinite")


def check_time(time: Floats, source: str) -> tuple[NDArray[np.int64], list[Remark]]:
    """Number of the part of each instant, and gaps and uneven sampling; raises for a time that does not grow."""
    name = "time_s"
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        raise faulty(source, name, int(missing[0]) + 1, "has no time")
    step = np.diff(time)
    wrong = np.flatnonzero(step <= 0.0)
    if wrong.size:
        row = int(wrong[0]) + 1
        what = "is repeated" if step[row - 1] == 0.0 else "goes back"
        raise faulty(
            source, name, row + 1, f"time {what}: {time[row]:.9g} s after {time[row - 1]:.9g} s"
        )
    period = float(np.median(step))
    is_even = np.mean(np.abs(step / period - 1.0) < 0.1) > EVEN
    apart = step > (GAP_EVEN if is_even else GAP_UNEVEN) * period
    gaps = np.flatnonzero(apart)
    remarks = [
        Remark(
            "gap", name, f"gap of {step[k]:.4g} s from {time[k]:.6g} s to {time[k + 1]:.6g} s",
            int(k) + 1, float(time[k]),
        )
        for k in gaps
    ]  # fmt: skip
    near = step[~apart]
    uneven = np.abs(near / period - 1.0) > 0.1
    if uneven.mean() > 0.01:
        remarks.append(
            Remark(
                "sampling", name,
                f"uneven sampling: {100.0 * uneven.mean():.0f} % of the steps differ from {period:.4g} s by more than "
                f"10 % ({near.min():.4g} to {near.max():.4g} s); the times are used as they are",
            )
        )  # fmt: skip
    if period > COARSE:
        remarks.append(
            Remark("sampling", name, f"a row every {period:.4g} s: short slips are missed")
        )
    return np.concatenate([[0], np.cumsum(apart)]), remarks


def missing_values(name: str, values: Floats, time: Floats) -> list[Remark]:
    """Where a column has no value."""
    remarks = []
    for begin, end in spans(~np.isfinite(values)).tolist():
        rows = f"row {begin + 1}" if end == begin + 1 else f"rows {begin + 1} to {end}"
        text = f"no value in {rows}, {time[begin]:.6g} s to {time[end - 1]:.6g} s"
        if end - begin == values.size:
            text = "no value at all"
        remarks.append(Remark("missing", name, text, begin + 1, float(time[begin])))
    return remarks


def check_speed(name: str, values: Floats, source: str) -> None:
    """Raise for speeds [m/s] that no train has."""
    for bad, reason in (
        (values > FASTEST, "m/s is faster than any train; wrong unit?"),
        (
            values < BACKWARDS,
            "m/s is negative; speeds count forwards, whichever way the train runs",
        ),
    ):
        rows = np.flatnonzero(bad)
        if rows.size:
            raise faulty(source, name, int(rows[0]) + 1, f"{values[rows[0]]:.4g} {reason}")


def check_force(name: str, force: Floats, load: float, source: str) -> None:
    """Raise for a force at the rim [N] that exceeds the axle load [N]."""
    rows = np.flatnonzero(np.abs(force) > LARGEST_COEFFICIENT * load)
    if rows.size:
        raise faulty(
            source, name, int(rows[0]) + 1,
            f"{1e-3 * force[rows[0]]:.4g} kN at the rim exceed the axle load of {1e-3 * load:.4g} kN; wrong unit?",
        )  # fmt: skip


def check_constant(name: str, force: Floats, time: Floats) -> list[Remark]:
    """Whether a force has one and the same value, not zero, all the time."""
    if force[0] == 0.0 or not np.all(force == force[0]) or time[-1] - time[0] < CONSTANT_TIME:
        return []
    return [Remark("stuck", name, "the same value all the time: a dead channel, or a set value?")]


def check_ratio(name: str, rim: Floats, train_name: str, speed: Floats, source: str) -> None:
    """Raise where wheels and train differ by the factor between m/s and km/h all the time."""
    moving = np.isfinite(rim) & np.isfinite(speed) & (speed > 2.0)
    if moving.sum() < FEWEST_ROWS:
        return
    low, middle, high = np.quantile(rim[moving] / speed[moving], (0.25, 0.5, 0.75))
    for factor in (3.6, 1.0 / 3.6):
        if abs(middle / factor - 1.0) < 0.08 and high - low < 0.1 * middle:
            raise faulty(
                source, name, None,
                f"{middle:.3g} times the train's speed in column {train_name!r} all the time: "
                "km/h and m/s are mixed up",
            )  # fmt: skip


def stuck(values: Floats, other: Floats, time: Floats) -> Iterator[slice]:
    """Stretches in which a speed stays exactly the same although the `other` one changes."""
    same = np.concatenate([np.diff(values) == 0.0, [False]])
    for begin, end in spans(same).tolist():
        inside = slice(begin, end + 1)
        if time[end] - time[begin] < STUCK_TIME or end - begin < FEWEST_ROWS:
            continue
        seen = other[inside][np.isfinite(other[inside])]
        if seen.size and seen.max() - seen.min() > STUCK_CHANGE:
            yield inside


def check_radius(name: str, rim: Floats, speed: Floats, share: Floats) -> list[Remark]:
    """Whether a wheel that neither pulls nor brakes turns as fast as the train runs; `share`: force over load."""
    rolling = (np.abs(share) < 0.01) & (speed > 5.0) & np.isfinite(rim)
    if rolling.sum() < FEWEST_ROWS:
        return []
    error = float(np.median(rim[rolling] / speed[rolling])) - 1.0
    if abs(error) <= RADIUS_ERROR:
        return []
    text = (
        f"turns {100.0 * abs(error):.1f} % {'faster' if error > 0.0 else 'slower'} than the train where it rolls "
        "freely: wheel radius or scale of a speed; Q and slips contain that"
    )
    return [Remark("radius", name, text)]


def check_balance(
    time: Floats, part: NDArray[np.int64], speed: Floats, rim: Floats, force: Floats,
    train: MeasuredTrain,
) -> list[Remark]:  # fmt: skip
    """Whether the train gains the momentum that its forces give it; says nothing where a force is missing."""
    used = np.abs(force[np.isfinite(force)]).max(initial=0.0) / train.axle_load.min()
    width = max(int(BALANCE_WINDOW / np.median(np.diff(time))), 1)
    rate = np.abs(speed[width:] - speed[:-width]) / (time[width:] - time[:-width])
    fastest = rate[np.isfinite(rate) & (part[width:] == part[:-width])].max(initial=0.0)
    if 0.0 < used < 0.25 * LEAST_EFFORT and fastest > LEAST_EFFORT * GRAVITY:
        text = (
            f"no axle's force exceeds {100.0 * used:.2g} % of the axle load, but the train's speed changes by "
            f"{fastest:.2g} m/s2: wrong unit?"
        )
        return [Remark("balance", "axleN_force", text)]
    momentum = (
        train.car_mass.sum() * speed + (train.inertia / train.radius**2 * rim).sum(axis=1)
    )  # fmt: skip
    total = force.sum(axis=1)
    gained, given = [], []
    for begin in range(0, time.size - width, width):
        end = begin + width
        impulse = np.trapezoid(total[begin : end + 1], time[begin : end + 1])
        mean = impulse / (time[end] - time[begin])
        if part[begin] == part[end] and abs(mean) > LEAST_EFFORT * train.car_mass.sum() * GRAVITY:
            gained.append(momentum[end] - momentum[begin])
            given.append(impulse)
    known = np.isfinite(gained) & np.isfinite(given)
    if known.sum() < 3:
        return []
    x, y = np.array(given)[known], np.array(gained)[known]
    ratio = float(x @ y / (x @ x))
    if BALANCE[0] < ratio < BALANCE[1]:
        return []
    cause = (
        "wrong sign of the forces" if ratio < 0.0 else "wrong unit, torque at the motor, or train"
    )
    text = (
        f"the train gains {ratio:.2g} times the momentum that the axles' forces give it: {cause}?"
    )
    return [Remark("balance", "axleN_force", text)]
