"""RTRI report: printed numbers, laws (1) to (9), and a small run of the study."""

import numpy as np
import pytest

from alloc.evaluation.brake_force import car_brake_forces, coupler_force_between
from alloc.run.simulation import simulate
from studies.files.scenario_files import load_scenario
from studies.rtri import (
    CUT_OUT,
    RIGGING,
    STUDY,
    TESTS,
    cells,
    estimate_forces,
    prepare_train,
    record_test,
    statements,
)
from studies.runner.study import run_study


def test_forces_and_couplers_follow_from_each_other_without_relative_motion():
    mass, force = np.array([96e3, 59e3, 59e3]), np.array([60e3, 30e3, 20e3])
    alpha = -force.sum() / mass.sum()
    couplers = np.array([coupler_force_between(force[:k].sum(), mass[:k].sum(), force[k:].sum(), mass[k:].sum())
                         for k in (1, 2)])  # (6)  # fmt: skip
    found = car_brake_forces(np.full(3, alpha), np.tile(couplers, (3, 1)), mass)
    np.testing.assert_allclose(found, np.tile(force, (3, 1)))  # (2)
    assert coupler_force_between(96.0, 96e3, 59.0, 59e3) == 0.0  # in proportion to the masses


def test_theory_is_that_of_one_wagon_times_their_number():
    assert RIGGING.lever_ratio == pytest.approx(5.0, abs=0.03)
    assert RIGGING.force(350e3, 0.2, cars=17) == pytest.approx(17.0 * RIGGING.force(350e3, 0.2))


def test_the_running_tests_are_those_of_the_report():
    assert [TESTS[name].braked for name in CUT_OUT] == [5.0, 4.0, 3.0, 2.5]  # Table 2
    assert {(one.wagons, one.speed) for one in TESTS.values()} == {(5, 25.0), (17, 75.0)}
    for name in CUT_OUT:
        cars = prepare_train(TESTS[name], 3).cars
        assert sum(2 - len(car.air_brake.cut_out) for car in cars[1:]) == 2 * TESTS[name].braked
        whole = [car.air_brake.friction_factor for car in prepare_train(TESTS["all"], 3).cars]
        assert [car.air_brake.friction_factor for car in cars] == whole


@pytest.mark.parametrize("name", ["locomotive", "all"])
def test_own_accelerations_give_the_force_at_every_instant(name):
    test = TESTS[name]
    exact = record_test(test, prepare_train(test, 0), None)
    e, inner = estimate_forces(test, exact), slice(50, None)  # the filter starts at rest
    assert np.abs(e.separate - exact.wagons())[inner].max() < 100.0  # (4) [N]
    assert np.abs(e.locomotive - exact.truth[:, 0])[inner].max() < 100.0  # (3)
    assert np.abs(e.wagons - exact.wagons())[inner].max() > 20e3  # (5): one acceleration for all
    lost = exact.acceleration @ exact.mass + (exact.truth + exact.resistance).sum(axis=1)
    assert np.abs(lost[inner]).max() < 100.0  # (1): couplers cancel in the sum


@pytest.mark.parametrize(
    ("name", "locomotive", "wagons"),
    [("rtri-locomotive", 60e3, 0.0), ("rtri-all", 60e3, 174e3), ("rtri-emergency", 85e3, 884e3)],
)
def test_couplers_and_accelerations_of_the_shipped_scenarios_give_the_forces(
    name, locomotive, wagons
):
    run = simulate(load_scenario(name).event(), "alone", "none")
    braked = (run["speed"] < 0.5 * run["speed"][0]) & (run["speed"] > 2.0)
    run = run.isel(time=braked.values)
    of_car = run["axle_car"].values[:, None] == np.arange(run.sizes["car"])
    mass = run["car_mass"].values + run["axle_turning_mass"].values @ of_car
    kinetics = run["car_acceleration"].values, run["coupler_force"].values
    found = car_brake_forces(*kinetics, mass).mean(axis=0)  # (2)
    truth = (run["brake_force"].values @ of_car).mean(axis=0)
    assert (np.abs(found - truth) < 0.03 * mass).all()  # running resistance is left
    assert truth[0] == pytest.approx(locomotive, rel=0.05)  # 3.2.2: about 60 kN
    assert truth[1:].sum() == pytest.approx(wagons, rel=0.05)


def test_more_events_add_cells_and_change_none():
    few, more = ({one.name: one for one in cells(n, 1)} for n in (1, 3))
    assert few.items() <= more.items()
    assert len(few) == len(TESTS)


def test_a_small_run_finds_what_the_report_found(tmp_path):
    rows = run_study(STUDY, tmp_path, events=2)
    assert set(rows["status"]) == {"ok"}
    beyond = [one.claim.name for one in statements(rows)
              if not one.claim.least < one.number.value < one.claim.most]  # fmt: skip
    assert beyond == ["3.2.3 proportional"]  # linear, with an intercept
    table = STUDY.table(rows).set_index("test")
    assert list(table.index) == list(TESTS)
    braked = table.loc[list(CUT_OUT), "estimate [kN]"]
    assert (np.diff(braked) < 0.0).all()
    np.testing.assert_allclose(table["estimate [kN]"], table["truth [kN]"], atol=4.0)
