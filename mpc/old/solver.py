"""One control period of the real-time iteration as one compiled call, without allocation: sequential quadratic programming.

In: a `Period` (measured state, parameters, targets, limits, guess). Out: torques over the horizon, cost, iterations, status.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, types, void

from alloc.old.plant.model import Floats, Ints
from alloc.old.records import ByReference
from mpc.old.arrays import VECTOR, prepare_at, rate_at, slope_at, sweep, tangent_at
from mpc.old.box_qp import BoxWorkspace, box_workspace, solve_box_qp
from mpc.old.condensing import (
    AxleTerms,
    Cost,
    CostWeights,
    Linearised,
    Nonzeros,
    Quadratic,
    Stiffness,
    UnitTerms,
    condense,
    cost_up_to,
    linearise,
    linearised,
    needed_substeps,
    quadratic,
    simulate,
    trajectory_cost,
)

# What a control period of the real-time iteration reads and writes, as one record for compiled code.


class Addresses(NamedTuple):
    """Where the model's compiled functions stand."""

    prepare: int
    slope: int
    rate: int
    tangent: int
    """Of the sensitivities, see `mpc.old.generated`."""


class Rules(NamedTuple):
    """Numbers that do not change from period to period."""

    step: float
    """Of the horizon [s]."""
    stiffness: Stiffness
    """Says how many Runge-Kutta steps make a step of the horizon."""
    tolerance: float
    """Residual at which the step that follows is the last."""


class Now(NamedTuple):
    """What is new in every period, see `mpc.old.period.HorizonProblem`; the rest stands in the cost."""

    state: Floats
    parameters: Floats
    upper: Floats
    """(horizon * units,)"""
    constants: Floats
    """What follows from the parameters, see `mpc.old.model`."""
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
    """All that `mpc.old.solver.iterate` reads and writes."""

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
    rules = Rules(0.0, Stiffness(0.0, 0.0, 0, -1, 1, 1.0), 0.0)
    return period(Addresses(0, 0, 0, 0), Nonzeros(empty, empty), terms, rules, 0, (0, 0))


PERIOD = ByReference(empty_period()).kind


# Sequential quadratic programming: linearise the trajectory, condense its cost to a quadratic model in the torques, and
# solve that within the bounds. Then take the step, halved as long as the cost would rise.


HALVINGS = 12
"""Largest number of halvings of a step that would raise the cost; the last is taken only if it does not."""

GOING, ENDED, NOT_FINITE, NO_SOLUTION = range(4)
"""How a call of `iterate` ends: the steps were used up; no further gain is possible; failures."""


@sweep(void(PERIOD))
def prepare(p):
    """Set new parameters: the model's constants, and the number of substeps."""
    now, rules = p.now, p.rules
    prepare_at(p.model.prepare)(now.parameters, now.constants)
    now.substeps[0] = needed_substeps(rules.stiffness, rules.step, now.parameters)


@sweep(void(VECTOR, PERIOD))
def linearise_at(torques, p):
    """Fill the trajectory of `torques` from the measured state, and its derivatives."""
    for i in range(p.now.state.size):
        p.around.nodes[0, i] = p.now.state[i]
    substeps = p.now.substeps[0]
    linearise(
        rate_at(p.model.rate), tangent_at(p.model.tangent), torques, p.now.constants, p.rules.step / substeps,
        substeps, p.around,
    )  # fmt: skip


@sweep(float64(PERIOD))
def optimality(p):
    """Largest change of a scaled torque by a projected gradient step; nan where the gradient is not finite."""
    residual = 0.0
    for i in range(p.guess.torques.size):
        gradient, scale = p.quadratic.gradient[i], p.guess.scale[i]
        if not abs(gradient) < np.inf:
            return np.nan
        now, most = p.guess.torques[i] / scale, p.now.upper[i] / scale
        residual = max(residual, abs(min(max(now - gradient, 0.0), most) - now))
    return residual


@sweep(boolean(PERIOD))
def step(p):
    """Solve the quadratic model within the bounds, and leave its end in the trial torques; False if that fails."""
    guess, size = p.guess, p.guess.torques.size
    for i in range(size):
        guess.lower[i] = -guess.torques[i] / guess.scale[i]
        guess.upper[i] = (p.now.upper[i] - guess.torques[i]) / guess.scale[i]
        guess.step[i] = 0.0
    hessian, gradient = p.quadratic.hessian, p.quadratic.gradient
    if solve_box_qp(hessian, gradient, guess.lower, guess.upper, guess.step, p.box) < 0:
        return False
    for i in range(size):
        end = guess.torques[i] + guess.step[i] * guess.scale[i]
        guess.trial[i] = min(max(end, 0.0), p.now.upper[i])
    return True


@sweep(types.Tuple((float64, float64, int64))(PERIOD))
def quadratic_model(p):
    """Condense the cost around the trajectory; returns cost, residual, and `ENDED`, or what went wrong."""
    guess = p.guess
    condense(p.around, guess.torques, p.terms, p.quadratic)
    cost, residual = trajectory_cost(p.around.nodes, guess.torques, p.terms), optimality(p)
    finite = abs(cost) < np.inf and residual < np.inf
    return cost, residual, ENDED if finite else NOT_FINITE


@sweep(boolean(float64, int64, PERIOD))
def search(cost, trials, p):
    """Take the trial torques, halving the step while the cost rises above `cost`; False if no step lowers it."""
    guess, units, substeps = p.guess, p.terms.unit.scale.size, p.now.substeps[0]
    for _ in range(trials):
        for i in range(p.now.state.size):
            guess.nodes[0, i] = p.now.state[i]
        reached, k = 0.0, 0
        while k + 1 < guess.nodes.shape[0] and reached <= cost:  # costs only add up
            torque = guess.trial[k * units : (k + 1) * units]
            simulate(
                slope_at(p.model.slope), torque, p.now.constants, p.rules.step / substeps, substeps,
                guess.nodes[k : k + 2], guess.scratch,
            )  # fmt: skip
            reached = cost_up_to(k, reached, guess.nodes, guess.trial, p.terms)
            k += 1
        lower = reached <= cost
        for i in range(guess.trial.size):
            if lower:
                guess.torques[i] = guess.trial[i]
            else:
                guess.trial[i] = 0.5 * (guess.trial[i] + guess.torques[i])
        if lower:
            return True
    return False


@sweep(void(PERIOD))
def shift(p):
    """Shift the guess by one step of the horizon; the last torques are repeated."""
    torques, units = p.guess.torques, p.terms.unit.scale.size
    for i in range(torques.size - units):
        torques[i] = torques[i + units]


@sweep(void(PERIOD))
def hold(p):
    """Discard the guess: hold the torques of the period before over the horizon."""
    torques, before = p.guess.torques, p.terms.unit.before
    for i in range(torques.size):
        torques[i] = before[i % before.size]


@sweep(void(float64, PERIOD))
def ahead(time, p):
    """Move the state forward by `time` [s] under the torques of the period before."""
    state, nodes, before = p.now.state, p.guess.nodes, p.terms.unit.before
    prepare(p)
    substeps = int(np.ceil(p.now.substeps[0] * time / p.rules.step * (1.0 - 1e-9)))
    for i in range(state.size):
        nodes[0, i] = state[i]
    simulate(
        slope_at(p.model.slope), before, p.now.constants, time / substeps, substeps, nodes[0:2], p.guess.scratch,
    )  # fmt: skip
    for i in range(state.size):
        state[i] = nodes[1, i]


@sweep(types.Tuple((float64, float64, int64, int64))(int64, PERIOD))
def iterate(most, p):
    """Take at most `most` steps; returns cost, residual, steps done, and how it ended.

    Cost and residual are those before the last step. The first step is always taken, since it responds to the measurement.
    Further steps are taken while the residual before the last step exceeds the tolerance.
    """
    guess = p.guess
    prepare(p)
    cost, residual, done, known = np.nan, np.inf, 0, False
    for i in range(guess.torques.size):
        guess.torques[i] = min(max(guess.torques[i], 0.0), p.now.upper[i])
    while done < most:
        if not known:
            linearise_at(guess.torques, p)
        cost, residual, end = quadratic_model(p)
        if end > ENDED:
            return cost, residual, done, end
        near = residual <= p.rules.tolerance
        if near and done > 0:
            return cost, residual, done, ENDED
        done += 1
        if not step(p):
            return cost, residual, done, NO_SOLUTION
        trials, known = HALVINGS + 1, False
        if not near and done == 1 and most > 1:
            # nearly every first step is taken whole, and the second begins with its derivatives; later ones seldom are
            linearise_at(guess.trial, p)
            known = trajectory_cost(p.around.nodes, guess.trial, p.terms) <= cost
            for i in range(guess.trial.size):
                if known:
                    guess.torques[i] = guess.trial[i]
                else:
                    guess.trial[i] = 0.5 * (guess.trial[i] + guess.torques[i])
            trials -= 1
        if (not known and not search(cost, trials, p)) or near:
            return cost, residual, done, ENDED
    return cost, residual, done, GOING
