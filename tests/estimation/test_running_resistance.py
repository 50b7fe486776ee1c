"""Running resistance: learners and their laws, what a run can teach, and learning from a log."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.errors import EstimationError
from alloc.estimation.running_resistance import (
    LEARNED,
    NOT_LEARNABLE,
    GradientLearner,
    Learner,
    LeastSquaresLearner,
    NormalisedGradientLearner,
    RunLog,
    gradient_step,
    judge_excitation,
    learn_from_log,
)
from alloc.onboard.line_memory import EXTENDED_WEIGHTS, WEIGHTS, LineMemory, Motion, regressor
from alloc.plant.laws import GRAVITY
from tests.cases import looped

THREE = np.array([12.0, 20.0, 250e3])


WRONG = THREE * np.array([1.3, 0.7, 0.7])


TYPICAL = np.array([400.0, 400.0, 0.5])


LEARNERS = (
    lambda w: GradientLearner(w, 1e-7),
    lambda w: NormalisedGradientLearner(w, 0.1),
    lambda w: LeastSquaresLearner(w, THREE),
    lambda w: LeastSquaresLearner(w, THREE, forgetting=0.99),
)


def motions(seed: int, count: int, tunnel: float | None = None) -> np.ndarray:
    """Regressors of random motions."""
    g = np.random.default_rng(seed)
    inside = g.integers(0, 2, count).astype(float) if tunnel is None else np.full(count, tunnel)
    return regressor(
        Motion(g.uniform(5, 20, count), g.uniform(-0.5, 0.5, count), g.uniform(-0.3, 0.3, count), inside)
    )  # fmt: skip


@looped("make", LEARNERS)
def test_exact_weights_stay(make):
    learner = make(THREE)
    for z in motions(0, 50):
        learner.update(z, float(THREE @ z - learner.weights @ z))
    np.testing.assert_allclose(learner.weights, THREE, rtol=1e-12)


@given(st.integers(0, 1000), st.floats(0.01, 3.0))
@settings(max_examples=60, deadline=None)
def test_a_gradient_step_lessens_its_samples_error_below_the_bound_and_enlarges_it_above(
    seed, share
):
    z = motions(seed, 1)[0]
    error = float((THREE - WRONG) @ z)
    stepped = gradient_step(WRONG, z, error, share * 2.0 / float(z @ z))
    left = float((THREE - stepped) @ z)
    assert left == pytest.approx((1.0 - 2.0 * share) * error, rel=1e-6, abs=1e-6)
    assert (abs(left) <= abs(error) * (1.0 + 1e-9)) == (share <= 1.0) or abs(error) < 1e-6


def test_the_gradient_diverges_beyond_its_bound():
    z = motions(1, 1, 0.0)[0]
    learner = GradientLearner(WRONG, 2.1 / float(z @ z))
    for _ in range(100):
        learner.update(z, float((THREE - learner.weights) @ z))
    assert abs((THREE - learner.weights) @ z) > 1e3 * abs((THREE - WRONG) @ z)


@given(
    st.integers(0, 1000),
    st.lists(st.floats(0.01, 100.0), min_size=3, max_size=3),
    st.floats(0.1, 10),
)
@settings(max_examples=40, deadline=None)
def test_the_normalised_gradient_does_not_depend_on_units(seed, units, force_unit):
    z, c = motions(seed, 1)[0], np.array(units)
    error = float((THREE - WRONG) @ z)
    one = NormalisedGradientLearner(WRONG, 0.3, TYPICAL)
    one.update(z, error)
    # weights in other units: z in units of c, forces in force_unit
    other = NormalisedGradientLearner(WRONG * force_unit / c, 0.3, TYPICAL * c)
    other.update(z * c, error * force_unit)
    plain, scaled = one.weights, other.weights
    np.testing.assert_allclose(scaled * c / force_unit, plain, rtol=1e-9)
    assert float((THREE - plain) @ z) == pytest.approx(0.7 * error, rel=1e-6, abs=1e-6)


@looped("joint", [True, False])
def test_recursive_least_squares_is_batch_least_squares(joint):
    z = motions(2, 200, None if joint else 0.0)
    force = z @ THREE + 500.0 * np.random.default_rng(3).standard_normal(200)
    learner = LeastSquaresLearner(WRONG, THREE, noise=500.0, joint=joint)
    for row, f in zip(z, force, strict=True):
        learner.update(row, float(f - learner.weights @ row))
    prior = np.diag(1.0 / THREE**2)
    information = z.T @ z / 500.0**2 + prior
    batch = np.linalg.solve(information, z.T @ force / 500.0**2 + prior @ WRONG)
    np.testing.assert_allclose(learner.weights, batch, rtol=1e-6)
    np.testing.assert_allclose(
        learner.posterior(), np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-6
    )


@looped("make", LEARNERS)
@looped(("tunnel", "kept"), [(1.0, 0), (0.0, 1)])
def test_a_section_moves_its_own_weight_only(make, tunnel, kept):
    learner = make(WRONG)
    for z in motions(4, 100):  # correlations between the weights come to be
        learner.update(z, float((THREE - learner.weights) @ z))
    before = learner.weights.copy()
    for z in motions(5, 50, tunnel):
        learner.update(z, float((1.2 * THREE - learner.weights) @ z))
    assert learner.weights[kept] == before[kept]
    assert learner.weights[1 - kept] != before[1 - kept]


def test_joint_least_squares_moves_both_sections():
    learner = LeastSquaresLearner(WRONG, THREE, joint=True)
    for z in motions(4, 100):
        learner.update(z, float((THREE - learner.weights) @ z))
    before = learner.weights[0]
    learner.update(motions(5, 1, 1.0)[0], 5e3)
    assert learner.weights[0] != before


def test_forgetting_follows_a_mass_that_changes_and_does_not_run_off_unexcited():
    heavier = THREE * np.array([1.0, 1.0, 1.3])
    errors = []
    for forgetting in (1.0, 0.98):
        learner = LeastSquaresLearner(THREE, THREE, forgetting=forgetting)
        for weights, seed in ((THREE, 6), (heavier, 7)):
            for z in motions(seed, 300):
                learner.update(z, float((weights - learner.weights) @ z))
        errors.append(abs(learner.weights[2] / heavier[2] - 1.0))
    assert errors[1] < 0.01 < errors[0]
    cruise = regressor(Motion(20.0, 0.0, 0.0, 0.0))
    for _ in range(5000):
        learner.update(cruise, 0.0)
    assert np.all(learner.posterior() <= THREE * (1.0 + 1e-9))


def test_forgetting_weighs_old_samples_less_by_its_share():
    """At one speed on level track only W1 is excited: its information is a sum, of which the old part fades."""
    learner = LeastSquaresLearner(WRONG, THREE, noise=500.0, forgetting=0.9)
    for _ in range(3):
        learner.update(regressor(Motion(20.0, 0.0, 0.0, 0.0)), 100.0)
    sample, prior = 400.0**2 / 500.0**2, 1.0 / 12.0**2
    information = 0.9 * (0.9 * (prior + sample) + sample) + sample
    assert learner.posterior()[0] == pytest.approx(information**-0.5, rel=1e-9)
    assert learner.posterior()[1:] == pytest.approx(THREE[1:], rel=1e-12)


def test_a_weight_that_is_hardly_excited_is_not_forgotten_beyond_its_prior():
    learner = LeastSquaresLearner(THREE, THREE, forgetting=0.98)
    creeping = regressor(Motion(0.1, 0.0, 0.0, 0.0))  # V^2 = 0.01 against a noise of 500 N
    for _ in range(2000):
        learner.update(creeping, 0.0)
    np.testing.assert_allclose(learner.posterior(), THREE, rtol=1e-2)
    assert np.all(learner.posterior() <= THREE * (1.0 + 1e-2))


def test_the_misprint_goes_the_wrong_way_where_a_train_slows_down_uphill():
    z = regressor(Motion(10.0, -0.1, 0.25, 0.0))
    error = float((THREE - np.array([12.0, 20.0, 175e3])) @ z)
    start = np.array([12.0, 20.0, 175e3])
    meant, printed = (GradientLearner(start, 1e-6, as_printed=p) for p in (False, True))
    for learner in (meant, printed):
        learner.update(z, error, -0.1)
    assert meant.weights[2] > start[2] > printed.weights[2]
    with pytest.raises(EstimationError, match="acceleration"):
        printed.update(z, error)


def test_from_a_gradient_at_constant_speed_the_misprint_learns_no_mass():
    learner = GradientLearner(WRONG, 1e-6, as_printed=True)
    learner.update(regressor(Motion(10.0, 0.0, 0.25, 0.0)), 1e4, 0.0)
    assert learner.weights[2] == WRONG[2]


@looped(
    ("make", "named"),
    [
        (lambda: GradientLearner(np.array([1.0, np.nan, 1.0]), 1.0), "weights"),
        (lambda: GradientLearner(np.ones(4), 1.0), "weights"),
        (lambda: GradientLearner(THREE, 0.0), "gain"),
        (lambda: NormalisedGradientLearner(THREE, -1.0), "rate"),
        (lambda: LeastSquaresLearner(THREE, np.ones(2)), "deviation"),
        (lambda: LeastSquaresLearner(THREE, THREE, forgetting=1.5), "forgetting"),
        (lambda: LeastSquaresLearner(THREE, THREE, noise=0.0), "noise"),
        (lambda: GradientLearner(THREE, 1.0).update(np.ones(5), 1.0), "regressor"),
        (lambda: GradientLearner(THREE, 1.0).update(np.ones(3), float("nan")), "error"),
    ],
)
def test_impossible_learners_and_samples_are_refused(make, named):
    with pytest.raises(EstimationError, match=named):
        make()


TRUE = np.array([12.0, 20.0, 250e3, 3e3, 140.0])


N = 400


def judged(motion: Motion, weights: int = 3, noise: float = 100.0):
    z = regressor(motion, weights)
    force = z @ TRUE[:weights] + noise * np.random.default_rng(0).standard_normal(N)
    return judge_excitation(z, force, EXTENDED_WEIGHTS[:weights])


def statuses(found):
    return {one.name: (one.status, one.reason) for one in found.weights}


def steady(value: float) -> np.ndarray:
    return np.full(N, value)


def test_constant_speed_on_level_track_teaches_air_resistance_only():
    found = statuses(judged(Motion(steady(20.0), steady(0.0), steady(0.0), steady(0.0))))
    assert found["W1"] == (LEARNED, "")
    assert found["W2"] == found["W3"] == (NOT_LEARNABLE, "its regressor is zero throughout")


def test_constant_speed_on_one_gradient_tells_neither():
    found = judged(Motion(steady(20.0), steady(0.0), steady(0.2), steady(0.0)))
    assert statuses(found)["W1"] == (NOT_LEARNABLE, "cannot be told apart from W3")
    assert statuses(found)["W3"] == (NOT_LEARNABLE, "cannot be told apart from W1")
    assert found.condition > 1e9


def test_a_gradient_that_changes_excites_the_mass():
    slope = np.where(np.arange(N) < N // 2, 0.0, 0.2)
    found = judged(Motion(steady(20.0), steady(0.0), slope, steady(0.0)))
    assert found.learned("W1")
    assert found.learned("W3")
    assert found.weights[2].value == pytest.approx(TRUE[2], rel=0.01)
    assert 0.0 < found.smallest_eigenvalue < 1.0 < found.condition < 20.0


def test_a_tunnel_with_the_mass_known_from_outside_teaches_its_weight():
    k = np.arange(N)
    found = judged(Motion(steady(20.0), np.where(k < 100, 0.3, 0.0), steady(0.0), k > 250))
    assert all(found.learned(name) for name in WEIGHTS)


def test_at_one_speed_a_constant_and_a_linear_part_hide_in_the_square():
    k = np.arange(N)
    found = judged(Motion(steady(20.0), np.where(k < 100, 0.3, 0.0), steady(0.0), steady(0.0)), 5)
    assert not any(found.learned(name) for name in ("W1", "A", "B"))
    assert found.learned("W3")
    speed = 1.0 + 30.0 * np.abs(np.sin(k / 40.0))
    wide = judged(Motion(speed, np.cos(k / 7.0), steady(0.0), k % 2), 5, noise=5.0)
    assert all(wide.learned(name) for name in EXTENDED_WEIGHTS)


def test_what_drowns_in_noise_or_has_few_samples_is_not_learned():
    slope = np.where(np.arange(N) < N // 2, 0.0, 0.01)
    motion = Motion(steady(20.0), steady(0.0), slope, steady(0.0))
    found = statuses(judged(motion, noise=10e3))
    assert found["W3"][0] == NOT_LEARNABLE
    assert "too little" in found["W3"][1]
    few = np.where(np.arange(N) < 5, 0.3, 0.0)
    found = statuses(judged(Motion(steady(20.0), few, steady(0.0), steady(0.0)), noise=1.0))
    assert found["W3"] == (NOT_LEARNABLE, "5 samples only")


def test_residuals_that_follow_each_other_count_less():
    z = regressor(Motion(20.0 + np.sin(np.arange(N)), steady(0.1), steady(0.0), steady(0.0)))
    white = 500.0 * np.random.default_rng(1).standard_normal(N)
    slow = np.convolve(white, np.ones(50) / np.sqrt(50.0), mode="same")
    deviations = [
        judge_excitation(z, z @ TRUE[:3] + noise, WEIGHTS).weights[0].deviation
        for noise in (white, slow)
    ]
    assert deviations[1] > 3.0 * deviations[0]


@looped(
    ("z", "f"),
    [
        (np.ones((4, 2)), np.ones(4)),
        (np.ones((4, 3)), np.ones(3)),
        (np.full((4, 3), np.nan), np.ones(4)),
    ],
)
def test_data_that_are_none_are_refused(z, f):
    with pytest.raises(EstimationError, match="excitation"):
        judge_excitation(z, f, WEIGHTS)


def by_hand(size=1.0):
    """40 samples of 3 z1 + 5 z2 and a residual ++++---- orthogonal to both: z1 is 1, z2 is 1 in the first 16."""
    z = np.column_stack([np.ones(40), np.arange(40) < 16])
    residual = size * np.where(np.arange(40) % 8 < 4, 1.0, -1.0)
    return judge_excitation(z, z @ [3.0, 5.0] + residual, ("one", "other"))


def test_numbers_of_a_judgement_by_hand():
    found = by_hand()
    # cosine of the regressors: 16 / sqrt(40 x 16); part apart: 1 - 0.4; eigenvalues 1 +- sqrt(0.4)
    assert [weight.part for weight in found.weights] == pytest.approx([0.6, 0.6])
    assert [weight.value for weight in found.weights] == pytest.approx([3.0, 5.0])
    assert found.smallest_eigenvalue == pytest.approx(1.0 - np.sqrt(0.4))
    assert found.condition == pytest.approx((1.0 + np.sqrt(0.4)) / (1.0 - np.sqrt(0.4)))
    assert found.residual == pytest.approx(1.0)
    # from one residual to the next: 30 pairs alike, 9 opposite, over 40; 40 samples less two weights
    r = 21 / 40
    variance = 40 / 38 * (1 + r) / (1 - r)
    assert [weight.deviation for weight in found.weights] == pytest.approx(
        [np.sqrt(variance / 0.6 / 40), np.sqrt(variance / 0.6 / 16)]
    )


def test_a_weight_may_be_uncertain_by_a_twentieth():
    unit = by_hand().weights[0].deviation / 3.0
    for uncertain, learnt in ((0.049, True), (0.051, False)):
        found = by_hand(uncertain / unit)
        assert found.learned("one") == learnt
        said = "excited too little against what the weights leave: uncertain by 5.1 %"
        assert found.weights[0].reason == ("" if learnt else said)


@looped(("square", "told_apart"), [(0.00095, False), (0.00106, True)])
def test_a_thousandth_of_the_regressor_must_be_its_own(square, told_apart):
    alternating = np.where(np.arange(400) % 2, 1.0, -1.0)
    third = np.where(np.arange(400) % 4 < 2, 1.0, -1.0)  # resembles neither
    against = np.column_stack([np.ones(400), -1.0 - np.sqrt(square) * alternating, third])
    found = judge_excitation(against, against @ [1.0, 2.0, 3.0], ("one", "other", "third"))
    reasons = [weight.reason for weight in found.weights[:2]]
    if told_apart:
        assert reasons == ["", ""]
    else:
        assert reasons == ["cannot be told apart from other", "cannot be told apart from one"]


@looped(("count", "learnt"), [(19, False), (20, True)])
def test_twenty_samples_are_needed(count, learnt):
    z = np.column_stack([np.ones(100), np.arange(100) < count])
    assert judge_excitation(z, z @ [1.0, 2.0], ("one", "few")).learned("few") == learnt


FIVE = np.array([12.0, 20.0, 250e3, 3e3, 140.0])


ROTATING = 20e3


PERIOD = 0.5


MEMORY = LineMemory(stations=(0.0, 300.0), gradients=(0.0, 2.0), tunnels=((500.0, 800.0),))


class Witness(Learner):
    """Learns nothing and keeps what it was asked to learn."""

    def _learn(self, regressor, error, acceleration):
        self.seen = [*getattr(self, "seen", []), (regressor, error, acceleration)]


def log(**changes):
    """A log of 60 s that obeys F = (W1 or W2) V^2 + W3 (a + g sin) + A + B V + M_r a over every interval, written out."""
    time = PERIOD * np.arange(121)
    speed = 15.0 + 4.0 * np.sin(time / 7.0)
    position = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * PERIOD)])
    force = np.zeros(time.size)
    for k in range(time.size - 1):
        v, a = (speed[k] + speed[k + 1]) / 2, (speed[k + 1] - speed[k]) / PERIOD
        x = (position[k] + position[k + 1]) / 2
        air = 20.0 if 500.0 <= x < 800.0 else 12.0
        slope = GRAVITY * 0.02 / np.sqrt(1.0 + 0.02**2) if x >= 300.0 else 0.0
        force[k] = air * v**2 + 250e3 * (a + slope) + 3e3 + 140.0 * v + 20e3 * a
    return RunLog(**{"time": time, "position": position, "speed": speed, "force": force} | changes)


def test_exact_weights_leave_nothing():
    learner = Witness(FIVE)
    found = learn_from_log(log(), MEMORY, learner, ROTATING)
    np.testing.assert_allclose(found.error, 0.0, atol=1e-6)
    assert found.weights.shape == (120, 5)
    assert len(learner.seen) == 120
    # what was learnt from, of the first interval
    regressor, _, acceleration = learner.seen[0]
    v, w = 15.0, 15.0 + 4.0 * np.sin(0.5 / 7.0)
    mean, a = (v + w) / 2, (w - v) / 0.5
    np.testing.assert_allclose(regressor, [mean**2, 0.0, a, 1.0, mean], rtol=1e-12)
    assert acceleration == pytest.approx(a)
    for weight, status in zip(FIVE, found.excitation.weights, strict=True):
        assert status.value == pytest.approx(weight, rel=1e-6)


def test_weights_of_every_instant_are_kept():
    class Counting(Learner):
        def _learn(self, regressor, error, acceleration):
            self.weights = self.weights + 1.0

    found = learn_from_log(log(), MEMORY, Counting(FIVE[:3]))
    np.testing.assert_allclose(found.weights[:, 0], 12.0 + 1.0 + np.arange(120))
    np.testing.assert_array_equal(found.time, PERIOD * np.arange(120))


def test_samples_over_a_change_of_the_line_and_those_not_kept_are_left_out():
    whole = log()
    middle = 0.5 * (whole.position[1:] + whole.position[:-1])
    under = np.zeros(120, dtype=bool)
    for change in (300.0, 500.0, 800.0):  # the train is 40 m long
        under |= (middle >= change) & (middle < change + 40.0)
    assert 0 < under.sum() < 20
    late = whole.time[:-1] >= 10.0
    found = learn_from_log(
        whole, MEMORY, Witness(FIVE), ROTATING, train_length=40.0, keep=lambda time: time >= 10.0
    )
    np.testing.assert_array_equal(np.isfinite(found.error), late & ~under)
    with pytest.raises(EstimationError, match="no sample is left"):
        learn_from_log(whole, MEMORY, Witness(FIVE), keep=lambda time: time > 1e3)


def test_a_filter_takes_samples_once_it_has_settled_and_starts_anew_in_a_tunnel():
    whole = log()
    found = learn_from_log(whole, MEMORY, Witness(FIVE), ROTATING, filter_time=1.0)
    middle = 0.5 * (whole.position[1:] + whole.position[:-1])
    inside = (middle >= 500.0) & (middle < 800.0)
    taken = np.isfinite(found.error)
    np.testing.assert_allclose(found.error[taken], 0.0, atol=1e-5)
    starts = [0, *(np.flatnonzero(np.diff(inside.astype(int))) + 1)]
    # three time constants of 1 s are 6 samples of 0.5 s: the seventh is the first
    expected = np.ones(120, dtype=bool)
    for start in starts:
        expected[start : start + 6] = False
    np.testing.assert_array_equal(taken, expected)
    with pytest.raises(EstimationError, match="no section is long enough"):
        learn_from_log(whole, MEMORY, Witness(FIVE), filter_time=100.0)


def test_a_filter_starts_anew_after_samples_that_were_left_out():
    found = learn_from_log(
        log(),
        LineMemory(),
        Witness(FIVE),
        filter_time=1.0,
        keep=lambda time: abs(time - 25.0) > 2.0,
    )
    # samples at 23.0 to 27.0 s are left out, that is 46 to 54; each stretch gives its seventh first
    k = np.arange(120)
    expected = ((k >= 6) & (k < 46)) | (k >= 55 + 6)
    np.testing.assert_array_equal(np.isfinite(found.error), expected)


def test_commanded_speed_and_acceleration_stand_in_for_the_measured_ones():
    whole = log()
    rate = np.append(np.diff(whole.speed) / PERIOD, 0.0)
    told = log(speed=0.0 * whole.speed, commanded_speed=whole.speed, commanded_acceleration=rate)
    found = learn_from_log(told, MEMORY, Witness(FIVE), ROTATING, source="commanded")
    np.testing.assert_allclose(found.error, 0.0, atol=1e-6)
    with pytest.raises(EstimationError, match="no commanded speed"):
        learn_from_log(whole, MEMORY, Witness(FIVE), source="commanded")
    with pytest.raises(EstimationError, match="source = 'guessed'"):
        learn_from_log(whole, MEMORY, Witness(FIVE), source="guessed")


def recorded(pressure=0.0):
    """Two units of two and one axles, and one axle without motor."""
    return xr.Dataset(
        {
            "axle_unit": ("axle", [0, 0, -1, 1]),
            "unit_gear": ("unit", [6.0, 7.0]),
            "unit_radius": ("unit", [0.5, 0.4]),
            "motor_torque": (("time", "unit"), [[0.0, 0.0], [100.0, 200.0], [300.0, 500.0]]),
            "position": ("time", [5.0, 6.0, 8.0]),
            "car_speed": (("time", "car"), [[1.0, 9.0], [2.0, 9.0], [4.0, 9.0]]),
            "cylinder_pressure": (("time", "brake_group"), np.full((3, 1), pressure)),
        },
        coords={"time": [0.0, 1.0, 2.0]},
    )


def test_a_recorded_run_is_a_log_of_the_foremost_car_and_of_all_motors():
    # 24 N per N m of unit 0 (2 x 6 / 0.5), 17.5 of unit 1; what acts in an interval is recorded at its end
    told = RunLog.of_run(recorded(0.9e3))  # 0.01 bar is no braking
    one, two = 100.0 * 24.0 + 200.0 * 17.5, 300.0 * 24.0 + 500.0 * 17.5
    assert told.force == pytest.approx([one, two, two])
    assert told.speed.tolist() == [1.0, 2.0, 4.0]
    assert told.position.tolist() == [5.0, 6.0, 8.0]
    assert told.period == 1.0
    noise = RunLog.of_run(recorded(), 0.5, seed=3).speed - told.speed
    np.testing.assert_allclose(noise, 0.5 * np.random.default_rng(3).standard_normal(3))


@looped(
    ("make", "named"),
    [
        (lambda: RunLog.of_run(recorded(1.1e3)), "air brakes acted"),
        (lambda: log(time=0.5 * np.arange(121) ** 1.01), "even steps"),
        (lambda: log(time=-0.5 * np.arange(121)), "must grow"),
        (lambda: log(speed=np.zeros(3)), "speed has shape"),
        (lambda: RunLog(*np.zeros((4, 2))), "3 samples"),
    ],
)
def test_logs_that_cannot_be_learnt_from_are_refused(make, named):
    with pytest.raises(EstimationError, match=named):
        make()
