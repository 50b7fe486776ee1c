"""What runs on board: sensing, slip detection, estimates, readhesion control, telegrams.

It never reads the plant's state."""

from typing import TYPE_CHECKING

from alloc.errors import OnboardError
from alloc.lazy import names_of

if TYPE_CHECKING:
    from alloc.onboard.controllers.cut_and_ramp import CutAndRamp
    from alloc.onboard.controllers.perturb_observe import PerturbObserve
    from alloc.onboard.controllers.pi_creep import CreepControl
    from alloc.onboard.controllers.steepest_gradient import SteepestGradient
    from alloc.onboard.controllers.torque_table import TorqueTable
    from alloc.onboard.parameters import (
        Belief,
        Braking,
        Detector,
        Dropout,
        Observer,
        Onboard,
        Sensors,
        Telegrams,
    )
    from alloc.onboard.reference_speed.parameters import ReferenceSpeed
    from alloc.onboard.slide_protection.parameters import Fuzzy, SlideProtection, Threshold
else:
    __getattr__ = names_of(
        __name__,
        **{
            "controllers.cut_and_ramp": "CutAndRamp",
            "controllers.perturb_observe": "PerturbObserve",
            "controllers.pi_creep": "CreepControl",
            "controllers.steepest_gradient": "SteepestGradient",
            "controllers.torque_table": "TorqueTable",
            "parameters": "Belief Braking Detector Dropout Observer Onboard Sensors Telegrams",
            "reference_speed.parameters": "ReferenceSpeed",
            "slide_protection.parameters": "Fuzzy SlideProtection Threshold",
        },
    )

__all__ = [
    "Belief", "Braking", "CreepControl", "CutAndRamp", "Detector", "Dropout", "Fuzzy", "Observer", "Onboard",
    "OnboardError", "PerturbObserve", "ReferenceSpeed", "Sensors", "SlideProtection", "SteepestGradient",
    "Telegrams", "Threshold", "TorqueTable",
]  # fmt: skip
