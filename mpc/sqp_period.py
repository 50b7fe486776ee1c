"""What a control period of the real-time iteration reads and writes, as one record for compiled code."""

from typing import NamedTuple

import numpy as np

from alloc.by_reference import ByReference
from alloc.plant.structure import Floats, Ints
from mpc.box_qp import BoxWorkspace, box_workspace
from mpc.condensing import Quadratic, quadratic
from mpc.cost import AxleTerms, Cost, CostWeights, UnitTerms
from mpc.shooting import Linearised, Nonzeros, linearised
from mpc.stiffness import Stiffness


class Addresses(NamedTuple):
    """Where the model's compiled functions stand."""

    prepare: int
    slope: int
    rate: int
    tangent: int
    """Of the sensitivities, see `mpc.tangent`."""


class Rules(NamedTuple):
    """Numbers that do not change from period to period."""

    step: float
    """Of the horizon [s]."""
    stiffness: Stiffness
    """Says how many Runge-Kutta steps make a step of the horizon."""
    tolerance: float
    """Residual at which the step that follows is the last."""


class Now(NamedTuple):
    """What is new in every period, see `mpc.horizon.HorizonProblem`; the rest stands in the cost."""

    state: Floats
    parameters: Floats
    upper: Floats
    """(horizon * units,)"""
    constants: Floats
    """What follows from the parameters, see `mpc.folding`."""
    substeps: Ints
    """Runge-Kutta steps of a step of the horizon, (1,): as many as the believed curve needs."""


class Guess(NamedTuple):
    """Torques and what leads to better ones; (horizon * units,), in N m, but for the step of the scaled torques."""

    torques: Floats
    trial: Floats
    scale: Floats
    step: Floats
    """Of the scaled torques, as its two bounds."""
    lower: Floats
    upper: Floats
    nodes: Floats
    """Trajectory of the trial, (horizon + 1, states)."""
    scratch: Floats
    """(3, states)"""


class Period(NamedTuple):
    """All that `mpc.sqp.iterate` reads and writes."""

    model: Addresses
    rules: Rules
    now: Now
    guess: Guess
    nonzeros: Nonzeros
    around: Linearised
    terms: Cost
    quadratic: Quadratic
    box: BoxWorkspace


def period(
    model: Addresses,
    nonzeros: Nonzeros,
    terms: Cost,
    rules: Rules,
    horizon: int,
    sizes: tuple[int, int],
) -> Period:
    """Room for the periods of the problem of cost `terms` over `horizon` steps; `sizes`: numbers of
    the model's parameters and constants."""
    (axles, states), units = terms.slip_matrix.shape, terms.unit.target.size
    n = horizon * units
    guess = Guess(
        torques=np.zeros(n),
        trial=np.zeros(n),
        scale=np.tile(terms.unit.scale, horizon),
        step=np.zeros(n),
        lower=np.zeros(n),
        upper=np.zeros(n),
        nodes=np.zeros((horizon + 1, states)),
        scratch=np.zeros((3, states)),
    )
    return Period(
        model,
        rules,
        Now(
            np.zeros(states),
            np.zeros(sizes[0]),
            np.zeros(n),
            np.zeros(sizes[1]),
            np.ones(1, dtype=np.int64),
        ),
        guess,
        nonzeros,
        linearised(horizon, states, units, nonzeros.row.size),
        terms,
        quadratic(horizon, states, axles, units),
        box_workspace(n),
    )


def empty_period() -> Period:
    """A period of no size, of whose kind all others are."""
    none, empty = np.zeros(0), np.zeros(0, dtype=np.int64)
    terms = Cost(
        np.zeros((0, 0)), AxleTerms(none, none), UnitTerms(*[none] * 5), CostWeights(*[0.0] * 5)
    )
    rules = Rules(0.0, Stiffness(0.0, 0.0, 0, -1, 1), 0.0)
    return period(Addresses(0, 0, 0, 0), Nonzeros(empty, empty), terms, rules, 0, (0, 0))


PERIOD = ByReference(empty_period()).kind
