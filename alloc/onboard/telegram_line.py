"""A line of telegrams from one computer of the train to another: what was sent arrives late, or never."""

from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from alloc.onboard.parameters import Telegrams

Content = TypeVar("Content")

ROUNDING = 1e-9
"""Tolerance [s] of comparing instants, which are multiples of a period."""


class Telegram(NamedTuple, Generic[Content]):
    """What arrived."""

    sent: float
    """Instant at which it was sent [s]: the age of what it says."""
    content: Content


class TelegramLine(Generic[Content]):
    """Telegrams from one sender to one receiver, under the latency, jitter and loss of `telegrams`.

    `seed` draws jitter and losses. The receiver keeps the newest telegram that has arrived; one that was overtaken is
    dropped. Times in s.
    """

    def __init__(self, telegrams: Telegrams, seed: int | Sequence[int] = 0) -> None:
        self._telegrams = telegrams
        self._generator = np.random.default_rng(seed)
        self._under_way: list[tuple[float, Telegram[Content]]] = []
        self._newest: Telegram[Content] | None = None
        self._heard = 0.0
        self.sent = 0
        """Telegrams sent so far."""
        self.lost = 0
        """Those of them that will never arrive."""

    def send(self, time: float, content: Content) -> None:
        """Send `content` at `time`."""
        self.sent += 1
        # both are drawn whether they matter or not, so that runs with other losses share their jitter
        jitter, fate = self._generator.random(2)
        if fate < self._telegrams.loss:
            self.lost += 1
            return
        arrival = time + self._telegrams.latency + self._telegrams.jitter * float(jitter)
        self._under_way.append((arrival, Telegram(time, content)))

    def receive(self, time: float) -> Telegram[Content] | None:
        """Newest telegram that has arrived by `time`; None if there is none, or the line is silent."""
        arrived = [item for item in self._under_way if item[0] <= time + ROUNDING]
        for item in arrived:
            self._under_way.remove(item)
            arrival, telegram = item
            self._heard = max(self._heard, arrival)
            if self._newest is None or telegram.sent > self._newest.sent:
                self._newest = telegram
        return None if self.silent(time) else self._newest

    def silent(self, time: float) -> bool:
        """Whether nothing arrived for longer than `Telegrams.silence` before `time`."""
        return time - self._heard > self._telegrams.silence + ROUNDING
