"""Tangential force and wheel damage from series: against the integrals, their errors, and what is refused."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from alloc.evaluation.wheel_damage import tangential_force, wheel_damage
from alloc.schema.errors import EstimationError
from tests.cases import looped

FOUR_SECONDS = np.linspace(0.0, 4.0, 401)

RADIUS, INERTIA = 0.43, 120.0


def sliding(time=FOUR_SECONDS, sign=1.0):
    """Constant tangential force 5 kN, slip velocity sign * sin^2: applied force, omega and speed that belong to it."""
    speed = 20.0 + sign * 0.8 * time
    slip = sign * 2.0 * np.sin(np.pi * time / 4.0) ** 2
    omega = (speed + slip) / RADIUS
    rate = (sign * 0.8 + sign * 0.5 * np.pi * np.sin(np.pi * time / 2.0)) / RADIUS
    applied = sign * 5000.0 + INERTIA / RADIUS * rate
    return applied[:, None], omega[:, None], speed


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_damage_is_force_times_distance_slipped(sign):
    applied, omega, speed = sliding(sign=sign)
    damage = wheel_damage(FOUR_SECONDS, applied, omega, speed, INERTIA, RADIUS)
    distance = FOUR_SECONDS - 2.0 / np.pi * np.sin(np.pi * FOUR_SECONDS / 2.0)
    np.testing.assert_allclose(damage[:, 0], 5000.0 * distance, atol=1e-4 * 20e3)


def test_the_error_falls_with_the_square_of_the_sampling():
    errors = []
    for count in (21, 41, 81):
        time = np.linspace(0.0, 3.0, count)  # no whole period, whose ends' errors would cancel
        applied, omega, speed = sliding(time)
        found = wheel_damage(time, applied, omega, speed, INERTIA, RADIUS)[-1, 0]
        errors.append(abs(found - 5e3 * (3.0 + 2.0 / np.pi)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 1.8), orders


@pytest.mark.filterwarnings("ignore:axle . has a Q of -")  # random lines are no train
def test_lines_between_instants_are_integrated_exactly():
    """Few instants of straight lines give what a thousand of them give."""
    rng = np.random.default_rng(3)
    knots = np.array([0.0, 0.3, 0.5, 1.1, 1.2])
    fine = np.unique(np.concatenate([knots, np.linspace(0.0, 1.2, 1001)]))
    applied, omega, speed = rng.uniform(1.0, 2.0, (3, knots.size)) * [[4e3], [50.0], [20.0]]
    coarse = wheel_damage(knots, applied[:, None], omega[:, None], speed, INERTIA, RADIUS)
    lines = [np.interp(fine, knots, values) for values in (applied, omega, speed)]
    many = wheel_damage(fine, lines[0][:, None], lines[1][:, None], lines[2], INERTIA, RADIUS)
    assert coarse[-1, 0] == pytest.approx(many[-1, 0], rel=1e-9)


def test_noise_of_the_speeds_does_not_bias_the_damage():
    applied, omega, speed = sliding()
    rng = np.random.default_rng(5)
    found = []
    for _ in range(400):
        noisy = omega + rng.normal(0.0, 0.05 / RADIUS, omega.shape)
        measured = speed + rng.normal(0.0, 0.05, speed.shape)
        found.append(wheel_damage(FOUR_SECONDS, applied, noisy, measured, INERTIA, RADIUS)[-1, 0])
    error = np.mean(found) - 20e3
    assert abs(error) < 3.0 * np.std(found) / np.sqrt(len(found)) + 2.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_window_gives_the_mean_force(sign):
    applied, omega, _ = sliding(sign=sign)
    force = tangential_force(FOUR_SECONDS, applied, omega, INERTIA, RADIUS, 0.1)
    np.testing.assert_allclose(force, sign * 5000.0, rtol=2e-3)
    np.testing.assert_allclose(force[20:-20], sign * 5000.0, rtol=1e-4)


FORCE, OMEGA, SPEED = sliding()
LOG = {"time": FOUR_SECONDS, "applied_force": FORCE, "angular_speed": OMEGA, "speed": SPEED}
STAMPS = pd.Timestamp("2024-10-27 02:59:58") + pd.to_timedelta(FOUR_SECONDS, unit="s")
TOKYO, SPANS = STAMPS.tz_localize("Asia/Tokyo"), STAMPS - STAMPS[0]


def q(radius=RADIUS, **changes):
    return wheel_damage(**LOG | changes, inertia=INERTIA, radius=radius)[-1, 0]


@looped("time", [
    *(one.values.astype(f"{one.values.dtype.kind}8[{unit}]") for one in (STAMPS, SPANS) for unit in ("ms", "us", "ns")),
    *(TOKYO, pd.Series(TOKYO), xr.DataArray(STAMPS), list(STAMPS.to_pydatetime()), list(TOKYO), list(SPANS)),
])  # fmt: skip
def test_time_stamps_of_any_type_are_seconds_and_no_force(time):
    assert q(time=time) == pytest.approx(q(), rel=1e-12)
    with pytest.raises(EstimationError, match=r"applied_force holds (date|time)\w+ values"):
        q(applied_force=np.array(time)[:, None])
    with pytest.raises(EstimationError, match=r"window = 0\.001 s is shorter"):
        tangential_force(time, FORCE, OMEGA, INERTIA, RADIUS, pd.Timedelta("1ms"))


GAP = {name: np.isin(np.arange(401), 7).reshape(401, *one.shape[1:]) for name, one in LOG.items()}


@looped(("change", "words"), [
    ({"time": FOUR_SECONDS[::-1]}, "time must grow"),
    ({"time": 1e3 * FOUR_SECONDS}, "time steps by 10 s at .* are these seconds"),
    ({"time": FOUR_SECONDS / 3600.0}, "time steps by 2.7.*e-06 s"),
    ({"time": FOUR_SECONDS + 10.0 * (FOUR_SECONDS > 2.0)}, "time steps by 10.01 s at 2 s"),
    ({"time": np.ma.array(STAMPS, mask=GAP["time"])}, r"time holds nan at \(7,\)"),
    ({"speed": np.zeros(3)}, "speed has shape"),
    ({"speed": 3.6 * SPEED}, "axle 0 never rolls: slip of -60.* units"),
    ({"speed": 360.0 * SPEED}, r"speed holds 7200 at \(0,\); no train has more than 160"),
    ({"angular_speed": 360.0 * OMEGA}, r"angular_speed times radius holds 7200 at \(0, 0\)"),
    ({"applied_force": -FORCE}, "axle 0 has a Q of -.*are the signs right"),
    ({"radius": 430.0}, r"radius holds 430 at \(\); no train has more than 1.5"),
    *(({"speed": SPEED.astype(kind)}, f"speed holds {kind}") for kind in ("str", "complex", "bool")),
    *(({key: np.where(GAP[key], gap, LOG[key])}, f"{key} holds nan at .7") for gap in (np.nan, None, pd.NA) for key in LOG),
    *(({key: np.ma.array(LOG[key], mask=GAP[key])}, f"{key} holds nan at .7") for key in LOG),
])  # fmt: skip
def test_gaps_and_other_units_are_named_or_refused(change, words):
    with pytest.raises((UserWarning, EstimationError), match=words):  # warnings are errors here
        q(**change)
