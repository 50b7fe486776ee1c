"""Cut-and-ramp readhesion control of one unit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.controllers.simple import (
    CUT,
    FOLLOW,
    HOLD,
    RAMP,
    RECOVERY_TIMEOUT,
    CutAndRamp,
    cut_and_ramp,
)

PERIOD, CUT_TO, RECOVER, RATE = 0.01, 0.5, 0.9, 400.0
LAW = CutAndRamp(CUT_TO, RECOVER, hold=0.1)


def _run(signals, target=1000.0, rail=800.0):
    phase, clock, base, torque = FOLLOW, 0.0, 0.0, target
    course = []
    for slipping in signals:
        phase, clock, base, torque = cut_and_ramp(
            phase, clock, base, torque, target, slipping, rail, LAW, RATE, PERIOD
        )
        course.append((phase, torque))
    return course


def test_without_slip_the_target_is_followed():
    assert all(step == (FOLLOW, 1000.0) for step in _run([False] * 10))


def test_course_of_one_slip():
    course = _run([False] * 3 + [True] * 8 + [False] * 120)
    phases = [phase for phase, _ in course]
    order = [p for k, p in enumerate(phases) if k == 0 or p != phases[k - 1]]
    assert order == [FOLLOW, CUT, HOLD, RAMP, FOLLOW]
    torque = np.array([t for _, t in course])
    assert np.all(torque[3:11] == CUT_TO * 800.0)
    assert np.all(torque[11:20] == RECOVER * 800.0)
    rising = torque[np.array(phases) == RAMP]
    assert np.allclose(np.diff(rising), RATE * PERIOD)
    assert rising.size == round((1000.0 - RECOVER * 800.0) / (RATE * PERIOD))
    assert torque[-1] == 1000.0


def test_new_slip_while_ramping_starts_again():
    course = _run([True] * 5 + [False] * 30 + [True] * 3)
    assert [phase for phase, _ in course][-3:] == [CUT] * 3


def test_slip_that_does_not_end_brings_the_torque_to_zero():
    ticks = round(RECOVERY_TIMEOUT / PERIOD)
    course = _run([True] * (ticks + 5))
    assert course[ticks - 2][1] == CUT_TO * 800.0
    assert course[-1][1] == 0.0


@given(
    st.lists(st.booleans(), min_size=1, max_size=300),
    st.floats(0, 3000),
    st.floats(-500, 3000),
)
def test_command_stays_between_zero_and_the_target(signals, target, rail):
    for _, torque in _run(signals, target, rail):
        assert 0.0 <= torque <= target


def test_what_is_recovered_may_be_all_that_the_rail_carried_and_no_more():
    assert CutAndRamp(1.0, 1.0).recover == 1.0
    for cut, recover in ((0.5, 1.001), (0.6, 0.59)):
        with pytest.raises(OnboardError, match="cut <= recover <= 1"):
            CutAndRamp(cut, recover)
