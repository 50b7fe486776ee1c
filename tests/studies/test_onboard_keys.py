"""Keys of the equipment on board arrive in SI; what is not given keeps its default."""

import pickle

import pytest

from alloc.onboard.brakes import SENSITIVITIES, Fuzzy, SlideProtection, Threshold
from alloc.onboard.increment_learning import IncrementLearning
from alloc.onboard.parameters import Braking, Onboard, ReferenceSpeed, Sensors, TorqueRelief
from studies.files.study_error import StudyError
from studies.scenario.onboard_keys import OnboardKeys
from studies.scenario.scenario import load_scenario

HEAD = """
title = "keys"
train = "commuter-8car"
duration_s = 1.0
[[command]]
time_s = 0.0
acceleration_kmhs = -2.0
[rail]
level = 0.1
increments = { law = "logarithmic" }
"""


def onboard(tmp_path, text):
    path = tmp_path / "keys.toml"
    path.write_text(HEAD + text)
    return load_scenario(str(path)).event(0).onboard


def test_defaults_stand(tmp_path):
    found = onboard(tmp_path, "")
    assert found.braking == Braking()
    assert found.inertia_in_limit == Onboard().inertia_in_limit
    assert found.sensors.sensorless_pole is None
    assert found.belief.unit_increments is None
    assert found.trigger == "limited"
    assert found.learning == IncrementLearning()
    assert found.learning.kind == "none"


def test_brakes_sensors_and_beliefs_of_units_arrive(tmp_path):
    found = onboard(
        tmp_path,
        """
[onboard]
trigger = "slip"
inertia_in_limit = false
[onboard.learning]
kind = "gaussian"
reference = "held"
first = 4
further = 2
stored = 3.0
noise = 0.02
deviation = 0.005
drift = 1e-6
[onboard.sensors]
sensorless_pole_per_s = 20.0
radius_error = 0.002
[onboard.reference]
source = "truth"
sensor_kmh = 0.036
creep_speed_kmh = 7.2
[onboard.reference.relief]
doubt_kmh = 0.36
time_s = 0.1
[onboard.braking]
blended = false
blend_time_s = 2.0
inertia_in_estimate = false
release_speed_kmh = 0.0
[onboard.braking.slide_protection]
law = "fuzzy"
period_s = 0.02
time_out_s = 5.0
[onboard.braking.slide_protection.threshold]
release = 0.2
hold = 0.1
[onboard.braking.slide_protection.fuzzy]
sensitivity = "high"
slip = [0.0, 0.04, 0.1]
rate_kmhs = [-3.6, 0.0, 3.6]
pole_per_s = 8.0
[belief]
unit_increments = [0.0, 0.004, 0.008, 0.009]
unit_deviation = [0.002, 0.003, 0.003, 0.003]
""",
    )
    assert found.braking == Braking(
        blended=False,
        blend_time=2.0,
        inertia_in_estimate=False,
        release_speed=0.0,
        slide_protection=SlideProtection(
            law="fuzzy",
            threshold=Threshold(0.2, 0.1),
            fuzzy=Fuzzy(SENSITIVITIES["high"], (0.0, 0.04, 0.1), (-1.0, 0.0, 1.0), 8.0),
            period=0.02,
            time_out=5.0,
        ),
    )
    assert found.sensors == Sensors(
        sensorless_pole=20.0, radius_error=0.002, seed=found.sensors.seed
    )
    assert found.reference == ReferenceSpeed(
        "truth", sensor=0.01, creep_speed=2.0, relief=TorqueRelief(doubt=0.1, time=0.1)
    )
    assert found.trigger == "slip"
    assert found.learning == IncrementLearning("gaussian", "held", 4, 2, 3.0, 0.02, 0.005, 1e-6)
    assert not found.inertia_in_limit
    assert found.belief.unit_increments == (0.0, 0.004, 0.008, 0.009)
    assert found.belief.unit_deviation == (0.002, 0.003, 0.003, 0.003)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[onboard.braking.slide_protection.threshold]\nrelease = 0.1\nhold = 0.2\n",
            "threshold.hold = 0.2 must not exceed onboard.braking",
        ),
        ('[onboard.braking.slide_protection]\nlaw = "fuzy"\n', "law"),
        ("[onboard.braking.slide_protection]\nperiod_s = 0.0\n", "slide_protection.period_s = 0.0"),
        (
            '[onboard.braking.slide_protection.fuzzy]\nsensitivity = "hgh"\n',
            "must be 'low', 'medium', 'high' or a number",
        ),
        (
            "[onboard.braking.slide_protection.fuzzy]\nslip = [0.0, 0.2, 0.1]\n",
            "three growing numbers",
        ),
        ('[onboard]\ntrigger = "slips"\n', "onboard.trigger.*'limited' or 'slip'"),
        ("[onboard.braking]\nblend_time_s = 0.0\n", "onboard.braking.blend_time_s = 0.0"),
        (
            "[onboard.sensors]\nsensorless_pole_per_s = -1.0\n",
            "onboard.sensors.sensorless_pole_per_s = -1.0",
        ),
        ("[onboard.braking]\nblendd = true\n", "blendd"),
        ('[onboard.reference]\nsource = "forces"\n', "source"),
        ('[onboard.reference]\nbound = "forces"\n', "bound"),
        ("[onboard.reference]\nsensor_kmh = 0.0\n", "onboard.reference.sensor_kmh = 0.0"),
        (
            "[onboard.reference.relief]\ntime_s = -0.1\n",
            "onboard.reference.relief.time_s = -0.1",
        ),
        ("[onboard.sensors]\nradius_error = -0.1\n", "radius_error = -0.1"),
        ('[onboard.learning]\nkind = "mean"\n', "onboard.learning.kind.*'running-mean'"),
        ("[onboard.learning]\nfirst = 0\n", "first = 0 must be a whole number, 1 or greater"),
        ("[onboard.learning]\nfirst = 2.5\n", "onboard.learning.first"),
        ("[onboard.learning]\nnoise = 0.0\n", "noise = 0.0"),
    ],
)
def test_bad_values_are_refused(tmp_path, text, message):
    with pytest.raises((StudyError, ValueError), match=message):
        onboard(tmp_path, text)


def test_believed_loads_are_tonnes_per_car(tmp_path):
    found = onboard(tmp_path, "[belief]\nloads_t = [1.5, 2, 0, 0, 0, 0, 0, 0]")
    assert found.belief.loads == (1500.0, 2000.0, *(0.0,) * 6)
    assert onboard(tmp_path, "").belief.loads is None


@pytest.mark.parametrize("name", ["scattered-rail", "freight-start", "wet-stop"])
def test_a_scenario_travels_to_other_processes_by_names_alone(name):
    # what travels by value, as classes without a name would, is large, and a new class at every arrival
    scenario = load_scenario(name)
    arrived = pickle.loads(pickle.dumps(scenario))
    assert arrived == scenario
    assert type(arrived.onboard) is OnboardKeys
    assert type(arrived.onboard.sensors) is type(scenario.onboard.sensors)
    assert arrived.hash() == scenario.hash()
    assert arrived.changed(duration_s=1.0) == scenario.changed(duration_s=1.0)
