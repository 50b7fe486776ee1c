"""Laws of sharing on the units' reports, in the closed loop: the bound, the oracle, and what cooperation gains."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.metrics import evaluate
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.onboard.parameters import Onboard, Telegrams
from alloc.simulation import simulate
from studies.scenario.loading import default_scenarios, load_scenario

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


def test_on_dry_rail_the_plan_is_the_bound_and_is_used(make_event):
    result = evaluate(simulate(make_event(0.35), "cooperative", "perturb-observe"))
    assert result["bound_use"] == pytest.approx(1.0, abs=2e-3)
    assert result["headroom"] == 0.0
    assert result["over_delivery"] < 2e-3


@pytest.mark.parametrize("name", DRIVING)
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


@pytest.mark.parametrize("name", DRIVING)
@pytest.mark.parametrize("controller", ["perturb-observe", "cut-and-ramp"])
def test_nothing_beats_the_bound_and_there_is_no_negative_room(name, controller, found):
    for rule in ("alone", "greedy", "exact", "cooperative"):
        result = found(name, rule, controller)
        assert 0.8 < result["bound_use"] <= 1.0
        assert result["headroom"] >= 0.0
        assert result["over_delivery"] >= 0.0


@pytest.mark.parametrize("name", DRIVING)
def test_cooperation_costs_nothing_where_there_is_no_room(name, found):
    alone, together = found(name, "alone"), found(name, "cooperative")
    assert together["bound_use"] >= alone["bound_use"] - 1e-3
    assert together["over_delivery"] < 5e-3


@pytest.mark.parametrize("name", WITH_ROOM)
def test_cooperation_gains_most_of_the_room(name, found):
    alone, together = found(name, "alone"), found(name, "cooperative")
    assert alone["headroom"] > 0.01
    assert together["bound_use"] - alone["bound_use"] >= 0.8 * alone["headroom"]


@pytest.mark.parametrize("name", WITH_ROOM)
def test_a_fifth_of_the_telegrams_lost_costs_half_a_point_at_most(name, found):
    none, some = (found(name, "cooperative", loss=loss) for loss in (0.0, 0.2))
    assert some["telegrams_lost"] > 0.15 * some["telegrams"]
    assert some["bound_use"] > none["bound_use"] - 5e-3
    assert some["over_delivery"] < 5e-3


@pytest.mark.parametrize("controller", ["cut-and-ramp", "perturb-observe"])
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
