"""Air brake and wheel lock: dead time and lag, shoe friction, a wheel that stays locked until the rail can turn it."""

import numpy as np
import pytest

from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import GRAVITY, shoe_torque
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import AirBrake, Train


def test_pressure_follows_after_the_dead_time(run, car):
    """p = P (1 - exp(-(t - t_d) / T)), exactly zero before t_d."""
    model = build(Train("one", (car(air_brake=AirBrake(400e3, 0.01, 0.4, 0.6, 0.123)),)), Rail(0.3))
    trace = run(model, 2.0, 10.0, pressure=300e3)
    pressure, t = trace.rows("pressure"), trace.time[:, None]
    expected = 300e3 * -np.expm1(-np.maximum(t - 0.123, 0.0) / 0.4)
    assert np.all(pressure[trace.time < 0.1235] == 0.0)
    np.testing.assert_allclose(
        pressure, np.broadcast_to(expected, pressure.shape), rtol=1e-6, atol=1e-3
    )


def test_valves_hold_and_release(run, car):
    model = build(Train("one", (car(air_brake=AirBrake(400e3, 0.01, 0.4, 0.6, 0.05)),)), Rail(0.3))
    trace = run(
        model, 3.0, 10.0, pressure=300e3,
        valve=lambda t: 0.0 if t < 1.0 - 1e-9 else (1.0 if t < 2.0 - 1e-9 else 2.0),
    )  # fmt: skip
    pressure = trace.rows("pressure")[:, 0]
    held = pressure[(trace.time >= 1.0505) & (trace.time <= 2.0495)]
    np.testing.assert_allclose(held, held[0], rtol=1e-13)
    late = trace.time > 2.0505
    expected = held[0] * np.exp(-(trace.time[late] - 2.05) / 0.6)
    np.testing.assert_allclose(pressure[late], expected, rtol=1e-6)


def test_groups_brake_on_their_own(run, car):
    model = build(Train("one", (car(),)), Rail(0.3))
    trace = run(model, 1.0, 10.0, pressure=np.array([200e3, 0.0]))
    assert trace.rows("pressure")[-1, 0] > 1e5
    assert trace.rows("pressure")[-1, 1] == 0.0


def test_deceleration_is_shoe_force_over_mass_and_rotating_mass(run, car):
    """On dry rail, friction (a / (V + b) + c): the source's formula by hand."""
    friction = (37.5, 75.0, 0.5)
    brake = AirBrake(400e3, 0.02, 0.01, 0.01, 0.0, friction)
    train = Train("one", (car(False, air_brake=brake),))
    trace = run(build(train, Rail(0.4)), 5.0, 30.0, pressure=400e3, sample=0.01)
    speed = trace.rows("speed")[:, 0]
    middle = slice(100, 400)
    rate = np.gradient(speed, trace.time)[middle]
    grip = friction[0] / (3.6 * speed[middle] + friction[1]) + friction[2]
    force = 4 * 0.02 * 400e3 * grip
    np.testing.assert_allclose(-rate, force / (train.mass + train.rotating_mass), rtol=2e-3)


def test_shoes_of_a_sliding_wheel_grip_by_its_own_speed(car):
    """Friction (V + 150) / (2 V + 150): 0.8 at 50 km/h of the rim, 12 % more than 0.714 at the train's 100 km/h."""
    brake = AirBrake(400e3, 0.02, friction=(37.5, 75.0, 0.5))
    model = build(Train("one", (car(False, air_brake=brake),)), Rail(0.4))
    n, arrays = model.layout, ArrayModel.of(model)
    state = model.initial_state(100.0 / 3.6)
    state[n.omega] *= (1.0, 0.5, 0.5, 1.0)
    state[n.pressure] = 300e3
    shoe, _ = arrays.wheelsets(state, np.zeros(4))
    rolling, sliding = (
        0.02 * 300e3 * 0.43 * (v + 150.0) / (2.0 * v + 150.0) for v in (100.0, 50.0)
    )
    np.testing.assert_allclose(shoe, [rolling, sliding, sliding, rolling], rtol=1e-12)
    assert sliding / rolling == pytest.approx(1.12)


def test_shoe_torque_never_drives():
    rng = np.random.default_rng(3)
    other, omega, limit = (
        rng.normal(0, 3e3, 5000),
        rng.normal(0, 20, 5000),
        rng.uniform(0, 4e3, 5000),
    )
    shoe = shoe_torque(other, omega, limit, 100.0)
    assert np.all(np.abs(shoe) <= limit)
    turning = np.abs(omega) > 2e-3 * (np.abs(other) + limit) / 100.0
    assert np.all(shoe[turning] == np.sign(omega[turning]) * limit[turning])
    at_rest = shoe_torque(other, 0.0, limit, 100.0)
    held = np.abs(other) <= limit
    np.testing.assert_array_equal(at_rest[held], other[held])


@pytest.fixture
def locked(run, car):
    """A car whose wheels lock on slippery rail; the cylinders are released from 3 s on."""
    brake = AirBrake(400e3, 0.05, 0.2, 0.8, 0.0)
    model = build(Train("one", (car(False, air_brake=brake),)), Rail(0.05))
    trace = run(model, 8.0, 15.0, pressure=lambda t: 400e3 if t < 3.0 - 1e-9 else 0.0,
                valve=lambda t: 0.0 if t < 3.0 - 1e-9 else 2.0)  # fmt: skip
    return model, trace


def test_locked_wheel_stays_locked_until_the_rail_can_turn_it(locked):
    """It turns when shoe force falls to the rail force of the sliding wheel, not earlier and not later."""
    model, trace = locked
    omega, speed = trace.rows("omega"), trace.rows("speed")[:, 0]
    pressure = trace.rows("pressure")[:, 0]
    at_three = round(3.0 / 1e-3)
    assert np.abs(omega[at_three]).max() < 1e-9
    assert speed[at_three] > 5.0
    slip = -speed
    rail_force = -model.rail.curve.coefficient(slip, 0.05) * model.structure.static_load[0]
    can_turn = (0.05 * pressure < rail_force) & (trace.time > 3.0)
    first = int(np.argmax(can_turn))
    assert np.abs(omega[at_three:first]).max() < 1e-9
    # then the excess of the rail force grows as the cylinder empties with 0.8 s: J omega = r F t^2 / (2 0.8 s)
    t = trace.time[first + 50] - trace.time[first]
    expected = 0.43 * rail_force[first] * t**2 / (2.0 * 0.8) / 60.0
    np.testing.assert_allclose(omega[first + 50], expected, rtol=0.1)


def test_released_wheel_returns_to_rolling(locked):
    _, trace = locked
    rim, speed = 0.43 * trace.rows("omega")[-1], trace.rows("speed")[-1, 0]
    np.testing.assert_allclose(rim, speed, rtol=1e-3)


def test_sliding_car_decelerates_with_the_adhesion_coefficient(locked):
    model, trace = locked
    speed = trace.rows("speed")[:, 0]
    window = (trace.time > 2.0) & (trace.time < 3.0)
    slip = -speed[window].mean()
    rate = (speed[window][-1] - speed[window][0]) / (window.sum() - 1) / 1e-3
    expected = GRAVITY * float(model.rail.curve.coefficient(slip, 0.05))
    assert rate == pytest.approx(expected, rel=1e-3)


def test_motor_does_not_turn_a_wheel_that_the_shoes_hold(run, train):
    model = build(train("M"), Rail(0.3))
    state = model.initial_state()
    state[model.layout.pressure] = 400e3
    held = run(model, 2.0, state=state, command=500.0, pressure=400e3, valve=1.0)
    freed = run(model, 2.0, command=500.0)
    # the dead time passes the valve's command on after 0.1 s, so it starts from a filled cylinder that sinks a little
    assert np.abs(held.rows("speed")).max() < 1e-9
    assert freed.rows("speed")[-1, 0] > 0.5
