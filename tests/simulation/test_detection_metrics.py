"""Detection delay, missed slips and false alarms, by hand and in closed loop."""

import numpy as np
import pytest
import xarray as xr

from alloc.metrics import evaluate
from alloc.metrics.search import detection_delay, false_alarms, missed_slips, slips
from alloc.onboard.parameters import Onboard, Sensors
from alloc.simulation import simulate


def _run(slip, signal):
    """One unit of one axle; `slip` and `signal` are (start, stop, value) spans in hundredths of a second."""
    velocity, slipping = np.full((400, 1), 0.01), np.zeros((400, 1), dtype=np.int8)
    for start, stop, value in slip:
        velocity[start:stop] = value
    for start, stop in signal:
        slipping[start:stop] = 1
    return xr.Dataset(
        {
            "slip_velocity": (("time", "axle"), velocity),
            "peak_slip": (("time", "axle"), np.full((400, 1), 0.05)),
            "slipping": (("time", "unit"), slipping),
            "driver_command": ("time", np.ones(400)),
            "axle_unit": ("axle", [0]),
        },
        coords={"time": 0.01 * np.arange(400)},
    )


def test_delay_is_counted_from_the_peak():
    run = _run([(100, 150, 0.06), (110, 140, 0.3)], [(120, 145)])
    assert [(s.start, s.stop) for s in slips(run)] == [(100, 150)]
    assert detection_delay(run) == pytest.approx(0.20)
    assert missed_slips(run) == 0
    assert false_alarms(run) == 0


def test_a_slip_without_detection_is_missed():
    run = _run([(100, 150, 0.3), (300, 320, 0.3)], [(105, 145)])
    assert missed_slips(run) == 1
    assert detection_delay(run) == pytest.approx(0.05)


def test_a_detection_without_slip_is_a_false_alarm():
    run = _run([(100, 150, 0.3)], [(105, 145), (250, 260)])
    assert false_alarms(run) == 1


def test_creep_just_past_the_peak_is_no_slip_and_no_false_alarm():
    run = _run([(100, 150, 0.06)], [(120, 130)])
    assert list(slips(run)) == []
    assert np.isnan(detection_delay(run))
    assert false_alarms(run) == 0


def test_detector_finds_every_slip_of_a_clean_run_soon(make_event, dip):
    result = evaluate(simulate(make_event(0.15, patches=[dip]), "alone"))
    assert result["missed_slips"] <= 1  # one that ends by itself before it shows
    assert result["false_alarms"] == 0
    assert 0.0 <= result["detection_delay"] < 0.6


def test_without_speed_sensors_detection_is_later(make_event, dip):
    results = {
        pole: evaluate(
            simulate(
                make_event(
                    0.15, patches=[dip], onboard=Onboard(sensors=Sensors(sensorless_pole=pole))
                ),
                "alone",
            )
        )
        for pole in (None, 15.0)
    }
    assert results[15.0]["detection_delay"] > results[None]["detection_delay"]
    assert results[15.0]["slip_peak"] > 0.0


def test_noise_raises_false_alarms(make_event):
    quiet, noisy = (
        evaluate(simulate(make_event(0.30, onboard=Onboard(sensors=Sensors(noise, 0.0))), "alone"))
        for noise in (0.0, 0.06)
    )
    assert quiet["false_alarms"] == 0
    assert noisy["false_alarms"] > 0


def test_quantisation_of_the_speed_sensor_is_seen_on_board(make_event):
    exact, coarse = (
        simulate(make_event(0.30, onboard=Onboard(sensors=Sensors(speed_quantum=quantum))), "alone")
        for quantum in (0.0, 0.05)
    )
    ripple = [run["computed_acceleration"].values[300:].std() for run in (exact, coarse)]
    assert ripple[1] > 5 * ripple[0]
