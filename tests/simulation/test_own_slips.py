"""The patent's rule at its best within its words, in the closed loop: what it has in common with the rule as printed."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard.parameters import Belief, Onboard, Telegrams
from alloc.plant.rail import Patch, logarithmic_increments
from alloc.rules import RULES
from alloc.simulation import simulate

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


@pytest.mark.parametrize("hold_time", [0.7, 5.0])
def test_where_the_foremost_unit_alone_slips_it_is_the_rule_as_printed(front_slips, hold_time):
    event = replace(front_slips, onboard=replace(front_slips.onboard, hold_time=hold_time))
    own, printed = (simulate(event, rule, "cut-and-ramp") for rule in (PLAIN, "greedy-literal"))
    assert printed.attrs["unit_detections"] == printed.attrs["detections"] > 1
    assert (printed["case"] > 0.0).any()
    equal(own, printed)


def test_a_rear_unit_that_slips_is_held_at_what_it_found_itself(all_slip):
    """The line is perfect but late: of a detection the unit's limit tells 0.2 s later, by two telegrams of 0.1 s."""
    run = simulate(all_slip, PLAIN, "cut-and-ramp")
    slipping, limit = run["slipping"].values, run["limit"].values
    assert run.attrs["unit_detections"] > run.attrs["detections"]
    time, onset = run["time"].values, np.diff(slipping[:, 1]) > 0.5
    last = np.flatnonzero(onset)[-1] + 1
    found = run["coefficient_estimate"].values[last, 1]
    after = (time > time[last] + 0.3) & (time <= time[last] + 5.0)
    assert after.any()
    assert np.all(limit[after, 1] <= found + 1e-9)


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


@pytest.mark.parametrize(
    "path", ["hold", "detector.pol", "detektor.pole", "detector.", "", "with_settings"]
)
def test_a_setting_that_is_no_field_is_named(path):
    with pytest.raises(OnboardError, match=f"'{path}' is no field"):
        Onboard().with_settings({path: 1.0})


def test_a_setting_out_of_range_is_refused_as_anywhere():
    with pytest.raises(OnboardError, match="hold_time"):
        Onboard().with_settings({"hold_time": -1.0})


def test_what_ships_is_within_range():
    for rule in RULES.values():
        Onboard().with_settings(rule.onboard)
