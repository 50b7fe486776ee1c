"""Line, running resistance and load transfer: gradients and tunnels by position, curves, and what unloads axles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.errors import PlantError
from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import GRAVITY, axle_load, car_rail_force, gradient_force, running_resistance
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import SETS
from alloc.plant.train import Coupler, Train
from tests.cases import looped
from tests.plant.conftest import make_car
from tests.plant.numpy_plant import environment_at

LINE = Line((0.0, 500.0, 900.0), (0.0, 0.02, -0.01), tunnels=((600.0, 700.0),), tunnel_factor=1.8)


def test_gradient_and_tunnel_by_position(train):
    """Cars of 20 m: their middles stand 10, 30 and 50 m behind the train's front."""
    model = build(train("TMT"), Rail(0.2), LINE)
    for front, grades, air in [
        (400.0, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
        (540.0, [0.02, 0.02, 0.0], [1.0, 1.0, 1.0]),
        (640.0, [0.02, 0.02, 0.02], [1.8, 1.8, 1.0]),
        (915.0, [-0.01, 0.02, 0.02], [1.0, 1.0, 1.0]),
        (1500.0, [-0.01, -0.01, -0.01], [1.0, 1.0, 1.0]),
    ]:
        state = model.initial_state(20.0, front + 1.0)
        local = environment_at(model, 0.0, state)
        np.testing.assert_allclose(local.grade, grades, atol=1e-12)
        np.testing.assert_allclose(local.air_factor, air)


def test_train_rolls_back_on_a_slope(run, train):
    """Acceleration g sin(angle) m / (m + J / r^2): without resistance and brakes, wheels roll."""
    t = train("TT", brake=False)
    trace = run(build(t, Rail(0.3), Line((0.0,), (0.03,))), 3.0, 0.0, position=100.0, sample=0.1)
    expected = -GRAVITY * np.sin(np.arctan(0.03)) * t.mass / (t.mass + t.rotating_mass)
    assert trace.rows("speed")[-1, 0] == pytest.approx(3.0 * expected, rel=1e-3)


def test_resistance_opposes_motion_and_is_the_parabola(train):
    speed = np.array([-30.0, -3.0, 3.0, 30.0])
    force = running_resistance(speed, 3e3, 60.0, 8.0, 1.0)
    parabola = np.sign(speed) * (3e3 + 60.0 * np.abs(speed) + 8.0 * speed**2)
    np.testing.assert_allclose(force, parabola, rtol=2e-4)
    assert running_resistance(0.0, 3e3, 60.0, 8.0, 1.0) == 0.0
    assert gradient_force(1e3, 0.0) == 0.0


def test_cars_share_the_resistance_of_the_train(train):
    for couplers in (None, (Coupler(), Coupler())):
        s = build(train("TMT", resistance=(3e3, 60.0, 8.0), couplers=couplers), Rail(0.2)).structure
        np.testing.assert_allclose(s.car_resistance.sum(axis=0), [3e3, 60.0, 8.0])


def test_coasting_slows_down_by_the_resistance(run, train):
    t = train("TMT", resistance=(5e3, 100.0, 10.0))
    trace = run(build(t, Rail(0.3)), 1.0, 30.0, sample=0.1)
    speed = trace.rows("speed")[:, 0]
    force = 5e3 + 100.0 * speed.mean() + 10.0 * speed.mean() ** 2
    assert speed[0] - speed[-1] == pytest.approx(force / (t.mass + t.rotating_mass), rel=1e-3)


def test_tunnel_raises_the_air_part_only(run, train):
    lost = []
    for factor in (1.0, 2.0):
        line = Line(tunnels=((-1e3, 1e4),), tunnel_factor=factor)
        model = build(train("TMT", resistance=(5e3, 0.0, 10.0)), Rail(0.3), line)
        work = run(model, 0.1, 30.0, position=100.0).rows("work")[-1, 2]
        lost.append(work / (30.0 * 0.1))
    assert lost[0] == pytest.approx(5e3 + 9e3, rel=5e-3)
    assert lost[1] == pytest.approx(5e3 + 18e3, rel=5e-3)


def test_curve_holds_back_each_car_where_it_is(train):
    """600/R kgf/t; Roeckl: 650 / (R - 55) from 300 m on, 500 / (R - 30) below. Middles 10, 30 and 50 m behind the front."""
    for law, expected in (
        ("600/R", 600.0 / 250.0),
        ("800/R", 800.0 / 250.0),
        ("roeckl", 500.0 / 220.0),
    ):
        line = Line(curves=((100.0, 145.0, 250.0), (300.0, 400.0, 1e3)), curve_law=law)
        model = build(train("TMT"), Rail(0.2), line)
        for front, inside in (
            (90.0, (0, 0, 0)),
            (135.0, (1, 1, 0)),
            (165.0, (0, 1, 1)),
            (250.0, (0, 0, 0)),
        ):
            local = environment_at(model, 0.0, model.initial_state(20.0, front + 1.0))
            np.testing.assert_allclose(
                local.curving, 1e-3 * expected * np.array(inside), atol=1e-15
            )
    assert Line(curve_law="roeckl").curving(300.0) == pytest.approx(650e-3 / 245.0)


def test_train_loses_its_weights_share_in_a_curve(run, train):
    """Work over a curve: specific resistance x weight x length, whatever the speed; none before it and behind."""
    t = train("TMT", brake=False)
    lost = []
    for radius in (300.0, 600.0):
        line = Line(curves=((100.0, 200.0, radius),))
        trace = run(build(t, Rail(0.3), line), 15.0, 20.0, position=50.0, sample=0.1)
        lost.append(trace.rows("work")[-1, 2])
        assert lost[-1] == pytest.approx(0.6 / radius * t.mass * GRAVITY * 100.0, rel=2e-3)
        speed = trace.rows("speed")[:, 0]
        kinetic = 0.5 * (t.mass + t.rotating_mass) * (speed[0] ** 2 - speed[-1] ** 2)
        assert kinetic == pytest.approx(lost[-1], rel=5e-3)
    assert lost[0] == pytest.approx(2.0 * lost[1], rel=1e-6)


def test_curves_are_checked():
    for curves, law, message in (
        (((0.0, 0.0, 300.0),), "600/R", "end beyond its start"),
        (((0.0, 9.0, 0.0),), "600/R", "radius"),
        (((0.0, 9.0, 30.0),), "roeckl", "radius"),
        (((0.0, 9.0, np.nan),), "600/R", "radius"),
        ((), "700/R", "curve_law"),
    ):
        with pytest.raises(PlantError, match=message):
            Line(curves=curves, curve_law=law)


def test_train_at_rest_on_level_track_stays(run, train):
    model = build(train("TMT", resistance=(5e3, 100.0, 10.0), couplers=(Coupler(),) * 2), Rail(0.2))
    trace = run(model, 1.0, 0.0, position=10.0, sample=0.1)
    np.testing.assert_array_equal(trace.state[-1], trace.state[0])


few = settings(max_examples=60, deadline=None, derandomize=True)


@st.composite
def cars(draw):
    """Cars of one to three bogies with one to three axles each."""
    sizes = draw(st.lists(st.integers(1, 3), min_size=1, max_size=3))
    count = sum(sizes)
    gaps = draw(st.lists(st.floats(1.0, 3.0), min_size=count, max_size=count))
    positions = np.cumsum(gaps)
    driven = tuple(draw(st.lists(st.booleans(), min_size=count, max_size=count)))
    return make_car(
        length=float(positions[-1] + 1.0),
        axle_positions=tuple(float(x) for x in positions),
        bogie_of_axle=tuple(b for b, size in enumerate(sizes) for _ in range(size)),
        wheel_inertia=(100.0,) * count,
        driven=driven,
        centre_of_mass_height=draw(st.floats(0.5, 2.0)),
        pivot_height=draw(st.floats(0.0, 0.4)),
    )


@few
@given(car=cars())
def test_sums_to_zero_over_the_car(car):
    assert abs(car.unloading_factors().sum()) < 1e-12


@few
@given(car=cars())
def test_balances_the_moment_of_the_centre_of_mass(car):
    """Moment of the load changes about any point = rail force times the height of the centre of mass."""
    factors, positions = car.unloading_factors(), np.array(car.axle_positions)
    bogies = np.bincount(car.bogie_of_axle)
    if len(positions) == 1:
        assert factors[0] == 0.0  # one axle cannot carry a moment
    elif bogies.size > 1 or bogies[0] > 1:
        moment = -(factors * positions).sum()
        assert moment == pytest.approx(car.centre_of_mass_height, rel=1e-9)


@few
@given(car=cars())
def test_turning_the_car_round_turns_the_transfer_round(car):
    np.testing.assert_allclose(
        car.reversed().unloading_factors(), -car.unloading_factors()[::-1], atol=1e-12
    )


@looped("name", SETS)
def test_every_set_keeps_its_weight(name):
    train = SETS[name]()
    for car in train.cars:
        assert abs(car.unloading_factors().sum()) < 1e-12
        share = sum(car.axle_load_share or (1.0,))
        assert car.static_axle_loads.sum() == pytest.approx(car.mass * GRAVITY * share)


def test_driving_unloads_the_front_axles():
    factors = make_car().unloading_factors()
    assert factors[0] > 0.0 > factors[-1]
    assert factors[:2].sum() == pytest.approx(-factors[2:].sum())


def test_rail_force_and_loads_are_consistent():
    """F = sum of mu_i (N0_i - k_i F), the algebraic loop that `car_rail_force` solves."""
    rng = np.random.default_rng(0)
    car = make_car()
    load, k = car.static_axle_loads, car.unloading_factors()
    for mu in rng.uniform(-0.4, 0.4, (50, 4)):
        force = car_rail_force((mu * load).sum(), (mu * k).sum())
        assert (mu * axle_load(load, k, force)).sum() == pytest.approx(force, rel=1e-12)


def test_switched_off_it_changes_nothing():
    for on in (False, True):
        model = build(Train("one", (make_car(),), load_transfer=on), Rail(0.2))
        state = model.initial_state(10.0)
        state[model.layout.omega] += 0.2
        _, mu, force = ArrayModel.of(model).forces(state, np.full(4, 0.2))
        uniform = np.ptp(force / mu) < 1e-6
        assert uniform is not on
        assert (force / mu).sum() == pytest.approx(model.train.mass * GRAVITY)
