"""Parts of a control period's compiled call, one at a time."""

from alloc.records import ByReference
from mpc.condensing import condense, simulate, trajectory_cost
from mpc.solver import linearise_at


def model_at_guess(solver, problem):
    """The solver's quadratic model of `problem` around its guess."""
    solver.take(problem)
    made = solver.period
    linearise_at(solver.torques, ByReference(made))
    parts = (ByReference(part) for part in (made.around, made.terms, made.quadratic))
    around, terms, quadratic = parts
    condense(around, solver.torques, terms, quadratic)
    return made.quadratic


def cost_of_torques(solver, problem, torques):
    """Cost of `problem`, the last that the solver took, under `torques` [N m], (horizon * units,)."""
    made = solver.period
    made.guess.nodes[0] = problem.state
    simulate(
        solver._model.slope, torques, made.now.constants, made.rules.step / made.now.substeps[0],
        int(made.now.substeps[0]), made.guess.nodes, made.guess.scratch,
    )  # fmt: skip
    return trajectory_cost(made.guess.nodes, torques, ByReference(made.terms))
