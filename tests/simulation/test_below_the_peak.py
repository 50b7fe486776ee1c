"""Where the peak is wide, at 1.2 m/s: what limits slip cuts below it, what seeks the peak does not."""

import numpy as np
import pytest

from alloc.simulation import simulate
from studies.core.drawn_scenarios import START_SPEED as REFERENCE_SPEED
from studies.core.drawn_scenarios import rail_offering
from studies.ladder.mismatch_events import RAILS
from studies.scenario.loading import load_scenario

OFFERED = 0.25
"""Adhesion at 15 km/h; the plan asks for 0.16."""


@pytest.fixture(scope="module")
def start():
    base = load_scenario("wet-start")
    train = base.event().model.train

    def event(curve):
        offered = rail_offering(RAILS[curve], OFFERED, REFERENCE_SPEED, train)
        rail = {**offered, "increments": {"law": "none"}}
        changed = base.changed(
            case=None, variation=None, duration_s=3.0, target_speed_kmh=None, rail=rail,
            belief={"curve": {"kind": "piecewise"}},
        )  # fmt: skip
        return changed.event(0)

    return event


def test_where_the_plan_needs_more_slip_than_a_controller_allows_it_cuts_though_adhesion_grows(
    start,
):
    # the peak at 1.2 m/s: what limits slip by itself must stop far below it
    for controller in ("pi-creep", "perturb-observe"):
        run = simulate(start("double exponential"), "alone", controller)
        assert run["torque_factor"].values.min() < 0.5
        assert float((np.abs(run["slip_velocity"]) / run["peak_slip"]).max()) < 1.0


def test_the_mpc_seeks_the_slip_that_a_wide_peak_needs(start):
    run = simulate(start("double exponential"), "alone", "mpc")
    factor = run["torque_factor"].values[run["time"].values >= 1.0]
    assert factor.min() > 0.85
