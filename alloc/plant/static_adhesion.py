"""Adhesion at standstill: an elastic contact that holds a force without slip.

Creepage needs motion, so a curve alone lets a braked train creep downhill. Below `STICK_SPEED` the contact of a braked wheel
is also a spring. Its deflection z [m] follows the slip and carries peak z / d, with the presliding displacement d at which
it yields (Dahl, A solid friction model, 1968). With the slip w, the curve's coefficient f and the share s of `stuck_share`,

    mu = f + c peak z / d,    dz/dt = c (w - |w| z / d) - (1 - s) z / T,    c = s (1 - |f| / peak).

The spring takes in c w times what it carries and loses the rest, so it never gives back more than it took; |z| stays within
d and |mu| within the peak. At rest c = 1 and z is constant. Above `STICK_SPEED` c = 0 and the curve acts alone. It also acts
alone under a wheel without brake, which rolls on to rail that is not strained.
"""

from alloc.compilation import equation
from alloc.plant.operations import absolute, maximum, minimum

STICK_SPEED = 0.2
"""Speed [m/s] of train or rim above which no contact sticks."""

RELEASE_TIME = 0.05
"""Time constant T [s] with which a moving contact loses its deflection."""


HOLDING_BRAKE = 0.005
"""Brake force over axle load, at constant shoe friction, above which a wheel counts as fully braked."""


@equation
def stuck_share(speed, rim_speed, brake):
    """Share of a contact that sticks: 1 at rest, 0 above `STICK_SPEED`; `brake` is the brake force over `HOLDING_BRAKE`."""
    pace = maximum(absolute(speed), absolute(rim_speed)) * (1.0 / STICK_SPEED)
    rest = maximum(0.0, 1.0 - pace * pace)
    return rest * rest * minimum(brake, 1.0)


@equation
def sticking_contact(coefficient, peak, slip, deflection, presliding, share):
    """Coefficient with the spring's part beside the curve's `coefficient`, and rate of the deflection [m/s]."""
    strain = deflection / presliding
    coupling = share * maximum(0.0, 1.0 - absolute(coefficient) / peak)
    release = (1.0 - share) * deflection * (1.0 / RELEASE_TIME)
    rate = coupling * (slip - absolute(slip) * strain) - release
    return coefficient + coupling * peak * strain, rate


@equation
def elastic_energy(deflection, presliding, peak, axle_load):
    """Energy [J] that a contact stores and `friction_work` contains."""
    return 0.5 * axle_load * peak * deflection * deflection / presliding
