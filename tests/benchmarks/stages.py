"""The horizon's problem stage by stage, on CasADi's symbols: the form that solvers of optimal control take.

The last torque joins the state, so that its change is the business of one stage; everything is divided by its scale,
so that a tolerance means the same for every unknown. The problem itself is that of `mpc.condensing`.
"""

from typing import NamedTuple

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from alloc.onboard.host import UnitContext
from mpc.model import slip_matrix, substeps, unit_model
from mpc.period import HorizonProblem, cost_of
from mpc.settings import MpcSettings
from tests.benchmarks.unit_step import step_function

Floats = NDArray[np.float64]


def with_numbers(problem: HorizonProblem) -> HorizonProblem:
    """The problem of one unit with plain numbers, as solvers of one torque take it."""
    target, before, upper, reference = (
        float(np.ravel(value)[0])
        for value in (problem.target, problem.before, problem.upper, problem.reference)
    )
    return problem._replace(target=target, before=before, upper=upper, reference=reference)


class Stages(NamedTuple):
    """Functions of one stage. State (axles + 3,): the model's and the last torque; control: torque; all scaled."""

    step: cs.Function
    """(state, control, parameters of the model) -> next state."""
    excess: cs.Function
    """(state, slip limit (axles,)) -> excess of each axle's slip, (axles,); its positive part is penalised."""
    scale: Floats
    """Scales of the state, (axles + 3,)."""
    torque_scale: float
    """[N m]"""

    def start(self, problem: HorizonProblem) -> Floats:
        """Scaled state at the beginning of the horizon, (axles + 3,)."""
        return np.append(problem.state, problem.before) / self.scale

    def rollout(self, problem: HorizonProblem, controls: Floats) -> Floats:
        """Scaled states after each of the scaled `controls` (horizon,): (horizon, axles + 3)."""
        states, state = [], self.start(problem)
        for control in controls:
            state = np.asarray(self.step(state, control, problem.parameters)).ravel()
            states.append(state)
        return np.array(states)


def stages(context: UnitContext, settings: MpcSettings) -> Stages:
    """Stage functions of the unit of `context`."""
    model = unit_model(context)
    torque_scale = float(cost_of(context, settings).unit.scale[0])
    scale = np.array([1.0, *[1.0 / context.radius] * context.axles, torque_scale, torque_scale])
    state, control = cs.SX.sym("state", model.states + 1), cs.SX.sym("control")
    limit = cs.SX.sym("limit", context.axles)
    physical = (cs.DM(scale) * state)[: model.states]
    step = step_function(model, settings.step, substeps(context, settings.step))
    end = step(physical, torque_scale * control, model.parameters)
    ahead = cs.vertcat(end / cs.DM(scale[:-1]), control)
    slip = cs.DM(slip_matrix(context)) @ physical
    return Stages(
        step=cs.Function("stage", [state, control, model.parameters], [ahead]),
        excess=cs.Function(
            "excess", [state, limit], [(slip - limit) / settings.weights.slip_scale]
        ),
        scale=scale,
        torque_scale=torque_scale,
    )
