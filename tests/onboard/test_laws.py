"""Laws of what units sense and command by: detector, observer, torque table, cut and ramp, fuzzy sets, learning."""

import math
from dataclasses import replace

import numpy as np
import pytest
import simpful
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from alloc.errors import OnboardError
from alloc.onboard import laws
from alloc.onboard.brakes import SENSITIVITIES, Fuzzy, SlideProtection, Threshold
from alloc.onboard.controllers.creep import CreepControl, FuzzyCreep, allowed_rate
from alloc.onboard.controllers.search import RULES as STEPS
from alloc.onboard.controllers.search import FuzzyTracking, inferred_step
from alloc.onboard.controllers.simple import (
    CUT,
    FOLLOW,
    HOLD,
    RAMP,
    RECOVERY_TIMEOUT,
    CutAndRamp,
    TorqueTable,
    asymmetric_lag,
    cut_and_ramp,
    lag_share,
    torque_factor,
)
from alloc.onboard.equipment import equipment
from alloc.onboard.increment_learning import (
    IncrementLearning,
    LearntIncrements,
    gaussian_posterior,
    running_mean,
)
from alloc.onboard.laws import (
    RELEASE,
    RULES,
    SUPPLY,
    differentiate,
    differentiator_gain,
    empty_torque_limit,
    infer,
    load_compensated,
    memberships,
    observe,
    observer_gains,
    slip_signal,
    tangential_coefficient_estimate,
    valve_action,
    weighted_action,
)
from alloc.onboard.laws import RULES as VALVES
from alloc.onboard.parameters import Belief, Detector, Onboard
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.rail import Rail
from tests.cases import looped
from tests.onboard.uneven import uneven_train

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


J, A, SAMPLING = 155.01, 25.0, 0.01


def _observe_course(torque, omega):
    keep, old, new = observer_gains(A, SAMPLING)
    filtered = last = torque[0] + A * J * omega[0]
    estimates = []
    for tau, w in zip(torque, omega, strict=True):
        filtered, last, estimate = observe(filtered, last, tau, w, J, A, keep, old, new)
        estimates.append(estimate)
    return np.array(estimates)


@given(st.floats(-2e4, 2e4), st.floats(-5, 5), st.floats(-50, 50))
def test_constant_load_is_found_exactly(load, omega_rate, omega_start):
    # J omega' = torque - load with constant torque: torque and speed are linear, the recursion exact
    time = SAMPLING * np.arange(400)
    torque = np.full(time.size, load + J * omega_rate)
    estimates = _observe_course(torque, omega_start + omega_rate * time)
    assert estimates[-1] == pytest.approx(load, abs=1e-6 * (1 + abs(load) + A * J * 60))


def test_recursion_equals_the_continuous_filter_of_equation_3():
    # load torque 3000 + 800 sin(5 t): reference from the transfer function a/(s + a) by quadrature
    def load(t):
        return 3000.0 + 800.0 * np.sin(5.0 * t)

    def right_side(t, y):
        return [(3200.0 - load(t)) / J, A * (load(t) - y[1])]

    time = SAMPLING * np.arange(301)
    exact = solve_ivp(right_side, (0, 3), [0.0, load(0.0)], t_eval=time, rtol=1e-10, atol=1e-8)
    estimates = _observe_course(np.full(time.size, 3200.0), exact.y[0])
    # linear interpolation between samples: error of second order in the period
    assert np.max(np.abs(estimates[50:] - exact.y[1][50:])) < 10.0


def test_pole_sets_the_lag():
    # a step of the load appears with 1 - exp(-a t)
    time = SAMPLING * np.arange(100)
    load = np.where(time < 0.2, 1000.0, 2000.0)
    omega = np.concatenate([[0.0], np.cumsum((1500.0 - load[:-1]) / J * SAMPLING)])
    estimates = _observe_course(np.full(time.size, 1500.0), omega)
    k = round(0.2 / SAMPLING) + round(1 / A / SAMPLING)
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


DEVIATION = st.floats(-50, 50)


MARGIN, WIDTH = st.floats(0, 5), st.floats(1e-3, 5)


TABLE_PERIOD, RISE, FALL = 0.01, 1.8, 0.25


@given(DEVIATION, MARGIN, WIDTH)
def test_the_factor_lies_between_nothing_and_all(deviation, margin, width):
    assert 0.0 <= torque_factor(deviation, margin, width) <= 1.0


@given(DEVIATION, DEVIATION, MARGIN, WIDTH)
def test_more_deviation_never_gives_more_torque(one, other, margin, width):
    low, high = sorted((one, other))
    assert torque_factor(high, margin, width) <= torque_factor(low, margin, width)


@given(DEVIATION, st.floats(0, 1), MARGIN, WIDTH)
def test_the_factor_is_continuous(deviation, step, margin, width):
    # Lipschitz with the slope of the line between the corners
    change = torque_factor(deviation + step, margin, width) - torque_factor(
        deviation, margin, width
    )
    assert abs(change) <= step / width * (1 + 1e-9) + 1e-12


@looped(("deviation", "factor"), [(-1.0, 1.0), (0.25, 1.0), (0.375, 0.5), (0.5, 0.0), (3.0, 0.0)])
def test_corners_of_figure_5(deviation, factor):
    # a_0 = a_w = 0.25 m/s2, exact in binary
    assert torque_factor(deviation, 0.25, 0.25) == factor


@looped(("start", "wanted", "lag"), [(0.0, 1.0, RISE), (1.0, 0.2, FALL)])
def test_the_lag_is_exact_at_its_instants(start, wanted, lag):
    # T y' = u - y with constant u: y = u + (y0 - u) exp(-t / T)
    value = start
    for k in range(1, 300):
        value = asymmetric_lag(
            value, wanted, lag_share(RISE, TABLE_PERIOD), lag_share(FALL, TABLE_PERIOD)
        )
        exact = wanted + (start - wanted) * math.exp(-k * TABLE_PERIOD / lag)
        assert value == pytest.approx(exact, abs=1e-12)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1e-4, 1e2), st.floats(1e-4, 1e2))
def test_the_lag_never_overshoots(value, wanted, rise, fall):
    after = asymmetric_lag(
        value, wanted, lag_share(rise, TABLE_PERIOD), lag_share(fall, TABLE_PERIOD)
    )
    rounding = 1e-12 * max(abs(value), abs(wanted))
    assert min(value, wanted) - rounding <= after <= max(value, wanted) + rounding


def test_torque_falls_faster_than_it_rises():
    shares = lag_share(RISE, TABLE_PERIOD), lag_share(FALL, TABLE_PERIOD)
    assert 0.5 - asymmetric_lag(0.5, 0.0, *shares) > asymmetric_lag(0.5, 1.0, *shares) - 0.5


def test_a_table_without_a_slope_is_refused():
    with pytest.raises(OnboardError, match=r"width = 0\.0"):
        TorqueTable(width=0.0)


RAMP_PERIOD, CUT_TO, RECOVER, RISING = 0.01, 0.5, 0.9, 400.0


RAMP_LAW = CutAndRamp(CUT_TO, RECOVER, hold=0.1)


def _run(signals, target=1000.0, rail=800.0):
    phase, clock, base, torque = FOLLOW, 0.0, 0.0, target
    course = []
    for slipping in signals:
        phase, clock, base, torque = cut_and_ramp(
            phase, clock, base, torque, target, slipping, rail, RAMP_LAW, RISING, RAMP_PERIOD
        )
        course.append((phase, torque))
    return course


def test_course_of_one_slip():
    course = _run([False] * 3 + [True] * 8 + [False] * 120)
    phases = [phase for phase, _ in course]
    order = [p for k, p in enumerate(phases) if k == 0 or p != phases[k - 1]]
    assert order == [FOLLOW, CUT, HOLD, RAMP, FOLLOW]
    torque = np.array([t for _, t in course])
    assert np.all(torque[3:11] == CUT_TO * 800.0)
    assert np.all(torque[11:20] == RECOVER * 800.0)
    rising = torque[np.array(phases) == RAMP]
    assert np.allclose(np.diff(rising), RISING * RAMP_PERIOD)
    assert rising.size == round((1000.0 - RECOVER * 800.0) / (RISING * RAMP_PERIOD))
    assert torque[-1] == 1000.0


def test_slip_that_does_not_end_brings_the_torque_to_zero():
    ticks = round(RECOVERY_TIMEOUT / RAMP_PERIOD)
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


RATIO_SETS, RATE_SETS = (0.0, 0.05, 0.15), (-1.0, 0.0, 1.0)


ratios = st.floats(0.0, 1.0)


rates = st.floats(-20.0, 20.0)


sensitivities = st.floats(0.1, 10.0)


EXACT = 1e-12


@given(st.floats(-10.0, 10.0))
def test_sets_share_every_value(x):
    degrees = memberships(x, *RATE_SETS)
    assert all(0.0 <= degree <= 1.0 for degree in degrees)
    assert sum(degrees) == pytest.approx(1.0)


def test_rules_are_ordered():
    assert np.all(np.diff(RULES, axis=0) >= 0.0)
    assert np.all(np.diff(RULES, axis=1) >= 0.0)


def test_at_the_peaks_of_two_sets_their_rule_alone_speaks():
    found = [
        [infer(slip, rate, 1.0, RATIO_SETS, RATE_SETS) for rate in RATE_SETS] for slip in RATIO_SETS
    ]
    np.testing.assert_allclose(found, RULES, atol=EXACT)


@given(ratios, ratios, rates, sensitivities)
def test_more_slip_never_asks_for_more_brake(a, b, rate, sensitivity):
    low, high = (infer(s, rate, sensitivity, RATIO_SETS, RATE_SETS) for s in sorted((a, b)))
    assert SUPPLY - EXACT <= low <= high + EXACT <= RELEASE + 2 * EXACT


@given(ratios, rates, rates, sensitivities)
def test_growing_slip_never_asks_for_more_brake(slip, a, b, sensitivity):
    low, high = (infer(slip, r, sensitivity, RATIO_SETS, RATE_SETS) for r in sorted((a, b)))
    assert low <= high + EXACT


@given(ratios, st.floats(0.0, 20.0), sensitivities, sensitivities)
def test_more_sensitivity_never_asks_for_more_brake_of_a_slide_that_grows(slip, rate, a, b):
    low, high = (infer(slip, rate, s, RATIO_SETS, RATE_SETS) for s in sorted((a, b)))
    assert low <= high + EXACT


def test_sensitivity_is_a_scale():
    assert infer(0.03, 0.2, 2.0, RATIO_SETS, RATE_SETS) == pytest.approx(
        infer(0.06, 0.4, 1.0, RATIO_SETS, RATE_SETS)
    )


def test_rolling_wheels_are_supplied():
    for sensitivity in SENSITIVITIES.values():
        assert valve_action(infer(0.0, 0.0, sensitivity, RATIO_SETS, RATE_SETS)) == SUPPLY


@looped(
    ("inferred", "action"),
    [
        (0.0, SUPPLY),
        (0.49, SUPPLY),
        (0.51, laws.HOLD),
        (1.49, laws.HOLD),
        (1.51, RELEASE),
        (2.0, RELEASE),
    ],
)
def test_the_nearest_action_is_taken(inferred, action):
    assert valve_action(inferred) == action


def test_the_settings_are_named_in_their_order():
    assert list(SENSITIVITIES) == ["low", "medium", "high"]
    assert sorted(SENSITIVITIES.values()) == list(SENSITIVITIES.values())
    assert Fuzzy().sensitivity == SENSITIVITIES["medium"] == 1.0


@looped(
    ("kind", "values", "words"),
    [
        (Fuzzy, {"sensitivity": 0.0}, "sensitivity = 0.0"),
        (Fuzzy, {"slip": (0.0, 0.2, 0.1)}, "three growing numbers"),
        (Fuzzy, {"rate": (-1.0, 0.0, math.nan)}, "three growing numbers"),
        (Fuzzy, {"pole": -1.0}, "pole = -1.0"),
        (Threshold, {"hold": 0.2, "release": 0.1}, "must not exceed release"),
        (SlideProtection, {"law": "fuzy"}, "must be one of none, threshold, fuzzy"),
        (SlideProtection, {"refill": -0.1}, "refill = -0.1"),
        (SlideProtection, {"time_out": 0.0}, "time_out = 0.0"),
    ],
)
def test_impossible_fuzzy_parameters_are_refused(kind, values, words):
    with pytest.raises(OnboardError, match=words):
        kind(**values)


CREEP, TRACKING = FuzzyCreep(), FuzzyTracking()


ANY_SLIP, ANY_RATE = st.floats(-1.0, 3.0), st.floats(-20.0, 20.0)


CHANGE, WAY = st.floats(-0.05, 0.05), st.floats(-0.1, 0.1)


@given(ANY_SLIP, ANY_SLIP, ANY_RATE, ANY_RATE)
def test_more_slip_or_more_growth_never_allows_more(slip, other, rate, growth):
    (low, high), (slow, fast) = sorted((slip, other)), sorted((rate, growth))
    assert allowed_rate(high, rate, CREEP) <= allowed_rate(low, rate, CREEP) + EXACT
    assert allowed_rate(slip, fast, CREEP) <= allowed_rate(slip, slow, CREEP) + EXACT
    assert abs(allowed_rate(slip, rate, CREEP)) <= CREEP.change + EXACT


def test_at_its_reference_steady_slip_changes_nothing_and_near_it_creep_control_is_met():
    assert allowed_rate(CREEP.reference, 0.0, CREEP) == 0.0
    linear = CreepControl()
    d = 1e-3
    below = allowed_rate(CREEP.reference - d, 0.0, CREEP)
    assert below == pytest.approx(linear.integral * d, rel=0.05)
    growing = allowed_rate(CREEP.reference, d, CREEP)
    assert growing == pytest.approx(-linear.proportional * d, rel=0.05)


def test_what_runs_away_loses_torque_and_what_comes_back_does_not():
    assert allowed_rate(1.0, 5.0, CREEP) == pytest.approx(-CREEP.change)
    assert allowed_rate(1.0, -5.0, CREEP) == pytest.approx(0.0, abs=EXACT)
    assert allowed_rate(0.0, 5.0, CREEP) == pytest.approx(0.0, abs=EXACT)
    assert allowed_rate(0.0, 0.0, CREEP) == pytest.approx(CREEP.change)


@given(CHANGE, CHANGE, WAY)
def test_the_more_the_coefficient_rose_the_further_the_search_goes_on(one, other, way):
    low, high = (inferred_step(0.01, c, abs(way), TRACKING) for c in sorted((one, other)))
    if one * other * way != 0.0:
        assert low <= high + EXACT


@given(st.sampled_from([-0.01, 0.01]), CHANGE, WAY)
def test_an_inferred_step_is_bounded_and_points_to_more_adhesion(last, change, way):
    step = inferred_step(last, change, way, TRACKING)
    assert TRACKING.least <= abs(step) <= TRACKING.largest * (1.0 + EXACT)
    if abs(change * way) > 1e-9:
        assert math.copysign(1, step) == math.copysign(1, change) * math.copysign(1, way)


def test_where_the_rules_say_nothing_the_search_turns():
    assert inferred_step(0.02, 0.0, 0.01, TRACKING) == -TRACKING.least
    assert inferred_step(-0.02, 0.01, 0.0, TRACKING) == TRACKING.least


def test_fuzzy_bounds_in_the_wrong_order_are_refused():
    with pytest.raises(OnboardError, match="reference"):
        FuzzyCreep(reference=0.4)
    with pytest.raises(OnboardError, match="least"):
        FuzzyTracking(least=0.1)


SETS = ("low", "middle", "high")


FAR = 1e3


"""Where the outer sets end, beyond all inputs."""


def variable(knots):
    """Sets that peak at three knots; the outer ones stay full beyond them."""
    low, middle, high = knots
    sets = [
        simpful.TrapezoidFuzzySet(low - FAR, low - FAR, low, middle, "low"),
        simpful.TriangleFuzzySet(low, middle, high, "middle"),
        simpful.TrapezoidFuzzySet(middle, high, high + FAR, high + FAR, "high"),
    ]
    return simpful.LinguisticVariable(sets, universe_of_discourse=[low - FAR, high + FAR])


def engine(rules, x_knots, y_knots):
    """Nine rules whose degree is the product of their sets', zero-order Sugeno."""
    made = simpful.FuzzySystem(operators=["AND_PRODUCT"], show_banner=False, verbose=False)
    made.add_linguistic_variable("x", variable(x_knots))
    made.add_linguistic_variable("y", variable(y_knots))
    for i, row in enumerate(rules):
        for j, action in enumerate(row):
            made.set_crisp_output_value(f"action{i}{j}", action)
            condition = f"(x IS {SETS[i]}) AND (y IS {SETS[j]})"
            made.add_rules([f"IF {condition} THEN (action IS action{i}{j})"])
    return made


@looped(
    ("rules", "x_knots", "y_knots"),
    [
        (VALVES, (0.0, 0.05, 0.15), (-1.0, 0.0, 1.0)),  # uneven sets
        (STEPS, (-0.002, 0.0, 0.002), (-0.01, 0.0, 0.01)),
        (np.random.default_rng(1).normal(size=(3, 3)), (-3.0, 0.5, 0.7), (0.0, 2.0, 9.0)),
    ],
)
def test_the_action_is_that_of_a_library(rules, x_knots, y_knots):
    made = engine(rules, x_knots, y_knots)
    points = [np.linspace(2.0 * k[0] - k[1], 2.0 * k[2] - k[1], 12) for k in (x_knots, y_knots)]
    for x in points[0]:
        for y in points[1]:
            made.set_variable("x", x)
            made.set_variable("y", y)
            found = made.Sugeno_inference(["action"])["action"]
            own = weighted_action(rules, x, y, x_knots, y_knots)
            assert own == pytest.approx(found, abs=1e-9)


LEARNT = LearntIncrements(*(tuple(0.01 * (k + j) for j in range(4)) for k in range(6)))


def test_running_mean_is_16_and_17_by_hand():
    # (16): 0.02; (17): (0.010 x 20 + 0.02 x 4) / 24
    assert running_mean(0.010, 20.0, 0.02 + 0.03 + 0.02 + 0.01, 4.0) == pytest.approx(0.28 / 24)
    assert running_mean(0.28 / 24, 24.0, 0.0, 2.0) == pytest.approx(0.28 / 26)


def test_running_mean_is_the_mean_of_all_data_however_they_are_parted():
    data = 0.02 + 0.01 * np.random.default_rng(2).standard_normal(60)
    increment, count = 0.5, 0.0  # with nothing behind it, what is stored does not count
    for part in np.split(data, [10, 15, 16, 40]):
        increment = running_mean(increment, count, part.sum(), part.size)
        count += part.size
    assert increment == pytest.approx(data.mean(), rel=1e-12)


def test_data_that_tell_what_is_stored_change_nothing():
    assert running_mean(0.013, 7.0, 5 * 0.013, 5.0) == pytest.approx(0.013, rel=1e-14)
    assert gaussian_posterior(0.013, 0.01, 0.013, 0.012, 1e-6)[0] == 0.013


def test_posterior_is_the_precision_weighted_mean():
    prior, spread, noise = 0.005, 0.01, 0.012
    data = np.array([0.02, 0.03, 0.01])
    increment, deviation = prior, spread
    for value in data:
        increment, deviation = gaussian_posterior(increment, deviation, value, noise, 0.0)
    precision = 1 / spread**2 + data.size / noise**2
    assert increment == pytest.approx((prior / spread**2 + data.sum() / noise**2) / precision)
    assert deviation == pytest.approx(precision**-0.5)


def test_posterior_states_its_own_error():
    # true increments drawn from the prior: the posterior's z-scores are standard normal
    generator = np.random.default_rng(4)
    spread, noise, n = 0.01, 0.012, 4000
    truth = spread * generator.standard_normal(n)
    increment, deviation = np.zeros(n), np.full(n, spread)
    for _ in range(5):
        data = truth + noise * generator.standard_normal(n)
        increment, deviation = gaussian_posterior(increment, deviation, data, noise, 0.0)
    z = (increment - truth) / deviation
    assert z.std() == pytest.approx(1.0, abs=0.04)
    assert abs(z.mean()) < 0.06


def test_posterior_with_a_vague_prior_is_the_running_mean():
    data = [0.01, 0.02, 0.04, 0.01]
    increment, deviation = 0.5, 1e3
    for value in data:
        increment, deviation = gaussian_posterior(increment, deviation, value, 0.01, 0.0)
    assert increment == pytest.approx(running_mean(0.5, 0.0, sum(data), 4.0), rel=1e-6)


def test_posterior_with_drift_by_hand():
    # prior 4e-4 grows by 1e-4 to 5e-4 against noise 5e-4: half of the difference is taken, half of the variance left
    increment, deviation = gaussian_posterior(0.010, 0.02, 0.030, np.sqrt(5e-4), 1e-4)
    assert increment == pytest.approx(0.020)
    assert deviation == pytest.approx(np.sqrt(2.5e-4))


def test_drift_lets_the_posterior_follow_the_seasons():
    found = {}
    for drift in (0.0, 1e-6):
        increment, deviation = 0.0, 0.01
        for value in [0.0] * 500 + [0.02] * 50:
            increment, deviation = gaussian_posterior(increment, deviation, value, 0.012, drift)
        found[drift] = increment
    assert found[1e-6] > 2 * found[0.0]


def believed(belief, learning):
    return equipment(build(uneven_train(), Rail(0.15)), Onboard(belief=belief, learning=learning))


def test_a_train_begins_with_what_it_has_learnt_else_with_what_it_believes():
    stored = Belief(unit_increments=(0.02, 0.03, 0.02, 0.05))
    plain = believed(stored, IncrementLearning()).learnt
    assert plain.increment.tolist() == [0.02, 0.03, 0.02, 0.05]
    mean = believed(stored, IncrementLearning("running-mean", stored=7.0)).learnt
    np.testing.assert_allclose(mean.increment, [0.0, 0.01, 0.0, 0.03], atol=1e-15)
    assert mean.behind.tolist() == [7.0] * 4
    assert not any(values.any() for values in mean[3:])
    gauss = believed(stored, IncrementLearning("gaussian", deviation=0.02)).learnt
    assert gauss.deviation.tolist() == [0.0, 0.02, 0.02, 0.02]
    known = replace(stored, unit_deviation=(0.0, 0.1, 0.2, 0.3))
    assert believed(known, IncrementLearning("gaussian")).learnt.deviation[3] == 0.3
    for kind in ("none", "running-mean", "gaussian"):
        found = believed(replace(known, learnt=LEARNT), IncrementLearning(kind)).learnt
        np.testing.assert_array_equal(found, [[0.01 * (k + j) for j in range(4)] for k in range(6)])


@looped(
    ("values", "message"),
    [
        ({"kind": "magic"}, "kind = 'magic' must be one of none, running-mean, gaussian"),
        ({"reference": "latest"}, "reference = 'latest' must be one of received, held"),
        ({"update": "never"}, "update = 'never' must be one of run, next run"),
        ({"weight": "half"}, "weight = 'half' must be one of all, original"),
        ({"first": 0}, "first = 0 must be a whole number, 1 or greater"),
        ({"further": 2.5}, r"further = 2.5 must be a whole number"),
        ({"noise": 0.0}, "noise = 0.0 must be"),
        ({"noise": float("inf")}, "noise = inf must be a finite number"),
        ({"stored": -1.0}, "stored = -1.0 must be"),
        ({"deviation": float("nan")}, "deviation = nan must be"),
        ({"drift": -1e-9}, "drift = -1e-09 must be"),
    ],
)
def test_bad_settings_are_refused(values, message):
    with pytest.raises(OnboardError, match=message):
        IncrementLearning(**values)


def test_bad_experience_is_refused():
    with pytest.raises(OnboardError, match="must have a number per traction unit each"):
        replace(LEARNT, behind=(1.0,))
    with pytest.raises(OnboardError, match=r"behind\[1\] = -1.0"):
        replace(LEARNT, behind=(1.0, -1.0, 0.0, 0.0))
    with pytest.raises(OnboardError, match="every number must be finite"):
        replace(LEARNT, increment=(float("inf"), 0.0, 0.0, 0.0))
    short = LearntIncrements(*(((0.0,) * 3,) * 6))
    with pytest.raises(OnboardError, match="increments of 3 traction units for 4"):
        believed(Belief(learnt=short), IncrementLearning())
