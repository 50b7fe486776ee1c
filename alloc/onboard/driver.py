"""Interface of a driver of `alloc.driving.drive`: a person, or a speed control."""

from typing import NamedTuple, Protocol

from alloc.plant.model import Floats


class TrainSense(NamedTuple):
    """What the driver reads."""

    time: float
    """[s]"""
    position: float
    """Of the train's front [m]."""
    speed: float
    """Of the foremost car [m/s]."""
    acceleration: float
    """Change of that speed over the last control period [m/s2]; 0 at the first."""
    torque: Floats
    """Torque of each motor of the units [N m], (units,)."""
    pressure: Floats
    """Brake cylinder pressures [Pa], (groups,)."""
    wheel_speed: Floats
    """Speed of each axle's tread [m/s], (axles,)."""


class Controls(NamedTuple):
    """What the driver sets, in place; it stays as set until changed."""

    torque: Floats
    """Torque wanted of each motor of the units [N m], (units,), negative braking."""
    pressure: Floats
    """Brake cylinder pressures wanted [Pa], (groups,); the plant delays them by each brake's dead time."""
    valve: Floats
    """Per brake group, (groups,): 0 the cylinder follows the pressure wanted, 1 it holds, 2 it releases."""
    sand: Floats
    """Sand that each sander lays on each rail [kg/s], (sanders,)."""


class Driver(Protocol):
    """A person or a speed control that drives the train."""

    def __call__(self, sense: TrainSense, controls: Controls) -> bool:
        """Set `controls` for the coming control period; False ends the run."""
