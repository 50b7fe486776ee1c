"""Increments of JP5484215: (12) to (15) from counts of slides, (16) and (17), and data out of recorded runs."""

import numpy as np
import pytest
from scipy.stats import norm

from alloc.plant.rail import GROWTH_SLOPE, logarithmic_increments
from alloc.run.simulation import simulate
from studies import StudyError
from studies import learning as study
from studies.files.scenario_files import load_scenario


def test_the_printed_numbers() -> None:
    assert study.plan_at(np.array(70.0 / 3.6)) == pytest.approx(13.6 / (70.0 + 85.0))  # (12)
    assert logarithmic_increments(64)[:4].mean() == pytest.approx(0.0, abs=1e-5)  # (15)
    assert (
        norm.cdf(-study.plan_at(np.array(270.0 / 3.6)) / study.SIGMA) < 1e-3
    )  # par. 0054: none below 0
    found = study.unit_increments(np.array([9.0, 1.0, 3.0, 4.0, 8.0]), np.array([-1, 0, 0, 1, 1]))
    assert found.tolist() == [0.0, 4.0]  # means over the axles of units


def test_counts_give_the_growth_back_within_two_errors_of_their_own() -> None:
    off = []
    for seed in range(40):
        slope, error = study.fit_slope(*study.axle_shifts(study.draw_counts(64, 2000, seed)))
        off.append((slope - GROWTH_SLOPE) / error)
    assert np.mean(np.abs(off) < 2.0) > 0.85
    assert 0.7 < np.std(off) < 1.3


def test_half_of_the_brakings_slide_the_lead_car_and_no_slide_says_nothing() -> None:
    shift, _ = study.axle_shifts(np.array([100, 100, 100, 100, 50, 0, 250]))
    np.testing.assert_allclose(shift[:4], 0.0, atol=1e-12)  # (13)
    assert shift[4] == pytest.approx(0.012 * 0.6745, rel=1e-3)  # (14): a quarter of all brakings
    assert np.isnan(shift[5:]).all()
    with pytest.raises(StudyError, match="lead car never slid"):
        study.axle_shifts(np.array([0, 0, 0, 0, 5]))


@pytest.mark.parametrize(("arm", "behind"), [("mean", 10.0), ("mean_growing", 20.0)])
def test_new_data_weigh_against_the_stored_ones_as_printed(arm: str, behind: float) -> None:
    stored = study.Stored(np.zeros(2))
    stored.learn(study.ARMS[arm], [(1, 0.02)] * 9)
    assert stored.increment.tolist() == [0.0, 0.0]  # N_min is not reached
    stored.learn(study.ARMS[arm], [(1, 0.02)])
    assert stored.increment.tolist() == [0.0, pytest.approx(0.01)]  # (17): 10 stored, 10 new
    stored.learn(study.ARMS[arm], [(1, 0.03)] * 5)
    assert stored.increment[1] == pytest.approx((0.01 * behind + 0.03 * 5) / (behind + 5))


def test_a_datum_is_the_estimate_at_a_slip_less_the_leaders_at_its_receipt_or_at_its_own_slip() -> (
    None
):
    event = study.make_start(load_scenario("wet-start"), ("even", "too low"), 0, 1, seed=77)
    found = simulate(event, study.RULE, study.CONTROLLER).isel(time=slice(300)).copy(deep=True)
    slips, estimate = found["slipping"].values, found["coefficient_estimate"].values
    slips[:], estimate[:] = 0, np.arange(300)[:, None] * 1e-4 + [0.10, 0.12, 0.13, 0.14]
    slips[100:110, 0] = slips[123:130, 1] = slips[20:30, 2] = slips[298:, 3] = 1
    # a telegram every 0.1 s is heard 0.05 s later; of unit 3 when the leader has not slipped, of unit 4 after the end
    assert study.collect_data(found, event, held=False) == [
        (2, pytest.approx(0.0295)),
        (1, pytest.approx(0.0188)),
    ]
    assert study.collect_data(found, event, held=True) == [(1, pytest.approx(0.0223))]


def test_a_held_reference_learns_increments_that_were_too_high() -> None:
    kind = ("even", "too high")
    rows = study.run(
        load_scenario("wet-start"), kind, "gaussian_held", event=0, seed=77, stations=4
    )
    assert [row["station"] for row in rows] == [1, 2, 3, 4]
    assert rows[-1]["error"] < 0.3 * 0.0236  # of the stored ones
