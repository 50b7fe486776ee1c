"""The period of rows whose time stamps do not determine it, such as an epoch in single precision: from the train's momentum.

The speed that the forces give the train over a number of rows equals the speed gained, if the rows are the right time apart.
A gradient and the resistance act as a constant force beside them, which is estimated too; loggers have round periods.
"""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import spans
from alloc.plant.laws import GRAVITY
from studies.logs.channels import FEWEST_ROWS, Channels
from studies.logs.clock import PERIODS, Clock
from studies.logs.recorder_files import RawChannel
from studies.logs.remarks import Remark, faulty

Floats = NDArray[np.float64]

STANDING = 0.05
"""Speed [m/s] below which a train stands."""
LEAST_CHANGE = 1.0
"""Change of speed [m/s] that a log must have."""
STEEPEST = 0.05
"""Rise per run that no line exceeds."""
AS_GOOD = 1.5
"""Ratio of residuals below which two periods explain a log as well: the one with the smaller gradient counts."""


def conclude_period(channels: Channels) -> None:
    """Give the clock of `channels` its period; raises `Faulty` where nothing determines it."""
    clock = channels.clock
    assert clock is not None
    column = channels.assigned["time", 0].column
    _keep(channels)
    period = _best(channels)
    if period is None:
        raise faulty(
            channels.source, column, None,
            "has too few different time stamps to tell the period of the rows; give period_s in a mapping file",
        )  # fmt: skip
    text = f"rows every {period:g} s, concluded from forces and speed; a mapping file may give period_s"
    channels.remarks.append(Remark("time", column, text))
    channels.clock = Clock(clock.time * period, clock.rows, clock.origin, clock.remarks)


def _best(channels: Channels) -> float | None:
    """The period with which the train gains the momentum that its forces give it; None where nothing tells it."""
    train = channels.train
    wheels = {n: _values(channels, ("wheel", n)) for n in channels.numbers_of("wheel")
              if channels.assigned["wheel", n].quantity == "axleN_speed"}  # fmt: skip
    efforts = channels.numbers_of("effort")
    if not efforts or not (wheels or ("speed", 0) in channels.assigned):
        return None
    if ("speed", 0) in channels.assigned:
        speed = np.abs(_values(channels, ("speed", 0)))
    else:
        speed = np.asarray(np.median(np.abs(list(wheels.values())), axis=0))
    mass, rotating = float(train.car_mass.sum()), train.inertia / train.radius**2
    momentum, total = mass * speed, np.zeros(speed.size)
    locked = np.zeros(speed.size, dtype=bool)
    for n in range(1, train.radius.size + 1):
        own = np.abs(wheels[n]) if n in wheels else speed
        momentum = momentum + rotating[n - 1] * own
        locked |= (own < STANDING) & (speed > LEAST_CHANGE)
    for n in efforts:
        values = _values(channels, ("effort", n))
        torque = channels.assigned["effort", n].quantity == "axleN_torque"
        total += values / train.radius[n - 1] if torque else values
    if np.ptp(speed) < LEAST_CHANGE:
        return None
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (total[1:] + total[:-1]))])
    gained, given, rows = _between_locked(~locked & (speed > STANDING), momentum, impulse)
    if rows.size < FEWEST_ROWS or not rows.any():
        return None
    found = []
    for period in PERIODS:
        left = gained - period * given
        constant = float(rows @ left / (rows @ rows))  # of gradient and resistance, per row
        if abs(constant) < STEEPEST * mass * GRAVITY * period:
            residual = float(np.sum((left - constant * rows) ** 2))
            found.append((residual, abs(constant) / period, period))
    if not found:
        return None
    least = min(found)[0]
    return min((c, p) for residual, c, p in found if residual <= AS_GOOD**2 * least)[1]


def _between_locked(used: NDArray[np.bool_], *series: Floats) -> tuple[Floats, ...]:
    """Series and the number of the row, less their means over stretches of `used` rows.

    What the brake of a locked wheel gives is not known.
    """
    rows = np.arange(used.size, dtype=float)
    pieces: list[list[Floats]] = [[] for _ in range(len(series) + 1)]
    for begin, end in spans(used).tolist():
        for piece, values in zip(pieces, (*series, rows), strict=True):
            piece.append(values[begin:end] - values[begin:end].mean())
    return tuple(np.concatenate(piece) if piece else np.zeros(0) for piece in pieces)


def _keep(channels: Channels) -> None:
    """Keep what is read twice: channels that are taken are gone."""
    held = channels.recording.channels
    for one in channels.assigned.values():
        if one.column in held:
            raw = held[one.column]
            values = raw.load()
            held[one.column] = RawChannel(raw.name, raw.unit, lambda v=values: v, raw.clock)  # type: ignore[misc]


def _values(channels: Channels, place: tuple[str, int]) -> Floats:
    """A channel on all rows [SI], straight lines over what is missing; nothing is remarked on."""
    before, raw = (
        list(channels.remarks),
        channels.recording.channels[channels.assigned[place].column],
    )
    time, values = channels.series(place)
    values = channels.scaled(place, values)
    channels.recording.channels[raw.name] = raw
    channels.remarks[:] = before
    known = np.isfinite(values)
    assert channels.clock is not None
    return np.interp(channels.clock.time, time[known], values[known])
