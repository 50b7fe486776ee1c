"""The demonstration of JP4209318: what its sets reach, are allowed to be, and is not to be read into them."""

from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from alloc.onboard.brakes import SENSITIVITIES, Fuzzy
from alloc.plant.sets import find_set
from studies.core.claims import meets
from studies.slides.calibration import to_unit_cube
from studies.slides.ensemble_statements import LEAST_MEMBERS
from studies.slides.extrapolation import STOPS, beyond_event, beyond_row
from studies.slides.jp4209318 import (
    BOUNDS,
    CALIBRATED,
    HALVED_STEP,
    brake,
    brake_event,
    measures,
    slide_train,
)
from studies.slides.members import HELD_OUT, MEMBERS
from studies.slides.targets import (
    GREATEST_PEAK,
    HOLD_OUT,
    LEAST_PEAK,
    REACHED,
    TARGETS,
    implausible,
    outcomes,
    residuals,
    unreached,
)

FEW = (*MEMBERS[::5], *HELD_OUT[::5])


@pytest.fixture(scope="module")
def found():
    """The targets' numbers of the calibrated set."""
    return outcomes(CALIBRATED)


@pytest.fixture(scope="module")
def medium():
    """Three cars at medium sensitivity."""
    return brake(brake_event(CALIBRATED))


@pytest.mark.parametrize("target", TARGETS)
def test_the_tables_are_reached(found, target):
    assert meets(REACHED[target], found[target]), found[target]


def test_no_wheel_locks_and_no_slips_are_out_of_order(found):
    assert found["locked"] == found["slides"] == 0.0


def test_slips_are_in_the_sources_order(medium):
    numbers = measures(medium)
    slip = np.array([numbers[f"slip_{i + 1}"] for i in range(12)])
    assert slip.argmax() == 0
    assert np.all(slip[1::2] < slip[0::2])
    assert np.all(np.diff(slip.reshape(3, 4).mean(axis=1)) < 0.0)


def test_members_of_the_ensemble_reach_the_tables_as_well():
    """On other processors the last digit, which valves that switch enlarge, may cost some their place."""
    tried = MEMBERS[::4]
    good = [not unreached(outcomes(one)) for one in tried]
    assert np.mean(good) >= 0.9


def test_fits_without_two_cars_reach_the_other_numbers():
    tried = HELD_OUT[::4]
    assert np.mean([set(unreached(outcomes(one))) <= {HOLD_OUT} for one in tried]) >= 0.9


def test_the_set_in_use_is_a_member_and_the_others_are_other_sets():
    assert MEMBERS[0] == CALIBRATED
    assert len(set(MEMBERS)) == len(MEMBERS) >= LEAST_MEMBERS
    points = np.array([to_unit_cube(one) for one in MEMBERS])
    assert np.abs(points[1:] - points[0]).max(axis=1).min() > 1e-3


def test_halving_the_step_changes_next_to_nothing(medium):
    fine, coarse = measures(brake(brake_event(CALIBRATED, step=HALVED_STEP))), measures(medium)
    assert fine["distance"] == pytest.approx(coarse["distance"], abs=0.05)
    assert fine["damage"] == pytest.approx(coarse["damage"], rel=0.01)


def test_the_distance_is_that_to_standstill(medium):
    assert float(medium["speed"][-1]) < 1e-3
    position = medium["position"].values
    assert measures(medium)["distance"] == pytest.approx(position[-1] - position[0], abs=1e-3)


@pytest.mark.parametrize("one", FEW)
def test_every_set_is_plausible(one):
    for key, value in asdict(one).items():
        low, high = BOUNDS[key]
        assert low <= value <= high, key
    speeds = np.linspace(0.0, 100.0, 51)
    peaks = one.peaks(speeds)
    assert implausible(one) == 0.0
    assert peaks.min() >= LEAST_PEAK
    assert (peaks * (1.0 + one.conditioning)).max() <= GREATEST_PEAK
    assert np.all(np.diff(peaks, axis=0) > 0.0)  # (1) lower in front
    fall = peaks[:, -1] / peaks[:, 0]
    assert np.all(np.diff(fall) > 0.0)  # (2) less dependent on speed further back
    assert one.conditioning > 0.0  # (3)


def test_sensitivity_alone_changes_between_the_columns():
    one, other = (brake_event(CALIBRATED, 3, s) for s in (1.0, CALIBRATED.sensitivity_high))
    assert other.model.rail == one.model.rail
    assert other.model.train == one.model.train
    braking = other.onboard.braking
    protection = braking.slide_protection
    fuzzy = replace(protection.fuzzy, sensitivity=1.0)
    same = replace(braking, slide_protection=replace(protection, fuzzy=fuzzy))
    assert replace(other.onboard, braking=same) == one.onboard


def test_the_defaults_on_board_are_the_calibrated_ones():
    assert CALIBRATED.fuzzy() == Fuzzy()
    assert CALIBRATED.sensitivities == SENSITIVITIES
    shipped, made = (train.cars[0] for train in (find_set("jp4209318-3car"), slide_train()))
    assert shipped.air_brake == made.air_brake


def test_every_parameter_has_bounds_and_a_meaning():
    assert {field.name for field in fields(CALIBRATED)} == set(BOUNDS)


def test_what_is_as_printed_has_no_misfit(found):
    printed = found | {name: target.value for name, target in TARGETS.items()}
    assert residuals(CALIBRATED, printed) == [0.0] * (len(TARGETS) + 3)
    assert unreached(printed | {"locked": 1.0}) == ["locked"]


def test_implausible_sets_are_told_by_how_much():
    assert implausible(replace(CALIBRATED, front_adhesion=0.16)) > 0.01
    assert implausible(replace(CALIBRATED, slip_large=0.5 * CALIBRATED.slip_medium)) > 0.0


def test_stops_beyond_the_tables_change_what_they_name():
    event = brake_event(CALIBRATED)
    for stop in STOPS.values():
        other = beyond_event(CALIBRATED, stop)
        assert other.initial_speed == stop.speed
        assert len(other.model.train.cars) == stop.cars
        assert other.model.rail == replace(event.model.rail, level=stop.adhesion)
        assert other.onboard.braking.slide_protection.fuzzy.sensitivity == stop.sensitivity


def test_faster_trains_and_worse_rails_brake_longer():
    names = ("from 80 km/h", "from 130 km/h", "adhesion 20 % lower", "adhesion 20 % higher")
    slow, fast, bad, good = (beyond_row(CALIBRATED, name) for name in names)
    assert all(row["stopped"] for row in (slow, fast, bad, good))
    assert slow["distance"] < 300.0 < 600.0 < fast["distance"]
    assert good["distance"] < bad["distance"]
