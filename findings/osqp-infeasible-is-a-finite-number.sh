#!/usr/bin/env bash
# OSQP 1.1.3, qpsolvers 4.13.0, NumPy 2.4.6, SciPy 1.17.1
#
# Guess: where a problem has no solution, OSQP fills x with nan, as SCS does, and a test for nan finds it.
# Seen:  x is 2143289344.0 in each place: 0x7fc00000, the bits of a 32-bit nan, taken as an integer and converted. It
#        is finite, so `isfinite`, `nan` tests and a sum pass it on. qpsolvers hands the same x on with found = False.
# Output: primal infeasible, x = [2143289344.0, 2143289344.0], finite: True; qpsolvers: found False, the same x
#
# Why: a control loop that looks for nan in x commands 2e9 after its first infeasible period, and a mean over a
# benchmark's answers is off by as much. Test the status.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check osqp==1.1.3 qpsolvers==4.13.0 numpy==2.4.6 scipy==1.17.1
cd "$folder"
venv/bin/python - <<'EOF'
import warnings

import numpy as np
import osqp
import qpsolvers
from scipy import sparse

eye, ones = sparse.eye(2, format="csc"), np.ones(2)
total = sparse.csc_matrix(np.ones((1, 2)))

# two shares up to 1 that shall add up to 3
solver = osqp.OSQP()
rows, lower, upper = sparse.vstack([eye, total], format="csc"), [0.0, 0.0, 3.0], [1.0, 1.0, 3.0]
solver.setup(eye, -ones, rows, np.array(lower), np.array(upper), verbose=False)
result = solver.solve(raise_error=False)
assert result.info.status == "primal infeasible", result.info.status
nan_bits = float(np.array(np.nan, np.float32).view(np.int32))
assert np.all(result.x == nan_bits), result.x
assert np.isfinite(result.x).all()

warnings.simplefilter("ignore")  # qpsolvers warns of the status
problem = qpsolvers.Problem(eye, -ones, A=total, b=np.array([3.0]), lb=0.0 * ones, ub=ones)
solution = qpsolvers.solve_problem(problem, "osqp")
assert not solution.found
assert np.all(solution.x == nan_bits), solution.x

print(f"{result.info.status}, x = {result.x.tolist()}, finite: True; qpsolvers: found False, the same x")
EOF
