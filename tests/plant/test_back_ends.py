"""NumPy, Numba and CasADi evaluate the same equations: 1e-12 relative on random states."""

from dataclasses import replace
from itertools import product

import casadi
import numpy as np
import pytest

from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    PiecewiseCurve,
    PolachByFrictionCurve,
    RationalCurve,
    SlipRatioCurve,
)
from alloc.plant.array_model import ArrayModel, Local
from alloc.plant.model import Inputs, Model, build
from alloc.plant.rail import SPEED_LAWS, Line, Patch, Rail, Receptivity, logarithmic_increments
from alloc.plant.sets import SETS
from alloc.plant.train import Sander
from tests.plant.compiled_rate import compiled_rate
from tests.plant.numpy_plant import environment_at

TIME = 1.7
Rails = dict[str, np.ndarray | None]
"""What lies on the rail under each axle."""
CURVES = {
    "piecewise": PiecewiseCurve(),
    "polach-dry": POLACH_DRY,
    "polach-wet": POLACH_WET,
    "polach-by-friction": PolachByFrictionCurve(),
    "slip-ratio": SlipRatioCurve(0.04, 0.7),
    "rational": RationalCurve(0.05, 1.7),
}
LINE = Line(
    (0.0, 300.0, 420.0), (0.0, 0.02, -0.01), tunnels=((200.0, 380.0),), tunnel_factor=1.6,
    curves=((150.0, 310.0, 250.0), (330.0, 400.0, 600.0)), curve_law="roeckl",
)  # fmt: skip


def _model(name: str, curve: str, law: str) -> Model:
    train = SETS[name]()
    if curve != "piecewise":  # a train without sanders takes another way
        car = replace(train.cars[0], sanders=(Sander(0, 0.03),))
        train = replace(train, cars=(car, *train.cars[1:]))
    rail = Rail(
        1.0 if law == "shinkansen" else 0.6,
        law,
        patches=(
            Patch(0.6, 250.0, 350.0, 20.0, 1.0, 3.0, 0.5),
            Patch(1.2, 300.0),
            Patch(0.5, 900.0),
        ),
        increments=tuple(logarithmic_increments(train.axle_count)),
        scatter=0.012,
        seed=2,
        conditioning=0.3,
        curve=CURVES[curve],
    )
    failures = {} if train.cars[-1].motors is None else {0: 1.5}
    return build(train, rail, LINE, Receptivity(0.8, 0.3, 2.0, 0.4), failures)


def _random(model: Model, seed: int) -> tuple[np.ndarray, Inputs, Rails]:
    """States from standstill to speed, with slip, slide, locked and sticking wheels; any command, cleaning and sand."""
    rng = np.random.default_rng(seed)
    n, s = model.layout, model.structure
    state = np.zeros(n.rows)
    state[n.position] = rng.uniform(200, 450) + rng.uniform(-0.05, 0.05, n.bodies)
    state[n.speed] = rng.choice([0.0, 2.0, 30.0]) + rng.uniform(-0.5, 1.0, n.bodies)
    state[n.speed] *= rng.choice([1.0, 0.1])  # near rest contacts stick
    rolling = state[n.speed][s.axle_body] / s.radius
    slip = rng.normal(0.0, 1.0, rolling.shape) * 10.0 ** rng.uniform(-3, 1, rolling.shape)
    state[n.omega] = (rolling + slip) * (rng.random(rolling.shape) > 0.1)
    state[n.torque] = rng.uniform(-2000.0, 2000.0, n.units)
    state[n.pressure] = rng.uniform(0.0, 4e5, n.groups)
    state[n.gear_travel] = rng.uniform(-0.02, 0.02, n.draft_gears)
    state[n.deflection] = rng.uniform(-1.0, 1.0, n.axles) * model.rail.presliding
    inputs = Inputs(
        rng.uniform(-4000.0, 4000.0, n.units),
        rng.uniform(0.0, 4e5, n.groups),
        rng.integers(0, 3, n.groups).astype(float),
        np.zeros(n.sanders),
    )
    sand = 0.02 * rng.random(n.axles) if n.sanders else None
    return state, inputs, {"cleaning": rng.random(n.axles), "sand": sand}


def _assert_agree(actual: np.ndarray, expected: np.ndarray, n, case: str = "") -> None:
    # a rate is a difference of larger terms: the scale is the largest of its kind
    first = 0
    for size in (
        n.bodies, n.bodies, n.axles, n.units, n.groups, n.draft_gears, n.axles, 1, 1, 1, 1, n.axles,
    ):  # fmt: skip
        part = slice(first, first + size)
        scale = np.abs(expected[part]).max(initial=0.0)
        np.testing.assert_allclose(
            actual[part], expected[part], rtol=1e-12, atol=1e-12 * scale, err_msg=case
        )
        first += size


@pytest.mark.parametrize("name", SETS)
def test_numpy_and_numba_agree(name):
    for curve, law in product(CURVES, SPEED_LAWS):
        model = _model(name, curve, law)
        arrays = ArrayModel.of(model)
        for seed in range(9):
            state, inputs, left = _random(model, seed)
            local = environment_at(model, TIME, state, arrays=arrays, **left)
            slope, peak = compiled_rate(model, state, inputs, TIME, **left)
            case = f"{curve}, {law}, {seed}"
            np.testing.assert_allclose(peak, local.peak, rtol=1e-12, err_msg=case)
            _assert_agree(slope, arrays.derivative(state, inputs, local), model.layout, case)


def _casadi_function(model: Model) -> casadi.Function:
    """Derivative as an SX function of state, inputs and environment."""
    n = model.layout
    state = casadi.SX.sym("state", n.rows)
    sizes = (
        n.units,
        n.groups,
        n.groups,
        n.sanders,
        n.axles,
        n.cars,
        n.cars,
        *(n.units,) * 3,
        n.cars,
    )
    arguments = [casadi.SX.sym(f"a{k}", size) for k, size in enumerate(sizes)]
    slope = ArrayModel.of(model).derivative(state, Inputs(*arguments[:4]), Local(*arguments[4:]))
    return casadi.Function("derivative", [state, *arguments], [slope])


@pytest.mark.parametrize("name", SETS)
def test_numpy_and_casadi_agree(name):
    for curve in CURVES:
        model = _model(name, curve, "none")
        arrays, function = ArrayModel.of(model), _casadi_function(model)
        for seed in range(9):
            state, inputs, left = _random(model, seed)
            local = environment_at(model, TIME, state, arrays=arrays, **left)
            symbolic = np.asarray(function(state, *inputs, *local)).ravel()
            expected = arrays.derivative(state, inputs, local)
            _assert_agree(symbolic, expected, model.layout, f"{curve}, {seed}")


def test_casadi_numbers_are_accepted_as_they_are():
    model = _model("commuter-8car", "polach-wet", "none")
    arrays = ArrayModel.of(model)
    state, inputs, left = _random(model, 5)
    local = environment_at(model, TIME, state, arrays=arrays, **left)
    given, *rest = [casadi.DM(values) for values in (state, *inputs, *local)]
    numeric = arrays.derivative(given, Inputs(*rest[:4]), Local(*rest[4:]))
    expected = arrays.derivative(state, inputs, local)
    _assert_agree(np.asarray(numeric).ravel(), expected, model.layout)
