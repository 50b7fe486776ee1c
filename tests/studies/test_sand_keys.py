"""Sand in files: keys of the rail, of the sanders of a train of one's own, and of when it sands."""

import pytest

from studies.command_line.main import run
from studies.files.study_error import StudyError
from studies.scenario.scenario import load_scenario
from studies.scenario.train_file import read_train_file

TRAIN = """
name = "sandy"
formation = "TT"
planned_acceleration_kmhs = 3.0

[car.T]
length_m = 20.0
mass_t = 30.0
axle_positions_m = [2.0, 4.5, 15.5, 18.0]
bogie_of_axle = [0, 0, 1, 1]
wheel_radius_m = 0.42
wheel_inertia_kgm2 = 80.0
air_brake = { pressure_kpa = 300.0, force_kn = 10.0 }

[[car.T.sanders]]
axle = 0
rate_kg_per_min = 2.0

[[car.T.sanders]]
axle = 2
rate_kg_per_min = 6.0
amount_g_per_m = 4.5
"""
EVENT = """
title = "sand on slippery rail"
train = "gb-unit-8car"
duration_s = 2.0
initial_speed_kmh = 60.0

[[command]]
time_s = 0.0
acceleration_kmhs = -3.2

[rail]
level = 0.05
increments = { law = "logarithmic" }
sanded_coefficient = 0.25
sand_saturation_g_per_m = 12.0
sand_decay = 0.1

[onboard.sanding]
on_slide = false
delay_s = 0.5
hold_s = 3.0
begin_s = 1.0
until_s = 9.0
least_speed_kmh = 18.0

[onboard.braking]
car_shares = [0.5, 0.5, 1.0, 1.0, 1.0, 1.0, 1.5, 1.5]
"""


def test_sanders_of_a_train_file_arrive_in_si(tmp_path):
    path = tmp_path / "sandy.toml"
    path.write_text(TRAIN)
    fixed, variable = read_train_file(str(path)).cars[1].sanders
    assert (fixed.axle, fixed.amount) == (0, None)
    assert fixed.rate == pytest.approx(1.0 / 30.0)
    assert (variable.axle, variable.rate, variable.amount) == pytest.approx((2, 0.1, 4.5e-3))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("axle = 2", "axle = 4", "sanders at axles [0, 4]"),
        ("axle = 2", "axle = 0", "sanders at axles [0, 0]"),
        ("axle = 2", "axle = -1", "axle = -1 must be a whole number"),
        ("rate_kg_per_min = 2.0", "rate_kg_per_min = 0.0", "sanders[1].rate_kg_per_min = 0.0"),
        ("rate_kg_per_min = 2.0", "rate_g_per_s = 33.0", "rate_g_per_s"),
        ("amount_g_per_m = 4.5", "amount_g_per_m = 4500.0", "amount_g_per_m"),
    ],
)
def test_a_faulty_sander_is_refused_in_one_line(tmp_path, capsys, old, new, words):
    path = tmp_path / "sandy.toml"
    assert TRAIN.count(old) == 1
    path.write_text(TRAIN.replace(old, new))
    event = tmp_path / "event.toml"
    event.write_text(EVENT.replace('"gb-unit-8car"', f'"{path}"'))
    assert run(["simulate", str(event)]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert "\n" not in error


def test_rail_and_equipment_are_as_the_file_says(write_scenario):
    event = load_scenario(write_scenario(EVENT)).event()
    rail, sanding = event.model.rail, event.onboard.sanding
    assert (rail.sanded_coefficient, rail.sand_decay) == (0.25, 0.1)
    assert rail.sand_saturation == pytest.approx(0.012)
    assert (sanding.on_slide, sanding.delay, sanding.hold) == (False, 0.5, 3.0)
    assert (sanding.begin, sanding.until, sanding.least_speed) == pytest.approx((1.0, 9.0, 5.0))
    assert event.onboard.braking.car_shares == (0.5, 0.5, 1.0, 1.0, 1.0, 1.0, 1.5, 1.5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("sand_decay = 0.1", "sand_decay = 1.1", "sand_decay = 1.1 must lie in"),
        ("sanded_coefficient = 0.25", "sanded_coefficient = 0.0", "sanded_coefficient"),
        ("sand_saturation_g_per_m", "sand_saturation_kg", "sand_saturation_kg"),
        ("until_s = 9.0", "until_s = 0.5", "onboard.sanding.begin_s = 1.0 must not exceed"),
        ("car_shares = [0.5, ", "car_shares = [", "7 car_shares for 8 cars"),
    ],
)
def test_faulty_keys_are_refused(write_scenario, old, new, words):
    with pytest.raises(StudyError, match=words):
        load_scenario(write_scenario(EVENT, (old, new))).event()
