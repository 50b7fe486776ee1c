#!/usr/bin/env bash
# pint 0.25.3, cf-units 3.3.1 (UDUNITS-2), NumPy 2.4.6
#
# Guess: 60 rpm are 1 Hz, kmph is km/h, kph is km/h in any library of units, and what is no unit is refused.
# Seen:  60 rpm are 6.283 Hz in both, because a revolution is 2 pi radians and a radian is 1. pint reads kmph as kilo-mph,
#        a thousand miles per hour, and Nm as 1000 m/kg, the number of a yarn. pint's kph is km/h, but that of UDUNITS is
#        a kilophot, a luminance; its mph is a milliphot. PS is a petasiemens in both, no metric horsepower.
# Output: 60 rpm = 6.283 Hz (pint), 6.283 Hz (UDUNITS); pint: 1 kmph = 447.0 m/s; UDUNITS: 1 kph = 10000000 cd m-2
#
# Why: a wheel's speed taken in Hz and then multiplied by 2 pi is 6.3 times too fast, and the `units` of a netCDF log
# that say kph are a valid unit, of brightness. Spell km/h and rad/s.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -qq --disable-pip-version-check pint==0.25.3 cf-units==3.3.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'EOF'
from math import isclose, pi

import pint
from cf_units import Unit

registry = pint.UnitRegistry()


def pint_value(amount: float, unit: str, wanted: str) -> float:
    return registry.Quantity(amount, unit).to(wanted).magnitude


def udunits_value(amount: float, unit: str, wanted: str) -> float:
    return float(Unit(unit).convert(amount, Unit(wanted)))


turning = pint_value(60.0, "rpm", "Hz"), udunits_value(60.0, "rpm", "Hz")
assert all(isclose(value, 2.0 * pi) for value in turning), turning

kmph = pint_value(1.0, "kmph", "m/s")
assert isclose(kmph, pint_value(1000.0, "mph", "m/s")), kmph
assert isclose(pint_value(1.0, "kph", "km/h"), 1.0)
assert isclose(pint_value(1.0, "Nm", "m/kg"), 1000.0)
assert isclose(pint_value(1.0, "PS", "siemens"), 1e15)

kph = udunits_value(1.0, "kph", "cd m-2")
assert isclose(kph, 1e7), kph
assert not Unit("kph").is_convertible("m s-1")
assert not Unit("mph").is_convertible("m s-1")
assert isclose(udunits_value(1.0, "PS", "S"), 1e15)
print(
    f"60 rpm = {turning[0]:.3f} Hz (pint), {turning[1]:.3f} Hz (UDUNITS); "
    f"pint: 1 kmph = {kmph:.1f} m/s; UDUNITS: 1 kph = {kph:.0f} cd m-2"
)
EOF
