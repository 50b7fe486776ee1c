#!/usr/bin/env bash
# CasADi 3.8.2, NumPy 2.4.6
#
# Guess: a NumPy function of a CasADi vector gives the same for numbers (DM) as for symbols (SX, MX).
# Seen:  symbols count as NumPy's vector, numbers as its column of one row each, so what works along the last axis
#        works along an axis of length 1. The integral of 10, 10, 10 by `np.trapezoid` is 10 as an SX and 0, 0, 0 as a
#        DM; `np.diff` is empty; `np.hypot` of three and three numbers has nine. A FutureWarning, once a process, speaks
#        of the result's type; it does not say that values differ. `GlobalOptions.setNumpyMode(1)` mends the integral.
# Output: np.trapezoid of 10, 10, 10 at 0.5: 10.0 by SX and MX, [0. 0. 0.] by DM, 10.0 by DM with setNumpyMode(1)
#
# Why: a cost that is written once, optimised in symbols and evaluated in numbers, reads zero energy in the
# evaluation, and each controller ties.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check casadi==3.8.2 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'EOF'
import warnings

import casadi
import numpy as np

POWER = casadi.DM([10.0, 10.0, 10.0])


def energy(power):
    return np.trapezoid(power, dx=0.5)


def by_symbols(kind) -> float:
    power = kind.sym("power", 3)
    return float(casadi.Function("energy", [power], [energy(power)])(POWER))


with warnings.catch_warnings(record=True) as heard:
    warnings.simplefilter("always")
    symbols = by_symbols(casadi.SX), by_symbols(casadi.MX)
    numbers = energy(POWER)
    steps = np.diff(POWER)
    lengths = np.hypot(POWER, np.ones(3))
assert symbols == (10.0, 10.0), symbols
assert numbers.tolist() == [0.0, 0.0, 0.0], numbers
assert steps.shape == (3, 0), steps
assert lengths.shape == (3, 3), lengths
assert {item.category for item in heard} == {FutureWarning}, heard

casadi.GlobalOptions.setNumpyMode(1)
mended = float(energy(POWER))
assert mended == 10.0, mended
print(
    f"np.trapezoid of 10, 10, 10 at 0.5: {symbols[0]} by SX and MX, {numbers} by DM, "
    f"{mended} by DM with setNumpyMode(1)"
)
EOF
