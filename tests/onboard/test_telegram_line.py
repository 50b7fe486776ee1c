"""A telegram line: nothing young acts, nothing lost arrives, and silence is noticed."""

import numpy as np
import pytest

from alloc.onboard.parameters import Telegrams
from alloc.onboard.telegram_line import TelegramLine

PERIOD = 0.1


def _traffic(telegrams, seconds=20.0, seed=0, tick=0.01):
    """The line, and (time, newest telegram) at every control instant of a sender that tells the time."""
    line = TelegramLine(telegrams, seed)
    heard = []
    for k in range(round(seconds / tick)):
        time = k * tick
        if k % round(PERIOD / tick) == 0:
            line.send(time, time)
        heard.append((time, line.receive(time)))
    return line, heard


@pytest.mark.parametrize("jitter", [0.0, 0.03, 0.25])
@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_nothing_younger_than_the_latency_is_heard(jitter, loss):
    _, heard = _traffic(Telegrams(latency=0.05, jitter=jitter, loss=loss))
    ages = [time - telegram.sent for time, telegram in heard if telegram is not None]
    assert len(ages) > 1000
    assert min(ages) > 0.05 - 1e-8
    assert all(telegram.content == telegram.sent for _, telegram in heard if telegram)


def test_without_jitter_and_loss_the_age_is_bounded():
    # latency at the arrival, one period more just before the next
    _, heard = _traffic(Telegrams(latency=0.05))
    ages = [time - telegram.sent for time, telegram in heard if telegram is not None]
    assert heard[5][1] is not None
    assert heard[4][1] is None
    assert max(ages) < 0.05 + PERIOD


def test_an_overtaken_telegram_is_dropped():
    _, heard = _traffic(Telegrams(latency=0.01, jitter=0.5))
    sent = [telegram.sent for _, telegram in heard if telegram is not None]
    assert np.all(np.diff(sent) >= 0.0)
    # with this jitter some are overtaken: not each one is ever the newest
    assert len(set(sent)) < 0.9 * max(sent) / PERIOD


@pytest.mark.parametrize("loss", [0.0, 0.3, 1.0])
def test_lost_telegrams_are_counted_and_never_heard(loss):
    line, heard = _traffic(Telegrams(latency=0.05, loss=loss, silence=1e3), seconds=100.0)
    assert line.sent == 1000
    assert line.lost == pytest.approx(1000 * loss, abs=4.0 * np.sqrt(1000 * 0.25))
    different = {telegram.sent for _, telegram in heard if telegram is not None}
    under_way = 1 if loss < 1.0 else 0
    assert abs(line.sent - line.lost - len(different)) <= under_way


def test_runs_with_different_losses_share_their_jitter():
    none, some = (
        {t.sent: time for time, t in reversed(_traffic(Telegrams(jitter=0.04, loss=loss))[1]) if t}
        for loss in (0.0, 0.3)
    )
    assert some.keys() < none.keys()
    assert all(none[sent] == arrival for sent, arrival in some.items())


def test_silence_is_noticed_and_ends():
    line = TelegramLine(Telegrams(latency=0.05, silence=0.5))
    line.send(0.0, "first")
    assert line.receive(0.04) is None
    assert line.receive(0.55).content == "first"
    assert line.receive(0.56) is None
    assert line.silent(0.56)
    line.send(2.0, "second")
    assert line.receive(2.04) is None
    assert line.receive(2.05).content == "second"


def test_the_seed_draws_the_losses():
    telegrams = Telegrams(loss=0.5)
    first, again, other = (
        [t.sent if t else None for _, t in _traffic(telegrams, seed=seed)[1]] for seed in (1, 1, 2)
    )
    assert first == again
    assert first != other
