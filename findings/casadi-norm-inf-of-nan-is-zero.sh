#!/usr/bin/env bash
# CasADi 3.8.2, NumPy 2.4.6
#
# Guess: the greatest magnitude of a vector that holds a nan is nan, as in NumPy and as in CasADi's other norms.
# Seen:  `norm_inf` passes over every nan, in SX, MX and DM: of (nan, 2) it is 2, and of (nan, nan) it is 0. `norm_1`,
#        `norm_2` and `norm_fro` are nan. `mmax` of (nan, 2) is 2 too; of (nan, nan) it is nan by SX, and -inf by MX and
#        DM, so the same formula changes its value with the kind of symbol.
# Output: (nan, nan): norm_inf 0.0, norm_1 nan, mmax nan by SX and -inf by MX; NumPy: nan
#
# Why: a solver that failed returns nan; the residual of its optimality conditions by `norm_inf` is then 0, and the
# failure counts as the best solution of all.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check casadi==3.8.2 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'EOF'
import math

import casadi
import numpy as np

NAN = math.nan


def by_each(name, numbers):
    """What a function makes of a vector as SX, as MX, and as numbers."""
    measure = getattr(casadi, name)
    found = []
    for kind in (casadi.SX, casadi.MX):
        x = kind.sym("x", 2)
        found.append(float(casadi.Function("f", [x], [measure(x)])(numbers)))
    return [*found, float(measure(casadi.DM(numbers)))]


assert by_each("norm_inf", [3.0, -4.0]) == [4.0] * 3
for vector, greatest in (([NAN, 2.0], 2.0), ([2.0, NAN], 2.0), ([NAN, NAN], 0.0)):
    assert by_each("norm_inf", vector) == [greatest] * 3, vector
    assert np.isnan([by_each(name, vector) for name in ("norm_1", "norm_2", "norm_fro")]).all()
    assert np.isnan(np.linalg.norm(vector, np.inf))
assert by_each("mmax", [NAN, 2.0]) == [2.0] * 3
symbols, *others = by_each("mmax", [NAN, NAN])
assert math.isnan(symbols), symbols
assert others == [-math.inf] * 2, others
zero, sum_of = by_each("norm_inf", [NAN, NAN])[0], by_each("norm_1", [NAN, NAN])[0]
print(
    f"(nan, nan): norm_inf {zero}, norm_1 {sum_of}, mmax {symbols} by SX and {others[0]} by MX; "
    f"NumPy: {np.linalg.norm([NAN, NAN], np.inf)}"
)
EOF
