"""The built-in readhesion controllers, and the compiled call of the one that a run has.

In: the units' torque targets. Out: their torque commands. To add one, import it here and give it a field.
"""

from collections import namedtuple
from dataclasses import dataclass, field, fields
from typing import Any

from alloc.compilation import equation, inlined_jit
from alloc.onboard.controllers.base import BuiltInController
from alloc.onboard.controllers.creep import CreepControl, FuzzyCreep
from alloc.onboard.controllers.cubature import CubatureSeeking
from alloc.onboard.controllers.particle_swarm import SwarmSlip, SwarmTracking
from alloc.onboard.controllers.search import FuzzyTracking, PerturbObserve, SteepestGradient
from alloc.onboard.controllers.simple import CutAndRamp, NoControl, TorqueTable


@dataclass(frozen=True)
class BuiltInControllers:
    """Parameters of every controller, from the simplest on; a field is a table `[onboard.<field>]` of a scenario file."""

    none: NoControl = field(default_factory=NoControl)
    """No readhesion control; it has no parameters."""
    table: TorqueTable = field(default_factory=TorqueTable)
    """Controller table. Source: readhesion paper, section 2.3."""
    cut_and_ramp: CutAndRamp = field(default_factory=CutAndRamp)
    """Controller cut-and-ramp. Source: after Kadowaki and Ohishi."""
    creep: CreepControl = field(default_factory=CreepControl)
    """Controller pi-creep; other searching controllers use its gains. Source: assumed."""
    perturb_observe: PerturbObserve = field(default_factory=PerturbObserve)
    """Controller perturb-observe; other searching controllers use its interval and bounds. Source: arXiv 2406.13650."""
    steepest_gradient: SteepestGradient = field(default_factory=SteepestGradient)
    """Controller steepest-gradient. Source: arXiv 2406.13650."""
    fuzzy_creep: FuzzyCreep = field(default_factory=FuzzyCreep)
    """Controller fuzzy-creep. Source: Tian, Daniel, Meehan (2014)."""
    fuzzy_tracking: FuzzyTracking = field(default_factory=FuzzyTracking)
    """Controller fuzzy-tracking. Source: arXiv 2406.13650."""
    swarm_tracking: SwarmTracking = field(default_factory=SwarmTracking)
    """Controller swarm-tracking. Source: arXiv 2406.13650."""
    swarm_slip: SwarmSlip = field(default_factory=SwarmSlip)
    """Controller swarm-slip. Source: Zirek, Onat (2020)."""
    cubature_seeking: CubatureSeeking = field(default_factory=CubatureSeeking)
    """Controller cubature-seeking. Source: Applied Sciences 15, 10524."""


_FIELDS: dict[str, Any] = {item.name: item.type for item in fields(BuiltInControllers)}

BUILT_IN: dict[str, type[BuiltInController]] = {kind.name: kind for kind in _FIELDS.values()}
"""Built-in controllers by name, from the simplest on; in compiled code a controller is its place here."""

RESERVE = "cut-and-ramp"
"""Built-in controller that takes over where a hosted one gives up."""

LawSettings = namedtuple("LawSettings", _FIELDS)  # type: ignore[misc]
"""Settings of every law, under the controller's field."""

LawMemory = namedtuple("LawMemory", _FIELDS)  # type: ignore[misc]
"""Memory of every law, under the controller's field."""


def law_settings(controllers: BuiltInControllers, period: float) -> LawSettings:
    """Settings of all laws for a control `period` [s]."""
    return LawSettings(*(getattr(controllers, name).settings(period) for name in _FIELDS))


def law_memory(units: int) -> LawMemory:
    """Memory of all laws at the start of a run."""
    return LawMemory(*(kind.memory(units) for kind in _FIELDS.values()))


# From the units' torque targets to their torque commands, by the readhesion controller of the run.


def _case(index: int, law: Any) -> Any:
    """Law of a unit under the controller of this index."""

    @equation
    def follow(eq, st, m, j, commanded):
        return law(eq, st, m, st.law[index], m.law[index], j, commanded)

    return follow


def _either(first: Any, below: int, second: Any) -> Any:
    """`first` for controllers of an index below this, else `second`."""

    @equation
    def choose(eq, st, m, j, commanded):
        if st.controller < below:
            return first(eq, st, m, j, commanded)
        else:
            return second(eq, st, m, j, commanded)

    return choose


def _tree(cases: list[Any], start: int) -> Any:
    """Choice among `cases`, the first of index `start`; halved, for the compiler goes through all at every level."""
    if len(cases) == 1:
        return cases[0]
    half = len(cases) // 2
    return _either(_tree(cases[:half], start), start + half, _tree(cases[half:], start + half))


_command: Any = _tree([_case(k, one.law) for k, one in enumerate(BUILT_IN.values())], 0)


@inlined_jit
def control(eq, st, m, commanded):
    """Torque commands of all units, and the share of its target that each is.

    Under a hosted controller these are its reserve; the share is then that of the host, which is not known yet.
    """
    for j in range(eq.axles.size):
        share = _command(eq, st, m, j, commanded)
        if not st.hosted:
            m.unit.torque_factor[j] = share
