#!/usr/bin/env bash
# HiGHS 1.16.0 (highspy), NumPy 2.4.6
#
# Guess: for a convex QP of three unknowns "optimal" means optimal, to 1e-7 or so, in any unit.
# Seen:  HiGHS adds 1e-7 to the diagonal of the Hessian (option qp_regularization_value). Forces in N, each over its
#        limit of 2, 4 and 6 kN and squared, have a Hessian of 2 / limit^2, about 1e-7 as well: the status is Optimal and the
#        smallest force is 1196 N in place of 643 N, the cost 10 % above the least. In kN it is right, and in N with
#        the option at 0.
# Output: Optimal: 1196 3190 4614 N, cost 1.585; with the option at 0: 643 2571 5786 N, cost 1.446
#
# Why: a quadratic cost is commonly made dimensionless by the square of a limit, and forces and torques are in N. A
# comparison of solvers then sees another optimum, with status optimal and feasible to 1e-9.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check highspy==1.16.0 numpy==2.4.6
cd "$folder"
venv/bin/python - >log <<'EOF'
import highspy
import numpy as np

LIMITS, TOTAL = np.array([2.0, 4.0, 6.0]), 9.0  # kN


def shared(newton: float, regularization: float | None = None) -> tuple[str, np.ndarray, float]:
    """Status, forces (3,) in N and cost of the least sum of (force / limit)^2; `newton` in the unit of x."""
    solver = highspy.Highs()
    solver.silent()
    solver.setOptionValue("time_limit", 20.0)
    if regularization is not None:
        solver.setOptionValue("qp_regularization_value", regularization)
    limits, total = LIMITS * 1e3 * newton, TOTAL * 1e3 * newton
    for _ in limits:
        solver.addVar(-highspy.kHighsInf, highspy.kHighsInf)
    solver.addRow(total, total, 3, np.arange(3), np.ones(3))
    triangle = int(highspy.HessianFormat.kTriangular)
    solver.passHessian(3, 3, triangle, np.arange(4), np.arange(3), 2.0 / limits**2)
    solver.run()
    forces = np.array(solver.getSolution().col_value) / newton
    return solver.modelStatusToString(solver.getModelStatus()), forces, float(((forces / LIMITS / 1e3) ** 2).sum())


exact = LIMITS**2 / (LIMITS**2).sum() * TOTAL * 1e3  # by hand: in proportion to the limits' squares
(status, forces, cost), (_, mended, least), kilo = shared(1.0), shared(1.0, 0.0), shared(1e-3)
assert status == kilo[0] == "Optimal", (status, kilo)
assert abs(forces.sum() - 9e3) < 1e-6, forces  # feasible
assert np.allclose(kilo[1], exact, rtol=1e-3), kilo
assert np.allclose(mended, exact), mended
assert forces[0] > 1.5 * exact[0], forces
# what was minimised: the cost with 1e-7 more on the diagonal
regularized = 1.0 / (2.0 / (LIMITS * 1e3) ** 2 + 1e-7)
assert np.allclose(forces, regularized / regularized.sum() * 9e3), forces

first, second = (" ".join(f"{force:.0f}" for force in row) for row in (forces, mended))
print(f"{status}: {first} N, cost {cost:.3f}; with the option at 0: {second} N, cost {least:.3f}")
EOF
tail -n 1 log
