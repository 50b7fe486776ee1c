"""Caps by the units' own slips: single steps on records made by hand, against numbers by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from alloc.onboard.telegrams import DETECTED, ESTIMATE, caps_by_slips, count_slips

PLAN, HOLD = 0.16, 5.0
INCREMENTS = SimpleNamespace(increment=np.array([0.01, 0.03, 0.06, 0.07]))
SETTINGS = SimpleNamespace(hold_time=HOLD)


def heard(**slips):
    """Memory of a leader that has heard of slips: `u1=(0.12, 3.0)` is unit 1, which found 0.12 at 3 s."""
    read = np.tile([PLAN, np.nan, -np.inf, 0.0, -np.inf], (4, 1))
    for unit, (estimate, detected) in slips.items():
        read[int(unit[1:]), [ESTIMATE, DETECTED]] = estimate, detected
    report = SimpleNamespace(line=SimpleNamespace(read=read), counted=np.full(4, -np.inf))
    train = SimpleNamespace(expected=np.array([PLAN]))
    return SimpleNamespace(report=report, train=train, learnt=INCREMENTS, cap=np.zeros(4))


def caps(time, **slips):
    memory = heard(**slips)
    assert count_slips(SETTINGS, memory, time) == (True, True)
    caps_by_slips(SETTINGS, memory, time)
    return memory.cap


def test_the_leaders_slip_alone_gives_the_caps_of_equation_5():
    assert caps(4.0, u0=(0.10, 3.0)) == pytest.approx([0.10, 0.12, 0.15, 0.16], rel=1e-12)
    assert caps(4.0, u0=(0.0, 3.0)) == pytest.approx([0.0, 0.02, 0.05, 0.06], rel=1e-12)


def test_a_unit_that_slipped_within_the_hold_time_has_its_own_estimate_as_cap():
    found = caps(4.0, u0=(0.10, 3.0), u2=(0.19, 3.5))
    assert found == pytest.approx([0.10, 0.12, 0.19, 0.16], rel=1e-12)


@pytest.mark.parametrize(("time", "own"), [(3.5 + HOLD, 0.19), (3.51 + HOLD, 0.15)])
def test_a_slip_older_than_the_hold_time_gives_no_cap(time, own):
    found = caps(time, u0=(0.10, 6.0), u2=(0.19, 3.5))
    assert found == pytest.approx([0.10, 0.12, own, 0.16], rel=1e-12)


def test_a_slip_in_the_rear_alone_leaves_the_plan_to_the_units_ahead():
    assert caps(4.0, u2=(0.11, 3.5)) == pytest.approx([PLAN, PLAN, 0.11, 0.12], rel=1e-12)


def test_a_change_is_told_once_when_a_slip_is_heard_and_when_it_no_longer_counts():
    memory = heard()
    assert count_slips(SETTINGS, memory, 1.0) == (False, False)
    memory.report.line.read[2, [ESTIMATE, DETECTED]] = 0.11, 2.0
    told = [
        count_slips(SETTINGS, memory, t) for t in (2.1, 2.2, 2.0 + HOLD, 2.1 + HOLD, 2.2 + HOLD)
    ]
    assert told == [(True, True), (True, False), (True, False), (False, True), (False, False)]
    memory.report.line.read[2, DETECTED] = 9.0  # the same coefficient, found anew
    assert count_slips(SETTINGS, memory, 9.1) == (True, True)
