"""JP4209318: printed numbers, the laws behind (5) to (29), and a small run of the study."""

import numpy as np
import pytest

from alloc.evaluation.metrics import damage, distance
from alloc.evaluation.wheel_damage import wheel_damage
from alloc.run.simulation import simulate
from studies import jp4209318
from studies.files.scenario_files import load_scenario
from studies.jp4209318 import CALIBRATED, STEP, STUDY, TABLE_3, TABLE_4, build_train
from studies.runner.study import run_study


def test_the_train_is_that_of_table_2():
    car = build_train(2).cars[1]
    assert len(build_train(2).cars) == 2
    assert (car.mass, len(car.axle_positions), car.wheel_radius) == (4 * 2 * 4000.0, 4, 0.43)
    assert car.wheel_inertia == 2 * 60.0
    brake = car.air_brake
    assert (brake.pressure, brake.dead_time, brake.lag) == (550e3, 0.05, 1.2)
    assert TABLE_3[3] == TABLE_4["medium"][0]


def test_q_is_the_work_of_the_rail_on_sliding_wheels_and_0_without_slide():
    time, brake = np.array([0.0, 10.0]), np.full((2, 1), -1000.0)  # N
    q = wheel_damage(time, brake, [[19.0], [19.0]], [20.0, 20.0], 60.0, 1.0)  # slides by 1 m/s
    assert q[-1, 0] == 10e3  # (28) [J]
    assert wheel_damage(time, brake, [[20.0], [9.0]], [20.0, 9.0], 60.0, 1.0)[-1, 0] == 0.0  # (29)


@pytest.fixture(scope="module")
def run():
    return jp4209318.run_stop(CALIBRATED, 3, CALIBRATED.make_protection())


def test_the_shipped_scenario_is_the_stop_of_the_calibrated_set(run):
    shipped = simulate(load_scenario("jp4209318-stop").event(), "alone", "none")
    assert distance(shipped) == pytest.approx(distance(run), abs=1e-6)
    assert damage(shipped) == pytest.approx(damage(run), rel=1e-9)


def test_both_forms_of_the_motion_the_balance_and_q_hold_in_a_record(run):
    found = jp4209318.check_laws(run, build_train())
    assert max(found["form_1"], found["form_2"]) < 0.02  # m/s, of records 20 ms apart
    assert found["form_1"] == pytest.approx(found["form_2"], abs=1e-9)
    assert found["energy"] < 1e-5  # (27)
    assert found["Q_28"] == pytest.approx(damage(run), rel=1e-4)


def test_wheels_never_turn_faster_than_the_train_runs(run):
    moving = run.isel(time=run["speed"].values > 5.0 / 3.6)
    assert (moving["rim_speed"].values <= moving["speed"].values[:, None] + 1e-9).all()  # (20)
    own = 120.0 / 0.43**2 * moving["acceleration"].values[:, None]
    own = -moving["rail_force"].values - own  # (12): F_m
    lacking = np.cumsum(moving["brake_force"].values - own, axis=0)
    assert lacking.min() > -1e-3 * lacking.max()  # (21)


def test_a_shorter_step_moves_the_stop_by_less_than_a_millimetre(run):
    finer = jp4209318.run_stop(CALIBRATED, 3, CALIBRATED.make_protection(), STEP / 4)
    assert distance(finer) == pytest.approx(distance(run), abs=1e-3)
    assert damage(finer) == pytest.approx(damage(run), rel=1e-5)


def test_more_events_add_cells_and_change_none():
    few, more = ({one.name: one for one in jp4209318.cells(n, 0)} for n in (1, 3))
    assert few.items() <= more.items()
    assert len(few) == 45 + 5 + 5


def test_a_small_run_gives_the_tables(tmp_path):
    rows = run_study(STUDY, tmp_path, events=1)
    assert set(rows["status"]) == {"ok"}
    table = STUDY.table(rows).set_index("number")
    assert table.loc[table["source"].str.startswith("Table"), "verdict"].eq("holds").all()
    assert table.loc["distance, 3 cars [m]", "found"] == pytest.approx(385.67921, abs=1e-5)
    assert table.loc["Q, medium [kJ]", "found"] == pytest.approx(1483.5258, abs=1e-4)
    failed = table.index[table["verdict"] == "does not hold"]
    # by slip ratio each does
    assert [name.partition(":")[0] for name in failed] == [
        "each car behind slides less by [m/s]", "settings that another sensitivity beats in both", "thresholds 0.01, 0.02",
        "2 cars by a set sought without them",
    ]  # fmt: skip
