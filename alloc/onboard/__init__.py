"""What runs on board: sensing, slip detection, estimates, readhesion control, telegrams.

It never reads the plant's state."""

from alloc.onboard.parameters import (
    Belief,
    Braking,
    CutAndRamp,
    Detector,
    Observer,
    Onboard,
    OnboardError,
    Sensors,
    Telegrams,
)

__all__ = [
    "Belief",
    "Braking",
    "CutAndRamp",
    "Detector",
    "Observer",
    "Onboard",
    "OnboardError",
    "Sensors",
    "Telegrams",
]
