"""Whether the forces of a log give the train the momentum that it gains: signs, units, gradients."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import usual_period
from alloc.plant.laws import GRAVITY
from studies.logs.common_instants import Instants
from studies.logs.known_train import MeasuredTrain
from studies.logs.remarks import Remark

Floats = NDArray[np.float64]

BALANCE = (0.6, 1.6)
"""Momentum gained over impulse of the forces, between which a log agrees with itself."""
STEEPEST = 0.045
"""Rise per run up to which a gradient may be the cause."""
BALANCE_WINDOW = 1.0
LEAST_EFFORT = 0.02
"""Sum of forces over weight from which the balance is drawn: below it gradients and resistance count as much."""
LEAST_CHANGE = 0.01
"""Change of that sum, root mean square, from which a scale of the forces shows apart from gradient and resistance."""
SCALED = 0.1
"""Deviation of that scale from 1 that is remarked on, ..."""
SURE = 5.0
"""... if it is as many times its standard deviation."""
FEWEST_WINDOWS = 8
LEAST_GAIN = 0.06
"""Rate of the train's momentum over its weight that no gradient gives: there the balance is drawn too."""
MISREAD = {
    "Speeds in mile/h that are taken for km/h": 0.6214,
    "Speeds in km/h that are taken for mile/h": 1.609,
    "Speeds in m/s that are taken for km/h": 1.0 / 3.6,
    "Speeds in km/h that are taken for m/s": 3.6,
    "Forces in kN that are taken for N": 1e3,
    "Forces in N that are taken for kN": 1e-3,
    "Forces in kgf or daN that are taken for N": 9.9,
    "Forces in lbf that are taken for N": 4.448,
}
"""Momentum gained over impulse of the forces, by the units that are mixed up."""
ALIKE = 0.05
"""Relative difference up to which such a value fits."""
FEWEST_AXLES = 4
"""Axles with a force of which one may have the wrong sign."""
ALIKE_FORCES = 0.8
"""Correlation, not less its mean, with the others' from which on a force is that of the others, or against them."""
LITTLE_WORK, NEARLY_ALL = 0.01, 0.9
"""Share of an axle in all work of friction from which on it counts, and share of such axles that must agree."""
MOVING = 2.0
"""Speed [m/s] from which on a balance of momentum says something: at rest a brake holds what pulls."""


class Balance(NamedTuple):
    """Momentum that a train gains beyond the effect of its forces."""

    ratio: float
    """The former over the latter."""
    rise: float
    """Rise per run that would make the difference."""


def momentum_balance(
    instants: Instants,
    speed: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    grade: Floats | None,
) -> Balance | None:
    """The balance of momentum; None where it cannot be determined."""
    gain = _gains(instants, speed, rim, force, train, grade)
    used = np.abs(gain.given / gain.lasts) > LEAST_EFFORT * train.car_mass.sum() * GRAVITY
    used |= np.abs(gain.gained / gain.lasts) > LEAST_GAIN * train.car_mass.sum() * GRAVITY
    used &= np.isfinite(gain.gained) & np.isfinite(gain.given)
    if used.sum() < 3:
        return None
    x, y = gain.given[used], gain.gained[used]
    lasts = float(np.sum(gain.lasts[used]))
    rise = float(np.sum(x - y)) / (lasts * float(train.car_mass.sum()) * GRAVITY)
    return Balance(float(x @ y / max(float(x @ x), 1e-9)), rise)


class _Gains(NamedTuple):
    """Of windows of a log, (windows,)."""

    given: Floats
    """Impulse of the forces [N s]; nan over a gap."""
    gained: Floats
    """Momentum of train and wheelsets [N s]."""
    lasts: Floats
    """[s]"""
    middle_speed: Floats
    """[m/s]"""


def _gains(
    instants: Instants,
    speed: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    grade: Floats | None,
) -> _Gains:
    time, part = instants
    width = max(int(BALANCE_WINDOW / usual_period(time)), 1)
    rotating = train.inertia / train.radius**2
    momentum, total = train.car_mass.sum() * speed, np.zeros(time.size)
    for i in range(train.radius.size):
        momentum = momentum + rotating[i] * rim[:, i]
        total += force[:, i]
    if grade is not None:
        total -= train.car_mass.sum() * GRAVITY * grade
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (total[1:] + total[:-1]) * np.diff(time))])
    begin = np.arange(0, time.size - width, width)
    end = begin + width
    given, gained = impulse[end] - impulse[begin], momentum[end] - momentum[begin]
    if np.isnan(impulse[-1]):  # cumulated over what is missing: window by window
        windows = [slice(a, b + 1) for a, b in zip(begin, end, strict=True)]
        given = np.array([np.trapezoid(total[w], time[w]) for w in windows])
    given = np.where(part[begin] == part[end], given, np.nan)
    return _Gains(given, gained, time[end] - time[begin], 0.5 * (speed[begin] + speed[end]))


class Scale(NamedTuple):
    """Momentum gained by a change of the forces over the impulse of that change."""

    value: float
    deviation: float


def scale_of_forces(
    instants: Instants,
    speed: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    grade: Floats | None = None,
) -> Scale | None:
    """By what changes of the forces must be multiplied to change the train's motion as measured; None where it is open.

    A gradient is a constant beside it, and the air resistance goes with the square of the speed: neither enters.
    """
    gain = _gains(instants, speed, rim, force, train, grade)
    weight = float(train.car_mass.sum()) * GRAVITY
    mean = gain.middle_speed
    used = np.isfinite(gain.given) & np.isfinite(gain.gained) & (mean > MOVING)
    if used.sum() < FEWEST_WINDOWS:
        return None
    lasts, x, y = gain.lasts[used], gain.given[used], gain.gained[used]
    beside = np.stack([lasts, lasts * mean[used] ** 2], axis=1)
    beside /= np.abs(beside).max(axis=0)
    # what the others cannot stand for
    x, y = (v - beside @ np.linalg.lstsq(beside, v, rcond=None)[0] for v in (x, y))
    if np.sqrt(np.mean((x / lasts) ** 2)) < LEAST_CHANGE * weight:
        return None
    value = float(x @ y / (x @ x))
    rest = float(np.sum((y - value * x) ** 2)) / (x.size - 3)
    return Scale(value, float(np.sqrt(rest / (x @ x))))


def forwards_too(
    instants: Instants,
    speed: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    turned: bool,
) -> tuple[Floats, list[Remark]]:
    """Forces turned round where only that makes them agree with the motion, all of them or single axles'.

    `turned`: whether the speeds were too.
    """
    scale = scale_of_forces(instants, speed, rim, force, train)
    sure = (
        scale is not None
        and -BALANCE[1] < scale.value < -BALANCE[0]
        and scale.deviation * SURE < abs(scale.value)
    )
    drives = not sure and _drives_slip(instants.time, speed, rim, force)
    if not sure and (turned or drives):
        balance = momentum_balance(instants, speed, rim, force, train, None)
        # where the forces would drive the wheels' slip too, a gradient may add to what they give
        least = -math.inf if drives else -BALANCE[1]
        sure = balance is not None and least < balance.ratio < -BALANCE[0]
    remarks = []
    if sure:
        force = -force
        how = (
            "turned round with the speeds"
            if turned
            else "braking counts positive in the log; turned round"
        )
        text = f"by the motion the forces count the other way round: {how}"
        remarks.append(Remark("sign", "axleN_force", text))
    force, more = _each_forwards(instants.time, speed, rim, force, train)
    return force, remarks + more


def _drives_slip(time: Floats, speed: Floats, rim: Floats, force: Floats) -> bool:
    """Whether the forces would drive the slip of nearly all wheels: friction brakes it."""
    work = np.array(
        [
            np.trapezoid(np.nan_to_num(force[:, i] * (rim[:, i] - speed)), time)
            for i in range(rim.shape[1])
        ]
    )
    told = np.abs(work) > LITTLE_WORK * np.abs(work).sum()
    return bool(told.any() and np.mean(work[told] < 0.0) > NEARLY_ALL)


def _each_forwards(
    time: Floats, speed: Floats, rim: Floats, force: Floats, train: MeasuredTrain
) -> tuple[Floats, list[Remark]]:
    """Forces of single axles turned round where they are against all others, and would drive the wheel's slip."""
    share = np.nan_to_num(force)
    share /= train.axle_load
    told = np.flatnonzero(share.any(axis=0))
    if told.size < FEWEST_AXLES:
        return force, []
    total, remarks = share.sum(axis=1), []
    for i in told.tolist():
        own, others = share[:, i], total - share[:, i]
        alike = float(own @ others) / max(np.sqrt(float(own @ own) * float(others @ others)), 1e-12)
        power = np.nan_to_num(force[:, i] * (rim[:, i] - speed))
        if alike > -ALIKE_FORCES or np.trapezoid(power, time) >= 0.0:
            continue
        force = force.copy()
        force[:, i] *= -1.0
        text = "against the forces of all other axles, and it would drive what brakes the wheel: turned round"
        remarks.append(Remark("sign", f"axle{i + 1}_force", text))
    return force, remarks


def fitting_units(ratio: float) -> str:
    """Which units mixed up would give this `ratio` of momentum gained over impulse: a sentence to go on with, or ""."""
    if ratio <= 0.0:
        return ""
    what, value = min(MISREAD.items(), key=lambda one: abs(math.log(ratio / one[1])))
    return f" {what} would make it {value:.2g}" if abs(math.log(ratio / value)) < ALIKE else ""


def check_balance(
    instants: Instants,
    speed: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    grade: Floats | None = None,
) -> list[Remark]:
    """Whether the train gains the momentum of its forces; gives no remark where a force is missing."""
    time, part = instants
    used = 0.0
    if np.isfinite(force).any():
        used = float(np.nanmax(np.abs(force))) / float(train.axle_load.min())
    width = max(int(BALANCE_WINDOW / usual_period(time)), 1)
    rate = np.abs(speed[width:] - speed[:-width]) / (time[width:] - time[:-width])
    fastest = rate[np.isfinite(rate) & (part[width:] == part[:-width])].max(initial=0.0)
    if 0.0 < used < 0.25 * LEAST_EFFORT and fastest > LEAST_EFFORT * GRAVITY:
        text = (
            f"no axle's force exceeds {100.0 * used:.2g} % of the axle load, but the train's speed changes by "
            f"{fastest:.2g} m/s2: wrong unit?"
        )
        return [Remark("balance", "axleN_force", text)]
    balance = momentum_balance(instants, speed, rim, force, train, grade)
    if balance is None or BALANCE[0] < balance.ratio < BALANCE[1]:
        scale = scale_of_forces(instants, speed, rim, force, train, grade)
        if scale is None or abs(scale.value - 1.0) < max(SCALED, SURE * scale.deviation):
            return []
        text = (
            f"changes of the axles' forces give the train {scale.value:.2g} ± {scale.deviation:.2g} times their impulse: "
            f"wrong unit of speeds or forces, or train?{fitting_units(scale.value)}"
        )
        return [Remark("balance", "axleN_force", text)]
    ratio, rise = balance
    cause = (
        "wrong sign of the forces" if ratio < 0.0 else "wrong unit, torque at the motor, or train"
    )
    if grade is None and abs(rise) < STEEPEST:
        cause = f"a gradient of {1e3 * rise:+.0f} per mille, {cause}"
    text = (
        f"the train gains {ratio:.2g} times the momentum that the axles' forces give it: {cause}?"
        f"{fitting_units(ratio)}"
    )
    return [Remark("balance", "axleN_force", text)]
