"""A measured run made of straight lines with a gap, so that forces, damage and slips can be computed by hand."""

import numpy as np
import pytest
import xarray as xr

from alloc.errors import EstimationError
from alloc.estimation.slip_events import SlipEvent
from alloc.plant.model import structure_of
from alloc.plant.sets import find_set
from studies.logs.measured_run import (
    Findings,
    MeasuredRun,
    MeasuredTrain,
    analyse_run,
    applied_force,
    train_acceleration,
)

TIME = np.concatenate([0.1 * np.arange(21), 3.0 + 0.1 * np.arange(11)])
PART = np.repeat([0, 1], [21, 11])
TRAIN = MeasuredTrain(
    name="two axles",
    car_mass=np.array([20e3, 30e3]),
    axle_car=np.array([0, 1]),
    axle_load=np.array([50e3, 60e3]),
    radius=np.array([0.5, 0.4]),
    inertia=np.array([100.0, 80.0]),
    driven=np.array([True, False]),
)


def run(**changes):
    """Both cars gain 1 m/s2. Axle 0 gains 2 m/s2 at its rim and slips by 1 m/s more every second; axle 1 rolls.

    The rail pulls axle 0 by 5000 N: its wheelset takes 100 / 0.5^2 x 2 = 800 N of what is applied. It holds axle 1 back by
    3000 N: the wheelset takes 80 / 0.4^2 x 1 = 500 N. What is applied to axle 1 was not recorded after the gap.
    """
    applied = np.column_stack([np.full(TIME.size, 5800.0), np.where(PART == 0, -2500.0, np.nan)])
    series = {
        "time": TIME, "part": PART, "speed": 10.0 + TIME, "applied_force": applied,
        "rim_speed": np.column_stack([10.0 + 2.0 * TIME, 10.0 + TIME]), "coupler_force": np.full((TIME.size, 1), 4e3),
    }  # fmt: skip
    return MeasuredRun(**series | changes)


def test_coefficients_are_forces_over_loads():
    found = analyse_run(run(), TRAIN)
    np.testing.assert_allclose(found.coefficient[:, 0], 5000.0 / 50e3, rtol=1e-9)
    np.testing.assert_allclose(found.coefficient[:21, 1], -3000.0 / 60e3, rtol=1e-9)
    assert np.isnan(found.coefficient[21:, 1]).all()
    np.testing.assert_allclose(found.slip_velocity[:, 0], TIME, atol=1e-12)
    assert found.covered == pytest.approx([3.0, 2.0])  # 2 s and 1 s; 2 s
    assert found.window == pytest.approx(0.2)  # two samplings, for 0.1 s would be but one


def test_forces_are_averaged_over_a_tenth_of_a_second_where_sampling_allows():
    time = 0.01 * np.arange(50)
    fine = MeasuredRun(
        time, np.zeros(50, dtype=int), 10.0 + time, np.full((50, 2), 10.0), np.zeros((50, 2))
    )
    assert analyse_run(fine, TRAIN).window == 0.1


def test_damage_is_force_times_slip_and_stands_still_over_the_gap():
    found = analyse_run(run(), TRAIN)
    before, after = 5000.0 * 2.0**2 / 2, 5000.0 * (4.0**2 - 3.0**2) / 2
    assert found.damage[20:22, 0] == pytest.approx(before, rel=1e-9)
    assert found.axle_damage == pytest.approx([before + after, 0.0], abs=1e-6)
    assert found.total_damage == pytest.approx(before + after)
    never = analyse_run(run(applied_force=np.full((TIME.size, 2), np.nan)), TRAIN)
    assert np.isnan(never.damage).all()
    assert never.total_damage == 0.0


def test_slips_are_found_part_by_part():
    # axle 0 passes half of 5 % of its rim speed where t = 0.025 (10 + 2 t): at 0.26 s, seen at 0.3 s
    found = analyse_run(run(), TRAIN)
    first, second = found.events
    assert (first.axle, first.start, first.end, first.cut) == (
        0, pytest.approx(0.3), pytest.approx(2.0), True
    )  # fmt: skip
    assert (second.start, second.end, second.cut) == (3.0, pytest.approx(4.0), True)
    assert first.onset_coefficient == pytest.approx(0.1)
    assert first.damage == pytest.approx(5000.0 * (2.0**2 - 0.2**2) / 2)
    assert np.isnan(second.onset_coefficient)
    assert second.largest_slip == pytest.approx(4.0)
    assert found.slipping_time == pytest.approx([1.7 + 1.0, 0.0])
    assert found.utilisation == pytest.approx(1.0)


def test_slips_without_forces_are_found_too():
    rim = np.column_stack([10.0 + TIME, 10.0 + 2.0 * TIME])
    found = analyse_run(run(rim_speed=rim), TRAIN)
    assert [(e.axle, e.start, np.isfinite(e.damage)) for e in found.events] == [
        (1, pytest.approx(0.3), True),
        (1, 3.0, False),
    ]


def test_use_in_slips_is_weighted_with_their_time():
    def slip(start, end, onset, share):
        return SlipEvent(0, start, end, False, 1.0, 0.1, onset, start, share, 0.0)

    nothing = np.zeros(1)
    events = [slip(0.0, 2.0, 0.1, 0.8), slip(5.0, 6.0, 0.2, 0.5), slip(7.0, 9.0, 0.3, np.nan)]
    found = Findings(events, nothing, nothing, nothing, nothing, nothing, None, 0.1)
    assert found.utilisation == pytest.approx(
        (0.1 * 0.8 * 2.0 + 0.2 * 0.5 * 1.0) / (0.1 * 2.0 + 0.2)
    )
    assert np.isnan(
        Findings([], nothing, nothing, nothing, nothing, nothing, None, 0.1).utilisation
    )


def test_brake_force_of_cars_is_by_the_coupler_and_the_acceleration():
    force = analyse_run(run(), TRAIN).car_force
    np.testing.assert_allclose(
        force, np.tile([-20e3 * 1.0 - 4e3, -30e3 * 1.0 + 4e3], (TIME.size, 1)), rtol=1e-9
    )
    own = np.tile([1.1, 0.8], (TIME.size, 1))
    own[7, 1] = np.nan
    couplers = np.full((TIME.size, 1), 4e3)
    couplers[3] = np.nan
    force = analyse_run(run(car_acceleration=own, coupler_force=couplers), TRAIN).car_force
    missing = np.isin(np.arange(TIME.size), [3, 7])
    np.testing.assert_allclose(
        force[~missing],
        np.tile([-20e3 * 1.1 - 4e3, -30e3 * 0.8 + 4e3], (TIME.size - 2, 1)),
        rtol=1e-9,
    )
    assert np.isnan(force[missing]).all()
    assert analyse_run(run(coupler_force=None), TRAIN).car_force is None


def test_acceleration_is_not_taken_over_a_gap():
    jump = 10.0 + TIME + 5.0 * PART
    np.testing.assert_allclose(train_acceleration(run(speed=jump), 0.4), 1.0, rtol=1e-9)


def test_series_of_another_train_are_refused():
    with pytest.raises(EstimationError, match=r"rim_speed: shape \(32, 1\) must be \(32, 2\)"):
        analyse_run(run(rim_speed=np.zeros((TIME.size, 1))), TRAIN)


def test_applied_force_is_torque_at_the_rim_less_the_shoes():
    train = find_set("commuter-8car")
    structure, layout = structure_of(train)
    torque = 100.0 * (1.0 + np.arange(layout.units)) * np.ones((2, 1))
    shoes = 10.0 * np.arange(layout.axles) * np.ones((2, 1))
    logged = xr.Dataset(
        {
            "rail_force": (("time", "axle"), np.zeros((2, layout.axles))),
            "brake_force": (("time", "axle"), shoes),
            "motor_torque": (("time", "unit"), torque),
            "axle_unit": (("axle",), structure.axle_unit),
            "unit_gear": (("unit",), structure.unit_gear),
        }
    )
    found = applied_force(logged, train)
    for i, unit in enumerate(structure.axle_unit):
        motor = 100.0 * (1 + unit) * structure.gear[i] / structure.radius[i] if unit >= 0 else 0.0
        assert found[:, i] == pytest.approx(motor - 10.0 * i)
    measured = MeasuredTrain.of(train)
    np.testing.assert_array_equal(applied_force(logged, measured), found)
    np.testing.assert_array_equal(measured.driven, structure.axle_unit >= 0)
    np.testing.assert_array_equal(measured.axle_load, structure.static_load)
    assert measured.car_mass.sum() == pytest.approx(train.mass)
    with pytest.raises(EstimationError, match="run of 3 axles"):
        applied_force(logged.isel(axle=slice(3)), train)
