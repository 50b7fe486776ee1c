"""Metrics against runs whose answer is known by hand."""

import numpy as np
import pytest
import xarray as xr

from alloc.metrics import METRICS, evaluate
from alloc.metrics.use import jerk
from alloc.simulation import simulate


def _constant_run(acceleration=0.5, speed=10.0, duration=10.0, period=0.01):
    """A run made by hand: two axles, one driven; constant acceleration, slip, coefficient."""
    time = np.arange(round(duration / period)) * period
    one = np.ones(time.size)
    two = np.ones((time.size, 2))
    v = speed + acceleration * time
    data = {
        "position": ("time", speed * time + 0.5 * acceleration * time**2),
        "speed": ("time", v),
        "acceleration": ("time", acceleration * one),
        "driver_command": ("time", 0.6 * one),
        "car_acceleration": (("time", "car"), acceleration * one[:, None]),
        "slip_velocity": (("time", "axle"), two * [0.2, 0.01]),
        "rim_speed": (("time", "axle"), v[:, None] + two * [0.2, 0.01]),
        "cylinder_pressure": (("time", "brake_group"), np.zeros((time.size, 0))),
        "group_volume": ("brake_group", np.zeros(0)),
        "coefficient": (("time", "axle"), two * [0.08, 0.0]),
        "adhesion_limit": (("time", "axle"), 0.1 * two),
        "peak_slip": (("time", "axle"), 0.05 * two),
        "rail_force": (("time", "axle"), two * [8e3, 0.0]),
        "axle_load": (("time", "axle"), 1e5 * two),
        "friction_work": (("time", "axle"), np.outer(time, [8e3 * 0.2, 0.0])),
        "coupler_force": (("time", "coupler"), np.zeros((time.size, 0))),
        "motor_work": ("time", 9e4 * time),
        "slipping": (("time", "unit"), np.zeros((time.size, 1), dtype=np.int8)),
        "coefficient_estimate": (("time", "unit"), 0.08 * one[:, None]),
        "axle_unit": ("axle", [0, -1]),
        "axle_group": ("axle", [-1, -1]),
        "axle_static_load": ("axle", [1e5, 1e5]),
        "axle_turning_mass": ("axle", [500.0, 200.0]),
        "drive_limit": (("time", "unit"), 1e3 * one[:, None]),
        "brake_limit": (("time", "unit"), 1e3 * one[:, None]),
        "torque_command": (("time", "unit"), 600.0 * one[:, None]),
        "torque_target": (("time", "unit"), 900.0 * one[:, None]),
        "torque_factor": (("time", "unit"), one[:, None]),
        "air_brake_force": (("time", "unit"), 0.0 * one[:, None]),
        "expected": ("time", 0.15 * one),
        "unit_static_load": ("unit", [1e5]),
        "unit_gear": ("unit", [7.0]),
        "unit_radius": ("unit", [0.5]),
    }
    counts = (
        "detections", "unit_detections", "telegrams_sent", "telegrams_lost", "fallbacks", "blinded", "locks", "time_outs",
        "rule_calls", "rule_failures", "rule_time_s", "controller_failures", "controller_median_s", "controller_p99_s",
    )  # fmt: skip
    attributes = {"train_mass": 20e3, "target_speed": 12.0, "blended_brakes": 0}
    attributes |= dict.fromkeys(counts, 0)
    return xr.Dataset(data, coords={"time": time}, attrs=attributes)


def test_metrics_by_hand():
    result = evaluate(_constant_run())
    assert result["acceleration"] == pytest.approx(0.5)
    assert result["acceleration_ratio"] == pytest.approx(0.5 / 0.6)
    assert result["effort_ratio"] == pytest.approx(8e3 / (0.6 * 20e3))
    assert result["utilisation"] == pytest.approx(
        0.8
    )  # the undriven axle's adhesion does not count
    assert result["bound_use"] == pytest.approx(0.8)  # 10 kN of rail; motors give 13.75 kN
    assert result["headroom"] == result["over_delivery"] == 0.0
    assert result["slip_time"] == pytest.approx(10.0)  # one of two axles beyond twice the peak slip
    assert result["slip_peak"] == pytest.approx(0.2)
    assert result["damage"] == pytest.approx(8e3 * 0.2 * 9.99 / 1e3)
    assert result["time_to_speed"] == pytest.approx(4.0)  # (12 - 10) / 0.5
    assert result["distance"] == pytest.approx(10 * 4 + 0.25 * 16)
    assert result["jerk_rms"] == pytest.approx(0.0, abs=1e-9)
    assert result["energy"] == pytest.approx(0.09 * 9.99)
    assert np.isnan(result["coupler_peak"])
    assert np.isnan(result["estimate_error"])


def test_speed_not_reached_is_nan_not_zero():
    run = _constant_run()
    run.attrs["target_speed"] = 30.0
    result = evaluate(run)
    assert np.isnan(result["time_to_speed"])
    assert np.isnan(result["distance"])


def test_jerk_of_a_slow_oscillation():
    run = _constant_run()
    time = run["time"].values
    run["car_acceleration"] = (("time", "car"), 0.1 * np.sin(2 * np.pi * 0.5 * time)[:, None])
    middle = slice(200, -200)
    expected = 0.1 * 2 * np.pi * 0.5 * np.cos(2 * np.pi * 0.5 * time)
    np.testing.assert_allclose(jerk(run)[middle, 0], expected[middle], atol=2e-3)


def test_jerk_filter_removes_what_passengers_do_not_feel():
    run = _constant_run()
    time = run["time"].values
    run["car_acceleration"] = (("time", "car"), 0.1 * np.sin(2 * np.pi * 30 * time)[:, None])
    assert evaluate(run)["jerk_peak"] < 0.02 * 0.1 * 2 * np.pi * 30


def test_damage_equals_the_integral_of_the_recorded_force_and_slip(make_event, dip):
    # Q from what a real train measures (28), on the recording's grid, against the plant's own integral
    run = simulate(make_event(0.13, patches=[dip], record_period=0.01), "alone")
    power = (run["rail_force"] * run["slip_velocity"]).sum("axle").values
    from_record = np.trapezoid(power, run["time"].values) / 1e3
    assert evaluate(run)["damage"] == pytest.approx(from_record, rel=5e-3)


def test_registry_is_complete(make_event):
    run = simulate(make_event(0.13, duration=3.0), "alone")
    result = evaluate(run)
    assert set(result) == set(METRICS)
    for name, metric in METRICS.items():
        assert metric.name == name
        assert metric.description
        assert isinstance(result[name], float)
