"""The allocation problem as CasADi, qpsolvers and cvxpy take it, for each of their QP solvers.

    minimise  1/2 sum m (x - plan)^2    subject to  sum m x = ask,  lower <= x <= upper

It is handed over as it stands, not scaled.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from studies import StudyError
from studies.runner.study import Row

PLAN = 0.17
"""Coefficient of the plan."""
SOLVERS = pd.read_csv(Path(__file__).with_name("solvers.csv"), index_col=0, keep_default_na=False)
"""By solver, the names of its tolerances and its distribution."""
Program = tuple[Any, float, Any, Any]
"""Masses (n,), the ask, lower and upper bounds (n,)."""
Adapter = Callable[[str, Program, Row], Iterator[tuple[Any, str]]]
"""Of a solver, a program and options; yields when it has built, and again x, or None, with the verdict."""


def by_casadi(solver: str, program: Program, options: Row) -> Iterator[tuple[Any, str]]:
    """A plugin of `conic`, which raises where it fails, or ipopt by `nlpsol`, which does not."""
    import casadi

    mass, ask, lower, upper = program
    h, a, x = casadi.diag(casadi.DM(mass)), casadi.DM(mass).T, casadi.SX.sym("x", mass.size)
    values: Row = {"lbg": ask, "ubg": ask}
    nested = options if solver in ("ipqp", "qpoases", "qrqp") else {solver: options}
    if solver == "ipopt":
        problem = {"x": x, "f": a @ (x - PLAN) ** 2 / 2.0, "g": a @ x}
        function = casadi.nlpsol("f", solver, problem, nested)
    else:
        function = casadi.conic("f", solver, {"h": h.sparsity(), "a": a.sparsity()}, nested)
        values = {"h": h, "g": -PLAN * mass, "a": a, "lba": ask, "uba": ask}
    yield None, "built"
    result = None
    with suppress(RuntimeError):
        result = function(lbx=lower, ubx=upper, **values)["x"].full()
    stats = function.stats()
    status = f"{stats['unified_return_status']} {stats.get('return_status', '')}"
    yield result, "solved" if stats["success"] else status


def by_qpsolvers(solver: str, program: Program, options: Row) -> Iterator[tuple[Any, str]]:
    """`solve_problem`, which has one word for all that fails, and converts while it solves."""
    import qpsolvers
    from scipy import sparse

    mass, ask, *bounds = program
    matrices = sparse.diags(mass, format="csc"), sparse.csc_matrix(mass[None])
    P, A = matrices if solver in qpsolvers.sparse_solvers else (x.toarray() for x in matrices)
    problem = qpsolvers.Problem(P, -PLAN * mass, None, None, A, np.array([ask]), *bounds)
    yield None, "built"
    solution = qpsolvers.solve_problem(problem, solver, **options)
    yield solution.x, "solved" if solution.found else "not found"


def by_cvxpy(solver: str, program: Program, options: Row) -> Iterator[tuple[Any, str]]:
    """A problem that has been canonised when it is built."""
    import cvxpy as cp

    mass, ask, lower, upper = program
    x = cp.Variable(mass.size)
    cost, bounds = mass @ (x - PLAN) ** 2 / 2.0, [mass @ x == ask, lower <= x, x <= upper]
    problem = cp.Problem(cp.Minimize(cost), bounds)
    problem.get_problem_data(solver, solver_opts=options)
    yield None, "built"
    problem.solve(solver=solver, **options)
    yield x.value, "solved" if problem.status == "optimal" else problem.status


ADAPTERS: dict[str, Adapter] = {"casadi": by_casadi, "qpsolvers": by_qpsolvers, "cvxpy": by_cvxpy}


def find_solvers() -> list[tuple[str, str]]:
    """Libraries, each with those of `SOLVERS` that it says it has; raises `StudyError` where one is missing."""
    try:
        import casadi
        import cvxpy
        import qpsolvers
    except ImportError as error:
        raise StudyError(f"{error.name} is not installed: pip install -e '.[solvers]'") from None
    plugins = [name for name in SOLVERS.index if name == "ipopt" or casadi.has_conic(name)]
    installed = plugins, qpsolvers.available_solvers, cvxpy.installed_solvers()
    return [
        (library, name)
        for library, names in zip(ADAPTERS, installed, strict=True)
        for name in names
        if name.lower() in SOLVERS.index
    ]
