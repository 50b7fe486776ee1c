"""A braked train stands on a gradient: held by the rail without creeping, chatter or energy from nowhere."""

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
from alloc.plant.laws import GRAVITY, STICK_SPEED, elastic_energy, sticking_contact, stuck_share
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.train import Coupler, Train
from tests.plant.numpy_plant import environment_at

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


@pytest.mark.parametrize(
    ("masses", "permille"), [((12e3,), 30.0), ((90e3,), -30.0), ((15e3, 80e3, 30e3), 30.0)], ids=str
)
@pytest.mark.parametrize("curve", CURVES.values(), ids=CURVES.keys())
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


@pytest.mark.parametrize("permille", [30.0, -30.0])
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


@pytest.mark.parametrize("curve", [PiecewiseCurve(), SlipRatioCurve()], ids=["piecewise", "ratio"])
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


@pytest.mark.parametrize("name", ["piecewise", "polach-wet", "slip-ratio"])
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
