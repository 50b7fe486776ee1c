"""Data of embodiment 2 from recorded runs: made by hand, so that every datum is known."""

import numpy as np
import pytest
import xarray as xr

from alloc.errors import EstimationError
from alloc.estimation.increment_data import detections, increment_data, true_increments

STEP = 0.01


def run(signals, estimates, demand=1.0, instants=1000):
    """A run of two units: `signals` unit -> (first, last) instant of each slip, `estimates` unit -> values over time."""
    slipping = np.zeros((instants, 2), dtype=np.int8)
    for unit, spans in signals.items():
        for first, last in spans:
            slipping[first : last + 1, unit] = 1
    estimate = np.stack([np.broadcast_to(estimates[unit], instants) for unit in (0, 1)], axis=1)
    return xr.Dataset(
        {
            "slipping": (("time", "unit"), slipping),
            "coefficient_estimate": (("time", "unit"), estimate),
            "driver_command": ("time", np.full(instants, demand)),
        },
        coords={"time": STEP * np.arange(instants)},
    )


def test_received_is_the_difference_to_what_b1_estimates_when_the_telegram_arrives():
    first = 0.10 + 1e-4 * np.arange(1000)
    found = increment_data(run({1: [(200, 205)]}, {0: first, 1: 0.15}), delay=0.1)
    (datum,) = found
    assert (datum.unit, datum.time) == (1, pytest.approx(2.0))
    assert datum.increment == pytest.approx(0.15 - first[210])


def test_held_is_the_difference_to_b1s_estimate_at_its_own_last_slip():
    first = 0.10 + 1e-4 * np.arange(1000)
    event = run({0: [(100, 101), (150, 152)], 1: [(200, 205)]}, {0: first, 1: 0.15})
    (datum,) = increment_data(event, "held")
    assert datum.increment == pytest.approx(0.15 - first[150])


def test_held_needs_a_slip_of_b1_that_is_not_too_old():
    estimates = {0: 0.1, 1: 0.15}
    assert increment_data(run({1: [(200, 205)]}, estimates), "held") == []
    event = run({0: [(100, 101)], 1: [(200, 205), (700, 701)]}, estimates)
    assert len(increment_data(event, "held", hold_time=5.0)) == 1
    assert len(increment_data(event, "held", hold_time=7.0)) == 2


def test_every_onset_is_a_datum_and_the_foremost_unit_gives_none():
    event = run({0: [(10, 20)], 1: [(0, 3), (50, 60), (62, 70)]}, {0: 0.1, 1: 0.12})
    assert [len(onset) for onset in detections(event)] == [1, 3]
    found = increment_data(event)
    assert [datum.time for datum in found] == pytest.approx([0.0, 0.5, 0.62])
    assert all(datum.increment == pytest.approx(0.02) for datum in found)


def test_nothing_is_learnt_without_demand_or_after_the_end():
    assert increment_data(run({1: [(200, 205)]}, {0: 0.1, 1: 0.12}, demand=0.0)) == []
    assert increment_data(run({1: [(995, 999)]}, {0: 0.1, 1: 0.12}), delay=0.1) == []


def test_both_references_agree_where_both_units_slip_together():
    estimates = {0: 0.13, 1: 0.15}
    event = run({0: [(200, 215)], 1: [(200, 215)]}, estimates)
    assert increment_data(event) == increment_data(event, "held")


def test_the_run_is_left_as_it_was():
    event = run({0: [(100, 101)], 1: [(200, 205)]}, {0: 0.1, 1: 0.12})
    before = event.copy(deep=True)
    increment_data(event, "held")
    xr.testing.assert_identical(event, before)


def test_true_increments_are_differences_of_unit_means():
    limit = np.tile([0.10, 0.12, 0.14, 0.16, 0.5], (3, 1))
    event = xr.Dataset(
        {
            "adhesion_limit": (("time", "axle"), limit),
            "axle_unit": ("axle", np.array([0, 0, 1, 1, -1])),
            "limit": (("time", "unit"), np.zeros((3, 2))),
        }
    )
    assert true_increments(event) == pytest.approx([0.0, 0.04])


def test_bad_values_are_refused():
    event = run({}, {0: 0.1, 1: 0.1})
    with pytest.raises(EstimationError, match="reference = 'latest' must be one of received, held"):
        increment_data(event, "latest")
    with pytest.raises(EstimationError, match="delay = -1"):
        increment_data(event, delay=-1)
    with pytest.raises(EstimationError, match="hold_time = nan"):
        increment_data(event, hold_time=float("nan"))


def test_held_takes_what_b1_detects_until_the_telegram_arrives():
    first = 0.10 + 1e-4 * np.arange(1000)
    event = run({0: [(100, 101), (205, 206), (215, 216)], 1: [(200, 203)]}, {0: first, 1: 0.15})
    (datum,) = increment_data(event, "held", delay=0.1)
    assert datum.increment == pytest.approx(0.15 - first[205])


def test_age_of_what_is_held_counts_until_the_telegram_arrives():
    # detected 4.95 s after B1's own slip, received 5.05 s after it
    event = run({0: [(100, 101)], 1: [(595, 596)]}, {0: 0.1, 1: 0.15})
    assert increment_data(event, "held", delay=0.1, hold_time=5.0) == []
    assert len(increment_data(event, "held", delay=0.1, hold_time=5.1)) == 1


def test_what_b1_detects_without_demand_is_not_held():
    event = run(
        {0: [(100, 101), (150, 151)], 1: [(200, 203)]}, {0: 1e-4 * np.arange(1000), 1: 0.15}
    )
    event["driver_command"].values[140:160] = 0.0
    (datum,) = increment_data(event, "held")
    assert datum.increment == pytest.approx(0.15 - 0.0100)
