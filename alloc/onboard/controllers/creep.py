"""Creep control, which holds a slip velocity, and what all controllers compute with.

In: the slip of the unit's worst axle, as sensed. Out: its torque command.
"""

import math
from dataclasses import replace
from typing import Any

from alloc.compilation import jit
from alloc.onboard.columns import NAN, ONE
from alloc.onboard.controllers.controller import register
from alloc.onboard.signatures import control
from alloc.schema.tables import Column, Table

ASSUMED = "assumed"
TUNED = "tuned by the procedure of `studies.tuning`"


@jit
def per_coefficient(unit):
    """Torque of each motor [N m] for a coefficient of 1 at the unit's axles."""
    return unit.load * unit.radius / unit.gear


@jit
def has_lasted(ticks, time, period):
    """Whether `ticks` control periods are at least `time` [s]; ticks are counted, so rounding adds none."""
    return (ticks + 1e-6) * period >= time


@jit
def lag_share(time_constant, period):
    """Share of the difference to its input by which a first-order lag moves in one `period` [s]."""
    return -math.expm1(-period / time_constant)


@jit
def clip(value, low, high):
    """`value` within its bounds."""
    return min(max(value, low), high)


def set_defaults(columns: dict[str, Column], **values: Any) -> dict[str, Column]:
    """The same columns with these values, which are tuned for another controller."""
    changed = {
        key: replace(columns[key], default=value, source=TUNED) for key, value in values.items()
    }
    return columns | changed


GAINS = {
    "proportional": Column(0.35, "s m-1", "coefficient over the error of slip", source=TUNED),
    "integral": Column(4.0, "m-1", "rate of the coefficient over that error", source=TUNED),
    "margin": Column(3.0, ONE, "least slip held over the noise of a speed reading", source=TUNED),
}
HELD = {
    "allowed": Column(NAN, ONE, "integral: coefficient that is allowed; nan: nothing yet"),
    "share": Column(1.0, ONE, "share of the target that was commanded last"),
}

CREEP = Table(
    "pi-creep",
    reference=Column(0.264, "m s-1", "slip of the worst axle that is held", source=TUNED),
    **set_defaults(GAINS, proportional=0.98, integral=10.6, margin=1.55),
    **HELD,
)
CREEP_ROW = CREEP.dtype


@jit
def hold_slip(unit, m, reference, slip, run):
    """PI control of `slip` to `reference` [m/s]; the integral stays within what can be commanded, so it does not wind up.

    The worst of several noisy slips is more than the slip: a reference within the noise would be none.
    """
    scale = per_coefficient(unit)
    ceiling = unit.torque_target / scale
    if math.isnan(m.allowed):
        m.allowed = ceiling
    error = max(reference, m.margin * run.noise) - slip
    m.allowed = clip(m.allowed + m.integral * error * run.period, 0.0, ceiling)
    coefficient = clip(m.allowed + m.proportional * error, 0.0, ceiling)
    # a ceiling times the scale need not be the target to the last bit
    unit.torque_command = min(coefficient * scale, unit.torque_target)
    m.share = unit.torque_command / unit.torque_target if unit.torque_target > 0.0 else 1.0


@control
def pi_creep(unit, axles, memory, run):
    """A fixed slip is held."""
    m = memory.view(CREEP_ROW)[0]
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


register(
    "pi-creep",
    pi_creep,
    "a fixed slip velocity is held by PI control",
    memory=CREEP,
    colour="#aac655",
    marker="^",
)
