"""What runs on board: sensing, slip detection, estimates, readhesion control, telegrams.

It never reads the plant's state."""

from alloc.onboard.errors import OnboardError
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
from alloc.onboard.readhesion import (
    CreepControl,
    CutAndRamp,
    PerturbObserve,
    SteepestGradient,
    TorqueTable,
)

__all__ = [
    "Belief",
    "Braking",
    "CreepControl",
    "CutAndRamp",
    "Detector",
    "Dropout",
    "Observer",
    "Onboard",
    "OnboardError",
    "PerturbObserve",
    "Sensors",
    "SteepestGradient",
    "Telegrams",
    "TorqueTable",
]
