#!/usr/bin/env bash
# Clarabel 0.11.1, cvxpy 1.9.3, OSQP 1.1.3, NumPy 2.4.6, SciPy 1.17.1
#
# Guess: the unit of x changes digits, not the verdict; a strictly convex problem with a feasible point is solved.
# Seen:  three powers up to 40 % of a total share the total, least squares of their deviation. In MW Clarabel solves it, in
#        W (a total of 10 MW is 1e7) cvxpy with Clarabel says "infeasible". Clarabel called directly says
#        DualInfeasible at 1e8, "the cost has no lower bound", of a sum of squares. OSQP, by the same call in W, is right.
# Output: total 10 MW: optimal in MW, infeasible in W; OSQP in W: optimal, 2.33 3.67 4.00 MW; directly at 1e8: DualInfeasible
#
# Why: Clarabel is what cvxpy picks for cones, and interior-point methods are the reference of many comparisons. A
# train's power in W is of that size. "infeasible" from it is no proof: solve it in units in which x is about 1.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check \
    clarabel==0.11.1 cvxpy==1.9.3 osqp==1.1.3 numpy==2.4.6 scipy==1.17.1
cd "$folder"
venv/bin/python - <<'EOF'
import clarabel
import cvxpy as cp
import numpy as np
from scipy import sparse

WEIGHTS = np.array([1.0, 2.0, 3.0])


def shared(total: float, solver: str) -> tuple[str, np.ndarray | None]:
    """Status, and powers (3,) of the least weighted deviation from half of the total, each up to 0.4 of it."""
    x = cp.Variable(3)
    cost = cp.sum(cp.multiply(WEIGHTS, cp.square(x - 0.5 * total)))
    problem = cp.Problem(cp.Minimize(cost), [cp.sum(x) == total, x >= 0.0, x <= 0.4 * total])
    problem.solve(solver=solver)
    return problem.status, x.value


def directly(total: float) -> str:
    """The same problem, without cvxpy."""
    rows = sparse.csc_matrix(np.vstack([np.ones((1, 3)), -np.eye(3), np.eye(3)]))
    right = np.concatenate([[total], np.zeros(3), np.full(3, 0.4 * total)])
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(6)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cost = sparse.diags(2.0 * WEIGHTS, format="csc"), -WEIGHTS * total
    return str(clarabel.DefaultSolver(*cost, rows, right, cones, settings).solve().status)


megawatts, watts = shared(10.0, "CLARABEL")[0], shared(1e7, "CLARABEL")[0]
other, powers = shared(1e7, "OSQP")
assert (megawatts, watts, other) == ("optimal", "infeasible", "optimal"), (megawatts, watts, other)
assert np.allclose(powers, np.array([7.0, 11.0, 12.0]) / 30.0 * 1e7), powers
statuses = directly(1e6), directly(1e8)
assert statuses == ("Solved", "DualInfeasible"), statuses
shares = " ".join(f"{power / 1e6:.2f}" for power in powers)
print(
    f"total 10 MW: {megawatts} in MW, {watts} in W; OSQP in W: {other}, {shares} MW; "
    f"directly at 1e8: {statuses[1]}"
)
EOF
