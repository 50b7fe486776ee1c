"""Laws of the plan that metrics judge by: it is the driver's and the plant's, not what the train takes it for."""

import numpy as np
import pytest

import readhesion
from alloc.metrics import METRICS

BOOKKEEPING = {"rule_calls", "rule_failures", "rule_time", "controller_failures", "controller_median", "controller_p99",
               "detections", "unit_detections", "detection_delay", "missed_slips", "false_alarms", "estimate_error",
               "telegrams", "telegrams_lost", "fallbacks", "search_time", "unfinished_searches", "utilisation_short",
               "utilisation_slipping"}  # fmt: skip
"""Metrics of the computers: their signals, telegrams and targets. The others say what rail and motors did."""
JUDGED = [name for name in METRICS if name not in BOOKKEEPING]
DRY = {"level": 0.4, "patches": ()}


@pytest.mark.parametrize("event", ["wet-patch", "wet-stop", "uneven-load"])
def test_equal_forces_give_equal_metrics_whatever_the_train_takes_for_the_plan(event):
    run = readhesion.simulate(event, "cooperative", "perturb-observe")
    for factor in (0.5, 1.08):
        other = run.assign(expected=factor * run["expected"], limit=factor * run["limit"])
        found, wanted = readhesion.evaluate(other), readhesion.evaluate(run)
        assert {name: found[name] for name in JUDGED} == pytest.approx(
            {name: wanted[name] for name in JUDGED}, rel=0, abs=0, nan_ok=True
        )


def test_a_rule_that_asks_for_what_the_plan_is_without_it_is_judged_as_none():
    both = [readhesion.evaluate(readhesion.simulate("wet-patch", rule, "perturb-observe"))
            for rule in ("alone", "greedy-printed")]  # fmt: skip
    for name in ("bound_use", "effort_ratio", "headroom", "damage", "slip_time"):
        assert both[0][name] == pytest.approx(both[1][name], rel=2e-4, abs=1e-6), name


@pytest.mark.parametrize(
    "rule", [name for name in readhesion.RULES if name not in ("wear-cvxpy", "qp-cvxpy")]
)
def test_a_dry_run_uses_all_of_the_plan_under_every_rule(rule):
    scenario = readhesion.load_scenario("wet-start")
    dry = scenario.changed(rail=scenario.rail.model_copy(update=DRY), duration_s=5.0)
    found = readhesion.evaluate(readhesion.simulate(dry, rule, "none"))
    assert found["bound_use"] == pytest.approx(1.0, abs=2e-4)
    assert found["effort_ratio"] > 0.8  # torque rises within a second
    assert found["headroom"] == found["slip_time"] == 0.0
    assert found["over_delivery"] < 2e-3


def test_the_plan_is_by_true_masses():
    run = readhesion.simulate("uneven-load", "alone", "cut-and-ramp")
    driven = run["axle_unit"].values >= 0
    mass = run.attrs["train_mass"] + run["axle_turning_mass"].values[~driven].sum()
    wanted = (
        np.abs(run["driver_command"].values) * mass / run["axle_static_load"].values[driven].sum()
    )
    np.testing.assert_allclose(run["planned_coefficient"].values, wanted, rtol=1e-12)
