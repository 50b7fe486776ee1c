"""Disturbance observer and coefficient estimate, JP5484215 (1)-(4), (6), (6')."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from alloc.onboard.laws import (
    empty_torque_limit,
    load_compensated,
    observe,
    observer_gains,
    tangential_coefficient_estimate,
)
from alloc.plant.laws import GRAVITY

J, A, T = 155.01, 25.0, 0.01


def _observe_course(torque, omega):
    keep, old, new = observer_gains(A, T)
    filtered = last = torque[0] + A * J * omega[0]
    estimates = []
    for tau, w in zip(torque, omega, strict=True):
        filtered, last, estimate = observe(filtered, last, tau, w, J, A, keep, old, new)
        estimates.append(estimate)
    return np.array(estimates)


@given(st.floats(-2e4, 2e4), st.floats(-5, 5), st.floats(-50, 50))
def test_constant_load_is_found_exactly(load, omega_rate, omega_start):
    # J omega' = torque - load with constant torque: torque and speed are linear, the recursion exact
    time = T * np.arange(400)
    torque = np.full(time.size, load + J * omega_rate)
    estimates = _observe_course(torque, omega_start + omega_rate * time)
    assert estimates[-1] == pytest.approx(load, abs=1e-6 * (1 + abs(load) + A * J * 60))


def test_recursion_equals_the_continuous_filter_of_equation_3():
    # load torque 3000 + 800 sin(5 t): reference from the transfer function a/(s + a) by quadrature
    def load(t):
        return 3000.0 + 800.0 * np.sin(5.0 * t)

    def right_side(t, y):
        return [(3200.0 - load(t)) / J, A * (load(t) - y[1])]

    time = T * np.arange(301)
    exact = solve_ivp(right_side, (0, 3), [0.0, load(0.0)], t_eval=time, rtol=1e-10, atol=1e-8)
    estimates = _observe_course(np.full(time.size, 3200.0), exact.y[0])
    # linear interpolation between samples: error of second order in the period
    assert np.max(np.abs(estimates[50:] - exact.y[1][50:])) < 10.0


def test_pole_sets_the_lag():
    # a step of the load appears with 1 - exp(-a t)
    time = T * np.arange(100)
    load = np.where(time < 0.2, 1000.0, 2000.0)
    omega = np.concatenate([[0.0], np.cumsum((1500.0 - load[:-1]) / J * T)])
    estimates = _observe_course(np.full(time.size, 1500.0), omega)
    k = round(0.2 / T) + round(1 / A / T)
    assert estimates[k] == pytest.approx(1000 + 1000 * (1 - np.exp(-1)), abs=60)


def test_estimate_of_the_coefficient_inverts_the_definition():
    assert tangential_coefficient_estimate(0.13 * 98066.5 * 0.43, 98066.5, 0.43) == pytest.approx(
        0.13
    )


def test_torque_limit_by_hand():
    # 0.15 x 9500 kg x 9.80665 x 0.43 / 7.07 = 849.9 N m; 1900 kg load on 9500 kg: + 20 %
    empty = empty_torque_limit(0.15, 9500.0, 0.43, 7.07)
    assert empty == pytest.approx(849.933, abs=1e-3)
    assert load_compensated(empty, 9500.0, 1900.0) == pytest.approx(1.2 * empty)


@given(st.floats(0, 0.4), st.floats(1e3, 2e4), st.floats(0, 1e4))
def test_compensated_limit_is_the_limit_of_the_loaded_axle(limit, empty_mass, load):
    compensated = load_compensated(
        empty_torque_limit(limit, empty_mass, 0.43, 7.07), empty_mass, load
    )
    assert compensated == pytest.approx(limit * (empty_mass + load) * GRAVITY * 0.43 / 7.07)
