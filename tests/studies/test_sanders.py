"""The sander trials of RSSB T1107 under the stored law, and what the sweep says of placement and sharing."""

import os

import numpy as np
import pytest

from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW, UNDECIDED
from studies.files.study_error import StudyError
from studies.stops.sander_trial import (
    AMOUNT,
    CALIBRATED,
    DEMAND,
    DISTANCES,
    FITTED,
    FIXED_RATE,
    FRICTION,
    HIGH,
    INITIAL_SPEED,
    LOW,
    PLACEMENTS,
    RATE,
    SOURCES,
    TOLERANCE,
    USUAL,
    calibrate,
    caps,
    coupled_units,
    distances,
    placed,
    rail,
    shares,
    stop,
)
from studies.stops.sanders_study import SANDERS, sander_statements
from tests.studies.made_tables import BEST, REAR, sander_table


def verdict(name, **how):
    return next(s for s in sander_statements(sander_table(**how)) if s.name == name)


@pytest.fixture(scope="module")
def found():
    return distances(CALIBRATED)


@pytest.mark.parametrize("kind", DISTANCES)
def test_the_stored_law_gives_the_trials_distances(found, kind):
    miss = found[kind] / DISTANCES[kind] - 1.0
    assert miss > 0.0 if kind == "none" else abs(miss) <= TOLERANCE


def test_more_sand_stops_sooner(found):
    assert list(found) == list(DISTANCES)
    assert np.all(np.diff(list(found.values())) < 0.0)


def test_the_law_lies_within_its_bounds():
    assert all(low <= x <= high for low, x, high in zip(LOW, CALIBRATED, HIGH, strict=True))
    assert set(FITTED) < set(DISTANCES)


@pytest.mark.skipif("READHESION_FULL" not in os.environ, reason="minutes of computing")
def test_the_stored_law_is_what_the_calibration_gives():
    """Its first gain and its decay; much sand would have to be laid to tell where the gain ends."""
    found = calibrate()
    first, stored = (
        (x.sanded_coefficient - FRICTION) / x.sand_saturation for x in (found, CALIBRATED)
    )
    assert first == pytest.approx(stored, rel=0.05)
    assert found.sand_decay == pytest.approx(CALIBRATED.sand_decay, abs=0.01)


@pytest.mark.parametrize("curve", ["slip-ratio", "polach"])
def test_rails_of_both_curves_carry_the_same(curve):
    one = rail(CALIBRATED, curve)
    contact = build(coupled_units(), one).environment.contact
    for level, carried in ((one.level, FRICTION), (one.sanded_coefficient, CALIBRATED[0])):
        found = one.curve.limit(level, INITIAL_SPEED, contact)[0]
        np.testing.assert_allclose(found, carried, rtol=1e-6)


@pytest.mark.parametrize("axles", PLACEMENTS.values())
def test_every_placement_has_the_same_sand(axles):
    train = placed(axles)
    assert sum(one.amount for one in train.sanders) == pytest.approx(AMOUNT)
    assert sum(one.rate for one in train.sanders) == pytest.approx(RATE)
    assert len(train.sanders) == len(axles)


def test_cars_behind_the_sand_are_believed_to_carry_more():
    found = caps(placed((16,)), 0.02, 15.0)
    assert found[:4] == [0.02] * 4
    assert found[4] > found[5] > found[7] > 0.05


def test_shares_ask_no_car_for_more_than_it_carries_or_brakes():
    train = placed((16,))
    found = np.array(shares(train, 0.02, 15.0, "by sand"))
    planned = -DEMAND / GRAVITY
    assert np.all(found * planned <= np.array(caps(train, 0.02, 15.0)) + 1e-12)
    assert found.max() <= 1.2 / 0.9 + 1e-12
    assert found[:4] == pytest.approx(0.02 / planned)
    assert found[4:].max() > 1.0
    raised = shares(train, 0.02, 15.0, "raised")
    np.testing.assert_array_equal(raised, np.maximum(found, 1.0))
    np.testing.assert_allclose(shares(train, 0.5, 15.0, "by sand"), 1.0)
    assert shares(train, 0.02, 15.0, "equal") is None


def test_more_events_change_no_cell():
    few, more = (SANDERS.cells(0, events) for events in (1, 2))
    assert more[: len(few)] == few
    assert len({cell.label for cell in more}) == len(more)


def test_slip_is_measured_from_the_speed_asked_for():
    usual, truth = (SANDERS.cells(0, 1, **how) for how in ({}, {"source": "truth"}))
    assert SANDERS.cells(0, 1, source="estimate") == usual
    assert not {cell.label for cell in usual} & {cell.label for cell in truth}
    with pytest.raises(StudyError, match="gps"):
        SANDERS.cells(0, 1, source="gps")
    found = [stop("two variable", CALIBRATED, 1, source=source) for source in SOURCES]
    assert found[0] != found[1]
    assert found[0]["distance"] == pytest.approx(found[1]["distance"], rel=0.03)


def test_a_train_that_stands_lays_no_sand():
    """Two units with a sander of fixed rate each: both rails, for the time of the stop."""
    metres, kg = (stop("one fixed", CALIBRATED)[name] for name in ("distance", "sand"))
    rate = 2 * 2 * FIXED_RATE
    mean_speed = metres / (kg / rate)
    assert 0.4 * INITIAL_SPEED < mean_speed < 0.7 * INITIAL_SPEED


def test_verdicts_follow_the_table():
    assert verdict("fitted").verdict == verdict("predicted").verdict == HOLDS
    assert verdict("placement").verdict == HOLDS
    assert BEST in verdict("placement").claim
    assert verdict("placement", best=1.0001).verdict == CONDITIONS
    assert verdict("placement", events=4).verdict == TOO_FEW
    assert verdict("sharing: raised").verdict == CONDITIONS
    assert f"not with the sand at {REAR}" not in verdict("sharing: raised").conditions
    assert f"not with the sand at {USUAL}" in verdict("sharing: raised").conditions
    assert verdict("sharing: raised", gain=0.01).verdict == FAILS
    assert verdict("sharing: by sand").verdict == FAILS
    assert verdict("together").verdict == UNDECIDED  # the best place gains nothing by sharing
    assert verdict("together", gain=0.5).verdict == HOLDS
