"""From what a unit reads and believes to the problem of the period, compiled."""

from typing import NamedTuple

import numpy as np
from numba import float64, void

from alloc.by_reference import ByReference
from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import PiecewiseCurve
from mpc.arrays import sweep
from mpc.belief import Belief, belief_of
from mpc.curve_filter import predicted_curve
from mpc.demand import tracked_coefficient
from mpc.settings import MpcSettings
from mpc.slip_search import slip_limit
from mpc.sqp_period import Period, empty_period
from mpc.unit_model import air_place, curve_place, parameters, torque_per_coefficient


class UnitProblem(NamedTuple):
    """Belief and solver of a unit, and what is between them."""

    carried: float
    """Greatest torque per believed coefficient, headroom included [N m], at the motor as is `per_coefficient`."""
    per_coefficient: float
    """Torque for a coefficient of 1 [N m]."""
    air: int
    """Place of other brakes' torque among the parameters of the model, see `mpc.unit_model.air_place`."""
    curve: int
    """That of the curve, see `mpc.unit_model.curve_place`."""
    belief: Belief
    solver: Period


def unit_problem(
    context: UnitContext, settings: MpcSettings, belief: Belief, solver: Period
) -> UnitProblem:
    """The unit's problem at the start of a run; `solver`: where the problem is written to."""
    solver.now.parameters[:] = parameters(context, belief.axles.peak)
    per_coefficient = float(torque_per_coefficient(context))
    carried = (1.0 + settings.headroom) * per_coefficient
    return UnitProblem(
        carried,
        per_coefficient,
        air_place(context).start,
        curve_place(context).start,
        belief,
        solver,
    )


def empty_problem() -> UnitProblem:
    """A problem of hardly any size, of whose kind all others are."""
    context = UnitContext(0, 1, 0.4, 100.0, 5.0, 1e5, 4e4, 0.01, PiecewiseCurve(), 0.01)
    return UnitProblem(0.0, 0.0, 0, 0, belief_of(context, MpcSettings()), empty_period())


UNIT_PROBLEM = ByReference(empty_problem()).kind


@sweep(void(UNIT_PROBLEM, float64, float64))
def pose(u, target, limit):
    """Write the problem of this period, except the state; in the direction of the demand. `limit` [N m]: of the motors."""
    now, axles, search = u.solver.now, u.belief.axles, u.belief.search
    least, most_slip = np.inf, slip_limit(search)
    for i in range(axles.peak.size):
        now.parameters[i] = axles.peak[i]
        u.solver.terms.axle.slip_limit[i] = most_slip
        least = min(least, axles.peak[i])
    now.parameters[axles.peak.size] = u.belief.drag.grade[0]
    now.parameters[u.curve], now.parameters[u.curve + 1] = predicted_curve(u.belief.curve, axles)
    air, load = u.belief.air.coefficient[0], 0.0
    for i in range(axles.peak.size):
        load += u.belief.load[i] / axles.peak.size
    now.parameters[u.air] = air * u.belief.constants.radius * load
    most = max(min(min(target, limit), least * u.carried - air * u.per_coefficient), 0.0)
    for k in range(now.upper.size):
        now.upper[k] = most
    terms, w = u.solver.terms, u.solver.terms.weights
    most = tracked_coefficient(
        least - air,
        most_slip,
        terms.unit.scale[0] / u.per_coefficient,
        w.tracking,
        w.slip,
        w.slip_scale,
    )
    terms.unit.target[0] = min(target, most * u.per_coefficient)
