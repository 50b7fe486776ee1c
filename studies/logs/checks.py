"""What is wrong with the series of a log at common instants; remarks on all of it, and what cannot be used is cut out."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import excerpt, spans, usual_period
from studies.logs.common_instants import Instants
from studies.logs.known_train import MeasuredTrain
from studies.logs.own_samples import Samples
from studies.logs.remarks import Remark, faulty
from studies.logs.speed_shape import middle_speed
from studies.logs.told_channels import FEWEST_ROWS

Floats = NDArray[np.float64]

COARSE = 0.25
"""Sampling period [s] above which slips are missed."""
STUCK_TIME = 1.0
"""Time [s] for which a speed may stay exactly the same while others change by `STUCK_CHANGE` [m/s]."""
STUCK_CHANGE = 0.5
STUCK_SAMPLES = 4
"""The same in samples of a slow channel."""
STILL = 0.01
"""Speed [m/s] up to which a wheel stands, whatever its channel makes of zero."""
HELD = 5e-3
"""Force over load below which nothing holds a wheel against the rail ..."""
FREE_TIME = 0.5
"""... for so long [s]."""
AWAY, HARDEST = 0.3, 4.0
"""Jump of the train's speed [m/s], and braking or pulling [m/s2] beyond it, that no train reaches."""
HARDEST_OF_WHEELS = 60.0
"""Acceleration of a wheel's rim [m/s2] that no brake and no rail gives it."""
MOST_AWAY = 0.2
"""Share of such measurements above which the speed itself is in doubt, and none is left out."""
OFTEN = 0.1
"""Time [s] between two looks at all wheels."""
CONSTANT_TIME = 10.0
"""Time [s] for which a measured force never is exactly constant."""
DEAD_SHARE = 0.95
"""Share of the time under way for which a wheel's speed is exactly zero, if its sensor is dead and not the wheel locked."""
OTHER_UNIT = 1.5
"""Factor between two speeds from which on their units differ: less than that between miles and kilometres."""


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
    low, middle, high = np.quantile(excerpt(rim[moving] / speed[moving]), (0.25, 0.5, 0.75))
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


def stuck(
    values: Floats, other: Floats, time: Floats, least: int = FEWEST_ROWS, at_rest: float = 0.0
) -> Iterator[slice]:
    """Stretches in which a speed stays exactly the same, or within `at_rest` of zero, although the `other` one changes."""
    rest = np.abs(values) <= at_rest
    same = np.concatenate([(np.diff(values) == 0.0) | (rest[1:] & rest[:-1]), [False]])
    begins, ends = spans(same).T
    lasting = (time[ends] - time[begins] >= STUCK_TIME) & (ends - begins >= least)
    for begin, end in zip(begins[lasting].tolist(), ends[lasting].tolist(), strict=True):
        inside = slice(begin, end + 1)
        seen = other[inside][np.isfinite(other[inside])]
        if seen.size and seen.max() - seen.min() > STUCK_CHANGE:
            yield inside


def without_stuck(
    fixes: Samples, instants: Instants, rim: Floats, name: str, remarks: list[Remark]
) -> Samples:
    """Measurements of the train's speed without those that do not move while the wheels do."""
    if fixes.time.size < STUCK_SAMPLES:
        return fixes
    every = max(int(OFTEN / usual_period(instants.time)), 1)
    wheels, time = middle_speed(rim[::every]), instants.time[::every]
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


def without_spikes(samples: Samples, name: str, remarks: list[Remark]) -> Samples:
    """A wheel's speed without single values from which it would have to jump back, as no wheelset does."""
    time, value = samples.time, samples.value
    if time.size < FEWEST_ROWS:
        return samples
    before, own, after = value[:-2], value[1:-1], value[2:]
    step = np.minimum(np.diff(time)[:-1], np.diff(time)[1:])
    least = max(AWAY, 8.0 * samples.noise) + HARDEST_OF_WHEELS * step
    beyond = np.maximum(before, after) + least < own
    beyond |= np.minimum(before, after) - least > own
    off = np.zeros(time.size, dtype=bool)
    off[1:-1] = beyond
    # the first and the last one have one neighbour, and must be as far from the next as well
    for end, near, next_ in ((0, 1, 2), (-1, -2, -3)):
        away = value[end] - value[[near, next_]]
        off[end] = bool(np.all(away > least[end]) or np.all(away < -least[end]))
    return _left_out(samples, off, "wheel", name, remarks)


def without_outliers(fixes: Samples, name: str, remarks: list[Remark]) -> Samples:
    """Measurements of the train's speed without those to which it jumps, and from which it jumps back, as no train does."""
    time, value = fixes.time, fixes.value
    least = max(AWAY, 8.0 * fixes.noise)

    def reaches(i: int, k: int) -> bool:
        return bool(abs(value[k] - value[i]) <= least + HARDEST * abs(time[k] - time[i]))

    jumps = np.flatnonzero(np.abs(np.diff(value)) > least + HARDEST * np.diff(time)) + 1
    if jumps.size == 0:
        return fixes
    bounds = [0, *jumps.tolist(), value.size]
    stretches = list(pairwise(bounds))
    longest_of = max(range(len(stretches)), key=lambda k: stretches[k][1] - stretches[k][0])
    off = np.ones(value.size, dtype=bool)
    off[slice(*stretches[longest_of])] = False
    # from the longest stretch without a jump to both sides: what a train reaches from the last one that it reached
    last = stretches[longest_of][1] - 1
    for begin, end in stretches[longest_of + 1 :]:
        if reaches(last, begin):
            off[begin:end], last = False, end - 1
    last = stretches[longest_of][0]
    for begin, end in reversed(stretches[:longest_of]):
        if reaches(last, end - 1):
            off[begin:end], last = False, begin
    return _left_out(fixes, off, "train", name, remarks)


def _left_out(
    samples: Samples, off: NDArray[np.bool_], what: str, name: str, remarks: list[Remark]
) -> Samples:
    """The samples without those that are `off`, and a remark; all of them where so many are that the channel is in doubt."""
    if not off.any() or off.mean() > MOST_AWAY:
        return samples
    time, value = samples.time, samples.value
    k = int(np.flatnonzero(off)[0])
    text = (
        f"{int(off.sum())} values to which no {what} jumps left out, the first {value[k]:.4g} m/s "
        f"at {time[k]:.6g} s"
    )
    remarks.append(Remark("faulty", name, text, None, float(time[k])))
    return samples._replace(time=time[~off], value=value[~off])


def cut_out_stuck(
    names: dict[int, str],
    time: Floats,
    speed: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
) -> list[Remark]:
    """Cut out, in place, speeds of wheels that do not move while the train does; one at rest may be locked and is kept.

    `speed` of the train [m/s], or the wheels' median. A wheel at rest that nothing brakes, or that stopped faster
    than its inertia and the rail allow, has a dead sensor.
    """
    remarks = []
    under_way = speed > STUCK_CHANGE
    for number, name in names.items():
        own, applied = rim[:, number - 1], force[:, number - 1]
        dead = bool(under_way.any()) and np.mean(own[under_way] == 0.0) > DEAD_SHARE
        load = float(train.axle_load[number - 1])
        rotating = float(train.inertia[number - 1] / train.radius[number - 1] ** 2)
        for inside in list(stuck(own, speed, time, at_rest=STILL)):
            if abs(own[inside.start]) > STILL or dead:
                text = "stuck: the train's speed changes; cut out"
            elif (
                _free(time[inside], applied[inside], under_way[inside], load)
                or _pulled(applied[inside], under_way[inside], load)
                or _too_fast(time, own, applied, inside.start, rotating, load)
            ):
                text = "zero though no brake holds the wheel: a dead sensor; cut out"
            else:
                text = "zero while the train runs: a locked wheel, and taken for one"
            if "cut out" in text:
                own[inside] = np.nan
            remarks.append(_stuck(name, time, inside, text))
    return remarks


def _free(time: Floats, applied: Floats, under_way: NDArray[np.bool_], load: float) -> bool:
    """Whether nothing brakes a wheel for long while the train moves: the rail would turn it."""
    free = (np.abs(applied) < HELD * load) & under_way
    begins, ends = spans(free).T
    return bool(np.any(time[ends - 1] - time[begins] > FREE_TIME))


def _pulled(applied: Floats, under_way: NDArray[np.bool_], load: float) -> bool:
    """Whether a wheel at rest is pulled forwards most of the time while the train moves: nothing holds it."""
    return bool(under_way.any() and np.mean(applied[under_way] > HELD * load) > 0.5)


def _too_fast(
    time: Floats, rim: Floats, applied: Floats, start: int, rotating: float, load: float
) -> bool:
    """Whether a wheel comes to rest from one row to the next with more than its brake and a rail could do."""
    before = start - 1
    if before < 0 or not np.isfinite(rim[before]):
        return False
    brake = np.nan_to_num(np.abs(applied[max(start - FEWEST_ROWS, 0) : start + 1])).max()
    needed = rotating * (rim[before] - rim[start]) / (time[start] - time[before])
    return bool(needed > brake + load)


def _stuck(name: str, time: Floats, inside: slice, text: str) -> Remark:
    begin, end = float(time[inside.start]), float(time[inside.stop - 1])
    return Remark("stuck", name, f"{text}, {begin:.6g} s to {end:.6g} s", inside.start + 1, begin)
