"""Interface of readhesion controllers that run as Python objects (the MPC): of a train, or one per traction unit.

They have the inputs of the units' computers: sensors, their belief, and the limits that they receive. They never read the
plant.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.onboard.attachment import AddedNumbers, Attachment
from alloc.onboard.equipment import Equipment
from alloc.onboard.parameters import Onboard, Telegrams
from alloc.plant.adhesion import AdhesionCurve
from alloc.plant.model import Model

if TYPE_CHECKING:
    from alloc.onboard.compiled_controller import CompiledController


@displayed
@dataclass(frozen=True)
class UnitContext:
    """A unit computer's description of its equipment; believed values, SI units."""

    unit: int
    axles: int
    radius: float
    """Radius of the wheels [m]."""
    inertia: float
    """Inertia of one wheelset at the wheel [kg m2]."""
    gear_ratio: float
    axle_load: float
    """Load of one of its axles [N], from empty mass and load signal."""
    mass: float
    """Share of the train's mass that the unit moves, rotating parts excluded [kg]."""
    torque_lag: float
    """Time constant of the motors' torque [s]."""
    curve: AdhesionCurve
    """Believed adhesion curve."""
    period: float
    """Control period [s]."""
    free_axle: bool = True
    """Whether its reference speed also uses axles that it does not drive itself."""
    car: int = 0
    """Number of the car it is on, 0 = foremost of the train."""
    unloading: tuple[float, ...] = ()
    """Load [N] that each of its axles loses per newton of the car's rail force; empty: loads are constant."""
    telegrams: Telegrams = field(default_factory=Telegrams)
    """Telegrams between the units."""
    blended: bool = False
    """Whether air brakes supply the part of a brake force that its motors lack."""
    settings: Any = None
    """Settings of the controller, as given to the run; None: its own defaults."""


@displayed
class UnitSense(NamedTuple):
    """What a unit's computer reads at a control instant."""

    time: float
    """Time since the start of the run [s]."""
    speed: float
    """Reference speed of the car [m/s]."""
    omega: NDArray[np.float64]
    """Angular speed of the unit's wheelsets [rad/s], (axles,): their rim speed over the unit's radius, for wheels differ."""
    torque: float
    """Torque of each motor as the inverter knows it [N m]."""
    target: float
    """Torque wanted of each motor: the driver's command under the limit received [N m]."""
    drive_limit: float
    """Largest torque of each motor that drives [N m]."""
    brake_limit: float
    """Largest torque of each motor that brakes, a magnitude [N m]."""
    coefficient: float
    """Estimate of the tangential force coefficient by the disturbance observer."""
    slipping: bool
    """Signal of the slip detector."""
    in_service: bool = True
    """Whether its motors work, as known to the whole train."""
    planned: float = 0.0
    """Magnitude of the torque that the driver's command asks of each motor, whatever a rule or the motors allow [N m]."""


@displayed
class TorqueDecision(NamedTuple):
    """A controller's answer."""

    torque: float
    """Commanded torque of each motor [N m]; ignored where `ok` is False (the unit then cuts and ramps)."""
    ok: bool
    status: str
    """"ok", or what failed: such a step is counted, even where part of the answer can be used."""
    solve_time: float
    """Time that the computer on board takes for it [s]; a controller without a model of it returns the measured time."""
    residual: float = math.nan
    """Optimality residual of the controller's optimisation; nan where it has none."""


class HostController(Protocol):
    """A readhesion controller of one unit.

    Where its solver fails it answers with ok = False. An exception is a fault of the program and ends the run.
    """

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period."""


HostControllerFactory = Callable[[UnitContext], HostController]
"""Makes the controller of a unit when a run starts."""


class TrainController(Protocol):
    """The readhesion controllers of all units of a train, which may exchange information."""

    def decide(self, senses: Sequence[UnitSense]) -> Sequence[TorqueDecision]:
        """Torque command of each unit for the coming control period, foremost first, as are `senses`."""


@runtime_checkable
class TellingController(TrainController, Protocol):
    """A train controller whose units exchange more numbers, with the periodic telegrams, than the rules need.

    A telegram is sent before `decide` is called. So it contains the numbers of the control period before, and `decide` can
    read what has arrived by then. The foremost unit that works leads: reports go to it and orders come from it.
    """

    added: AddedNumbers

    def connect(self, reports: Attachment, orders: Attachment) -> None:
        """Get the arrays that every unit writes and reads, once, before a run."""


TrainControllerFactory = Callable[
    [Sequence[UnitContext]], TrainController | tuple["CompiledController", ...]
]
"""Makes the controllers of a train when a run starts, from one context per unit, foremost first; as Python or compiled."""


@displayed
@dataclass(frozen=True)
class HostedController:
    """A readhesion controller that is not built in, as an entry of the collection."""

    name: str
    meaning: str
    """One line."""
    factory: TrainControllerFactory
    colour: str = "#402020"
    """Hexadecimal; the same in every figure."""
    marker: str = "h"
    """In figures, as Matplotlib names it."""
    settings: type[Any] | None = None
    """Frozen dataclass of its settings, all with defaults: the table `[onboard.<name>]` of scenario files."""


class EachUnit:
    """Controllers of single units side by side; a `TrainController`."""

    def __init__(self, controllers: Sequence[HostController]) -> None:
        self.controllers = tuple(controllers)

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Answers of each unit's own controller."""
        return [one.decide(sense) for one, sense in zip(self.controllers, senses, strict=True)]


def each_unit(factory: HostControllerFactory) -> TrainControllerFactory:
    """Factory of a train whose units each have a controller of their own, without information on the others."""
    return lambda contexts: EachUnit([factory(context) for context in contexts])


def unit_contexts(
    model: Model, eq: Equipment, onboard: Onboard, controller: str
) -> list[UnitContext]:
    """Every unit computer's description of its equipment, foremost unit first; with the settings of its `controller`."""
    mass = model.train.mass
    weight = (eq.empty_axle_mass + eq.load_per_axle) * eq.axles
    s = model.structure
    members = [s.axle_unit == j for j in range(eq.axles.size)]
    return [
        UnitContext(
            unit=j,
            axles=int(eq.axles[j]),
            radius=float(eq.radius[j]),
            inertia=float(eq.inertia[j]),
            gear_ratio=float(eq.gear[j]),
            axle_load=float(eq.axle_load[j]),
            mass=float(mass * weight[j] / weight.sum()),
            torque_lag=float(s.unit_lag[j]),
            curve=onboard.belief.curve.on(0.5 * float(eq.axle_load[j]), float(eq.radius[j])),
            period=onboard.period,
            free_axle=bool(np.any((eq.axle_body == eq.unit_body[j]) & ~members[j])),
            car=int(s.axle_car[members[j]][0]),
            unloading=tuple(s.unloading[members[j]].tolist()),
            telegrams=onboard.telegrams,
            blended=eq.blended,
            settings=onboard.hosted.get(controller),
        )
        for j in range(eq.axles.size)
    ]
