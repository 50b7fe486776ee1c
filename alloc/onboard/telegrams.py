"""Telegrams between the units and the leader, the foremost unit that works: reports to it, orders from it.

What happens to a telegram is drawn before the run. What a unit said at an instant is its row in the record, so a telegram
that is late or lost is a look-up: `report_tick[k, j]` is the instant of the newest report of unit j that the leader has at
instant k, `order_tick[k, j]` that of the newest order that unit j has.
"""

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.onboard.sensing import NOTICED, ROUNDING

Floats = NDArray[np.float64]
Ticks = NDArray[np.int64]


def find_leaders(ticks: int, failure: Floats, period: float) -> Ticks:
    """The foremost unit that works, as the train knows, (ticks,); the hindmost if none does.

    `failure` (units,): instants at which motors fail [s]; `period` of control [s].
    """
    works = np.arange(ticks)[:, None] * period < failure + NOTICED - ROUNDING
    return np.where(works.any(axis=1), works.argmax(axis=1), failure.size - 1).astype(np.int64)


def draw_telegrams(
    leader: Ticks,
    units: int,
    every: int,
    period: float,
    latency: float,
    jitter: float,
    loss: float,
    seed: int,
) -> tuple[Ticks, Ticks]:
    """`report_tick` and `order_tick`, (ticks, units) each, of telegrams sent `every` so many control periods [s].

    A telegram arrives after `latency` and a part of `jitter` [s] that is equally likely everywhere in it, or, with
    probability `loss`, never. The leader itself needs none; at the first instant all know all. Draws do not depend on the
    settings, so events that differ in these alone lose the same telegrams.
    """
    arrived, ticks = [], leader.size
    sent = np.arange(0, ticks, every, dtype=np.int64)
    for stream in (4, 2):  # reports, orders
        draws = np.random.default_rng([seed, stream]).random((2, ticks // every + 1, units))
        late, lost = draws[:, : sent.size]
        delay = np.where(lost < loss, np.inf, (latency + jitter * late) / period)
        newest_tick = newest_arrived(
            ticks, sent, np.asarray(sent[:, None] + delay, dtype=np.float64)
        )
        if units:
            newest_tick[np.arange(ticks), leader] = np.arange(ticks)
        arrived.append(newest_tick)
    return arrived[0], arrived[1]


def newest_arrived(ticks: int, sent: Ticks, arrival: Floats) -> Ticks:
    """The newest instant of `sent` whose telegram has arrived, (ticks, lines); `arrival` (sent, lines), in instants."""
    arrived = np.minimum(np.ceil(arrival - 1e-6), ticks).astype(np.int64)
    ticks_sent = np.zeros((ticks + 1, arrival.shape[1]), dtype=np.int64)  # the last row: too late
    for line in range(arrival.shape[1]):
        np.maximum.at(ticks_sent[:, line], arrived[:, line], sent)
    return np.maximum.accumulate(ticks_sent[:ticks], axis=0)


@jit
def set_limits(k, units, order_tick, orders, onboard, run):
    """Orders that have arrived by instant `k` become limits; who is told nothing follows the plan.

    `orders` (ticks, units): recorded rows. A unit that has heard nothing for `onboard.silence` falls back to the plan: its
    order is too old to count, and so is a limit below the plan.
    """
    for j in range(units.size):
        u, sent = units[j], order_tick[k, j]
        order = u.wanted if sent == k else orders[sent, j].wanted
        silent = (k - sent) * run.period > onboard.silence + run.telegram + ROUNDING
        u.fallen_back = 1 if silent else 0
        u.follows = 0 if silent or order == np.inf else 1
        u.limit = order if u.follows else run.plan
