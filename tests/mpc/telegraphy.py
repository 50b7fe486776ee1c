"""Telegrams between the units of a controller that no loop asks: sent, late and lost by the loop's own code."""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from alloc.compilation import jit
from alloc.onboard.telegrams import Attachment, channel, deliver, exchange
from alloc.records import ByReference, numbers_of
from mpc.model import leading

PERIOD = 0.01


class Count(NamedTuple):
    telegrams_sent: np.ndarray
    telegrams_lost: np.ndarray


@jit
def _carry(line, leader, time, message, sending, telegrams, counter, lost):
    for j in range(message.shape[0]):
        if j == leader:
            deliver(line, j, time, message)
        else:
            exchange(line, j, time, message, sending, telegrams, counter, 0.0, lost[j])


class Telegraphy:
    """The lines of a controller, which it is connected to; `lost` says whose telegrams are lost from now on."""

    def __init__(self, controller, units, telegrams):
        self.controller, self.telegrams = controller, telegrams
        self.lost = np.zeros(units, dtype=bool)
        self.counter = Count(np.zeros(1, np.int64), np.zeros(1, np.int64))
        self._lines = [
            SimpleNamespace(
                channel=channel(units, size, np.nan),
                message=np.full((units, size), np.nan),
                size=size,
            )
            for size in controller.added
        ]
        self.reports, self.orders = (
            Attachment(line.message, line.channel.read, line.channel.heard) for line in self._lines
        )
        controller.connect(self.reports, self.orders)

    def decide(self, senses):
        """What the controller answers in a control period, after the telegrams, as in the loop."""
        time, t = senses[0].time, self.telegrams
        ticks = max(1, round(t.period / PERIOD))
        settings = ByReference(numbers_of(t, loss=0.5, ticks=ticks))
        for line in self._lines:
            _carry(
                line.channel, leading(senses), time, line.message, round(time / PERIOD) % ticks == 0, settings,
                self.counter, np.where(self.lost, 0.0, 1.0),
            )  # fmt: skip
        return self.controller.decide(senses)
