"""Laws of the closed loop: one plant, compiled and hosted parts alike, limits as the patent sets them."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.balance import mechanical_energy
from alloc.metrics import evaluate
from alloc.onboard.parameters import Belief, Onboard, Sensors, Telegrams
from alloc.rules import find_rule
from alloc.simulation import DriverCommand, SimulationError, simulate


def _b1_onsets(run):
    signal = run["slipping"].values[:, 0]
    return np.flatnonzero((signal[1:] == 1) & (signal[:-1] == 0)) + 1


def test_energy_balance_of_a_run_with_slip(make_event, dip):
    event = make_event(0.15, patches=[dip], record_period=0.01)
    run = simulate(event, "alone", "cut-and-ramp")
    n = event.model.layout
    state = np.zeros((n.rows, run.sizes["time"]))
    state[n.position] = run["position"].values
    state[n.speed] = run["speed"].values
    state[n.omega] = (run["rim_speed"].values / event.model.structure.radius).T
    stored = np.array([mechanical_energy(event.model, now) for now in state.T])
    lost = run["friction_work"].values.sum(axis=1) + sum(
        run[name].values for name in ("shoe_work", "resistance_work", "coupler_work")
    )
    work = run["motor_work"].values
    assert _b1_onsets(run).size > 0
    assert np.max(np.abs(work - lost - (stored - stored[0]))) < 1e-6 * work[-1]


def test_halving_the_step_changes_the_metrics_by_less_than_a_thousandth(make_event, dip):
    coarse, fine = (
        evaluate(simulate(make_event(0.15, patches=[dip], step=step), "greedy"))
        for step in (1e-3, 5e-4)
    )
    for name in ("acceleration", "effort_ratio", "utilisation", "slip_peak", "damage", "distance"):
        assert fine[name] == pytest.approx(coarse[name], rel=1e-3), name
    assert fine["detections"] == coarse["detections"] > 0


def test_runs_are_reproducible_to_the_bit(make_event, dip):
    onboard = Onboard(
        sensors=Sensors(speed_noise=0.01, seed=4), telegrams=Telegrams(jitter=0.02, loss=0.1)
    )
    event = make_event(0.13, patches=[dip], onboard=onboard, scatter=0.006, seed=4)
    first, second = simulate(event, "greedy"), simulate(event, "greedy")
    first.attrs = second.attrs = {}
    assert first.identical(second)


def test_hosted_rule_and_compiled_rule_make_the_same_run(make_event, dip):
    event = make_event(0.13, patches=[dip])
    compiled = simulate(event, "exact")

    class Hosted:
        """The exact rule called from Python."""

        inner = find_rule("exact")
        name = "exact"
        trigger, caps, needs_truth = inner.trigger, inner.caps, inner.needs_truth
        law, onboard = None, inner.onboard

        def __call__(self, problem):
            return self.inner(problem)

    hosted = simulate(event, Hosted())
    assert compiled.attrs["rule_calls"] == hosted.attrs["rule_calls"] > 0
    for name in compiled.data_vars:
        np.testing.assert_allclose(hosted[name], compiled[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_qp_in_the_loop_equals_the_exact_level(make_event):
    # with uniform loads the weights are equal and the QP's optimum is the exact level
    event = make_event(0.07, increments=6.0)
    exact, qp = simulate(event, "exact"), simulate(event, "qp")
    assert 2 in exact["case"]
    assert qp.attrs["rule_calls"] > 0
    assert qp.attrs["rule_failures"] == 0
    np.testing.assert_allclose(qp["limit"], exact["limit"], atol=1e-7)


def test_limits_are_set_once_per_detection_and_reset_after_the_hold_time(make_event, dip):
    lines = Telegrams(period=0.1, latency=0.05)
    onboard = Onboard(hold_time=2.0, telegrams=lines, trigger="slip")
    run = simulate(make_event(0.155, patches=[dip], onboard=onboard, duration=12.0), "greedy")
    onsets = run["time"].values[_b1_onsets(run)]
    assert onsets.size > 0
    b1 = run["limit"].values[:, 0]
    changes = run["time"].values[1:][np.diff(b1) != 0.0]
    changes = changes[changes > 0.25]  # the start itself
    for change in changes:
        at_detection = np.min(np.abs(onsets - change)) < 0.011
        after_hold = np.any(np.abs(onsets + 2.0 - change) < 0.021)
        assert at_detection or after_hold
    # every other unit hears of it within a telegram period, the latency and a control period
    rear = run["limit"].values[:, -1]
    heard = run["time"].values[1:][np.diff(rear) != 0.0]
    heard = heard[heard > 0.5]
    assert all(np.min((h - changes)[h - changes > -1e-9]) <= 0.1 + 0.05 + 0.011 for h in heard)
    assert run["limit"].values[-1] == pytest.approx(run["expected"].values[-1])


def test_in_case_a_every_limit_is_the_cap(make_event):
    run = simulate(make_event(0.09, onboard=Onboard(trigger="slip")), "greedy", "cut-and-ramp")
    k = _b1_onsets(run)[0] + 30
    assert run["case"].values[k] == 1
    held = run["limit"].values[k, 0]
    growth = np.array(make_event(0.09).onboard.belief.increments)
    unit = run["axle_unit"].values
    means = np.array([growth[unit == j].mean() for j in range(run.sizes["unit"])])
    np.testing.assert_allclose(run["limit"].values[k], held + means - means[0], rtol=1e-12)


def test_estimate_at_detection_is_near_the_true_adhesion(make_event):
    for level in (0.09, 0.10, 0.11):
        run = simulate(make_event(level), "greedy")
        error = evaluate(run)["estimate_error"]
        assert abs(error) < 0.1 * level


def test_without_slip_nothing_acts(make_event):
    run = simulate(make_event(0.30), "greedy")
    metrics = evaluate(run)
    assert metrics["detections"] == metrics["unit_detections"] == metrics["slip_time"] == 0
    assert metrics["rule_calls"] == 0
    settled = run.sel(time=slice(1.5, None))
    np.testing.assert_allclose(
        settled["limit"], settled["expected"].values[:, None] + 0 * settled["limit"]
    )
    # delivers the plan less running resistance, and rotates its wheels without slip beyond the peak
    resistance = 3000.0 + 60.0 * settled["speed"] + 6.0 * settled["speed"] ** 2
    planned = 0.75 - resistance / (run.attrs["train_mass"] + run.attrs["train_rotating_mass"])
    # (6) compensates the units' own loads; the plan counts empty cars, all loaded by the same share here but for
    # the rotating parts, which do not grow with load
    assert settled["acceleration"].values == pytest.approx(planned.values, rel=0.02)


def test_lost_telegrams_make_units_fall_back_to_the_plan(make_event):
    onboard = Onboard(telegrams=Telegrams(loss=1.0, silence=0.5), trigger="slip")
    run = simulate(make_event(0.10, onboard=onboard), "greedy")
    assert run.attrs["fallbacks"] == 2
    assert run.attrs["telegrams_lost"] == run.attrs["telegrams_sent"] > 0
    late = run.sel(time=slice(2.0, 6.0))  # within the hold time after B1's first detection
    np.testing.assert_allclose(late["limit"].values[:, 1], late["expected"].values)
    assert np.all(late["limit"].values[:, 0] < late["expected"].values)


def test_when_b1_fails_the_next_motor_car_takes_over(make_event):
    event = make_event(0.10, failures={0: 2.0})
    run = simulate(event, "greedy")
    late = run.sel(time=slice(3.0, None))
    assert np.all(np.abs(late["motor_torque"].values[:, 0]) < 1.0)
    onset = np.diff(late["slipping"].values[:, 1]) == 1
    assert onset.any()
    assert run.attrs["detections"] > 0
    second = late["limit"].values[:, 1][-1]
    assert second < late["expected"].values[-1]


def test_wrong_increments_show_in_the_limits_only(make_event, train):
    wrong = Onboard(belief=Belief(increments=tuple(np.zeros(train.axle_count))), trigger="slip")
    right, belief = make_event(0.10), make_event(0.10, onboard=wrong)
    np.testing.assert_array_equal(
        right.model.environment.increment, belief.model.environment.increment
    )
    run = simulate(belief, "greedy")
    k = _b1_onsets(run)[0] + 30
    assert np.ptp(run["limit"].values[k]) == 0.0


def test_common_random_numbers(make_event):
    event = make_event(0.11, scatter=0.01, seed=7, onboard=Onboard(sensors=Sensors(0.01, seed=7)))
    one, other = simulate(event, "alone"), simulate(event, "greedy")
    assert one.attrs["event_hash"] == other.attrs["event_hash"]
    k = _b1_onsets(one)[0]  # until the first detection both runs are the same run
    assert one["slip_velocity"].values[: k - 1] == pytest.approx(
        other["slip_velocity"].values[: k - 1]
    )
    assert make_event(0.13, scatter=0.01, seed=8).model.rail != event.model.rail


def test_braking_mirrors_driving(make_event):
    # same rail, same demand in the other direction, no resistance: slides are detected and limits set alike
    event = make_event(0.10, command=DriverCommand((0.2,), (-0.75,)), initial_speed=25.0)
    run = simulate(event, "greedy")
    assert run.attrs["detections"] > 0
    assert run["speed"].values[-1] < 25.0
    assert np.all(run["motor_torque"].values <= 1.0)
    assert evaluate(run)["damage"] > 0.0


def test_load_compensation_keeps_the_acceleration(make_event, train):
    light, heavy = train.loaded((0.0,) * 5), train.loaded((9e3, 12e3, 12e3, 12e3, 9e3))
    accelerations = []
    for loaded in (light, heavy):
        free = replace(loaded, resistance=(0.0, 0.0, 0.0))
        run = simulate(make_event(0.35, train=free), "greedy")
        accelerations.append(run["acceleration"].sel(time=slice(2.0, 4.0)).mean().item())
    # without compensation the heavy train would lose a quarter
    assert accelerations[1] == pytest.approx(accelerations[0], rel=0.03)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"duration": float("nan")}, "duration = nan"),
        ({"step": 0.0}, r"step = 0\.0"),
    ],
)
def test_impossible_events_are_refused(make_event, change, message):
    with pytest.raises(SimulationError, match=message):
        make_event(0.13, **change)


def test_unknown_controller_is_named_with_the_nearest(make_event):
    with pytest.raises(SimulationError, match="did you mean 'cut-and-ramp'"):
        simulate(make_event(0.13), "greedy", "cut-and-rmp")
