"""The optimum of an event: its plant is the compiled one, its derivatives are CasADi's, and its torques do what it says."""

from dataclasses import replace

import casadi as cs
import numpy as np
import pytest

from alloc.plant.curves import CURVES, own_curve
from alloc.plant.dynamics import derivative
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.train import Coupler
from alloc.plant.trains import find_train
from alloc.run.event import DriverCommand, Event
from alloc.schema.errors import InputError
from mpc import optimum
from mpc.optimum import TOLERANCE, EventProblem, NoOptimum
from mpc.plant import KNOTS, build_plant
from tests.cases import looped

CARS = find_train("commuter-8car").cars
INDUCTION = replace(
    CARS[1], motors=replace(CARS[1].motors, kind="induction", inverter_group="1C2M")
)
TRAIN = replace(find_train("commuter-8car"), cars=(CARS[0], INDUCTION, CARS[2]), load_transfer=True)
PATCHES = Patch(0.6, start=5.0, end=15.0, edge=4.0), Patch(0.8, begin=2.0, until=3.0, fade=0.5)
RAIL = Rail(0.12, patches=PATCHES, scatter=0.01, increments=tuple(np.linspace(-0.01, 0.02, 12)))
LINE = Line((-500.0, 2.0, 12.0), (0.005, 0.02, -0.01), tunnels=((6.0, 400.0),), tunnel_factor=1.5)
START = DriverCommand((0.0,), (0.83,))


def make_event(duration=0.4, **changes):
    return Event(
        **{"name": "small", "train": TRAIN, "rail": RAIL, "command": START, "duration": duration}
        | changes
    )


@looped("name", CURVES)
def test_the_plant_on_symbols_is_the_compiled_one(name):
    curve = CURVES[name]() if isinstance(CURVES[name], type) else CURVES[name]
    event = make_event(rail=replace(RAIL, curve=curve), line=LINE)
    problem, w, g = EventProblem(event, step=0.1), event.world(), np.random.default_rng(3)
    plant, n, m = build_plant(w, curve), problem.n, problem.m
    states = g.uniform(0.0, 1.0, problem.start.shape) * problem.scale[:, None]
    states[:2] *= np.array([[0.3], [1.5]])
    states[2 : 2 + n] = g.uniform(-0.1, 0.6, states[2 : 2 + n].shape)
    numbers, undriven = problem.find_numbers(states), w.wheelsets[w.wheelsets.unit < 0]
    moved = w.plant.body_mass[0] + (undriven.inertia / undriven.radius**2).sum()
    for k in range(problem.K):
        y, u, t = states[:, 2 * k], g.uniform(0.0, 50.0, m), g.uniform(0.0, 4.0)
        knots = numbers[2:, k].reshape(KNOTS + 1, -1, order="F")[:, : n + 2]
        rates, force, offered = (np.array(part).ravel() for part in plant(y, u, t, knots))
        rims = np.full(w.wheelsets.size, y[1])
        rims[problem.driven] += y[2 : 2 + n]
        state, rate = np.zeros((2, w.state.size))
        state[:2], state[2 : 2 + rims.size] = y[:2], rims / w.wheelsets.radius
        state[2 + rims.size :][:m], w.drives.applied[:] = y[2 + n : -1], u
        tables = w.wheelsets, w.cars, w.drives, w.cylinders, w.patches, w.line
        derivative(t, state, rate, *tables, w.effort, w.retard, w.curve, w.scatter, w.plant[0])
        works = rate[2 + rims.size + m + w.cylinders.size :][: rims.size]
        expected = [
            rate[0], rate[1] * w.plant.body_mass[0] / moved, *(w.wheelsets.radius * rate[2 : 2 + rims.size])[problem.driven],
            *rate[2 + rims.size :][:m], works[problem.driven].sum(),
        ]  # fmt: skip
        # the compiled plant has a shape as a table, and a gradient between points is the sine of the mean
        near = 1e-5 if hasattr(curve, "shape") else 1e-7
        assert np.allclose(offered, w.wheelsets.offered[problem.driven], rtol=1e-12)
        assert np.allclose(force, w.wheelsets.rail_force[problem.driven], rtol=near, atol=1e-6)
        assert np.allclose(rates, expected, rtol=30.0 * near, atol=30.0 * near)


@pytest.fixture(scope="module")
def problem():
    return EventProblem(make_event(6.0), step=0.12)


@pytest.fixture(scope="module")
def best(problem):
    return problem.least_damage(0.98 * problem.start[1, -1])


def test_its_derivatives_are_casadis_own():
    small = EventProblem(make_event(), step=0.1)
    g, solver = np.random.default_rng(4), small.solver
    x, p = (
        g.uniform(0.1, 0.5, solver.size1_in("x0")),
        np.append(small.find_numbers(small.start).ravel("F"), [1.0, 0.3]),
    )
    X, P = cs.MX.sym("x", x.size), cs.MX.sym("p", p.size)
    values, dual = solver.get_function("nlp_g")(X, P), g.standard_normal(solver.size1_in("lam_g0"))
    cost = 0.7 * solver.get_function("nlp_f")(X, P) + cs.dot(dual, values)
    plain = cs.Function("plain", [X, P], [cs.jacobian(values, X), cs.triu(cs.hessian(cost, X)[0])])
    ours = small.constraints(x, p)[1], solver.get_function("nlp_hess_l")(x, p, 0.7, dual)
    for matrix, reference in zip(ours, plain(x, p), strict=True):
        assert np.allclose(matrix.full(), reference.full(), rtol=1e-9, atol=1e-9)


def test_the_compiled_plant_agrees(problem, best):
    run = problem.replay(best)
    assert float(run["speed"][-1]) == pytest.approx(best.speed, rel=1e-3)
    work = run["friction_work"].values[-1, problem.driven].sum()
    assert work == pytest.approx(best.damage, rel=1e-2)
    assert best.residual <= TOLERANCE


def test_finer_intervals_change_little(problem, best):
    finer = EventProblem(problem.event, step=0.06).least_damage(best.speed)
    assert finer.damage == pytest.approx(best.damage, rel=5e-3)


def test_less_speed_takes_less_damage_and_the_two_aims_agree(problem, best):
    slower = problem.least_damage(0.99 * best.speed, best)
    assert slower.damage < 0.99 * best.damage
    assert problem.most_speed(best.damage, best).speed == pytest.approx(best.speed, rel=1e-4)
    # the oracle's run is one way to go
    assert problem.least_damage(problem.start[1, -1]).damage < problem.start[-1, -1]


def test_what_has_not_converged_is_no_optimum(problem, monkeypatch):
    monkeypatch.setitem(optimum.IPOPT, "max_iter", 4)
    hasty = EventProblem(problem.event, step=0.2)
    with pytest.raises(NoOptimum, match="Maximum_Iterations_Exceeded after 4"):
        hasty.least_damage(0.98 * hasty.start[1, -1])
    monkeypatch.setitem(optimum.IPOPT, "max_iter", 40)
    with pytest.raises(NoOptimum):
        EventProblem(problem.event, step=0.2).least_damage(2.0 * hasty.start[1, -1])
    with pytest.raises(InputError, match="speed = nan"):
        problem.least_damage(float("nan"))


MOTORLESS = replace(TRAIN, cars=(CARS[0],))
REFUSED = {
    "couplers": {"train": replace(TRAIN, couplers=(Coupler(),) * 2)},
    "rail that slip cleans": {"rail": replace(RAIL, conditioning=0.1)},
    "adhesion that recovers": {"rail": replace(RAIL, recovered_coefficient=0.2)},
    "motors that fail": {"failures": {0: 0.2}},
    "braking": {"command": DriverCommand((0.0, 0.2), (0.83, -0.5))},
    "no traction": {"train": MOTORLESS, "rail": Rail(0.1)},
    "rolls backwards": {"initial_speed": -1.0},
    "a curve without a formula": {
        "rail": replace(RAIL, curve=own_curve("own", lambda slip: slip * np.exp(-slip)))
    },
}


@looped(("reason", "changes"), REFUSED.items())
def test_an_event_that_the_model_does_not_have_is_refused(reason, changes):
    with pytest.raises(InputError, match=f"'small' has .*{reason}"):
        EventProblem(make_event(**changes))
