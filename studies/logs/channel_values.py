"""The values of a log's channels in SI units, on their own instants: numbers checked, signs and units that nobody stated."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import excerpt
from studies.logs.own_samples import pulse_step
from studies.logs.recorder_files import numbers_of
from studies.logs.remarks import NAMED, Remark, faulty

Floats = NDArray[np.float64]

FASTEST = 160.0
"""Speed [m/s] that no train on wheels has exceeded in service or on test."""
BACKWARDS = -2.0
"""Speed [m/s] down to which a negative one passes: noise at standstill, or a train that rolls back."""
IMPLAUSIBLE = 0.01
"""Share of the values of a channel that may be impossible, and are left out."""
LARGEST_COEFFICIENT = 1.0
"""Force over axle load that no wheel on a rail carries (dry rail: 0.3 to 0.6)."""
FEWEST = 20
"""Values of a channel from which on one that stands for none can be told."""
MOST_STAND_INS = 0.3
"""Share of the values of a channel that one may be, if it stands for none."""
FAR = 2.0
"""Distance of such a value from all others, in their range and in their size."""
STAND_INS = (9999.0, 99999.0, 999.0, 999.9, 9999.9, 32767.0, 32768.0, 65535.0)
"""Sizes of values that recorders write for none; such a one counts even if it is there once, or alone differs."""
MOVING = 1.0
"""Speed [m/s] above which a speed has a sign."""


def numbers(values: NDArray[Any], name: str, source: str) -> tuple[Floats, list[Remark]]:
    """Values as numbers, and remarks; empty cells, words and infinite ones are nan. Raises for other texts."""
    remarks = []
    if values.dtype.kind == "b":
        raise faulty(source, name, 1, f"{str(values[0])!r} is not a number")
    if values.dtype.kind not in "iuf":
        found = numbers_of(values)
        if found.wrong is not None or np.isnan(found.values).all():
            row = found.wrong or 0
            raise faulty(source, name, row + 1, f"{str(values[row])!r} is not a number")
        values = found.values
        if found.words:
            words = ", ".join(repr(word) for word, _ in found.words.most_common(NAMED))
            text = f"{words} in {found.words.total()} rows: no value"
            remarks.append(Remark("missing", name, text))
    numbers = values.astype(np.float64, copy=False)
    infinite = np.flatnonzero(np.isinf(numbers))
    if infinite.size:
        numbers = np.where(np.isinf(numbers), np.nan, numbers)
        text = f"infinite in {infinite.size} rows: no value"
        remarks.append(Remark("missing", name, text, int(infinite[0]) + 1))
    stands_for_none = _in_place_of_none(numbers)
    if stands_for_none:
        for value in stands_for_none:
            alike = numbers == value
            text = f"{value:g} in {int(alike.sum())} rows, far from all others: no value"
            remarks.append(Remark("missing", name, text, int(np.flatnonzero(alike)[0]) + 1))
            numbers = np.where(alike, np.nan, numbers)
    return numbers, remarks


def _in_place_of_none(values: Floats) -> list[float]:
    """Numbers such as -9999 that stand for no value: an end of the range, far from all others, again and again."""
    found: list[float] = []
    known = values[np.isfinite(values)]
    for _ in range(2):
        if known.size < FEWEST:
            break
        some = excerpt(known)
        for end in (float(known.min()), float(known.max())):
            if not _is_far(end, some[some != end]):  # nor is it from all others
                continue
            others = known[known != end]
            times = known.size - others.size
            usual = abs(end) in STAND_INS
            least = 1 if usual else 2
            if not least <= times <= MOST_STAND_INS * known.size:
                continue
            if not usual and np.unique(others[:FEWEST]).size < 2:
                continue
            if _is_far(end, others):
                found.append(end)
                known = others
                break
        else:
            break
    return found


def _is_far(end: float, others: Floats) -> bool:
    """Whether an end of a range is far from all others, in their range and in their size; true where there are none."""
    if others.size == 0:
        return True
    apart = np.abs(others - end).min()
    return bool(apart / FAR > max(np.ptp(others), np.abs(others).max()))


def forwards(name: str, speed: Floats, source: str) -> tuple[Floats, list[Remark]]:
    """A speed [m/s] that counts forwards, and what was done to it; raises for speeds that no train has."""
    remarks = []
    moving = np.isfinite(speed) & (np.abs(speed) > MOVING)
    if moving.any() and np.mean(speed[moving] < 0.0) > 0.98:
        speed = -speed
        remarks.append(Remark("sign", name, "negative all the time: the direction is turned round"))
    backwards = speed < BACKWARDS
    if backwards.any():
        # one pulse back in a row is no speed: the wheel rolls back a little
        backwards = speed < BACKWARDS - pulse_step(speed[np.isfinite(speed)])
    for bad, reason in (
        (speed > FASTEST, "m/s is faster than any train; wrong unit?"),
        (backwards, "m/s is negative; speeds count forwards, whichever way the train runs"),
    ):
        rows = np.flatnonzero(bad)
        if rows.size > IMPLAUSIBLE * speed.size:
            raise faulty(source, name, int(rows[0]) + 1, f"{speed[rows[0]]:.4g} {reason}")
        if rows.size:
            speed = np.where(bad, np.nan, speed)
            text = f"{rows.size} value{'s' if rows.size > 1 else ''} that no train has left out"
            remarks.append(Remark("faulty", name, text, int(rows[0]) + 1))
    return speed, remarks


def carried(name: str, force: Floats, load: float) -> tuple[Floats, list[Remark]]:
    """A force at the rim [N] without single values that no axle load [N] carries; where many are, its unit is wrong."""
    bad = np.abs(force) > LARGEST_COEFFICIENT * load
    rows = np.flatnonzero(bad)
    if rows.size == 0:
        return force, []
    if rows.size > IMPLAUSIBLE * force.size:
        return force, []
    text = f"{rows.size} value{'s' if rows.size > 1 else ''} beyond the axle load left out"
    return np.where(bad, np.nan, force), [Remark("faulty", name, text, int(rows[0]) + 1)]
