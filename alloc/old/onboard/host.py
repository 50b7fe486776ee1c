"""Interface of readhesion controllers: of a train or a unit in Python, or compiled per unit; and all of them by name.

In: a `UnitSense` per control period. Out: a `Decision` with a torque command, or the word that there is none; the unit then
cuts and ramps. `CONTROLLERS` has the built-in ones, those of installed packages, and those registered at run time.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numba import float64, int64, types, void
from numba.np.numpy_support import from_dtype
from numpy.typing import NDArray

from alloc.old.compilation import jit
from alloc.old.display import displayed
from alloc.old.errors import OnboardError
from alloc.old.onboard.controllers.base import BuiltInController, share_of_target
from alloc.old.onboard.controllers.collection import BUILT_IN, RESERVE
from alloc.old.onboard.equipment import Equipment
from alloc.old.onboard.parameters import Onboard, Telegrams
from alloc.old.onboard.telegrams import AddedNumbers, Attachment
from alloc.old.plant.adhesion import AdhesionCurve
from alloc.old.plant.model import Floats, Ints, Model
from alloc.old.records import named_record, stored_at
from alloc.old.registry import Registry

# Interface of readhesion controllers that run as Python objects (the MPC): of a train, or one per traction unit.
#
# They have the inputs of the units' computers: sensors, their belief, and the limits that they receive. They never read
# the plant.


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
    twisting: bool = False
    """Whether the drives between its motors and its wheels twist."""
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
    reserve: str = RESERVE
    """Built-in controller that commands a unit for which it has no torque."""


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
            twisting=bool(s.axle_shaft[:, members[j]].any()),
            settings=onboard.hosted.get(controller),
        )
        for j in range(eq.axles.size)
    ]


# Readhesion controllers of single units that the loop calls as compiled code, without going through Python.
#
# The loop does not depend on them. It has the address of a function of one signature, and that of a record with the
# controller's data, which it passes to the function. So a package that this one must not import can add such a
# controller.


READING = named_record(
    "time", "speed", "torque", "target", "drive_limit", "brake_limit", "coefficient", slipping=np.int64
)  # fmt: skip
"""Readings of a unit's computer at a control instant, as `UnitSense`, except for the angular speeds of its axles."""
ANSWER = named_record("torque", "solve_time", "residual", usable=np.int64, status=np.int64)
"""What a controller answers, as `TorqueDecision`: `usable` 0 or 1, and `status` by its number; 0 is "ok"."""

STEP = types.FunctionType(void(int64, from_dtype(READING), float64[::1], from_dtype(ANSWER)))
"""A control period: (address of the controller's record, reading, angular speeds [rad/s] (axles,), answer to be filled)."""
_step_at = stored_at(STEP)

NOT_A_TORQUE = "torque not finite"


class CompiledController(NamedTuple):
    """The compiled controller of one unit."""

    step: int
    """Address of a compiled function of the kind `STEP`, see `alloc.old.records`."""
    state: int
    """Address of the record that it is called with."""
    statuses: tuple[str, ...]
    """By number; the first is "ok"."""
    kept: Any
    """What must live as long as the addresses are in use."""


CompiledControllers = tuple[CompiledController, ...]
"""Those of a train's units, foremost first."""


def each_compiled(
    factory: Callable[[UnitContext], CompiledController],
) -> Callable[[Sequence[UnitContext]], CompiledControllers]:
    """Factory of a train whose units each have a compiled controller of their own."""
    return lambda contexts: tuple(factory(context) for context in contexts)


class Answers(NamedTuple):
    """What the loop calls the units' compiled controllers with, and counts of their answers; of no units without them."""

    step: Ints
    """(units,), as `state`."""
    state: Ints
    reading: NDArray[np.void]
    """`READING` (units,)"""
    answer: NDArray[np.void]
    """`ANSWER` (units,)"""
    first: Ints
    """Place of each unit's first axle in the next two, and the end, (units + 1,)."""
    axle: Ints
    """Number of each driven axle in the train, unit by unit."""
    omega: Floats
    status: Ints
    """How often each status was answered, (units, statuses); in the last column torques that were no number."""
    solve_time: Floats
    """[s], (ticks, units)"""


def answers(controllers: CompiledControllers, eq: Equipment, ticks: int) -> Answers:
    """Room for the answers of `controllers` in a run of `ticks` control periods."""
    units = len(controllers)
    axles = [np.flatnonzero(eq.axle_unit == j) for j in range(units)]
    most = max((len(one.statuses) for one in controllers), default=0)
    none = np.zeros(0, dtype=np.int64)
    return Answers(
        np.array([one.step for one in controllers], dtype=np.int64),
        np.array([one.state for one in controllers], dtype=np.int64),
        np.zeros(units, READING),
        np.zeros(units, ANSWER),
        np.cumsum([0, *map(len, axles)]).astype(np.int64),
        np.concatenate([none, *axles]),
        np.zeros(sum(map(len, axles))),
        np.zeros((units, most + 1), dtype=np.int64),
        np.zeros((ticks if units else 0, units)),
    )


def failures(controllers: CompiledControllers, counted: Answers) -> dict[str, int]:
    """How often the controllers failed, by status."""
    found: dict[str, int] = {}
    for one, row in zip(controllers, counted.status.tolist(), strict=True):
        for status, number in zip(
            (*one.statuses[1:], NOT_A_TORQUE), (*row[1 : len(one.statuses)], row[-1]), strict=True
        ):
            if number:
                found[status] = found.get(status, 0) + number
    return found


@jit
def command_compiled(eq, m, c, torque, time, tick):
    """Torque commands by the compiled controllers `c`; the reserve's stand where one gives none.

    `torque` [N m]: of each motor as the inverters know it, (units,).
    """
    for j in range(c.step.size):
        reading, answer = c.reading[j], c.answer[j]
        reading.time = time
        reading.speed = m.reference[eq.unit_body[j]]
        reading.torque = torque[j]
        reading.target = m.unit.torque_target[j]
        reading.drive_limit = m.drive_limit[j]
        reading.brake_limit = m.brake_limit[j]
        reading.coefficient = m.unit.coefficient_estimate[j]
        reading.slipping = int(m.unit.slipping[j] != 0.0)
        for i in range(c.first[j], c.first[j + 1]):
            k = c.axle[i]
            c.omega[i] = m.axle_omega[k] * (eq.axle_radius[k] / eq.radius[j])
        _step_at(c.step[j])(c.state[j], reading, c.omega[c.first[j] : c.first[j + 1]], answer)
        c.solve_time[tick, j] = answer.solve_time
        status = answer.status
        if answer.usable != 0 and not abs(answer.torque) < np.inf:
            status = c.status.shape[1] - 1
        elif answer.usable != 0:
            m.unit.torque_command[j] = answer.torque
        c.status[j, status] += 1
        m.unit.torque_factor[j] = share_of_target(m, j)


CONTROLLERS: Registry[type[BuiltInController] | HostedController] = Registry(
    "controller", "readhesion.controllers", OnboardError
)
"""Built-in controllers first, starting with the simplest; each registered or installed one is a `HostedController`."""

for _name, _controller in BUILT_IN.items():
    CONTROLLERS.register(_name, _controller)
