"""Telegrams on lines between computers: what arrives when, what is believed, and what never arrives."""

import numpy as np
import pytest

from alloc.onboard.telegrams import SLOTS, channel, collect, deliver, send

UNITS = 3


def said(value):
    """What each unit would say: one number and its negative."""
    return np.array([[value + j, -value - j] for j in range(UNITS)])


@pytest.fixture
def line():
    return channel(UNITS, 2, np.inf)


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.37])
def test_a_telegram_arrives_exactly_after_its_delay(line, delay):
    send(line, 1, 0.2, delay, said(5.0))
    if delay > 0.0:
        assert not collect(line, 1, 0.2 + delay - 1e-6)
        assert np.isinf(line.read).all()
        assert (line.newest[1], line.heard[1]) == (-np.inf, 0.0)
    assert collect(line, 1, 0.2 + delay)
    assert line.read[1].tolist() == [6.0, -6.0]
    assert (line.newest[1], line.heard[1]) == (0.2, 0.2 + delay)
    assert not collect(line, 1, 9.0)  # it arrives once
    assert np.isinf(line.read[[0, 2]]).all()  # and at nobody else


def test_the_newest_sent_is_believed_though_it_was_overtaken(line):
    send(line, 0, 0.0, 0.5, said(1.0))
    send(line, 0, 0.1, 0.2, said(2.0))
    assert collect(line, 0, 0.3)
    assert line.read[0, 0] == 2.0
    assert collect(line, 0, 0.5)  # the line lives, what it says is old
    assert line.read[0, 0] == 2.0
    assert (line.newest[0], line.heard[0]) == (0.1, 0.5)
    send(line, 0, 0.6, 0.3, said(3.0))
    send(line, 0, 0.7, 0.1, said(4.0))
    assert collect(line, 0, 1.0)  # both at once
    assert (line.read[0, 0], line.newest[0]) == (4.0, 0.7)


@pytest.mark.parametrize("seed", range(5))
def test_what_is_read_is_what_was_sent_last_of_all_that_has_arrived(line, seed):
    rng = np.random.default_rng(seed)
    posted = []
    for tick in range(200):
        time = 0.01 * tick
        if tick % 3 == 0 and rng.random() < 0.8:
            delay = rng.uniform(0.0, 0.12)
            send(line, 2, time, delay, said(time))
            posted.append((time + delay, time))
        collect(line, 2, time)
        arrived = [sent for arrival, sent in posted if arrival <= time + 1e-9]
        if arrived:
            assert line.newest[2] == max(arrived)
            assert line.read[2, 0] == max(arrived) + 2
        else:
            assert np.isinf(line.read[2, 0])


def test_what_is_posted_is_as_it_was_then(line):
    told = said(1.0)
    send(line, 0, 0.0, 0.1, told)
    told[:] = 99.0
    collect(line, 0, 0.1)
    assert line.read[0].tolist() == [1.0, -1.0]


def test_a_line_on_which_everything_is_lost_says_what_it_said_at_the_start():
    line = channel(UNITS, 2, 0.07)
    for tick in range(1000):
        assert not collect(line, 1, 0.1 * tick)
    assert (line.read[1].tolist(), line.newest[1], line.heard[1]) == ([0.07, 0.07], -np.inf, 0.0)


def test_a_line_carries_sixteen_telegrams_and_what_is_more_is_lost(line):
    assert SLOTS == 16
    for k in range(SLOTS + 3):
        send(line, 1, 0.1 * k, 10.0, said(float(k)))
    assert collect(line, 1, 100.0)
    assert line.read[1, 0] == SLOTS - 1 + 1  # unit 1 says one more
    assert np.isinf(line.arrival).all()
    send(line, 1, 200.0, 0.0, said(70.0))
    assert collect(line, 1, 200.0)
    assert line.read[1, 0] == 71.0


def test_who_sends_to_itself_knows_at_once(line):
    send(line, 0, 0.0, 5.0, said(1.0))
    deliver(line, 0, 0.3, said(8.0))
    assert (line.read[0].tolist(), line.newest[0], line.heard[0]) == ([8.0, -8.0], 0.3, 0.3)
    collect(line, 0, 5.0)  # what was sent before is old
    assert line.read[0, 0] == 8.0
