"""Speed control with compensation of running resistance by position, and with learning of it (JP H07-322414)."""

from alloc.onboard.speed_control.command import SpeedCommand
from alloc.onboard.speed_control.controller import MODES, Learning, SpeedControl
from alloc.onboard.speed_control.feedback import Feedback
from alloc.onboard.speed_control.line_memory import LineMemory
from alloc.onboard.speed_control.resistance import (
    EXTENDED_WEIGHTS,
    WEIGHTS,
    Motion,
    compensation_force,
    feedforward_force,
    regressor,
)
from alloc.onboard.speed_control.sampling import Regression, RegressionFilter
from alloc.onboard.speed_control.switch import LearnThenUse
from alloc.onboard.speed_control.traction import Traction

__all__ = [
    "EXTENDED_WEIGHTS",
    "MODES",
    "WEIGHTS",
    "Feedback",
    "LearnThenUse",
    "Learning",
    "LineMemory",
    "Motion",
    "Regression",
    "RegressionFilter",
    "SpeedCommand",
    "SpeedControl",
    "Traction",
    "compensation_force",
    "feedforward_force",
    "regressor",
]
