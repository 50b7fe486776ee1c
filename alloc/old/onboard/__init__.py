"""What runs on board: sensing, slip detection, estimates, readhesion control, telegrams.

It never reads the plant's state."""

from typing import TYPE_CHECKING

from alloc.old.errors import OnboardError
from alloc.old.registry import names_of

if TYPE_CHECKING:
    from alloc.old.onboard.brakes import Fuzzy, SlideProtection, Threshold
    from alloc.old.onboard.controllers.creep import CreepControl
    from alloc.old.onboard.controllers.search import PerturbObserve, SteepestGradient
    from alloc.old.onboard.controllers.simple import CutAndRamp, TorqueTable
    from alloc.old.onboard.parameters import (
        Belief,
        Braking,
        Detector,
        Dropout,
        Observer,
        Onboard,
        ReferenceSpeed,
        Sensors,
        Telegrams,
    )
else:
    __getattr__ = names_of(
        __name__,
        **{
            "brakes": "Fuzzy SlideProtection Threshold",
            "controllers.creep": "CreepControl",
            "controllers.search": "PerturbObserve SteepestGradient",
            "controllers.simple": "CutAndRamp TorqueTable",
            "parameters": "Belief Braking Detector Dropout Observer Onboard ReferenceSpeed Sensors Telegrams",
        },
    )

__all__ = [
    "Belief", "Braking", "CreepControl", "CutAndRamp", "Detector", "Dropout", "Fuzzy", "Observer", "Onboard",
    "OnboardError", "PerturbObserve", "ReferenceSpeed", "Sensors", "SlideProtection", "SteepestGradient",
    "Telegrams", "Threshold", "TorqueTable",
]  # fmt: skip
