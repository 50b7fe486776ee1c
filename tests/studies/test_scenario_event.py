"""What a scenario file says is what the simulation gets: every key arrives, in SI; random draws follow the seed alone."""

import numpy as np
import pytest

from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    DryPolachCurve,
    PolachByFrictionCurve,
    PolachCurve,
)
from alloc.plant.train import Coupler, DraftGear
from studies.files.study_error import StudyError
from studies.scenario.rail_keys import RailKeys
from studies.scenario.scenario import load_scenario

FULL = """
title = "everything"
train = "freight-5"
load_t = [0.0, 10.0, 20.0, 30.0, 40.0, 0.0]
load_transfer = true
duration_s = 4.0
start_m = 120.0
initial_speed_kmh = 36.0
target_speed_kmh = 72.0
step_s = 0.0005
record_period_s = 0.02

[[command]]
time_s = 0.5
acceleration_kmhs = 1.8

[[command]]
time_s = 2.0
acceleration_kmhs = -3.6

[coupler]
stiffness_n_per_m = 5e6
slack_mm = 12.0

[[failures]]
unit = 2
time_s = 1.5

[rail]
law_factor = 0.9
speed_law = "curtius-kniffler"
scatter = 0.012
scatter_length_m = 15.0
conditioning = 0.1

[rail.increments]
law = "logarithmic"
slope = 0.01
offset = 0.001

[rail.curve]
kind = "polach"

[[rail.patches]]
factor = 0.5
start_m = 150.0
end_m = 250.0
edge_m = 3.0
begin_s = 1.0
until_s = 3.0
fade_s = 0.4

[line]
curve_law = "roeckl"

[[line.sections]]
start_m = 0.0
grade_permille = -5.0

[[line.sections]]
start_m = 200.0
grade_permille = 20.0

[[line.curves]]
start_m = 150.0
end_m = 260.0
radius_m = 350.0

[[line.tunnels]]
start_m = 300.0
end_m = 400.0

[belief.increments]
law = "none"

[belief.curve]
kind = "piecewise"

[onboard]
hold_time_s = 3.0
rise_time_s = 0.8
period_s = 0.005

[onboard.detector]
on_kmhs = 7.2
off_kmhs = 3.6
pole_per_s = 50.0
speed_on_kmh = 1.8

[onboard.observer]
pole_per_s = 30.0

[onboard.cut_and_ramp]
cut = 0.4
recover = 0.8
hold_s = 0.2
ramp_s = 2.0

[onboard.telegrams]
period_s = 0.2
latency_s = 0.1
loss = 0.01

[onboard.sensors]
speed_quantum_kmh = 0.036
"""


@pytest.fixture
def event(write_scenario):
    return load_scenario(write_scenario(FULL)).event(5)


def test_the_run_is_as_the_file_says(event):
    assert event.name == "own"
    assert (event.duration, event.step, event.record_period) == (4.0, 0.0005, 0.02)
    assert event.initial_speed == pytest.approx(10.0)
    assert event.initial_position == 120.0
    assert event.target_speed == pytest.approx(20.0)
    assert event.command.times == (0.5, 2.0)
    assert event.command.accelerations == pytest.approx((0.5, -1.0))
    assert event.seed == 5


def test_the_train_is_loaded_and_coupled(event):
    train = event.model.train
    assert [car.load for car in train.cars] == pytest.approx([0.0, 1e4, 2e4, 3e4, 4e4, 0.0])
    assert train.load_transfer
    assert all(c.stiffness == 5e6 and c.slack == pytest.approx(0.012) for c in train.couplers)
    assert {(c.damping, c.stiffening) for c in train.couplers} == {(Coupler().damping, 0.0)}
    assert event.model.environment.failure_time[1] == 1.5
    assert np.isinf(event.model.environment.failure_time[[0, 2, 3, 4, 5]]).all()


def test_laws_of_front_and_rear_arrive_as_they_are_given():
    keys = RailKeys(
        law_factor=1.0,
        speed_law=(15.0, 150.0, 0.0),
        rear_speed_law=(6.0, 150.0, 0.09),
        rear_axles=3.0,
        increments={"law": "none"},
    )
    rail = keys.rail(4, seed=0)
    assert (rail.speed_law, rail.rear_speed_law) == ((15.0, 150.0, 0.0), (6.0, 150.0, 0.09))
    assert rail.rear_axles == 3.0


def test_the_rail_is_as_the_file_says(event):
    rail = event.model.rail
    assert (rail.level, rail.speed_law, rail.scatter) == (0.9, "curtius-kniffler", 0.012)
    assert (rail.scatter_length, rail.conditioning) == (15.0, 0.1)
    assert rail.increments == pytest.approx(0.01 * np.log(np.arange(1, 27)) + 0.001)
    (patch,) = rail.patches
    assert (patch.factor, patch.start, patch.end, patch.edge) == (0.5, 150.0, 250.0, 3.0)
    assert (patch.begin, patch.until, patch.fade) == (1.0, 3.0, 0.4)
    assert type(rail.curve).__name__ == "PolachCurve"


def test_the_line_is_as_the_file_says(event):
    line = event.model.line
    assert line.stations == (0.0, 200.0)
    assert line.grades == pytest.approx((-0.005, 0.020))
    assert line.tunnels == ((300.0, 400.0),)
    assert (line.curves, line.curve_law) == (((150.0, 260.0, 350.0),), "roeckl")


def test_what_is_believed_is_kept_apart_from_what_is_true(event):
    assert event.onboard.belief.increments is None
    assert type(event.onboard.belief.curve).__name__ == "PiecewiseCurve"


def test_the_equipment_is_as_the_file_says(event):
    o = event.onboard
    assert (o.hold_time, o.rise_time, o.period) == (3.0, 0.8, 0.005)
    assert (o.detector.on, o.detector.off) == pytest.approx((2.0, 1.0))
    assert (o.detector.pole, o.detector.speed_on) == pytest.approx((50.0, 0.5))
    assert o.observer.pole == 30.0
    r = o.cut_and_ramp
    assert (r.cut, r.recover, r.hold, r.ramp) == (0.4, 0.8, 0.2, 2.0)
    assert (o.telegrams.period, o.telegrams.latency, o.telegrams.loss) == (0.2, 0.1, 0.01)
    assert o.sensors.speed_quantum == pytest.approx(0.01)


def test_what_is_not_said_is_believed_as_it_is(short):
    event = short.event()
    assert event.onboard.belief.increments == event.model.rail.increments
    assert event.onboard.belief.curve == event.model.rail.curve


def test_equal_seeds_give_equal_draws_and_others_differ(short):
    one, again, other = short.event(3), short.event(3), short.event(4)
    assert one.model.rail.seed == again.model.rail.seed != other.model.rail.seed
    assert one.onboard.sensors.seed == again.onboard.sensors.seed != other.onboard.sensors.seed
    assert one.onboard.sensors.seed != one.model.rail.seed


def test_a_failure_of_a_unit_that_does_not_exist_is_refused(write_scenario):
    text = write_scenario.short + "\n[[failures]]\nunit = 9\n"
    with pytest.raises(StudyError, match="unit"):
        load_scenario(write_scenario(text))


def test_increments_that_do_not_fit_the_train_are_refused(write_scenario):
    text = write_scenario.short + '\n[belief.increments]\nlaw = "given"\nvalues = [0.0, 0.1]\n'
    with pytest.raises(StudyError, match="2 increments for 32 axles"):
        load_scenario(write_scenario(text))


def test_the_hash_follows_content_and_nothing_else(write_scenario):
    base = load_scenario(write_scenario()).hash()
    renamed = write_scenario(write_scenario.short, ("two slippery", "other"), name="b.toml")
    changed = write_scenario(write_scenario.short, ("level = 0.05", "level = 0.051"))
    assert load_scenario(renamed).hash() == base
    assert load_scenario(changed).hash() != base


def test_a_changed_copy_is_checked_anew(short):
    assert short.changed(duration_s=1.0).duration_s == 1.0
    with pytest.raises(StudyError, match=r"'duration_s' = 0\.0"):
        short.changed(duration_s=0.0)


def test_a_name_without_ending_is_a_shipped_scenario():
    with pytest.raises(StudyError, match="did you mean 'wet-start'"):
        load_scenario("wet-strat")


def test_friction_draft_gears_come_from_the_file():
    scenario = load_scenario("freight-start").changed(
        coupler=None, draft_gear={"preload_kn": 120.0, "slack_mm": 30.0, "stroke_mm": 80.0}
    )
    couplers = scenario.event().model.train.couplers
    assert set(couplers) == {DraftGear(preload=120e3, slack=0.03, stroke=0.08)}
    with pytest.raises(StudyError, match="either coupler or draft_gear"):
        scenario.changed(coupler={"stiffness_n_per_m": 1e7})


@pytest.mark.parametrize(
    ("keys", "curve"),
    [
        ({"kind": "polach"}, POLACH_WET),
        ({"kind": "polach-wet"}, POLACH_WET),
        ({"kind": "polach-dry"}, POLACH_DRY),
        ({"kind": "polach-by-friction"}, PolachByFrictionCurve()),
        ({"kind": "polach", "creep_stiffness": 186.0}, PolachCurve(creep_stiffness=186.0)),
        ({"kind": "polach-dry", "half_axes_ratio": 1.5}, DryPolachCurve(half_axes_ratio=1.5)),
    ],
)
def test_polachs_sets_have_names(keys, curve):
    rail = RailKeys(level=0.3, presliding_m=2e-4, curve=keys, increments={"law": "none"}).rail(8, 0)
    assert rail.curve == curve
    assert rail.presliding == 2e-4


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"presliding_m": 0.0}, "presliding"),
        ({"curve": {"kind": "polach", "creep_stiffness": -1.0}}, "creep_stiffness"),
        ({"curve": {"kind": "polach", "half_axes_ratio": 4.0}}, "half_axes_ratio"),
        ({"curve": {"kind": "polach-by-friction", "decay": 0.2}}, "decay does not belong"),
    ],
)
def test_impossible_contacts_are_named(values, said):
    with pytest.raises(ValueError, match=said):
        RailKeys(level=0.3, increments={"law": "none"}, **values).rail(8, 0)
