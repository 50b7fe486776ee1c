"""Axle load transfer: sums to zero over the car, balances the pitching moment, and turns with the force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import GRAVITY, axle_load, car_rail_force
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import SETS
from alloc.plant.train import Train
from tests.plant.conftest import make_car

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


@pytest.mark.parametrize("name", SETS)
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
