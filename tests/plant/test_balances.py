"""Energy and momentum balances of the plant."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.balance import mechanical_energy
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.train import Coupler, Sander
from tests.plant.numpy_plant import environment_at

DRAFT_GEAR = Coupler(stiffness=5e6, stiffening=1e9, damping=1e5, slack=0.01)
RESISTANCE = (3e3, 60.0, 8.0)


@pytest.mark.parametrize("curve", [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)])
def test_energy_closes_over_slip_slide_and_lock(run, train, curve):
    """Motor work = change of kinetic and elastic energy + friction + shoes + resistance + couplers."""
    level = 0.35 if curve is POLACH_WET else 0.2
    rail = Rail(level, patches=(Patch(0.3, begin=0.5, until=9.0, fade=0.1),), curve=curve)
    line = Line((0.0, 30.0), (0.0, 0.02), ((20.0, 60.0),), 2.0, curves=((10.0, 40.0, 300.0),))
    couplers = (DRAFT_GEAR, DRAFT_GEAR)
    whole = train("TMT", resistance=RESISTANCE, couplers=couplers, load_transfer=True)
    if curve is POLACH_WET:  # sand changes the force between wheel and rail, and no balance
        whole = replace(
            whole, cars=(replace(whole.cars[0], sanders=(Sander(2, 0.03),)), *whole.cars[1:])
        )
    model = build(whole, rail, line)

    trace = run(
        model, 4.0, 8.0, step=2e-4, sample=2e-3,
        command=lambda t: 1900.0 if t < 1.5 else 0.0,
        pressure=lambda t: 400e3 if t > 1.5 else 0.0,
        sand_rate=lambda t: 0.03 if t > 1.0 else 0.0,
    )  # fmt: skip
    assert (trace.sand.max() > 0.0) == (curve is POLACH_WET)
    slip = 0.43 * trace.rows("omega") - trace.rows("speed")[:, model.structure.axle_body]
    assert slip.max() > 0.5  # slip
    assert slip.min() < -1.0  # slide
    assert np.abs(trace.rows("omega")[-1]).min() < 1e-6 < trace.rows("speed")[-1].min()  # lock

    energy = np.array([mechanical_energy(model, state) for state in trace.state])
    motors, shoes, resistance, couplers_lost = trace.rows("work").T
    friction = trace.rows("friction_work").sum(axis=1)
    turned_over = max(np.abs(motors).max(), friction.max() + shoes.max())
    residual = energy - energy[0] - (motors - shoes - resistance - couplers_lost - friction)
    assert np.abs(residual).max() < 1e-6 * turned_over
    for lost in (friction, shoes, couplers_lost):
        assert lost[-1] > 0.0
        assert np.diff(lost).min() > -1e-9 * turned_over  # dissipation never gives back


def test_gradient_gives_back_what_it_took(run, train):
    """Rolling over a crest without resistance: the work against the gradient is that of lifting the train."""
    line = Line((0.0, 200.0, 300.0), (0.0, 0.01, 0.0))
    model = build(train("T", brake=False), Rail(0.3), line)
    trace = run(model, 20.0, 25.0, sample=0.1)
    lifted = model.train.mass * GRAVITY * 100.0 * 0.01 / np.sqrt(1.0 + 0.01**2)
    assert trace.rows("work")[-1, 2] == pytest.approx(lifted, rel=1e-3)


@pytest.mark.parametrize("couplers", [None, (DRAFT_GEAR, DRAFT_GEAR)], ids=["rigid", "coupled"])
def test_momentum_follows_the_motors(run, train, couplers):
    """Sum of m v and J omega / r of a train without resistance grows by the motors' impulse only."""
    model = build(train("TMT", couplers=couplers), Rail(0.1))
    trace = run(model, 2.0, 10.0, command=2500.0, step=5e-4, sample=0.01)
    s = model.structure
    carried = trace.rows("speed") @ s.body_mass
    rotating = trace.rows("omega") @ (s.inertia / s.radius)
    lag, t = s.unit_lag[0], trace.time
    per_torque = (s.gear / s.radius).sum()
    impulse = per_torque * 2500.0 * (t - lag * (1.0 - np.exp(-t / lag)))
    momentum = carried + rotating
    np.testing.assert_allclose(momentum - momentum[0], impulse, rtol=1e-5, atol=1e-6 * momentum[0])
    assert (0.43 * trace.rows("omega")[-1].max() - trace.rows("speed")[-1].max()) > 1.0  # slipped


def test_forces_between_cars_are_equal_and_opposite(train):
    """Sum of m a over the bodies = rail forces - resistance, whatever the couplers do."""
    model = build(
        train("TMT", resistance=RESISTANCE, couplers=(DRAFT_GEAR, DRAFT_GEAR)), Rail(0.15)
    )
    n, s, arrays = model.layout, model.structure, ArrayModel.of(model)
    rng = np.random.default_rng(7)
    for _ in range(20):
        state = model.initial_state(20.0)
        state[n.position] += rng.uniform(-0.05, 0.05, n.bodies)
        state[n.speed] += rng.uniform(-0.3, 0.3, n.bodies)
        state[n.omega] += rng.uniform(-2.0, 2.0, n.axles)
        local = environment_at(model, 0.0, state)
        slope = arrays.derivative(state, model.zero_inputs(), local)
        _, _, force = arrays.forces(state, local.peak)
        speed = state[n.speed][s.car_body]
        a, b, c = s.car_resistance.T
        drag = (a + b * speed + c * speed**2) * speed / np.sqrt(speed**2 + 0.05**2)
        total = s.body_mass @ slope[n.speed]
        assert total == pytest.approx(force.sum() - drag.sum(), rel=1e-9, abs=1e-6)
