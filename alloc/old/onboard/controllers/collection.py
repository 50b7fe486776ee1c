"""The built-in readhesion controllers, and the compiled law of each for all units of a train.

In: the units' torque targets. Out: their torque commands. To add one, import it here and give it a field.
"""

from collections import namedtuple
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any

from alloc.old.onboard.controllers.base import BuiltInController, of_units
from alloc.old.onboard.controllers.creep import CreepControl, FuzzyCreep
from alloc.old.onboard.controllers.cubature import CubatureSeeking
from alloc.old.onboard.controllers.particle_swarm import SwarmSlip, SwarmTracking
from alloc.old.onboard.controllers.search import FuzzyTracking, PerturbObserve, SteepestGradient
from alloc.old.onboard.controllers.simple import CutAndRamp, NoControl, TorqueTable


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
"""Built-in controllers by name, from the simplest on; the settings and memory of a controller have its place."""

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


@cache
def control(name: str) -> Any:
    """Compiled law of the built-in controller `name` for all units of a train: from their torque targets to commands."""
    return of_units(BUILT_IN[name], list(BUILT_IN).index(name))
