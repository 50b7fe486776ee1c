#!/usr/bin/env bash
# CasADi 3.8.2, its conic plugins "osqp", "superscs", "qrqp", "qpoases", "proxqp", "piqp", "ipqp"; NumPy 2.4.6
#
# Guess: a plugin without integers refuses the option `discrete`, or warns.
# Seen:  qrqp, qpoases, proxqp, piqp and ipqp refuse it. osqp takes it and solves without integers: (0.4, 1.1), success,
#        and not a word. The best integers are (0, 1), which cost more. superscs takes it too and returns no integers
#        either.
# Output: osqp: success at (0.4, 1.1) for two integers, best (0, 1); refused by qrqp, qpoases, proxqp, piqp, ipqp
#
# Why: notches, valves and sanders are on or off. A comparison of mixed-integer MPC over CasADi's plugins finds OSQP
# both fastest and cheaper than the optimum.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check casadi==3.8.2 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'EOF'
import itertools

import casadi
import numpy as np

WISH, MOST = np.array([0.6, 1.3]), 1.5
SHAPE = {"h": casadi.Sparsity.diag(2), "a": casadi.Sparsity.dense(1, 2)}
QUIET = {"osqp": {"osqp": {"verbose": False}}, "superscs": {"superscs": {"verbose": 0}}}


def answer(plugin: str) -> np.ndarray:
    """Two integers from 0 to 5, their sum 1.5 at most, of the least (x - wish)^2 / 2."""
    solver = casadi.conic("solver", plugin, SHAPE, {"discrete": [True, True]} | QUIET.get(plugin, {}))
    row = {"a": np.ones((1, 2)), "lba": -10.0, "uba": MOST}
    x = solver(h=casadi.DM.eye(2), g=-WISH, lbx=0.0, ubx=5.0, **row)["x"]
    assert solver.stats()["success"], solver.stats()
    return np.array(x).ravel()


def cost(x) -> float:
    return float(((np.asarray(x) - WISH) ** 2).sum() / 2.0)


best = min((x for x in itertools.product(range(6), repeat=2) if sum(x) <= MOST), key=cost)
assert best == (0, 1), best
x = answer("osqp")
assert np.allclose(x, [0.4, 1.1], atol=1e-4), x
assert cost(x) < cost(best)
other = answer("superscs")
assert np.abs(other - np.round(other)).max() > 0.05, other

refused = []
for plugin in ("qrqp", "qpoases", "proxqp", "piqp", "ipqp"):
    try:
        answer(plugin)
    except RuntimeError as error:
        assert "integer_support" in str(error), error
        refused.append(plugin)
assert len(refused) == 5, refused
print(f"osqp: success at ({x[0]:.1f}, {x[1]:.1f}) for two integers, best {best}; refused by {', '.join(refused)}")
EOF
