"""The RTRI report's findings in its running tests, made on the plant; the sweep `brake-force` asks the same of many days."""

from functools import cache

import numpy as np
import pytest

from alloc.estimation.brake_force import stop_mean
from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.sets import find_set
from studies.brake_force.findings import row_of_test
from studies.brake_force.running_tests import (
    BRAKE,
    BRAKED_AT,
    RIGGING,
    SHOE_SCATTER,
    STANDSTILL_FRICTION,
    TESTS,
    estimate,
    run_test,
    smooth,
    train_of_test,
)

DAY = 1


@cache
def result(name):
    return run_test(name, DAY)


@cache
def row(name):
    return row_of_test(name, result(name))


def test_cylinders_fill_in_the_order_of_the_brake_pipe():
    m = result("emergency").measured
    built = (m.pressure > 50e3).argmax(axis=0)
    assert np.all(np.diff(m.time[built]) >= 0.0)
    delay = m.time[built[-1]] - m.time[built[0]]
    distance = 19.6 + 16 * 20.4
    assert delay == pytest.approx(distance / 250.0, abs=0.1)


def test_only_the_locomotive_fills_under_its_own_brake():
    m = result("locomotive").measured
    assert m.pressure[-1, 0] == pytest.approx(350e3, rel=0.05)
    assert np.abs(m.pressure[:, 1:]).max() < 20e3  # noise
    assert np.abs(m.pressure[m.time < BRAKED_AT]).max() < 20e3


@pytest.mark.parametrize(
    ("name", "works"), [("all", 10), ("4 wagons", 8), ("3 wagons", 6), ("2.5 wagons", 5)]
)
def test_bogies_are_cut_out_as_the_test_says(name, works):
    cars = train_of_test(TESTS[name], DAY).cars
    assert cars[0].air_brake.cut_out == ()
    assert sum(2 - len(car.air_brake.cut_out) for car in cars[1:]) == works
    if name == "2.5 wagons":
        assert {car.air_brake.cut_out for car in cars[1:]} == {(0,)}


def test_a_day_has_the_same_shoes_in_all_tests_and_others_on_another_day():
    def shoes(name, day):
        return [car.air_brake.force_per_pascal for car in train_of_test(TESTS[name], day).cars]

    assert shoes("all", 1) == shoes("3 wagons", 1) == shoes("locomotive", 1)
    assert shoes("all", 1) != shoes("all", 2)
    nominal = [car.air_brake.force_per_pascal for car in find_set("freight-17").cars]
    ratio = np.array([shoes("emergency", day) for day in range(30)]) / nominal
    assert ratio.std() == pytest.approx(SHOE_SCATTER, rel=0.1)
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)


def test_theory_is_the_force_of_sound_shoes():
    """(7) with the wagon's constants is the plant's brake of a wagon whose shoes do not scatter."""
    for speed in (0.0, 5.0, 20.0):
        friction = hyperbolic_speed_law(speed, *BRAKE.friction)
        plant = 4 * find_set("freight-5").cars[1].air_brake.force_per_pascal * 350e3 * friction
        theory = RIGGING.force(350e3, STANDSTILL_FRICTION * friction)
        assert theory == pytest.approx(plant)


def test_locomotive_alone_presses_the_coupler_by_a_shock_that_dies_out():
    one = row("locomotive")
    assert one["shock_ratio"] > 1.2
    assert one["swing_late"] < 0.1 * one["swing_early"]
    # what remains is (6): the wagons push with their share of the locomotive's force
    assert one["compression"] == pytest.approx(60.0 * 295.0 / 391.0, rel=0.1)


def test_locomotives_estimate_is_right_at_once_and_the_wagons_sum_only_later():
    one = row("locomotive")
    assert one["locomotive_before"] < 0.05 * one["locomotive"]
    assert one["locomotive_before"] < 1.2 * one["locomotive_after"]
    assert one["wagons_before"] > 2.0 * one["wagons_after"]
    assert abs(one["wagons_mean_after"]) < 4.0


def test_couplers_are_free_but_for_spikes_when_all_brake():
    alone, one = row("locomotive"), row("all")
    assert one["coupler_median"] < 0.1 * alone["compression"]
    assert one["coupler_peak"] > 5.0 * one["coupler_median"]
    assert one["spikes"] >= 1
    assert one["error_in_spikes"] > one["error_between"]


def test_locomotives_estimate_is_60_kn_in_both_tests():
    both = [row(name)["locomotive"] for name in ("locomotive", "all")]
    assert both[0] == pytest.approx(both[1], rel=0.05)
    # its own shoes scatter
    scatter = result("all").train.cars[0].air_brake.force_per_pascal / (
        find_set("freight-5").cars[0].air_brake.force_per_pascal
    )
    assert np.array(both) / scatter == pytest.approx(60.0, rel=0.05)


def test_averages_are_linear_in_the_wagons_braked():
    count = np.array([5.0, 4.0, 3.0, 2.5])
    means = np.array([row(name)["mean"] for name in ("all", "4 wagons", "3 wagons", "2.5 wagons")])
    slope, intercept = np.polyfit(count, means, 1)
    assert np.abs(means - slope * count - intercept).max() < 0.5 * slope
    assert np.all(np.diff(means) < 0.0)
    assert slope == pytest.approx(60.0 * 59.0 / 96.0, rel=0.15)


def test_18_cars_follow_theory_on_average_and_oscillate():
    one = row("emergency")
    # the shoes of this day are not those of theory
    assert one["sum_over_theory"] == pytest.approx(one["true_sum_over_theory"], rel=0.05)
    assert one["wagon_over_theory"] == pytest.approx(one["true_wagon_over_theory"], rel=0.05)
    assert abs(one["sum_over_theory"] - 1.0) < 0.1
    assert one["theory_growth"] > 1.0
    assert one["error_first"] > row("all")["error_first"]


@pytest.mark.parametrize("name", ["locomotive", "all", "emergency"])
def test_own_accelerations_averaging_and_smoothing_reduce_the_error(name):
    one = row(name)
    assert one["error_own"] < 0.5 * one["error_first"]
    assert one["error_smooth"] < one["error_own"]
    assert one["mean_error_first"] < 0.5 * one["error_first"]


def test_smoothed_force_of_every_car_is_nearer_than_the_measured_one():
    one = result("emergency")
    smoothed, w = smooth(one), one.window
    error = (smoothed.force - one.true_force)[w]
    measured = estimate(one).wagon[w] - one.true_force[w, 1]
    assert error[:, 1].std() < 0.5 * measured.std()
    # the stated deviation is the error's, of all cars together, but for errors of calibration, which are constant
    changing = error - error.mean(axis=0)
    assert 0.75 < np.sqrt(np.mean(np.square(changing / smoothed.deviation[w]))) < 1.1


def test_mean_over_the_stop_is_as_sure_as_it_says():
    for name in ("all", "3 wagons", "emergency"):
        one = row(name)
        assert abs(one["mean"] - one["true_mean"]) < 3.5 * one["whole_deviation"]
    w = result("all").window
    mean = stop_mean(estimate(result("all")).wagons[w] / 1e3, moving=True)
    assert float(mean.mean) == pytest.approx(row("all")["mean"])
