"""Increments of JP5484215: (12) to (15) from counts of slides, (16) and (17), and data out of recorded runs."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.increment_learning import IncrementLearning
from alloc.plant.rail import logarithmic_increments
from alloc.simulation import simulate
from studies.core import StudyError
from studies.learning import (
    ARMS,
    SLOPE,
    Stored,
    axle_shifts,
    data,
    drawn_counts,
    fit,
    planned,
    run,
    start,
    unit_increments,
)


def test_the_printed_numbers() -> None:
    assert planned(np.array(70.0 / 3.6)) == pytest.approx(13.6 / (70.0 + 85.0))  # (12)
    assert logarithmic_increments(64)[:4].mean() == pytest.approx(0.0, abs=1e-5)  # (15)


def test_counts_give_the_growth_back_within_two_errors_of_their_own() -> None:
    off = []
    for seed in range(40):
        slope, error = fit(*axle_shifts(drawn_counts(64, 2000, seed)))
        off.append((slope - SLOPE) / error)
    assert np.mean(np.abs(off) < 2.0) > 0.85
    assert 0.7 < np.std(off) < 1.3


def test_half_of_the_lead_cars_axles_slide_and_no_slide_says_nothing() -> None:
    shift, covariance = axle_shifts(np.array([100, 100, 100, 100, 50, 0, 250]))
    np.testing.assert_allclose(shift[:4], 0.0, atol=1e-12)  # (13)
    assert shift[4] == pytest.approx(0.012 * 0.6745, rel=1e-3)  # (14): a quarter of all brakings
    assert np.isnan(shift[5:]).all()
    assert covariance[0, 0] > 0.0
    with pytest.raises(StudyError, match="lead car never slid"):
        axle_shifts(np.array([0, 0, 0, 0, 5]))


def test_a_unit_has_the_mean_of_its_axles_over_the_foremost_one() -> None:
    found = unit_increments(np.array([9.0, 1.0, 3.0, 4.0, 8.0]), np.array([-1, 0, 0, 1, 1]))
    np.testing.assert_allclose(found, [0.0, 4.0])


@pytest.mark.parametrize("arm", ["mean", "mean_growing"])
def test_means_of_new_data_weigh_against_the_stored_ones_as_printed(arm: str) -> None:
    stored = Stored(np.zeros(2))
    stored.learn(ARMS[arm], [(1, 0.02)] * 9)
    assert stored.increment[1] == 0.0
    stored.learn(ARMS[arm], [(1, 0.02)])
    assert stored.increment[1] == pytest.approx(0.01)  # (17): 10 stored, 10 new
    stored.learn(ARMS[arm], [(1, 0.02)] * 5)
    grown = 20.0 if ARMS[arm].grows else 10.0
    assert stored.increment[1] == pytest.approx((0.01 * grown + 0.02 * 5) / (grown + 5))
    assert stored.increment[0] == 0.0


@pytest.mark.parametrize("reference", ["received", "held"])
def test_data_in_a_record_are_those_that_the_leader_took_on_board(reference: str) -> None:
    event = start(("even", "too high"), event=0, station=1, seed=77)
    learning = IncrementLearning("running-mean", reference, first=10**9)  # type: ignore[arg-type]
    recorded = simulate(replace(event, onboard=replace(event.onboard, learning=learning)), "exact")
    number = recorded["increment_data"].values
    at, unit = np.nonzero(np.diff(number, axis=0, prepend=0.0))
    taken = sorted(zip(unit.tolist(), recorded["increment_datum"].values[at, unit], strict=True))
    found = sorted(data(recorded, event, reference == "held"))
    assert len(found) > 10
    assert found == taken


def test_a_held_reference_learns_increments_that_were_too_high() -> None:
    rows = run("even", "too high", "gaussian_held", event=0, seed=77, stations=4)
    assert [row["station"] for row in rows] == [1, 2, 3, 4]
    errors = [row["error"] for row in rows]
    assert errors[3] < 0.3 * 0.0236
