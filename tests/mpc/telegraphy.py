"""Telegrams between the units of a controller that no loop asks: sent, late and lost by the loop's own code."""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from alloc.compilation import jit
from alloc.onboard.telegrams import Attachment, exchange, mail, tell
from alloc.records import ByReference, numbers_of
from mpc.model import leading

PERIOD = 0.01


class Count(NamedTuple):
    telegrams_sent: np.ndarray
    telegrams_lost: np.ndarray


@jit
def _carry(line, leader, time, told, sending, telegrams, counter, fate):
    for j in range(told.shape[0]):
        if j == leader:
            tell(line, j, time, told)
        else:
            exchange(line, j, time, told, sending, telegrams, counter, 0.0, fate[j])


class Telegraphy:
    """The lines of a controller, which it is connected to; `lost` says whose telegrams are lost from now on."""

    def __init__(self, controller, units, telegrams):
        self.controller, self.telegrams = controller, telegrams
        self.lost = np.zeros(units, dtype=bool)
        self.counter = Count(np.zeros(1, np.int64), np.zeros(1, np.int64))
        self._lines = [
            SimpleNamespace(
                mail=mail(units, size, np.nan), told=np.full((units, size), np.nan), size=size
            )
            for size in controller.added
        ]
        self.reports, self.orders = (
            Attachment(line.told, line.mail.read, line.mail.heard) for line in self._lines
        )
        controller.connect(self.reports, self.orders)

    def decide(self, senses):
        """What the controller answers in a control period, after the telegrams, as in the loop."""
        time, t = senses[0].time, self.telegrams
        ticks = max(1, round(t.period / PERIOD))
        settings = ByReference(numbers_of(t, loss=0.5, ticks=ticks))
        for line in self._lines:
            _carry(
                line.mail, leading(senses), time, line.told, round(time / PERIOD) % ticks == 0, settings,
                self.counter, np.where(self.lost, 0.0, 1.0),
            )  # fmt: skip
        return self.controller.decide(senses)
