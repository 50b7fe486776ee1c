"""The stiffness that sets the number of substeps is a bound: never below the Jacobian's spectral radius."""

import numpy as np
import pytest

from alloc.plant.adhesion import (
    POLACH_DRY,
    PiecewiseCurve,
    PolachByFrictionCurve,
    RationalCurve,
    SlipRatioCurve,
)
from alloc.plant.array_model import ArrayModel
from alloc.plant.model import STABLE_STEP, build
from alloc.plant.rail import Rail
from alloc.plant.sets import SETS
from alloc.plant.train import DraftGear
from tests.plant.numpy_plant import environment_at

CURVES = [
    PiecewiseCurve(), POLACH_DRY, PolachByFrictionCurve(), SlipRatioCurve(0.03, 0.7), RationalCurve(),
]  # fmt: skip
DIFFERENCE = 1e-7


def _states(model, rng):
    """Rolling at several speeds; stretched couplers with slipping wheels; nearly locked wheels."""
    n = model.layout
    for speed in (0.0, 1.0, 20.0):
        yield model.initial_state(speed)
        state = model.initial_state(speed)
        state[n.position] += rng.uniform(-0.08, 0.08, n.bodies)
        state[n.speed] += rng.uniform(-0.3, 0.3, n.bodies)
        state[n.omega] += rng.uniform(-0.5, 0.5, n.axles)
        state[n.gear_travel] = rng.uniform(-0.1, 0.1, n.draft_gears)
        state[n.pressure] = 2e5
        yield state
        state = state.copy()
        state[n.omega] *= 1e-4
        yield state


def _spectral_radius(model, arrays, state) -> float:
    """Of the numerical Jacobian of positions to what the draft gears have travelled, and deflections."""
    n, inputs = model.layout, model.zero_inputs()
    moving = np.r_[: n.gear_travel.stop, n.deflection]

    def rate(x):
        local = environment_at(model, 0.0, x, arrays=arrays)
        return arrays.derivative(x, inputs, local)[moving]

    there = state + DIFFERENCE * np.eye(state.size)[moving]
    rows = (np.stack([rate(x) for x in there]) - rate(state)) / DIFFERENCE
    return np.abs(np.linalg.eigvals(rows)).max()  # those of the transpose


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: type(curve).__name__)
@pytest.mark.parametrize(
    "name", ["one-axle", "jp4209318-3car", "commuter-8car", "freight-5", "draft gears"]
)
def test_stiffness_bounds_the_jacobian(name, curve):
    train = SETS["freight-5"]().coupled(DraftGear()) if name == "draft gears" else SETS[name]()
    model = build(train, Rail(0.3, curve=curve))
    arrays = ArrayModel.of(model)
    for state in _states(model, np.random.default_rng(4)):
        radius = _spectral_radius(model, arrays, state)
        # bounds of wheels and couplers are taken apart; together they exceed them by parts in 1e5
        assert radius <= model.stiffness() * (1.0 + 1e-3)


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: type(curve).__name__)
def test_substeps_keep_the_step_stable(train, curve):
    model = build(train("TMT"), Rail(0.3, curve=curve))
    for step in (1e-4, 1e-3, 1e-2):
        count = model.substeps(step)
        assert model.stiffness() * step / count <= STABLE_STEP
        assert count == 1 or model.stiffness() * step / (count - 1) > STABLE_STEP
