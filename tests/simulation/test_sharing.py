"""Sharing in the closed loop: the bound, the oracle, what cooperation gains, own slips, who leads, and what is learnt."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from alloc.compilation import jit
from alloc.errors import OnboardError
from alloc.metrics import evaluate
from alloc.onboard.equipment import equipment
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.onboard.increment_learning import (
    IncrementLearning,
    Increments,
    LearntIncrements,
    gaussian_posterior,
    running_mean,
)
from alloc.onboard.parameters import Belief, Onboard, Telegrams
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail, logarithmic_increments
from alloc.plant.sets import find_set
from alloc.recording import VARIABLES
from alloc.rules import RULES, Caps, Rule, Trigger
from alloc.simulation import DriverCommand, Event, simulate
from studies.scenario import default_scenarios
from studies.scenario import load as load_scenario
from tests.cases import looped

DRIVING = [s.name for s in default_scenarios() if s.command[-1].acceleration_kmhs > 0.0]


WITH_ROOM = ("wet-patch", "failed-unit")


@pytest.fixture(scope="module")
def found():
    """Metrics of a scenario under a rule and a controller, with telegrams lost or not; each run is made once."""
    made = {}

    def find(name, rule, controller="perturb-observe", loss=None):
        key = (name, rule, controller, loss)
        if key not in made:
            event = load_scenario(name).event(0)
            if loss is not None:
                lines = replace(event.onboard.telegrams, loss=loss)
                event = replace(event, onboard=replace(event.onboard, telegrams=lines))
            made[key] = evaluate(simulate(event, rule, controller))
        return made[key]

    return find


@jit
def shares_of_all_caps(units, expected, limit_out):
    """Each unit asked for its cap, a little less where the caps together are more than twice the plan: it sums them up."""
    total = 0.0
    for cap in units.cap:
        total += cap
    for j in range(limit_out.size):
        limit_out[j] = min(
            units.cap[j] * min(1.0, 2.0 * expected * units.cap.size / total), units.limit_max[j]
        )
    return np.nan, total > expected * units.cap.size


def test_a_rule_gets_the_same_caps_compiled_as_in_python():
    """Also those of units of which nothing is known: their motors alone bound them."""
    lawful = Rule("mine", "", law=shares_of_all_caps, caps=Caps.DELIVERED, trigger=Trigger.TELEGRAM)
    hosted = replace(lawful, answer=lawful._by_law, law=None)
    one, other = (simulate(load_scenario("wet-patch").event(0), rule) for rule in (lawful, hosted))
    for name in ("limit", "level", "speed", "motor_torque"):
        np.testing.assert_array_equal(one[name], other[name])


@looped("name", DRIVING)
def test_the_oracle_works_at_the_bound_without_slip_under_every_controller(name):
    event = load_scenario(name).event(0)
    first, second = (simulate(event, "oracle", c) for c in ("cut-and-ramp", "perturb-observe"))
    result = evaluate(first)
    assert 0.994 <= result["bound_use"] <= 1.0
    assert result["slip_time"] == 0.0
    assert result["over_delivery"] < 0.002
    driven = first["axle_unit"].values >= 0
    past = np.abs(first["slip_velocity"].values) > first["peak_slip"].values
    assert not past[:, driven].any()
    for variable in first.data_vars:
        np.testing.assert_array_equal(first[variable], second[variable], err_msg=variable)


def test_a_preview_with_truth_keeps_all_units_but_the_leader_below_their_peaks(make_event):
    # rules are asked from the first slips on, at 1.1 s
    run = simulate(make_event(0.09), "preview", "cut-and-ramp").sel(time=slice(1.5, None))
    past = np.abs(run["slip_velocity"].values) > run["peak_slip"].values
    unit = run["axle_unit"].values
    assert past[:, unit == 0].any()
    assert not past[:, unit > 0].any()


@looped("name", DRIVING)
@looped("controller", ["perturb-observe", "cut-and-ramp"])
def test_nothing_beats_the_bound_and_there_is_no_negative_room(name, controller, found):
    for rule in ("alone", "greedy", "exact", "cooperative"):
        result = found(name, rule, controller)
        assert 0.8 < result["bound_use"] <= 1.0
        assert result["headroom"] >= 0.0
        assert result["over_delivery"] >= 0.0


@looped("name", DRIVING)
def test_cooperation_costs_nothing_where_there_is_no_room(name, found):
    alone, together = found(name, "alone"), found(name, "cooperative")
    assert together["bound_use"] >= alone["bound_use"] - 1e-3
    assert together["over_delivery"] < 5e-3


@looped("name", WITH_ROOM)
def test_cooperation_gains_most_of_the_room(name, found):
    alone, together = found(name, "alone"), found(name, "cooperative")
    assert alone["headroom"] > 0.01
    assert together["bound_use"] - alone["bound_use"] >= 0.8 * alone["headroom"]


@looped("controller", ["cut-and-ramp", "perturb-observe"])
def test_a_controller_that_takes_torque_away_without_slip_signal_is_heard(make_event, controller):
    """Under the slip signal the rule acts on what the detector sees; under reports on every limited unit."""
    heard = simulate(make_event(0.09), "exact", controller)
    literal = simulate(make_event(0.09, onboard=Onboard(trigger="slip")), "exact", controller)
    limited = (heard["torque_factor"].values < 0.985).any(axis=1)
    active, time = heard["case"].values > 0.0, heard["time"].values
    # one telegram's period, its latency, and a filter's time later at most the leader acts on it
    span = round(0.25 / (time[1] - time[0]))
    lasting = np.convolve(limited, np.ones(span), mode="full")[: time.size] == span
    counted = lasting & (time > 1.0)
    assert counted.any()
    assert active[counted].all()
    assert heard.attrs["rule_calls"] > literal.attrs["rule_calls"]


def test_what_is_reported_of_nothing_is_nothing(make_event):
    """Where no telegram arrives a leader knows of itself alone, and the others keep to the plan."""
    lost = Onboard(telegrams=Telegrams(loss=1.0, silence=0.5))
    run = simulate(make_event(0.09, onboard=lost), "cooperative", "perturb-observe")
    late = run.sel(time=slice(1.0, None))
    np.testing.assert_allclose(
        late["limit"].values[:, 1:], late["expected"].values[:, None] + np.zeros((1, 2))
    )


class Shy:
    """A hosted controller that leaves the first unit half of its target, and says so to nobody."""

    def __init__(self, context):
        self.share = 0.5 if context.unit == 0 else 1.0

    def decide(self, sense):
        return TorqueDecision(self.share * sense.target, True, "ok", 1e-4)


def test_a_hosted_controller_is_heard_as_well(make_event):
    shy = HostedController("shy", "takes half of the first unit's torque", each_unit(Shy))
    run = simulate(make_event(0.35), "cooperative", shy)
    assert run.attrs["rule_calls"] > 0
    late = run.sel(time=slice(5.0, None))
    relative = late["limit"].values / late["expected"].values[:, None]
    assert relative[:, 1:].min() > 1.2
    # limits beyond the plan turn the wheelsets no faster: what they hold for it is left over
    whole = simulate(make_event(0.35), "alone")
    force, plan = (
        r["rail_force"].sel(time=slice(5.0, None)).sum("axle").values.mean() for r in (run, whole)
    )
    assert force == pytest.approx(plan, rel=0.02)


TUNED = RULES["greedy-tuned"]


PLAIN = replace(TUNED, onboard={})


@pytest.fixture(scope="module")
def front_slips(make_event):
    """Adhesion grows twice as much as believed, so that the foremost unit alone slips."""
    believed = Onboard(belief=Belief(increments=tuple(4.0 * logarithmic_increments(20))))
    dip = Patch(0.7, begin=3.0, until=4.0)
    return make_event(0.06, increments=8.0, patches=[dip], onboard=believed, duration=7.0)


@pytest.fixture(scope="module")
def all_slip(make_event):
    return make_event(
        0.09, patches=[Patch(0.7, begin=3.0, until=5.0)], increments=0.5, duration=6.0
    )


def equal(one, other):
    for name in one.data_vars:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@looped("hold_time", [0.7, 5.0])
def test_where_the_foremost_unit_alone_slips_it_is_the_rule_as_printed(front_slips, hold_time):
    event = replace(front_slips, onboard=replace(front_slips.onboard, hold_time=hold_time))
    own, printed = (simulate(event, rule, "cut-and-ramp") for rule in (PLAIN, "greedy-literal"))
    assert printed.attrs["unit_detections"] == printed.attrs["detections"] > 1
    assert (printed["case"] > 0.0).any()
    equal(own, printed)


def test_of_slips_that_no_telegram_tells_nobody_knows(all_slip):
    lost = replace(all_slip.onboard, telegrams=Telegrams(loss=1.0))
    event = replace(all_slip, onboard=lost)
    own, printed = (simulate(event, rule, "cut-and-ramp") for rule in (PLAIN, "greedy-literal"))
    assert own.attrs["unit_detections"] > own.attrs["detections"] > 0
    equal(own, printed)


def test_a_rules_own_settings_stand_in_place_of_the_events(all_slip):
    settings = {"hold_time": 0.8, "detector.pole": 9.0}
    changed = replace(all_slip, onboard=all_slip.onboard.with_settings(settings))
    assert (changed.onboard.hold_time, changed.onboard.detector.pole) == (0.8, 9.0)
    assert changed.onboard.detector.on == all_slip.onboard.detector.on
    brought = simulate(all_slip, replace(TUNED, onboard=settings))
    equal(brought, simulate(changed, PLAIN))
    equal(brought, simulate(changed, replace(TUNED, onboard=settings)))
    with pytest.raises(AssertionError):
        equal(brought, simulate(all_slip, PLAIN))


@looped("path", ["hold", "detector.pol", "detektor.pole", "detector.", "", "with_settings"])
def test_a_setting_that_is_no_field_is_named(path):
    with pytest.raises(OnboardError, match=f"'{path}' is no field"):
        Onboard().with_settings({path: 1.0})


def test_what_ships_is_within_range():
    for rule in RULES.values():
        Onboard().with_settings(rule.onboard)


TRAIN = find_set("commuter-8car")


GROWTH = tuple(logarithmic_increments(TRAIN.axle_count))


PATENT = Onboard(belief=Belief(increments=GROWTH), trigger="slip")


"""Computers that follow (5) from the leader's detection."""


def start(train, rail, onboard=None, **options):
    """A start of `train` that believes the increments (15)."""
    onboard = onboard or Onboard(belief=Belief(increments=GROWTH))
    return Event("start", build(train, rail), DriverCommand((0.0,), (0.8,)), onboard, **options)


def test_behind_a_lead_trailer_the_first_motor_car_leads():
    run = simulate(start(TRAIN, Rail(0.13, increments=GROWTH), duration=3.0), "greedy")
    assert not any(TRAIN.cars[0].driven)
    axles = np.flatnonzero(run["axle_unit"].values == 0)
    assert set(run["axle_car"].values[axles]) == {1}
    assert run.attrs["detections"] > 0


def test_reversed_the_other_end_leads_and_the_increments_follow():
    # the train has motor cars 2, 3, 6, 7 of 8: alike from both ends, but not in its loads
    cars = tuple(replace(car, load=500.0 * k) for k, car in enumerate(TRAIN.cars))
    train = replace(TRAIN, cars=cars)
    rail = Rail(0.125, increments=GROWTH)
    ahead, back = (
        simulate(start(t, rail, PATENT, duration=4.0), "greedy") for t in (train, train.reversed())
    )
    assert ahead["unit_static_load"].values[0] < back["unit_static_load"].values[0]
    for run in (ahead, back):
        allocated = np.flatnonzero(run["case"].values > 0)
        assert allocated.size
        limits = run["limit"].values[allocated[-1]]
        assert limits[0] == limits.min()  # whoever leads has the lowest cap
    eq, eq_back = (
        equipment(build(t, rail), Onboard(belief=Belief(increments=GROWTH)))
        for t in (train, train.reversed())
    )
    np.testing.assert_array_equal(eq.learnt.increment, eq_back.learnt.increment)


@looped("group", ["1C4M", "1C2M", "1C1M"])
def test_every_inverter_group_redistributes(group):
    cars = tuple(
        replace(car, motors=replace(car.motors, group=group)) if car.motors else car
        for car in TRAIN.cars
    )
    event = start(replace(TRAIN, cars=cars), Rail(0.12, increments=GROWTH), PATENT, duration=4.0)
    run = simulate(event, "greedy")
    allocated = run["case"].values > 0
    assert allocated.any()
    last = run["limit"].values[allocated][-1]
    assert np.all(np.diff(last) >= 0.0)
    assert last[-1] > last[0]


def wet_start(learning=None, failures=(), loss=0.0, trigger="slip"):
    """A start on rail that is wet from end to end; the foremost unit may fail."""
    base = load_scenario("wet-start")
    rail = base.rail.model_dump() | {"level": 0.125, "scatter": 0.0085}
    event = base.changed(
        rail=rail, variation=None, duration_s=8.0, failures=failures,
        onboard={"telegrams": {"loss": loss}, "trigger": trigger},
    ).event(3)  # fmt: skip
    if learning is None:
        return event
    return replace(event, onboard=replace(event.onboard, learning=learning))


def data_of(run):
    """The data of a run: instant (index), unit, value."""
    number = run["increment_data"].values
    instant, unit = np.nonzero(np.diff(number, axis=0, prepend=0.0))
    return list(zip(instant, unit, run["increment_datum"].values[instant, unit], strict=True))


def learnt_in(run):
    """What the train has learnt by the end of a run."""
    learnt = (tuple(run[f"learnt_{name}"].values.tolist()) for name in Increments._fields)
    return LearntIncrements(*learnt)


def onsets(run):
    """Instants (indices) at which the slip signal of each unit goes on."""
    signal = np.diff(run["slipping"].values, axis=0, prepend=0) > 0
    return [np.flatnonzero(on) for on in signal.T]


MEAN = IncrementLearning("running-mean", first=3, further=2, stored=4.0)


@looped(("trigger", "weight"), [("slip", "all"), ("limited", "all"), ("slip", "original")])
def test_what_a_run_learns_is_16_and_17_of_its_data(trigger, weight):
    event = wet_start(replace(MEAN, reference="held", weight=weight), trigger=trigger)
    run = simulate(event, "exact")
    given = run["increment"].values[0]
    increment, count = given.copy(), np.full(4, 4.0)
    waiting, updates = [[] for _ in range(4)], np.zeros(4)
    over_time = np.tile(given, (run.sizes["time"], 1))
    for k, unit, value in data_of(run):
        waiting[unit].append(value)
        if len(waiting[unit]) == (2 if updates[unit] else 3):
            n = len(waiting[unit])
            increment[unit] = running_mean(increment[unit], count[unit], sum(waiting[unit]), n)
            count[unit] += n * (weight == "all")
            waiting[unit], updates[unit] = [], updates[unit] + 1
        over_time[k:, unit] = increment[unit]
    assert updates.sum() > 0
    np.testing.assert_allclose(run["increment"].values, over_time, rtol=1e-12, atol=1e-15)
    for name in (name for name in VARIABLES if name.startswith(("increment", "learnt"))):
        assert (run[name].dims, run[name].attrs["units"]) == (VARIABLES[name].dims, "1")
    learnt = learnt_in(run)
    np.testing.assert_allclose(learnt.increment, increment, rtol=1e-12, atol=1e-15)
    assert learnt.behind == tuple(count)
    assert learnt.waiting == tuple(map(len, waiting))
    np.testing.assert_allclose(learnt.waiting_sum, list(map(sum, waiting)), rtol=1e-12)
    assert learnt.updates == tuple(updates)


def test_data_of_a_run_may_wait_for_the_next_one():
    """Then (17) is used once for all of them, before that run begins."""
    event = wet_start(replace(MEAN, update="next run"))
    first = simulate(event, "exact")
    given = first["increment"].values
    np.testing.assert_array_equal(given, np.tile(given[0], (given.shape[0], 1)))
    learnt = learnt_in(first)
    assert max(learnt.waiting) >= MEAN.first
    belief = replace(event.onboard.belief, learnt=learnt)
    second = simulate(replace(event, onboard=replace(event.onboard, belief=belief)), "exact")
    expected = [
        running_mean(one, behind, total, count) if count >= MEAN.first else one
        for one, behind, total, count in zip(
            learnt.increment, learnt.behind, learnt.waiting_sum, learnt.waiting, strict=True
        )
    ]
    np.testing.assert_allclose(second["increment"].values[0], expected, rtol=1e-12, atol=1e-15)
    assert learnt_in(second).updates == tuple(
        float(count >= MEAN.first) for count in learnt.waiting
    )


def test_a_second_run_goes_on_where_the_first_one_ended():
    event = wet_start(IncrementLearning("gaussian", "held"))
    first = simulate(event, "exact")
    learnt = learnt_in(first)
    belief = replace(event.onboard.belief, learnt=learnt)
    second = simulate(replace(event, onboard=replace(event.onboard, belief=belief)), "exact")
    np.testing.assert_array_equal(second["increment"].values[0], learnt.increment)
    mean, deviation = np.array(learnt.increment), np.array(learnt.deviation)
    for _, unit, value in data_of(second):
        mean[unit], deviation[unit] = gaussian_posterior(
            mean[unit], deviation[unit], value, 0.012, 0.0
        )
    assert second["increment_data"].values[-1].sum() > 0
    np.testing.assert_allclose(second["learnt_increment"].values, mean, rtol=1e-9)
    np.testing.assert_allclose(second["learnt_deviation"].values, deviation, rtol=1e-9)


@looped("loss", [0.0, 0.2])
def test_every_slip_of_a_rear_unit_is_one_datum(loss):
    """One that is not followed by another before the next telegrams, and not shortly before the end."""
    run = simulate(wet_start(replace(MEAN, first=1000), loss=loss, trigger="limited"), "exact")
    assert (run.attrs["telegrams_lost"] > 0) == (loss > 0.0)
    time, found, checked = run["time"].values, data_of(run), 0
    for unit, instants in enumerate(onsets(run)):
        taken = time[[k for k, j, _ in found if j == unit]] if unit else np.zeros(0)
        assert len(taken) <= len(instants)
        at = [*time[instants], np.inf]
        for begin, until in pairwise(at):
            if unit and until - begin > 0.6 and begin < time[-1] - 0.6:
                assert np.sum((begin < taken) & (taken < begin + 0.6)) == 1
                checked += 1
    assert checked >= 5


def test_runs_in_which_nothing_is_learnt_are_as_they_were():
    plain = simulate(wet_start(), "exact")
    other = simulate(wet_start(IncrementLearning("none", "held", 1, 1, 0.0, 0.5)), "exact")
    assert not [name for name in map(str, plain) if "increment" in name or "learnt" in name]
    for name in plain:
        np.testing.assert_array_equal(plain[name].values, other[name].values)
    # and what takes data alone, as a learner that never changes anything, does not move the first slips
    idle = simulate(wet_start(replace(MEAN, first=10**9)), "exact")
    before = int(min(k[0] for k in onsets(idle)[1:] if k.size))
    for name in plain:
        if "time" in plain[name].dims:
            kept, found = plain[name].values[:before], idle[name].values[:before]
            # increments count from the foremost unit then: the same differences, rounded otherwise
            np.testing.assert_allclose(found, kept, rtol=1e-9, atol=1e-9, err_msg=str(name))
