"""Readhesion controllers that are built in: what a traction unit does with its torque when its wheels slip.

Each is a law in a module of its own, driven by what the unit senses; `alloc.onboard.control` calls the one that a run uses.
"""

from alloc.onboard.readhesion.parameters import (
    CreepControl,
    CutAndRamp,
    PerturbObserve,
    SteepestGradient,
    TorqueTable,
)

NONE, CUT_AND_RAMP, TABLE, PI_CREEP, PERTURB_OBSERVE, STEEPEST_GRADIENT, HOST = range(7)
"""Identifiers in compiled code; HOST: a controller in Python, with cut-and-ramp in reserve."""

CONTROLLERS: dict[str, int] = {
    "none": NONE,
    "table": TABLE,
    "cut-and-ramp": CUT_AND_RAMP,
    "pi-creep": PI_CREEP,
    "perturb-observe": PERTURB_OBSERVE,
    "steepest-gradient": STEEPEST_GRADIENT,
}
"""Built-in controllers by name, from the simplest on."""

MEMORY = 9
"""Numbers that a controller may remember per unit."""

__all__ = [
    "CONTROLLERS",
    "CreepControl",
    "CutAndRamp",
    "PerturbObserve",
    "SteepestGradient",
    "TorqueTable",
]
