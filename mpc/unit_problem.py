"""From what a unit reads and believes to the problem of the period, compiled."""

from typing import NamedTuple

import numpy as np
from numba import float64, void

from alloc.by_reference import ByReference
from alloc.compilation import jit
from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.adhesion_laws import PIECEWISE, POLACH, POLACH_BY_FRICTION
from alloc.plant.structure import Floats
from mpc.arrays import sweep
from mpc.belief import Belief, belief_of
from mpc.settings import MpcSettings, PeakBelief
from mpc.sqp_period import Period, empty_period
from mpc.unit_model import parameters, steps_of, stiffness, torque_per_coefficient

STIFFNESS_MARGIN = 0.8
"""How much stiffer than the believed curve, as a share of its stretch, the steps of the prediction are made for."""


class Limits(NamedTuple):
    """Numbers of a unit that do not change from period to period."""

    slip: float
    """Slip limit over the believed peak's slip."""
    carried: float
    """Greatest motor torque per believed coefficient, headroom included [N m]."""
    contacts: float
    """Stiffness of the given curve [1/s], see `mpc.unit_model.stiffness`."""
    motors: float


class UnitProblem(NamedTuple):
    """Belief and solver of a unit, and what is between them."""

    limits: Limits
    belief: Belief
    solver: Period
    steepness: Floats
    """How many times as steep as the given curve the believed one may be with the present number of substeps, (1,)."""


def steepest(settings: MpcSettings) -> float:
    """How many times as steep as the given curve the prediction's steps may have to be made for."""
    return 1.0 / (STIFFNESS_MARGIN * settings.curve.smallest) if settings.curve.estimate else 1.0


def unit_problem(
    context: UnitContext, settings: MpcSettings, belief: Belief, solver: Period
) -> UnitProblem:
    """The unit's problem at the start of a run; `solver`: where the problem is written to."""
    solver.now.parameters[:] = parameters(context, belief.axles.peak)
    carried = (1.0 + settings.headroom) * torque_per_coefficient(context)
    limits = Limits(float(settings.slip_limit), float(carried), *map(float, stiffness(context)))
    return UnitProblem(limits, belief, solver, np.full(1, 1.0 / STIFFNESS_MARGIN))


def empty_problem() -> UnitProblem:
    """A problem of hardly any size, of whose kind all others are."""
    context = UnitContext(0, 1, 0.4, 100.0, 5.0, 1e5, 4e4, 0.01, PiecewiseCurve(), 0.01)
    return UnitProblem(
        Limits(*[0.0] * 4), belief_of(context, PeakBelief()), empty_period(), np.zeros(1)
    )


UNIT_PROBLEM = ByReference(empty_problem()).kind


@jit
def relative_slope(kind, q, given):
    """Slope at the origin of the curve with parameters `q` (6,), over that with the parameters `given`."""
    if kind == PIECEWISE:
        return max(q[0], q[2]) / max(given[0], given[2])
    elif kind in (POLACH, POLACH_BY_FRICTION):
        return q[4] / given[4]
    else:
        return given[0] / q[0]


@jit
def _refine(u):
    """Divide the prediction's steps more finely where the believed curve has become too steep for them.

    The margin of Runge-Kutta's stability over the plant's own bound covers what the given curve's steps do not.
    """
    slope, p = u.belief.slope, u.solver
    now = relative_slope(slope.kind, slope.q, slope.given)
    if now > u.steepness[0]:
        u.steepness[0] = now / STIFFNESS_MARGIN
        needed = steps_of(p.rules.step, u.limits.contacts, u.limits.motors, u.steepness[0])
        p.now.substeps[0] = min(needed, p.rules.most_substeps)


@sweep(void(UNIT_PROBLEM, float64, float64))
def pose(u, target, limit):
    """Write the problem of this period, but for the state; in the direction of the demand. `limit` [N m]: of the motors."""
    now, peak, top = u.solver.now, u.belief.axles.peak, u.belief.axles.peak_slip
    _refine(u)
    least = np.inf
    for i in range(peak.size):
        now.parameters[i] = peak[i]
        u.solver.terms.axle.slip_limit[i] = u.limits.slip * top[i]
        least = min(least, peak[i])
    # they are the last parameters of a unit alone
    q = u.belief.slope.q
    for k in range(q.size):
        now.parameters[now.parameters.size - q.size + k] = q[k]
    most = min(min(target, limit), least * u.limits.carried)
    for k in range(now.upper.size):
        now.upper[k] = most
    u.solver.terms.unit.target[0] = target
