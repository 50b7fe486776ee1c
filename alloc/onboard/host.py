"""Interface of readhesion controllers that run as Python objects (the MPC), one per traction unit.

They see what a unit's own computer sees: sensors, its belief, the limit handed down. Never the plant.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.equipment import Equipment
from alloc.onboard.parameters import Onboard
from alloc.plant.adhesion import AdhesionCurve
from alloc.plant.model import Model


@dataclass(frozen=True)
class UnitContext:
    """What a unit's computer knows of its equipment; believed values, SI units."""

    unit: int
    axles: int
    radius: float
    inertia: float
    """Inertia of one wheelset at the wheel [kg m2]."""
    gear_ratio: float
    axle_load: float
    """Load of one of its axles [N], from empty mass and load signal."""
    mass: float
    """Share of the train's mass that the unit moves, rotating parts excluded [kg]."""
    torque_lag: float
    curve: AdhesionCurve
    """Believed adhesion curve."""
    period: float
    """Control period [s]."""


class UnitSense(NamedTuple):
    """What a unit's computer reads at a control instant."""

    time: float
    speed: float
    """Reference speed of the car [m/s]."""
    omega: NDArray[np.float64]
    """Angular speed of the unit's wheelsets [rad/s], (axles,)."""
    torque: float
    """Torque of each motor as the inverter knows it [N m]."""
    target: float
    """Torque wanted of each motor: the driver's command under the limit handed down [N m]."""
    drive_limit: float
    brake_limit: float
    coefficient: float
    """Estimate of the tangential force coefficient by the disturbance observer."""
    slipping: bool
    """Signal of the slip detector."""


class TorqueDecision(NamedTuple):
    """What a controller answers."""

    torque: float
    """Commanded torque of each motor [N m]; ignored where `ok` is False (the unit then cuts and ramps)."""
    ok: bool
    status: str
    solve_time: float
    """Time spent [s]."""
    residual: float = math.nan
    """Optimality residual of the controller's optimisation; nan where it has none."""


class HostController(Protocol):
    """A readhesion controller of one unit."""

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period."""
        ...


class HostControllerFactory(Protocol):
    """Makes the controller of a unit when a run starts."""

    def __call__(self, context: UnitContext) -> HostController:
        """Build the controller."""
        ...


def unit_contexts(model: Model, eq: Equipment, onboard: Onboard) -> list[UnitContext]:
    """What each unit's computer knows of its equipment, foremost unit first."""
    mass = model.train.mass
    weight = (eq.empty_axle_mass + eq.load_per_axle) * eq.axles
    return [
        UnitContext(
            unit=j,
            axles=int(eq.axles[j]),
            radius=float(eq.radius[j]),
            inertia=float(eq.inertia[j]),
            gear_ratio=float(eq.gear[j]),
            axle_load=float(eq.axle_load[j]),
            mass=float(mass * weight[j] / weight.sum()),
            torque_lag=float(model.structure.unit_lag[j]),
            curve=onboard.belief.curve,
            period=onboard.period,
        )
        for j in range(eq.axles.size)
    ]


__all__ = [
    "HostController",
    "HostControllerFactory",
    "TorqueDecision",
    "UnitContext",
    "UnitSense",
    "unit_contexts",
]
