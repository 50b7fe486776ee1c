"""What is wrong with the series of a log at common instants; remarks on all of it, and what cannot be used is cut out."""

import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.common_instants import Instants
from alloc.estimation.known_train import MeasuredTrain
from alloc.estimation.own_samples import Samples
from alloc.plant.equations import GRAVITY
from alloc.spans import spans
from studies.logs.remarks import Remark, faulty
from studies.logs.told_channels import FEWEST_ROWS, Sources

Floats = NDArray[np.float64]

COARSE = 0.25
"""Sampling period [s] above which slips are missed."""
STUCK_TIME = 1.0
"""Time [s] for which a speed may stay exactly the same while others change by `STUCK_CHANGE` [m/s]."""
STUCK_CHANGE = 0.5
STUCK_SAMPLES = 4
"""The same in samples of a slow channel."""
OFTEN = 0.1
"""Time [s] between two looks at all wheels."""
CONSTANT_TIME = 10.0
"""Time [s] for which a measured force never is exactly constant."""
DEAD_SHARE = 0.95
"""Share of the time under way for which a wheel's speed is exactly zero, if its sensor is dead and not the wheel locked."""
RADIUS_ERROR = 0.005
"""Deviation of a rolling wheel's speed from the train's that its radius explains and that spoils Q."""
ROLLING = 0.01
"""Force over load below which a wheel without a motor rolls; a driven one pulls as much on a climb."""
OTHER_UNIT = 1.5
"""Factor between two speeds from which on their units differ: less than that between miles and kilometres."""
BALANCE = (0.6, 1.6)
"""Momentum gained over impulse of the forces, between which a log agrees with itself."""
STEEPEST = 0.045
"""Rise per run up to which a gradient may be the cause."""
BALANCE_WINDOW = 1.0
LEAST_EFFORT = 0.02
"""Sum of forces over weight from which the balance is drawn: below it gradients and resistance count as much."""


def check_instants(instants: Instants) -> list[Remark]:
    """Gaps and uneven or coarse sampling of the common instants."""
    time, part = instants
    step = np.diff(time)
    period = float(np.median(step))
    gaps = np.flatnonzero(np.diff(part))
    remarks = [
        Remark(
            "gap", "time", f"gap of {step[k]:.4g} s from {time[k]:.6g} s to {time[k + 1]:.6g} s",
            int(k) + 1, float(time[k]),
        )
        for k in gaps
    ]  # fmt: skip
    near = step[np.diff(part) == 0]
    uneven = np.abs(near / period - 1.0) > 0.1
    if uneven.size and uneven.mean() > 0.01:
        remarks.append(
            Remark(
                "sampling", "time",
                f"uneven sampling: {100.0 * uneven.mean():.0f} % of the steps differ from {period:.4g} s by more than "
                f"10 % ({near.min():.4g} to {near.max():.4g} s); the times are used as they are",
            )
        )  # fmt: skip
    if period > COARSE:
        text = f"wheels every {period:.4g} s: short slips are missed"
        remarks.append(Remark("sampling", "time", text))
    return remarks


def check_constant(name: str, force: Floats, time: Floats) -> list[Remark]:
    """Whether a force has one and the same value, not zero, all the time."""
    if force.size == 0 or force[0] == 0.0 or not np.all(force == force[0]):
        return []
    if time[-1] - time[0] < CONSTANT_TIME:
        return []
    return [Remark("stuck", name, "the same value all the time: a dead channel, or a set value?")]


def check_ratio(name: str, rim: Floats, train_name: str, speed: Floats, source: str) -> None:
    """Raise where wheels and train differ all the time by a factor that no slip has: that between two units."""
    moving = np.isfinite(rim) & np.isfinite(speed) & (speed > 2.0)
    if moving.sum() < FEWEST_ROWS:
        return
    low, middle, high = np.quantile(rim[moving] / speed[moving], (0.25, 0.5, 0.75))
    if high - low >= 0.1 * middle or 1.0 / OTHER_UNIT < middle < OTHER_UNIT:
        return
    known = any(abs(middle / factor - 1.0) < 0.08 for factor in (3.6, 1.0 / 3.6))
    reason = (
        "km/h and m/s are mixed up"
        if known
        else "their units do not agree; say them in a mapping file"
    )
    raise faulty(
        source, name, None,
        f"{middle:.3g} times the train's speed in column {train_name!r} all the time: {reason}",
    )  # fmt: skip


def stuck(values: Floats, other: Floats, time: Floats, least: int = FEWEST_ROWS) -> Iterator[slice]:
    """Stretches in which a speed stays exactly the same although the `other` one changes."""
    same = np.concatenate([np.diff(values) == 0.0, [False]])
    for begin, end in spans(same).tolist():
        inside = slice(begin, end + 1)
        if time[end] - time[begin] < STUCK_TIME or end - begin < least:
            continue
        seen = other[inside][np.isfinite(other[inside])]
        if seen.size and seen.max() - seen.min() > STUCK_CHANGE:
            yield inside


def without_stuck(
    fixes: Samples, instants: Instants, rim: Floats, name: str, remarks: list[Remark]
) -> Samples:
    """Measurements of the train's speed without those that do not move while the wheels do."""
    if fixes.time.size < STUCK_SAMPLES:
        return fixes
    every = max(int(OFTEN / np.median(np.diff(instants.time))), 1)
    wheels, time = _median(rim[::every]), instants.time[::every]
    known = np.isfinite(wheels)
    if not known.any():
        return fixes
    other = np.interp(fixes.time, time[known], wheels[known])
    least = STUCK_SAMPLES if fixes.period > 0.1 else FEWEST_ROWS
    keep = np.ones(fixes.time.size, dtype=bool)
    for inside in stuck(fixes.value, other, fixes.time, least):
        keep[inside] = False
        remarks.append(
            _stuck(name, fixes.time, inside, "stuck: the wheels' speeds change; cut out")
        )
    return fixes if keep.all() else fixes._replace(time=fixes.time[keep], value=fixes.value[keep])


def cut_out_stuck(
    names: dict[int, str], time: Floats, speed: Floats | None, rim: Floats
) -> list[Remark]:
    """Cut out, in place, speeds of wheels that do not move while the train does; one at rest may be locked and is kept.

    Without the train's speed the wheels' median replaces it.
    """
    remarks = []
    speed = _median(rim) if speed is None else speed
    under_way = speed > STUCK_CHANGE
    for number, name in names.items():
        own = rim[:, number - 1]
        dead = bool(under_way.any()) and np.mean(own[under_way] == 0.0) > DEAD_SHARE
        for inside in list(stuck(own, speed, time)):
            if own[inside.start] == 0.0 and not dead:
                text = "zero while the train runs: a locked wheel, and taken for one"
            else:
                text = "stuck: the train's speed changes; cut out"
                own[inside] = np.nan
            remarks.append(_stuck(name, time, inside, text))
    return remarks


def _stuck(name: str, time: Floats, inside: slice, text: str) -> Remark:
    begin, end = float(time[inside.start]), float(time[inside.stop - 1])
    return Remark("stuck", name, f"{text}, {begin:.6g} s to {end:.6g} s", inside.start + 1, begin)


def _median(rim: Floats) -> Floats:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # rows without any wheel
        return np.asarray(np.nanmedian(rim, axis=1))


def check_radius(
    name: str, rim: Floats, speed: Floats, share: Floats, deviation: Floats | None = None
) -> list[Remark]:
    """Whether a wheel that neither pulls nor brakes turns as fast as the train runs; `share`: force over load.

    `deviation` [m/s] of the train's speed: where that may be the cause nothing is said.
    """
    rolling = (np.abs(share) < ROLLING) & (speed > 5.0) & np.isfinite(rim)
    if rolling.sum() < FEWEST_ROWS:
        return []
    error = float(np.median(rim[rolling] / speed[rolling])) - 1.0
    unsure = 0.0
    if deviation is not None:
        unsure = 2.0 * float(np.median(deviation[rolling] / speed[rolling]))
    if abs(error) <= RADIUS_ERROR + unsure:
        return []
    text = (
        f"turns {100.0 * abs(error):.1f} % {'faster' if error > 0.0 else 'slower'} than the train where it rolls "
        "freely: wheel radius or scale of a speed; Q and slips contain that"
    )
    return [Remark("radius", name, text)]


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
    time, part = instants
    width = max(int(BALANCE_WINDOW / np.median(np.diff(time))), 1)
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
    mean = given / (time[end] - time[begin])
    used = (part[begin] == part[end]) & (
        np.abs(mean) > LEAST_EFFORT * train.car_mass.sum() * GRAVITY
    )
    used &= np.isfinite(gained) & np.isfinite(given)
    if used.sum() < 3:
        return None
    x, y = given[used], gained[used]
    lasts = float(np.sum((time[end] - time[begin])[used]))
    rise = float(np.sum(x - y)) / (lasts * float(train.car_mass.sum()) * GRAVITY)
    return Balance(float(x @ y / (x @ x)), rise)


def turned_round(
    instants: Instants,
    speed: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    sources: Sources,
) -> tuple[Floats, list[Remark]]:
    """Forces of the other sign where the speeds were turned round and only that makes forces and motion agree."""
    if not any(remark.kind == "sign" for remark in sources.remarks):
        return force, []
    balance = momentum_balance(instants, speed, rim, force, train, None)
    if balance is None or not -BALANCE[1] < balance.ratio < -BALANCE[0]:
        return force, []
    text = "the forces too count the other way round: turned round with the speeds"
    return -force, [Remark("sign", "axleN_force", text)]


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
    width = max(int(BALANCE_WINDOW / np.median(np.diff(time))), 1)
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
        return []
    ratio, rise = balance
    cause = (
        "wrong sign of the forces" if ratio < 0.0 else "wrong unit, torque at the motor, or train"
    )
    if grade is None and abs(rise) < STEEPEST:
        cause = f"a gradient of {1e3 * rise:+.0f} per mille, {cause}"
    text = (
        f"the train gains {ratio:.2g} times the momentum that the axles' forces give it: {cause}?"
    )
    return [Remark("balance", "axleN_force", text)]
