"""Data of a log on its axles: speeds of wheels, and forces at their rims."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import usual_period
from studies.logs import checks
from studies.logs.common_instants import Instants, Series, resample
from studies.logs.own_samples import Samples, own_samples
from studies.logs.remarks import Remark
from studies.logs.rim_speeds import RimSpeed, of_way, rim_speed
from studies.logs.told_channels import Sources

Floats = NDArray[np.float64]
AROUND = 10
"""Rows before and after one in which a counter goes back, which tell how much it gained."""
SELDOM = 0.1
"""Share of rows below which a sum of pulses may go back."""
LEAST_RANGE = 10.0
"""Range of counts from which on one that goes back by most of it began anew."""
FEW_PULSES = 3.0
"""By which a row may differ from those around."""


def wheel_speeds(sources: Sources, fixes: Samples | None) -> dict[int, RimSpeed]:
    """Speeds of the wheels at their own samples, by axle from 1."""
    wheels = {}
    like = None if fixes is None or fixes.time.size == 0 else fixes.value
    for number in sources.numbers_of("wheel"):
        place = ("wheel", number)
        one = sources.assigned[place]
        if one.quantity == "axleN_pulses":
            found = _pulses(sources, number)
        else:
            found = rim_speed(
                checks.without_spikes(sources.speed(place, like), one.column, sources.remarks)
            )
        if found.time.size > 1:
            wheels[number] = found
        if found.step > 0.0:
            text = f"pulses that step by {found.step:.2g} m/s: the slope of the way over {found.span:.2g} s"
            sources.remarks.append(Remark("sampling", one.column, text))
        elif found.span > 0.0:
            text = f"noise: mean over {found.span:.2g} s"
            sources.remarks.append(Remark("sampling", one.column, text))
    return wheels


def _pulses(sources: Sources, number: int) -> RimSpeed:
    """Speed of a wheel from a column of pulses, counted so far or since the row before."""
    one = sources.assigned["wheel", number]
    time, count = sources.series(("wheel", number))
    known = np.isfinite(count)
    time, count = time[known], count[known] * one.sign
    if _since_row_before(count):  # neither is a counter that runs backwards
        way = np.cumsum(np.abs(count))
    else:
        change, bridged = _gained(time, count)
        way = np.concatenate([[0.0], np.cumsum(change)])
        if bridged:
            text = f"counter set back {bridged} time{'s' if bridged > 1 else ''}: bridged by the speed around"
            sources.remarks.append(Remark("sampling", one.column, text))
    radius = float(sources.train.radius[number - 1])
    pulse = 2.0 * np.pi * radius / float(one.pulses_per_turn or 1.0)
    return of_way(time, way * pulse, pulse)


def _since_row_before(count: Floats) -> bool:
    """Whether counts are those of a row, and not the sum so far: a sum goes back seldom, or by most of its range."""
    change = np.diff(count)
    back = -change[change < 0.0]
    if back.size < SELDOM * change.size:
        return False
    span = float(np.ptp(count))
    return not (span > LEAST_RANGE and float(np.median(back)) > 0.5 * span)


def _turn(count: Floats) -> float:
    """After how many pulses a counter goes on from where it began: its bits, or its digits if they fit better."""
    change = np.diff(count)
    span = float(np.ptp(count)) + 1.0
    two, ten = 2.0 ** np.ceil(np.log2(span)), 10.0 ** np.ceil(np.log10(span))
    back = np.flatnonzero(change < 0.0)
    if back.size == 0:
        return float(two)
    before = np.maximum(back - 1, 0)
    usual = np.maximum(change[before], 0.0)
    return float(min((two, ten), key=lambda t: float(np.median(np.abs(change[back] + t - usual)))))


def _gained(time: Floats, count: Floats) -> tuple[Floats, int]:
    """Pulses from row to row of a counter, and how often it was set back.

    A counter of so many bits or digits goes on from where it began; what was counted then is known. One that was set back
    gained what it gains around.
    """
    change, step = np.diff(count), np.diff(time)
    turn = _turn(count)
    forwards = change >= 0.0
    bridged = 0
    for k in np.flatnonzero(~forwards):
        near = slice(max(k - AROUND, 0), k + AROUND + 1)
        known = forwards[near]
        spent = float(step[near][known].sum())
        usual = float(change[near][known].sum()) / spent * step[k] if spent > 0.0 else 0.0
        change[k] += turn
        if abs(change[k] - usual) > max(FEW_PULSES, 0.5 * usual):
            change[k] = usual
            bridged += 1
    return change, bridged


def at_instants(wheel: RimSpeed, instants: Instants) -> Series:
    """A wheel's speed at the common instants; its samples are taken as they come."""
    period = usual_period(wheel.time)
    return resample(
        Samples(wheel.time, wheel.speed, "sampled", period, wheel.deviation), instants.time
    )


def typical(series: Series) -> float:
    """Root mean square of the standard deviation where there is a value."""
    known = series.deviation[np.isfinite(series.deviation)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


class AppliedForces(NamedTuple):
    """What acts on the axles at the rim."""

    value: Floats
    """[N], (instants, axles)."""
    deviation: Floats
    """Standard deviation [N], (axles,)."""
    period: float
    """Time between the samples of the slowest channel [s]; 0 without any."""


def applied_forces(sources: Sources, instants: Instants) -> AppliedForces:
    """What acts on the axles, at the common instants."""
    slowest = 0.0
    train = sources.train
    force = np.full((instants.time.size, train.radius.size), np.nan, order="F")
    deviation = np.full(train.radius.size, np.nan)
    for number in sources.numbers_of("effort"):
        name = sources.assigned["effort", number].column
        samples = sources.force(number)
        series = resample(samples, instants.time)
        force[:, number - 1], deviation[number - 1] = series.value, typical(series)
        slowest = np.fmax(slowest, samples.period)
        sources.remarks += checks.check_constant(name, samples.value, samples.time)
    cars = sources.numbers_of("carK_pressure")
    for car in cars:
        one = sources.assigned["carK_pressure", car]
        if one.newton_per_pascal is None:
            continue
        time, values = sources.series(("carK_pressure", car))
        values = -sources.scaled(("carK_pressure", car), values) * one.newton_per_pascal
        series = resample(own_samples(time, values), instants.time)
        del sources.assigned["carK_pressure", car]
        for i in np.flatnonzero(train.axle_car == car - 1):
            if np.isnan(force[:, i]).all():
                force[:, i], deviation[i] = series.value, typical(series)
    return AppliedForces(force, deviation, float(slowest))
