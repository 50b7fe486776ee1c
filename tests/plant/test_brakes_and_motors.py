"""Motors, air brakes, wheels that lock, and a braked train that stands on a gradient."""

import numpy as np
import pytest

from alloc.balance import mechanical_energy
from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    PiecewiseCurve,
    PolachByFrictionCurve,
    PolachCurve,
    SlipRatioCurve,
)
from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import (
    GRAVITY,
    STICK_SPEED,
    elastic_energy,
    shoe_torque,
    sticking_contact,
    stuck_share,
)
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail, Receptivity
from alloc.plant.train import AirBrake, Coupler, Motors, TorqueLimit, Train
from tests.cases import looped
from tests.plant.numpy_plant import environment_at

LAG = 5e-3


def test_torque_lags_the_command(run, train):
    trace = run(build(train("M"), Rail(0.3)), 0.05, 10.0, command=1000.0)
    expected = 1000.0 * -np.expm1(-trace.time / LAG)
    np.testing.assert_allclose(trace.rows("torque")[:, 0], expected, rtol=1e-4)


@looped("command", [9e3, -9e3])
def test_torque_is_bounded(run, train, command):
    trace = run(build(train("M"), Rail(0.5)), 0.2, 20.0, command=command)
    assert trace.rows("torque")[-1, 0] == pytest.approx(np.sign(command) * 4000.0, rel=1e-9)


def test_limit_by_speed():
    """Peak torque, then constant power, then falling with the square of the speed; fading at low speed."""
    limit = TorqueLimit(1000.0, 150e3, pull_out_speed=30.0, fade_speed=5.0)
    table = limit.tabulate(0.43, 7.0)
    speed = np.arange(table.size) / 3.6
    np.testing.assert_allclose(table[:18], 1000.0 * speed[:18] / 5.0)
    power = (speed > 12.0) & (speed < 30.0)
    np.testing.assert_allclose(table[power] * 7.0 * speed[power] / 0.43, 150e3)
    beyond = speed > 30.0
    np.testing.assert_allclose(table[beyond] * speed[beyond] ** 2, 150e3 * 0.43 / 7.0 * 30.0)
    assert table.max() <= 1000.0


def test_table_is_interpolated_at_the_mean_rim_speed_of_the_unit(car):
    given = tuple(1000.0 + 10.0 * k for k in range(100))
    motors = Motors("1C4M", 7.0, TorqueLimit(1.0, 0.0, table=given), TorqueLimit(1.0, 0.0))
    model = build(Train("one", (car(motors=motors),)), Rail(0.3))
    state = model.initial_state(0.0)
    state[model.layout.omega] = np.array([10.0, 11.0, 12.0, 14.0]) / 0.43
    local = environment_at(model, 0.0, state)
    assert local.drive_limit[0] == pytest.approx(1000.0 + 10.0 * 3.6 * 11.75)
    state[model.layout.omega] = 300.0
    assert environment_at(model, 0.0, state).drive_limit[0] == pytest.approx(given[-1])


def test_electric_brake_follows_the_receptivity(run, train):
    """First-order response to mean + amplitude sin(w t + phase): amplitude and phase of the closed form."""
    mean, amplitude, period, phase = 0.6, 0.2, 0.5, 0.7
    model = build(train("M"), Rail(0.5), receptivity=Receptivity(mean, amplitude, period, phase))
    trace = run(model, 1.0, 20.0, command=-9e3)
    w, t = 2.0 * np.pi / period, trace.time
    wave = np.sin(w * t + phase - np.arctan(w * LAG)) / np.hypot(1.0, w * LAG)
    late = t > 0.1
    expected = -4000.0 * (mean + amplitude * wave)
    np.testing.assert_allclose(trace.rows("torque")[late, 0], expected[late], rtol=1e-5)


def test_receptivity_does_not_touch_driving_and_stays_in_bounds(run, train):
    model = build(train("M"), Rail(0.5), receptivity=Receptivity(0.5, 3.0, 1.0))
    driving = run(model, 0.6, 20.0, command=2000.0).rows("torque")
    assert driving[-1, 0] == pytest.approx(2000.0)
    braking = run(model, 1.0, 20.0, command=-9e3).rows("torque")
    assert braking.min() >= -4000.0
    assert braking.max() <= 0.0
    assert braking.min() < -3999.0


def test_failed_unit_loses_its_torque_at_that_time(run, train):
    model = build(train("MM"), Rail(0.5), failures={1: 0.3})
    torque = run(model, 0.6, 10.0, command=1000.0).rows("torque")
    time = np.arange(torque.shape[0]) * 1e-3
    after = time > 0.3005
    np.testing.assert_allclose(torque[time < 0.2995, 0], torque[time < 0.2995, 1])
    np.testing.assert_allclose(torque[after, 0], 1000.0, rtol=1e-9)
    # the step that straddles the failure is the only inexact one
    decayed = 1000.0 * np.exp(-(time[after] - 0.3) / LAG)
    np.testing.assert_allclose(torque[after, 1], decayed, rtol=0.1, atol=1e-9)


@looped(("group", "units"), [("1C4M", 2), ("1C2M", 4), ("1C1M", 8)])
def test_inverter_groups(train, group, units):
    model = build(train("TMM", group), Rail(0.3))
    assert model.layout.units == units
    unit = model.structure.axle_unit
    assert list(unit[:4]) == [-1] * 4
    assert sorted(set(unit[4:])) == list(range(units))
    assert np.all(np.diff(unit[4:]) >= 0)


def test_power_of_the_motors_is_what_the_work_adds_up(run, train):
    trace = run(build(train("M"), Rail(0.5)), 1.0, 10.0, command=1000.0)
    power = 7.0 * trace.rows("torque")[:, 0] * trace.rows("omega").sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * 1e-3])
    np.testing.assert_allclose(trace.rows("work")[:, 0], work, rtol=1e-4, atol=20.0)


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
    brake = AirBrake(400e3, 0.02, 1.2, 1.2, friction=(37.5, 75.0, 0.5))
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


CURVES = {
    "piecewise": PiecewiseCurve(),
    "polach-dry": POLACH_DRY,
    "polach-wet": POLACH_WET,
    "polach-186": PolachCurve(creep_stiffness=186.0),
    "polach-by-friction": PolachByFrictionCurve(),
    "slip-ratio": SlipRatioCurve(),
    "slip-ratio-broad": SlipRatioCurve(0.3, 0.6),
}


DRAFT_GEAR = Coupler(stiffness=2e7, damping=2e5, slack=0.02)


PRESSURE = 400e3


def _train(car, masses, coupled=False) -> Train:
    cars = tuple(car(False, mass=mass) for mass in masses)
    couplers = (DRAFT_GEAR,) * (len(cars) - 1) if coupled else None
    return Train("standing", cars, (100.0, 30.0, 4.0), couplers)


def _slope(permille) -> Line:
    return Line((0.0,), (permille * 1e-3,))


def _braked(model, speed=0.0) -> np.ndarray:
    state = model.initial_state(speed)
    state[model.layout.pressure] = PRESSURE
    return state


@looped(("masses", "permille"), [((12e3,), 30.0), ((90e3,), -30.0), ((15e3, 80e3, 30e3), 30.0)])
@looped("curve", CURVES.values())
def test_a_braked_train_stands_for_a_minute(run, car, curve, masses, permille):
    """Less than a millimetre from rest, of which all but a thousandth in the first seconds; every wheel stands."""
    model = build(_train(car, masses), Rail(0.08, curve=curve), _slope(permille))
    step = 1e-3 / model.substeps(1e-3)
    trace = run(model, 60.0, state=_braked(model), pressure=PRESSURE, step=step, sample=0.5)
    position = trace.rows("position")[:, 0]
    assert 1e-6 < np.abs(position).max() < 1e-3
    assert np.abs(position[10:] - position[10]).max() < 1e-6
    assert np.abs(trace.rows("speed")[-1]).max() < 1e-9
    assert np.abs(trace.rows("omega")[-1]).max() < 1e-9


@looped("permille", [30.0, -30.0])
def test_a_coupled_train_stands_after_its_slack_has_run_out(run, car, permille):
    model = build(_train(car, (15e3, 80e3, 30e3), coupled=True), Rail(0.1), _slope(permille))
    trace = run(model, 60.0, state=_braked(model), pressure=PRESSURE, sample=0.5)
    assert np.abs(trace.rows("position")).max() < 1e-3
    assert np.ptp(trace.rows("position")[20:], axis=0).max() < 1e-6


def test_braked_wheels_hold_those_that_roll(run, car):
    """One car of three has brakes: its locked wheels bear the gradient, the others nothing."""
    cars = (car(False, brake=False), car(False), car(False, brake=False))
    model = build(Train("partly", cars), Rail(0.2), _slope(30.0))
    trace = run(model, 60.0, state=_braked(model), pressure=PRESSURE, sample=0.5)
    assert np.abs(trace.rows("position")).max() < 1e-3
    last = trace.state[-1]
    force = ArrayModel.of(model).forces(last, environment_at(model, 60.0, last).peak)[2]
    weight = model.train.mass * GRAVITY * 0.03 / np.sqrt(1.0 + 0.03**2)
    np.testing.assert_allclose(force, [0.0] * 4 + [weight / 4.0] * 4 + [0.0] * 4, atol=1.0)


@looped("curve", [PiecewiseCurve(), SlipRatioCurve()])
def test_a_train_slides_where_the_rail_does_not_hold_it(run, car, curve):
    """30 per mille on a rail of 0.02, with locked wheels: it accelerates by the difference, and never stands."""
    level = 0.02
    model = build(_train(car, (30e3,)), Rail(level, curve=curve), _slope(30.0))
    trace = run(model, 10.0, state=_braked(model), pressure=PRESSURE, sample=0.1)
    speed = trace.rows("speed")[:, 0]
    assert np.all(np.diff(speed) < 0.0)
    residual = curve.residual_ratio * level
    assert GRAVITY * 9.0 * (0.029 - level) < -speed[-1] < GRAVITY * 10.0 * (0.03 - residual)
    assert np.abs(trace.rows("omega")[-1]).max() < 1e-9


def _arrival(run, model, step):
    """Braked from walking pace to rest uphill; samples every 10 ms."""
    return run(model, 6.0, state=_braked(model, 1.5), pressure=PRESSURE, step=step, sample=0.01)


@looped("name", ["piecewise", "polach-wet", "slip-ratio"])
def test_where_it_stands_does_not_depend_on_the_step(run, car, name):
    model = build(_train(car, (30e3,)), Rail(0.15, curve=CURVES[name]), _slope(30.0))
    first = 2e-3 / model.substeps(2e-3)
    ends = [_arrival(run, model, first / k).rows("position")[-1, 0] for k in (1, 2, 4)]
    assert abs(ends[0] - ends[2]) < 1e-5
    assert abs(ends[1] - ends[2]) < 0.3 * abs(ends[0] - ends[2]) + 1e-8


def test_coming_to_rest_keeps_the_energy_and_does_not_chatter(run, car):
    """Balance to 1e-6; what is dissipated, that is the friction's work less what the contacts store, only grows."""
    model = build(_train(car, (15e3, 60e3), coupled=True), Rail(0.15), _slope(30.0))
    trace = _arrival(run, model, 2.5e-4)
    energy = np.array([mechanical_energy(model, state) for state in trace.state])
    motors, shoes, drag, couplers = trace.rows("work").T
    friction = trace.rows("friction_work").sum(axis=1)
    residual = energy - energy[0] - (motors - shoes - drag - couplers - friction)
    assert np.abs(residual).max() < 1e-6 * energy[0]
    load = model.structure.static_load
    stored = elastic_energy(trace.rows("deflection"), model.rail.presliding, 0.15, load).sum(axis=1)
    assert 0.1 < stored[-1] < 10.0
    assert np.diff(friction - stored).min() > -1e-6 * energy[0]
    speed = trace.rows("speed")
    assert np.abs(speed[-200:]).max() < 1e-6
    turns = np.diff(np.sign(np.where(np.abs(speed) > 1e-5, speed, 0.0)), axis=0)
    assert np.count_nonzero(turns) < 40


def test_pulling_away(run, train):
    """From a stand on a gradient: the train gets what the motors give, and no contact stays strained."""
    model = build(train("MT"), Rail(0.2), _slope(20.0))
    command, release = 700.0, 2.0
    trace = run(
        model, 12.0, state=_braked(model), sample=0.05,
        command=lambda t: command if t > release else 0.0,
        pressure=lambda t: PRESSURE if t < release else 0.0,
    )  # fmt: skip
    s = model.structure
    pull = (s.gear / s.radius).sum() * command - GRAVITY * model.train.mass * 0.02
    expected = pull / (model.train.mass + model.train.rotating_mass)
    late = trace.time > 6.0
    speed = trace.rows("speed")[late, 0]
    slope = np.polyfit(trace.time[late], speed, 1)[0]
    assert slope == pytest.approx(expected, rel=1e-3)
    assert np.abs(trace.rows("deflection")[-1]).max() < 1e-20


def test_no_contact_sticks_above_the_speed():
    speed, rim = (
        np.array([0.0, STICK_SPEED, 3.0, -STICK_SPEED]),
        np.array([STICK_SPEED, 0.0, 3.0, 0.1]),
    )
    np.testing.assert_array_equal(stuck_share(speed, rim, 1.0), 0.0)
    assert (stuck_share(0.0, 0.0, 0.0), stuck_share(0.0, 0.0, 20.0)) == (0.0, 1.0)
    mu, _ = sticking_contact(np.array(0.1), 0.2, 0.3, 1e-4, 1.5e-4, 0.0)
    assert mu == 0.1


def test_a_contact_bears_no_more_than_the_peak_and_never_gives_back_more_than_it_took():
    """Over random states: |mu| <= peak, and force times slip less the stored power is a loss."""
    rng = np.random.default_rng(5)
    peak, presliding = rng.uniform(0.02, 0.6, 4000), 1.5e-4
    curve = peak * rng.uniform(-1.0, 1.0, 4000)
    slip = np.sign(curve) * 10.0 ** rng.uniform(-6, 1, 4000)
    z, share = presliding * rng.uniform(-1.0, 1.0, 4000), rng.random(4000)
    mu, rate = sticking_contact(curve, peak, slip, z, presliding, share)
    assert np.all(np.abs(mu) <= peak * (1.0 + 1e-12))
    assert np.all(mu * slip - peak / presliding * z * rate >= -1e-15)


def test_a_train_that_starts_without_its_brakes_does_as_the_curve_says(run, train):
    """Nothing sticks: the presliding displacement changes not a bit."""
    ends = [
        run(build(train("MT"), Rail(0.1, presliding=d)), 3.0, command=900.0).state[-1]
        for d in (1.5e-4, 3e-3)
    ]
    np.testing.assert_array_equal(*ends)


def test_a_released_brake_lets_go(run, car):
    """Within a second of the brakes' release the train rolls as the gradient pulls it."""
    model = build(_train(car, (30e3,)), Rail(0.2), _slope(30.0))
    trace = run(
        model, 10.0, state=_braked(model), sample=0.01,
        pressure=lambda t: PRESSURE if t < 2.0 else 0.0, valve=lambda t: 0.0 if t < 2.0 else 2.0,
    )  # fmt: skip
    speed = -trace.rows("speed")[:, 0]
    assert speed[200] < 1e-9
    late = trace.time > 6.0
    slope = np.polyfit(trace.time[late], speed[late], 1)[0]
    mass = model.train.mass + model.train.rotating_mass
    assert slope == pytest.approx((0.03 * GRAVITY * model.train.mass - 150.0) / mass, rel=0.03)
