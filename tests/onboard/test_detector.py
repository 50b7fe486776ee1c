"""Slip detection, JP5484215 Fig. 5."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.laws import differentiate, differentiator_gain, slip_signal
from alloc.onboard.parameters import Detector

THRESHOLDS = {"on": 1.8, "off": 0.9, "speed_on": 0.6}


@given(st.floats(-5, 5), st.floats(-1, 1), st.booleans())
def test_signal_changes_only_beyond_its_thresholds(acceleration, slip, was_on):
    signal = slip_signal(was_on, acceleration, slip, **THRESHOLDS)
    if acceleration > 1.8 or slip > 0.6:
        assert signal
    elif acceleration <= 0.9 and slip < 0.3:
        assert not signal
    else:
        assert signal == was_on


def test_hysteresis_on_the_course_of_the_patents_figure():
    course = [0.0, 1.0, 1.79, 1.81, 1.5, 1.0, 0.91, 0.9, 1.5, 0.0]
    signal, signals = False, []
    for acceleration in course:
        signal = bool(slip_signal(signal, acceleration, 0.0, **THRESHOLDS))
        signals.append(signal)
    assert signals == [False, False, False, True, True, True, True, False, False, False]


def test_differentiator_settles_on_the_slope_of_a_ramp():
    pole, period, slope = 40.0, 0.01, 1.3
    filtered, gain = 0.0, differentiator_gain(pole, period)
    for k in range(200):
        filtered, derivative = differentiate(filtered, slope * k * period, pole, gain)
    # a sampled first-order filter lags a ramp by period / gain just before it is updated
    assert derivative == pytest.approx(slope * pole * period / gain, rel=1e-9)
    assert derivative == pytest.approx(slope, rel=0.25)


def test_differentiator_passes_no_constant():
    filtered, gain = 3.0, differentiator_gain(40.0, 0.01)
    for _ in range(5):
        filtered, derivative = differentiate(filtered, 3.0, 40.0, gain)
        assert derivative == 0.0


def test_thresholds_must_leave_a_hysteresis():
    with pytest.raises(OnboardError, match=r"off = 2\.0 must be below on = 1\.8"):
        Detector(off=2.0)
    with pytest.raises(OnboardError, match="pole = nan"):
        Detector(pole=float("nan"))


def test_noise_free_detector_is_deterministic():
    rng = np.random.default_rng(3)
    course = rng.normal(1.3, 0.6, 500)

    def run():
        signal, out = False, []
        for a in course:
            signal = bool(slip_signal(signal, a, 0.0, **THRESHOLDS))
            out.append(signal)
        return out

    assert run() == run()
    assert 0 < sum(run()) < 500
