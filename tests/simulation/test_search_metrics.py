"""Search time and fluctuation of torque on courses made by hand, whose answers are known."""

import numpy as np
import pytest
import xarray as xr

from alloc.metrics import METRICS
from alloc.metrics.search import FOUND, STAY, Search, episodes, searches, shortage, unit_shares

PERIOD = 0.01
times = PERIOD * np.arange(1000)
PLAN = 0.16
LOAD, GEAR, RADIUS = 1e5, 7.0, 0.5
TO_TORQUE = LOAD * RADIUS / GEAR


def run(used, available=0.10, asked=PLAN, command=None, axles=1):
    """One unit of `axles` axles: used share of what is available over time, coefficients available and asked for."""
    one = np.ones((times.size, axles))
    used, available, asked = (np.broadcast_to(v, times.shape) for v in (used, available, asked))
    command = asked * TO_TORQUE if command is None else command
    data = {
        "driver_command": ("time", np.full(times.size, 0.8)),
        "expected": ("time", np.full(times.size, PLAN)),
        "rail_force": (("time", "axle"), one * (used * available * LOAD)[:, None]),
        "axle_load": (("time", "axle"), one * LOAD),
        "adhesion_limit": (("time", "axle"), one * available[:, None]),
        "torque_target": (("time", "unit"), (asked * TO_TORQUE)[:, None]),
        "torque_command": (("time", "unit"), np.asarray(command)[:, None]),
        "air_brake_force": (("time", "unit"), np.zeros((times.size, 1))),
        "axle_unit": ("axle", np.zeros(axles, dtype=int)),
        "unit_static_load": ("unit", [axles * LOAD]),
        "unit_gear": ("unit", [GEAR]),
        "unit_radius": ("unit", [RADIUS]),
    }
    return xr.Dataset(data, coords={"time": times})


def metric(name, recorded):
    return METRICS[name].function(recorded)


def between(low, high, inside, outside):
    return np.where((times >= low) & (times < high), inside, outside)


def test_shares_are_the_coefficients_that_went_in():
    asked, used, available = unit_shares(run(0.8, axles=2))
    assert asked == pytest.approx(PLAN)
    assert used == pytest.approx(0.08)
    assert available == pytest.approx(0.10)


def test_a_unit_that_gets_what_it_asks_for_searches_nothing():
    recorded = run(1.0, available=0.17)
    assert not shortage(recorded).any()
    assert list(episodes(recorded)) == []
    for name in ("search_time", "unfinished_searches", "utilisation_short"):
        assert np.isnan(metric(name, recorded))


def test_adhesion_that_is_never_lost_takes_no_time():
    assert searches(run(FOUND + 0.01)) == [Search(0.0, finished=True)]


def test_a_search_lasts_from_the_loss_to_the_return():
    recorded = run(between(2.0, 3.5, 0.7, 0.97))
    (search,) = searches(recorded)
    assert search.finished
    assert search.time == pytest.approx(1.5)
    assert metric("search_time", recorded) == pytest.approx(1.5)
    assert metric("unfinished_searches", recorded) == 0.0


def test_a_return_too_short_to_stay_does_not_end_it():
    used = between(2.0, 3.0, 0.7, 0.97)
    used = np.where((times >= 3.0 + 0.8 * STAY) & (times < 5.0), 0.8, used)
    assert searches(run(used))[0].time == pytest.approx(3.0)


def test_what_is_not_found_counts_until_the_end_and_as_unfinished():
    recorded = run(np.where(times < 4.0, 0.95, 0.5))
    (search,) = searches(recorded)
    assert not search.finished
    assert search.time == pytest.approx(6.0)
    assert metric("unfinished_searches", recorded) == 1.0


def test_a_drop_starts_a_search_anew():
    recorded = run(between(5.0, 6.0, 0.6, 0.95), available=np.where(times < 5.0, 0.12, 0.08))
    assert [e.start for e in episodes(recorded)] == [0, 500]
    assert [s.time for s in searches(recorded)] == [0.0, pytest.approx(1.0)]


def test_shortages_apart_are_episodes_of_their_own_and_short_gaps_are_bridged():
    apart = run(0.95, available=between(4.0, 6.0, 0.20, 0.10))
    bridged = run(0.95, available=between(4.0, 4.2, 0.20, 0.10))
    assert len(list(episodes(apart))) == 2
    assert len(list(episodes(bridged))) <= 2  # the end of the gap is a drop
    assert len(list(episodes(run(0.95, available=between(4.0, 4.5, 0.10, 0.20))))) == 0


def test_use_is_counted_only_where_adhesion_is_short():
    recorded = run(between(0.0, 5.0, 0.9, 0.5), available=np.where(times < 5.0, 0.10, 0.20))
    assert metric("utilisation_short", recorded) == pytest.approx(0.9)


def test_a_constant_torque_does_not_fluctuate_and_a_slow_one_hardly():
    assert metric("torque_fluctuation", run(0.9)) == pytest.approx(0.0, abs=1e-12)
    ramp = TO_TORQUE * PLAN * times / times[-1]
    # a ramp is its own moving mean but at its ends
    assert metric("torque_fluctuation", run(0.9, command=ramp)) < 0.005


@pytest.mark.parametrize("amplitude", [0.05, 0.2])
def test_a_fast_oscillation_fluctuates_by_its_rms(amplitude):
    command = TO_TORQUE * PLAN * (1.0 + amplitude * np.sin(2 * np.pi * 5.0 * times))
    found = metric("torque_fluctuation", run(0.9, command=command))
    assert found == pytest.approx(amplitude / np.sqrt(2), rel=0.02)


def test_units_and_directions_are_registered():
    better = {"search_time": -1, "unfinished_searches": -1, "utilisation_short": 1}
    assert {name: METRICS[name].better for name in better} == better
    assert METRICS["search_time"].unit == "s"
