"""A run is a self-describing dataset that survives being written and read."""

import time
from typing import get_type_hints

import numpy as np
import pytest

from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.recording import VARIABLES, PlantRecord, RunAttributes, load, physical_variables, save
from alloc.simulation import simulate


@pytest.fixture(scope="module")
def run(make_event, dip):
    return simulate(make_event(0.13, patches=[dip], duration=5.0), "greedy")


def test_every_variable_has_unit_and_name(run):
    # of trains with sanders, with cars that move apart, and that learn
    others = {"sand_rate", "slide_reference"}
    others |= {name for name in VARIABLES if name.startswith(("increment", "learnt"))}
    assert set(run.data_vars) == set(VARIABLES) - others
    for name in run.data_vars:
        assert run[name].attrs["units"], name
        assert run[name].attrs["long_name"], name
        assert run[name].dims == VARIABLES[name].dims
    assert run["time"].attrs["units"] == "s"


def test_netcdf_round_trip_is_equal(run, tmp_path):
    path = tmp_path / "run.nc"
    save(run, path)
    assert load(path).identical(run)


def test_attributes_are_those_that_are_typed(run, tmp_path):
    path = tmp_path / "run.nc"
    save(run, path)
    for one in (run, load(path)):
        assert {key: type(value) for key, value in one.attrs.items()} == get_type_hints(
            RunAttributes
        )


def test_what_follows_from_a_record_occupies_one_processor():
    model = build(find_set("commuter-8car"), Rail(0.13))
    record = PlantRecord.allocate(5000, model.layout)
    state = np.broadcast_to(model.initial_state(10.0).T, record.state.shape)
    record = record._replace(state=state.copy(), peak=np.full_like(record.peak, 0.13))
    physical_variables(model, record)  # threads that something else woke spin for a while
    thread, process = time.thread_time(), time.process_time()
    for _ in range(10):
        physical_variables(model, record)
    assert time.process_time() - process <= 1.2 * (time.thread_time() - thread)


def test_provenance_is_recorded(run):
    for key in ("event_hash", "seed", "rule", "controller", "git_revision", "version_numba"):
        assert str(run.attrs[key])


def test_hash_tells_events_apart(make_event, dip):
    plain = make_event(0.13)
    assert plain.hash == make_event(0.13).hash
    others = [
        make_event(0.14),
        make_event(0.13, patches=[dip]),
        make_event(0.13, duration=9.0),
        make_event(0.13, failures={1: 2.0}),
        make_event(0.13, seed=1, scatter=0.01),
    ]
    assert len({e.hash for e in [plain, *others]}) == 6


def test_recorded_quantities_obey_their_definitions(run):
    load_ = run["axle_load"].values
    np.testing.assert_allclose(run["rail_force"], run["coefficient"] * load_, rtol=1e-9, atol=1e-6)
    car = run["axle_car"].values
    slip = run["rim_speed"].values - run["car_speed"].values[:, car]
    np.testing.assert_allclose(run["slip_velocity"], slip, atol=1e-12)
    assert np.all(np.abs(run["coefficient"]) <= run["adhesion_limit"] * (1 + 1e-12))
    # position is the integral of speed (trapezoidal rule at the recording period)
    speed, instants = run["speed"].values, run["time"].values
    travelled = np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(instants))
    assert run["position"].values[-1] - run["position"].values[0] == pytest.approx(
        travelled, rel=1e-5
    )
