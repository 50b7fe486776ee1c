#!/usr/bin/env bash
# CasADi 3.8.2, its conic plugin "superscs" (SuperSCS), NumPy 2.4.6
#
# Guess: a QP solver that reports success is at the optimum, to about its tolerance of 1e-6.
# Seen:  with success it answers x = sqrt(2 / w) to: minimise w (x - target)^2 / 2, no constraint, wherever the
#        target is smaller than that. Above, it is right. A target of 0.3 gives 1.414, 1.000, 0.447 for the weights
#        1, 2, 10: always the point where x H x / 2 is 1. So 0.3 kN is wrong, and the same 300 N is right. A tighter
#        eps, normalize = 0 and do_super_scs = 0 change nothing.
# Output: target 0.3, weights 1, 2, 10: success at 1.414, 1.000, 0.447; target 3: 3.000, 3.000, 3.000
#
# Why: a benchmark that counts "success" counts these as solved, and feasibility does not give them away. Check an
# answer by its optimality conditions, not by its status.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check casadi==3.8.2 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'EOF'
import casadi

SHAPE = {"h": casadi.Sparsity.dense(1, 1), "a": casadi.Sparsity(0, 1)}


def answer(plugin: str, weight: float, target: float) -> float:
    """x of least weight (x - target)^2 / 2."""
    options = {"superscs": {"verbose": 0}} if plugin == "superscs" else {}
    solver = casadi.conic("solver", plugin, SHAPE, options)
    x = float(solver(h=weight, g=-weight * target)["x"])
    assert solver.stats()["success"], (plugin, solver.stats())
    return x


WEIGHTS = 1.0, 2.0, 10.0
small, large = ([answer("superscs", weight, target) for weight in WEIGHTS] for target in (0.3, 3.0))
for weight, x in zip(WEIGHTS, small, strict=True):
    assert abs(x - (2.0 / weight) ** 0.5) < 1e-3, (weight, x)
    assert abs(answer("daqp", weight, 0.3) - 0.3) < 1e-9  # another plugin, the same call
assert all(abs(x - 3.0) < 1e-3 for x in large), large

shown = [", ".join(f"{x:.3f}" for x in row) for row in (small, large)]
print(f"target 0.3, weights 1, 2, 10: success at {shown[0]}; target 3: {shown[1]}")
EOF
