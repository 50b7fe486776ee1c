"""A prediction step of the unit's model as CasADi takes it: what solvers and tests are compared with."""

import casadi as cs

from mpc.model import UnitModel


def right_side(model: UnitModel) -> cs.Function:
    """CasADi function (state, torque, parameters) -> derivative of the state."""
    return cs.Function("right_side", [model.state, model.torque, model.parameters], [model.rate])


def step_function(model: UnitModel, step: float, substeps: int) -> cs.Function:
    """CasADi function (state, torque, parameters) -> state after `step` [s], classical Runge-Kutta."""
    x, u, p = model.state, model.torque, model.parameters
    f, h = right_side(model), step / substeps
    for _ in range(substeps):
        k1 = f(x, u, p)
        k2 = f(x + 0.5 * h * k1, u, p)
        k3 = f(x + 0.5 * h * k2, u, p)
        k4 = f(x + h * k3, u, p)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return cs.Function("step", [model.state, u, p], [x])
