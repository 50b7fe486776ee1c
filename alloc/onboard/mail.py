"""Telegrams between the foremost unit and the others: they arrive late, or never.

Controllers in Python add their numbers to the same telegrams (`alloc.onboard.attachment`).
"""

from typing import NamedTuple

import numpy as np

from alloc.compilation import inlined_jit
from alloc.plant.model import Floats

SLOTS = 16
"""Largest number of telegrams in transit on one line."""

ROUNDING = 1e-9
"""Tolerance [s] for comparing instants, which are multiples of a period."""


class Mail(NamedTuple):
    """Lines of telegrams, one per unit, with `fields` numbers in each."""

    arrival: Floats  # (units, SLOTS) [s]; inf: empty
    sent: Floats  # (units, SLOTS) [s]
    content: Floats  # (units, SLOTS, fields)
    newest: Floats  # (units,) when the newest that has arrived was sent [s]
    heard: Floats  # (units,) when the last one arrived [s]
    read: Floats  # (units, fields) what the newest said


def mail(units: int, fields: int, nothing: float) -> Mail:
    """Lines without any telegram yet; a receiver reads `nothing`."""
    return Mail(
        arrival=np.full((units, SLOTS), np.inf),
        sent=np.zeros((units, SLOTS)),
        content=np.zeros((units, SLOTS, fields)),
        newest=np.full(units, -np.inf),
        heard=np.zeros(units),
        read=np.full((units, fields), nothing),
    )


@inlined_jit
def post(line, j, time, delay, told):
    """Send `told[j]` (units, fields) on line `j` at `time`; it arrives after `delay` [s]."""
    for k in range(SLOTS):
        if np.isinf(line.arrival[j, k]):
            line.arrival[j, k] = time + delay
            line.sent[j, k] = time
            for f in range(told.shape[1]):
                line.content[j, k, f] = told[j, f]
            break


@inlined_jit
def tell(line, j, time, told):
    """Deliver at once on line `j`, whose sender and receiver are one computer."""
    line.newest[j] = line.heard[j] = time
    for f in range(told.shape[1]):
        line.read[j, f] = told[j, f]


@inlined_jit
def collect(line, j, time):
    """Read the newest telegram that has arrived on line `j` by `time`; returns whether any has."""
    found = False
    for k in range(SLOTS):
        if line.arrival[j, k] <= time + ROUNDING:
            found = True
            if line.sent[j, k] > line.newest[j]:
                line.newest[j] = line.sent[j, k]
                for f in range(line.read.shape[1]):
                    line.read[j, f] = line.content[j, k, f]
            line.arrival[j, k] = np.inf
    if found:
        line.heard[j] = time
    return found


@inlined_jit
def exchange(line, j, time, told, sending, telegrams, counter, delay, fate):
    """Send on line `j` when it is due, unless the telegram is lost, and read what has arrived; returns whether any has.

    `delay`, `fate`: draws from 0 to 1 of the telegram's jitter and loss.
    """
    if sending:
        counter.telegrams_sent[0] += 1
        if fate < telegrams.loss:
            counter.telegrams_lost[0] += 1
        else:
            post(line, j, time, telegrams.latency + telegrams.jitter * delay, told)
    return collect(line, j, time)
