"""The period of rows whose time stamps do not tell it, as an epoch in single precision: by the train's momentum.

The speed that the forces give the train in so many rows is the one that it has gained, if the rows are the right time apart.
A gradient and the resistance are a constant force beside them, which is found too; loggers have round periods.
"""

import numpy as np
from numpy.typing import NDArray

from studies.logs.clock import PERIODS, Clock
from studies.logs.recording import RawChannel
from studies.logs.remarks import Remark, faulty
from studies.logs.sources import Sources

Floats = NDArray[np.float64]

LEAST_CHANGE = 1.0
"""Change of speed [m/s] that a log must have."""


def conclude_period(sources: Sources) -> None:
    """Give the clock of `sources` its period; raises `Faulty` where nothing tells it."""
    clock = sources.clock
    assert clock is not None
    column = sources.assigned["time", 0].column
    _keep(sources)
    speed = _speed(sources, clock)
    total, inertia = _force(sources, clock)
    period = None
    if speed is not None and total is not None:
        mass = float(sources.train.car_mass.sum()) + inertia
        gained = speed - speed[0]
        given = np.concatenate([[0.0], np.cumsum(0.5 * (total[1:] + total[:-1]))]) / mass
        if np.ptp(gained) > LEAST_CHANGE and np.ptp(given) > 0.0:
            rows = np.arange(gained.size, dtype=float)
            columns = np.stack([np.ones_like(rows), rows / rows[-1], given], axis=1)
            slope = float(np.linalg.lstsq(columns, gained, rcond=None)[0][2])
            if slope > 0.0:
                period = min(PERIODS, key=lambda p: abs(np.log(p / slope)))
    if period is None:
        raise faulty(
            sources.source, column, None,
            "has too few different time stamps to tell the period of the rows; give period_s in a mapping file",
        )  # fmt: skip
    text = f"rows every {period:g} s, concluded from forces and speed; a mapping file may give period_s"
    sources.remarks.append(Remark("time", column, text))
    sources.clock = Clock(clock.time * period, clock.rows, clock.origin, clock.remarks)


def _keep(sources: Sources) -> None:
    """Keep what is read twice: channels that are taken are gone."""
    channels = sources.recording.channels
    for one in sources.assigned.values():
        if one.column in channels:
            raw = channels[one.column]
            values = raw.load()
            channels[one.column] = RawChannel(raw.name, raw.unit, lambda v=values: v, raw.clock)  # type: ignore[misc]


def _values(sources: Sources, place: tuple[str, int]) -> Floats:
    """A channel on all rows [SI], straight lines over what is missing; nothing is remarked on."""
    before, raw = list(sources.remarks), sources.recording.channels[sources.assigned[place].column]
    time, values = sources.series(place)
    values = sources.scaled(place, values)
    sources.recording.channels[raw.name] = raw
    sources.remarks[:] = before
    known = np.isfinite(values)
    assert sources.clock is not None
    return np.interp(sources.clock.time, time[known], values[known])


def _speed(sources: Sources, clock: Clock) -> Floats | None:
    wheels = [n for n in sources.numbers_of("wheel") if sources.assigned["wheel", n].quantity == "axleN_speed"]  # fmt: skip
    if ("speed", 0) in sources.assigned:
        return np.abs(_values(sources, ("speed", 0)))
    if not wheels:
        return None
    return np.asarray(np.abs(np.median([_values(sources, ("wheel", n)) for n in wheels], axis=0)))


def _force(sources: Sources, clock: Clock) -> tuple[Floats | None, float]:
    numbers = sources.numbers_of("effort")
    if not numbers:
        return None, 0.0
    total = np.zeros(clock.time.size)
    for n in numbers:
        values = _values(sources, ("effort", n))
        if sources.assigned["effort", n].quantity == "axleN_torque":
            values = values / sources.train.radius[n - 1]
        total += values
    return total, float((sources.train.inertia / sources.train.radius**2).sum())
