"""Runs that a driver makes: the plant's laws hold in them, and the driver gets what he sets."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.driving import Controls, TrainSense, drive
from alloc.errors import PlantError
from alloc.event import SimulationError
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Car, Train

DRY = Rail(0.3)


def one_wagon(cut_out: tuple[int, ...] = ()) -> Train:
    """The last wagon of a freight train, alone, without resistance."""
    car: Car = find_set("freight-5").cars[-1]
    assert car.air_brake is not None
    car = replace(car, air_brake=replace(car.air_brake, cut_out=cut_out))
    return Train("one wagon", (car,))


def braking(pressure: float):
    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.pressure[:] = pressure
        return sense.speed > 1.0

    return driver


def test_the_brakes_work_on_what_they_take_from_the_train():
    train = one_wagon()
    run = drive(build(train, DRY), braking(200e3), 60.0, initial_speed=15.0, record_period=0.1)
    speed = run["speed"].values
    rolling = train.mass + train.rotating_mass
    lost = 0.5 * rolling * (speed[0] ** 2 - speed**2)
    friction = run["friction_work"].values.sum(axis=1)
    np.testing.assert_allclose(
        run["shoe_work"].values + friction, lost, rtol=0.0, atol=2e-4 * lost[-1]
    )
    assert speed[-1] <= 1.0 < speed[-2]  # the driver ended it


def test_a_bogie_that_is_cut_out_does_not_brake():
    speeds = [
        drive(build(one_wagon(cut), DRY), braking(200e3), 10.0, initial_speed=20.0)["speed"].values
        for cut in ((), (1,), (0, 1))
    ]
    losses = [speed[0] - speed[-1] for speed in speeds]
    assert losses[2] == 0.0
    assert losses[1] == pytest.approx(0.5 * losses[0], rel=0.05)  # shoes grip better when slower


def test_cutting_out_turns_with_the_car():
    train = one_wagon((1,)).reversed()
    assert train.cars[0].air_brake is not None
    assert train.cars[0].air_brake.cut_out == (0,)
    assert train.reversed().cars[0].air_brake == one_wagon((1,)).cars[0].air_brake


def test_the_driver_reads_what_the_plant_does():
    seen = []

    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.torque[:] = 500.0
        seen.append(sense)
        return True

    model = build(find_set("commuter-8car"), DRY, Line((0.0,), (0.01,)))
    run = drive(model, driver, 2.0, initial_speed=10.0, period=0.05)
    np.testing.assert_array_equal([s.speed for s in seen], run["car_speed"].values[:, 0])
    np.testing.assert_array_equal([s.position for s in seen], run["position"].values)
    np.testing.assert_allclose(run["torque_command"].values, 500.0)
    np.testing.assert_allclose(seen[-1].torque, 500.0, rtol=1e-6)
    np.testing.assert_allclose(
        [s.acceleration for s in seen[20:]], run["acceleration"].values[20:], atol=2e-3
    )


def test_rolling_downhill_obeys_gravity():
    model = build(one_wagon((0, 1)), DRY, Line((0.0,), (-0.02,)))
    run = drive(model, braking(0.0), 20.0, initial_speed=10.0)
    train = model.train
    share = train.mass / (train.mass + train.rotating_mass)
    expected = share * GRAVITY * 0.02 / np.sqrt(1.0 + 0.02**2)
    np.testing.assert_allclose(run["acceleration"].values[10:], expected, rtol=1e-4)


def test_neither_control_period_nor_recording_changes_the_run():
    def run(period: float, record_period: float) -> np.ndarray:
        model = build(one_wagon(), DRY)
        result = drive(
            model, braking(200e3), 5.0, initial_speed=20.0, period=period, record_period=record_period
        )  # fmt: skip
        return result["speed"].sel(time=[1.0, 5.0], method="nearest").values

    np.testing.assert_allclose(run(0.1, 0.5), run(0.1, 0.1), rtol=0.0, atol=0.0)
    np.testing.assert_allclose(run(0.5, 0.5), run(0.1, 0.1), rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"duration": -1.0}, "duration"),
        ({"period": float("nan")}, "period"),
        ({"step": -1.0}, "step"),
        ({"record_period": 0.15}, "multiple"),
    ],
)
def test_impossible_runs_are_refused(changes, named):
    arguments = {"duration": 1.0, **changes}
    with pytest.raises(SimulationError, match=named):
        drive(build(one_wagon(), DRY), braking(0.0), **arguments)


def test_a_brake_that_is_not_there_cannot_be_cut_out():
    with pytest.raises(PlantError, match="cut_out"):
        one_wagon((2,))
    with pytest.raises(PlantError, match="cut_out"):
        one_wagon((-1,))


def test_nan_torque_is_refused():
    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.torque[:] = np.nan
        return True

    with pytest.raises(SimulationError, match="finite"):
        drive(build(find_set("commuter-8car"), DRY), driver, 0.5)
