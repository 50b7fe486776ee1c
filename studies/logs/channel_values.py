"""The values of a log's channels in SI units, on their own instants: numbers checked, signs and units that nobody stated."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.estimation.known_train import MeasuredTrain
from alloc.plant.equations import GRAVITY
from studies.logs.assignment import Assigned
from studies.logs.remarks import Remark, faulty

Floats = NDArray[np.float64]

FASTEST = 160.0
"""Speed [m/s] that no train on wheels has exceeded in service or on test."""
BACKWARDS = -0.5
"""Speed [m/s] down to which a negative one passes as a sensor's noise at standstill."""
IMPLAUSIBLE = 0.01
"""Share of the values of a channel that may be impossible, and are left out."""
LARGEST_COEFFICIENT = 1.0
"""Force over axle load that no wheel on a rail carries (dry rail: 0.3 to 0.6)."""
MOVING = 1.0
"""Speed [m/s] above which a speed has a sign."""


def numbers(values: NDArray[Any], name: str, source: str) -> Floats:
    """Values as numbers; empty cells are nan. Raises for texts and for what is infinite."""
    if values.dtype.kind not in "iuf":
        texts = pd.Series(values)
        found = pd.to_numeric(texts, errors="coerce")
        bad = np.flatnonzero((found.isna() & texts.notna()).to_numpy())
        if bad.size or values.dtype.kind == "b":
            row = int(bad[0]) if bad.size else 0
            raise faulty(source, name, row + 1, f"{str(values[row])!r} is not a number")
        values = found.to_numpy(float)
    numbers = values.astype(np.float64, copy=False)
    infinite = np.flatnonzero(np.isinf(numbers))
    if infinite.size:
        raise faulty(source, name, int(infinite[0]) + 1, "is infinite")
    return numbers


def forwards(name: str, speed: Floats, source: str) -> tuple[Floats, list[Remark]]:
    """A speed [m/s] that counts forwards, and what was done to it; raises for speeds that no train has."""
    remarks = []
    moving = np.isfinite(speed) & (np.abs(speed) > MOVING)
    if moving.any() and np.mean(speed[moving] < 0.0) > 0.98:
        speed = -speed
        remarks.append(Remark("sign", name, "negative all the time: the direction is turned round"))
    for bad, reason in (
        (speed > FASTEST, "m/s is faster than any train; wrong unit?"),
        (speed < BACKWARDS, "m/s is negative; speeds count forwards, whichever way the train runs"),
    ):
        rows = np.flatnonzero(bad)
        if rows.size > IMPLAUSIBLE * speed.size:
            raise faulty(source, name, int(rows[0]) + 1, f"{speed[rows[0]]:.4g} {reason}")
        if rows.size:
            speed = np.where(bad, np.nan, speed)
            text = f"{rows.size} value{'s' if rows.size > 1 else ''} that no train has left out"
            remarks.append(Remark("faulty", name, text, int(rows[0]) + 1))
    return speed, remarks


def carried(name: str, force: Floats, load: float, source: str) -> tuple[Floats, list[Remark]]:
    """A force at the rim [N] that an axle load [N] can carry; raises where it cannot."""
    bad = np.abs(force) > LARGEST_COEFFICIENT * load
    rows = np.flatnonzero(bad)
    if rows.size == 0:
        return force, []
    if rows.size > IMPLAUSIBLE * force.size:
        raise faulty(
            source, name, int(rows[0]) + 1,
            f"{1e-3 * force[rows[0]]:.4g} kN at the rim exceed the axle load of {1e-3 * load:.4g} kN; wrong unit?",
        )  # fmt: skip
    text = f"{rows.size} value{'s' if rows.size > 1 else ''} beyond the axle load left out"
    return np.where(bad, np.nan, force), [Remark("faulty", name, text, int(rows[0]) + 1)]


def scale_of(
    one: Assigned, values: Floats, wheels: Floats | None, train: MeasuredTrain
) -> tuple[float, str, bool]:
    """Factor to SI, unit, and whether it is a turning speed, of a column without a unit, by the size of its values.

    `wheels` [m/s]: of another channel, at the same rows, where there is one.
    """
    size = float(np.nanquantile(np.abs(values), 0.99)) if np.isfinite(values).any() else 0.0
    if one.quantity == "speed":
        return (1.0 / 3.6, "km/h", False) if size > 50.0 or wheels is None else _speed(size, wheels)
    if one.quantity == "axleN_speed":
        radius = float(train.radius[min(one.number, train.radius.size) - 1])
        choices = [
            (1.0 / 3.6, "km/h", False, 1.0), (1.0, "m/s", False, 1.0), (1.0, "rad/s", True, radius),
            (2.0 * np.pi / 60.0, "rpm", True, radius),
        ]  # fmt: skip
        if wheels is None:
            return (2.0 * np.pi / 60.0, "rpm", True) if size > 350.0 else (1.0 / 3.6, "km/h", False)
        other = float(np.nanquantile(np.abs(wheels), 0.99))
        best = min(
            choices, key=lambda c: abs(np.log(max(size * c[0] * c[3], 1e-9) / max(other, 1e-9)))
        )
        return best[:3]
    load = (
        float(train.axle_load.max())
        if one.quantity.startswith("axle")
        else float(train.car_mass.sum()) * GRAVITY
    )
    if one.quantity == "axleN_torque":
        load *= float(train.radius.max())
    if one.quantity in ("axleN_force", "axleN_torque", "couplerK_force"):
        unit = "N m" if one.quantity == "axleN_torque" else "N"
        return (1.0, unit, False) if size > 2e-3 * load else (1e3, "k" + unit, False)
    if one.quantity == "gradient":
        return (1e-3, "permille", False) if size > 0.1 else (1.0, "m/m", False)
    if one.quantity.endswith("pressure"):
        return (1e5, "bar", False) if size < 15.0 else (1e3, "kPa", False)
    return 1.0, {"position": "m"}.get(one.quantity, "m/s2"), False


def _speed(size: float, wheels: Floats) -> tuple[float, str, bool]:
    other = float(np.nanquantile(np.abs(wheels), 0.99))
    choices = ((1.0 / 3.6, "km/h", False), (1.0, "m/s", False))
    return min(choices, key=lambda c: abs(np.log(max(size * c[0], 1e-9) / max(other, 1e-9))))
