"""Faults of signals, telegrams, solvers and controllers: the train goes on, falls back as stated, and counts each."""

import math
from dataclasses import replace

import numpy as np
import pytest

from alloc.event import DriverCommand
from alloc.metrics import evaluate
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.onboard.parameters import Dropout, Onboard, Sensors, Telegrams
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.rules import Caps, Trigger, find_rule
from alloc.simulation import simulate
from tests.cases import looped


def dropouts(axles, begin=2.0, until=5.0):
    return Onboard(sensors=Sensors(dropouts=tuple(Dropout(k, begin, until) for k in axles)))


def test_an_axle_without_signal_is_taken_for_the_mean_of_its_unit(make_event):
    # on rail that carries the plan all axles of a unit turn alike: nothing changes but what is seen
    whole = simulate(make_event(0.30), "greedy")
    part = simulate(make_event(0.30, onboard=dropouts([4])), "greedy")
    seen = part["axles_seen"].values
    lost = (part["time"].values >= 2.0) & (part["time"].values < 5.0)
    assert set(seen[lost, 0]) == {3.0}
    assert set(seen[~lost, 0]) == set(seen[:, 1]) == {4.0}
    assert part.attrs["blinded"] == 0
    np.testing.assert_allclose(part["torque_command"], whole["torque_command"], rtol=1e-3)


def test_an_axle_without_signal_slips_unnoticed_while_the_others_hold(make_event, train):
    # the front axle of the foremost unit alone finds too little adhesion
    given = np.full(train.axle_count, 0.05)
    given[4] = 0.0
    rail = Rail(0.09, increments=tuple(given))
    base = make_event(0.09, duration=5.0)
    slip = []
    for onboard in (Onboard(), dropouts([4], 0.0, math.inf)):
        event = replace(base, model=build(train, rail), onboard=onboard)
        slip.append(simulate(event, "alone")["slip_velocity"].values[:, 4].max())
    assert slip[1] > 2.0 * slip[0]


@looped("share", [0.3, 0.5, 1.0])
@looped("trigger", ["slip", "limited"])
def test_a_blind_unit_pulls_its_share_and_recovers_afterwards(make_event, trigger, share):
    onboard = replace(dropouts(range(4, 8)), trigger=trigger)
    onboard = replace(onboard, sensors=replace(onboard.sensors, blind_share=share))
    run = simulate(make_event(0.30, onboard=onboard), "greedy")
    whole = simulate(make_event(0.30), "greedy")
    blind = run.sel(time=slice(2.02, 4.98))
    target = whole["torque_target"].sel(time=slice(2.02, 4.98)).values
    np.testing.assert_allclose(
        blind["torque_command"].values[:, 0], share * target[:, 0], rtol=0.01
    )
    if trigger == "slip":
        np.testing.assert_allclose(blind["torque_command"].values[:, 1], target[:, 1], rtol=0.01)
    else:  # the others make up for what it leaves
        late = blind["torque_command"].values[150:]
        np.testing.assert_allclose(late.sum(axis=1), target[150:].sum(axis=1), rtol=0.03)
        np.testing.assert_allclose(late[:, 1], late[:, 2], rtol=0.01)
    assert set(blind["axles_seen"].values[:, 0]) == {0.0}
    # who is told of it goes by the report for another second
    late = slice(5.02 if trigger == "slip" else 7.0, None)
    after = run["torque_command"].sel(time=late).values
    np.testing.assert_allclose(after, whole["torque_target"].sel(time=late).values, rtol=0.01)
    assert run.attrs["blinded"] == 1


@looped("rule", ["alone", "greedy", "exact"])
def test_dropouts_leave_the_random_numbers_alone(make_event, rule):
    noisy = Sensors(speed_noise=0.01, seed=3)
    lost = replace(noisy, dropouts=(Dropout(4, 4.0, 5.0),))
    one, other = (
        simulate(make_event(0.13, onboard=Onboard(sensors=s), scatter=0.006, seed=3), rule)
        for s in (noisy, lost)
    )
    before = one["time"].values < 4.0
    for name in ("slip_velocity", "torque_command", "coefficient_estimate"):
        np.testing.assert_array_equal(one[name].values[before], other[name].values[before])


@looped("loss", [0.5, 0.9])
def test_telegrams_are_counted_and_units_fall_back_in_silence(make_event, loss):
    onboard = Onboard(telegrams=Telegrams(loss=loss, silence=0.35))
    run = simulate(make_event(0.10, onboard=onboard, duration=12.0), "greedy")
    sent = 2 * 2 * 120  # two units and B1 tell each other ten times a second
    assert run.attrs["telegrams_sent"] == sent
    spread = 4.0 * math.sqrt(sent * loss * (1.0 - loss))
    assert run.attrs["telegrams_lost"] == pytest.approx(sent * loss, abs=spread)
    fallen = run["fallen_back"].values.astype(int)
    onsets = int((np.diff(fallen, axis=0) == 1).sum() + fallen[0].sum())
    assert run.attrs["fallbacks"] == onsets > 0
    # who has fallen back keeps the plan, and takes limits up again with the next telegram
    for unit in (1, 2):
        silent = run["fallen_back"].values[:, unit].astype(bool)
        expected = run["expected"].values[silent]
        np.testing.assert_allclose(run["limit"].values[silent, unit], expected)
    assert (np.diff(fallen, axis=0) == -1).any()


def test_losing_telegrams_leaves_the_rail_and_the_noise_alone(make_event):
    none, most = (
        simulate(make_event(0.13, onboard=Onboard(telegrams=Telegrams(loss=p))), "alone")
        for p in (0.0, 0.9)
    )
    for name in ("slip_velocity", "torque_command"):
        np.testing.assert_array_equal(none[name], most[name])


class FailingRule:
    """The exact rule, whose solver fails every `every`-th call: it then answers with what stood before."""

    name = "failing"

    def __init__(self, every: int) -> None:
        self.inner, self.every, self.calls, self.failed = find_rule("exact"), every, 0, 0
        self.trigger, self.caps, self.needs_truth = Trigger.STEPWISE, Caps.FRONT, False
        self.onboard = {}
        self.law = None

    def __call__(self, problem):
        self.calls += 1
        answer = self.inner(problem)
        if self.calls % self.every:
            return answer
        self.failed += 1
        return replace(answer, limit=np.asarray(problem.previous), status="time limit reached")


@looped("every", [1, 3])
def test_a_rule_whose_solver_fails_is_counted_and_the_last_limits_stand(make_event, every):
    rule = FailingRule(every)
    run = simulate(make_event(0.10), rule)
    assert run.attrs["rule_calls"] == rule.calls > 10
    assert run.attrs["rule_failures"] == rule.failed == rule.calls // every
    assert "rule: time limit reached" in run.attrs["messages"]
    if every == 1:  # limits never leave the plan: the train runs as under `alone`
        np.testing.assert_allclose(
            run["limit"].values, run["expected"].values[:, None] + 0.0 * run["limit"].values
        )
    assert evaluate(run)["effort_ratio"] > 0.5


class FailingController:
    """Host controller that passes the target, and from `BEGIN` to `UNTIL` fails or says nothing usable."""

    BEGIN, UNTIL = 2.0, 4.0

    def __init__(self, answer: TorqueDecision) -> None:
        self.answer = answer

    def decide(self, sense) -> TorqueDecision:
        if self.BEGIN <= sense.time < self.UNTIL:
            return self.answer
        return TorqueDecision(sense.target, True, "ok", 1e-4)


FAILURES = {
    "solver": TorqueDecision(0.0, False, "infeasible", 1e-3),
    "late": TorqueDecision(500.0, False, "late", 0.02),
    "nan": TorqueDecision(math.nan, True, "ok", 1e-4),
}


@looped("kind", FAILURES)
def test_where_a_controller_fails_its_unit_cuts_and_ramps(make_event, kind):
    failing = HostedController(
        "failing", "fails", each_unit(lambda context: FailingController(FAILURES[kind]))
    )
    event = make_event(0.11)
    run = simulate(event, "alone", failing)
    steps = round((FailingController.UNTIL - FailingController.BEGIN) / event.onboard.period)
    assert run.attrs["controller_failures"] == steps * run.sizes["unit"]
    status = "torque not finite" if kind == "nan" else FAILURES[kind].status
    assert f"controller: {status}" in run.attrs["messages"]
    inside = run.sel(time=slice(FailingController.BEGIN + 0.02, FailingController.UNTIL - 0.02))
    # cut-and-ramp in reserve ends the slip that passing the target has brought
    outside = run.sel(time=slice(None, FailingController.BEGIN))
    assert np.abs(outside["slip_velocity"].values[-1]).max() > 0.3
    command, target = inside["torque_command"].values, inside["torque_target"].values
    assert np.all((command >= 0.0) & (command <= target))
    assert (command < 0.9 * target).any()
    assert evaluate(run)["effort_ratio"] > 0.5


def test_a_controller_that_fails_throughout_is_cut_and_ramp(make_event):
    class Dead(FailingController):
        BEGIN, UNTIL = 0.0, math.inf

    event = make_event(0.11)
    dead = each_unit(lambda context: Dead(FAILURES["solver"]))
    run = simulate(event, "alone", HostedController("dead", "never answers", dead))
    reserve = simulate(event, "alone", "cut-and-ramp")
    for name in ("torque_command", "slip_velocity"):
        np.testing.assert_array_equal(run[name], reserve[name])


@looped(("rule", "trigger"), [("greedy", "slip"), ("alone", "limited")])
def test_a_failed_unit_costs_its_share_and_no_more(make_event, rule, trigger):
    onboard = Onboard(trigger=trigger)
    whole = simulate(make_event(0.30, onboard=onboard), rule)
    failed = simulate(make_event(0.30, onboard=onboard, failures={1: 3.0}), rule)
    late = slice(4.0, None)
    force, left = (r["rail_force"].sel(time=late).values.sum() for r in (whole, failed))
    assert left == pytest.approx(2.0 / 3.0 * force, rel=0.03)
    others = failed["torque_command"].sel(time=late).values[:, [0, 2]]
    np.testing.assert_allclose(
        others, whole["torque_command"].sel(time=late).values[:, [0, 2]], rtol=0.01
    )


@looped("rule", ["greedy", "greedy-claim", "exact", "qp", "cooperative"])
def test_the_others_make_up_for_a_failed_unit_where_the_rail_lets_them(make_event, rule):
    """At once, and with no more than the plan, though nothing slips that would tell how far they may go."""
    run = simulate(make_event(0.40, failures={1: 3.0}), rule)
    before, after = (
        run["rail_force"].sel(time=slice(*span)).values.sum(axis=1)
        for span in ((2.0, 2.9), (5.0, 7.9))
    )
    assert run["motor_torque"].sel(time=slice(3.5, None)).values[:, 1].max() < 1e-6
    np.testing.assert_allclose(after, before.mean(), rtol=0.04)
    # a failure is known after 0.1 s, and told with the next telegrams
    later = run.sel(time=slice(2.0, None))
    limits = later["limit"].values[:, [0, 2]] / later["expected"].values[:, None]
    assert limits[:100].max() < 1.005
    first = later["time"].values[np.argmax(limits > 1.005, axis=0)]
    assert np.all((first > 3.09) & (first < 3.0 + 0.1 + 2 * 0.1 + 0.05))


def test_a_rule_with_caps_of_its_own_goes_by_reports_whatever_the_trigger(make_event):
    """Also where a unit sees none of its axles and limits arrive late: its own is the plan at least."""
    onboard = replace(dropouts(range(8, 12)), telegrams=Telegrams(loss=0.8))
    command = DriverCommand((0.2, 3.0, 4.0), (0.75, 0.5, 0.75))
    runs = [
        simulate(
            make_event(0.13, onboard=replace(onboard, trigger=one), command=command), "cooperative"
        )
        for one in ("slip", "limited")
    ]
    for name in runs[0].data_vars:
        np.testing.assert_array_equal(runs[0][name], runs[1][name], err_msg=name)
