"""A slip event: what is the same for every rule and controller of a comparison.

In: train, rail, line, driver's command, computers on board, all validated. Out: the `World` of a run, with everything that
is random drawn. A run that would take hours, or more memory than a machine has, is refused here.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.settings import Onboard
from alloc.plant.rail import Line, Rail, Receptivity
from alloc.plant.train import Train
from alloc.run.world import World, world_of
from alloc.schema.errors import SimulationError
from alloc.schema.parameters import Parameters, quantity

STEP = 2.5e-3
"""Longest integration step [s] where an event names none: a quarter of the control period. Against steps a fifth as long,
120 drawn events use the same share of the bound in the mean, and the median event is within 2e-5 of it."""
MOST_AXLE_STEPS = 3e8
"""Integration steps times axles: minutes of computing, and at most 2.4 GB of sensor noise."""
MOST_AXLE_RECORDS = 5e6
"""Control instants times axles: about 1 GB of record."""


@dataclass(frozen=True)
class DriverCommand(Parameters):
    """Acceleration asked for on level track, from each of `times` on; zero before the first."""

    error = SimulationError

    times: tuple[float, ...] = quantity(MISSING, "s", least=-np.inf)
    """Increasing instants."""
    accelerations: tuple[float, ...] = quantity(MISSING, "km/h/s", least=-np.inf)
    """On level track, negative braking."""

    def _find_faults(self) -> Iterator[str]:
        n, m = len(self.times), len(self.accelerations)
        if n != m or not n:
            yield f"{n} times and {m} accelerations; give as many of each, at least one"
        if any(b <= a for a, b in pairwise(self.times)):
            yield "`times` must grow"

    def sampled(self, instants: NDArray[np.float64]) -> NDArray[np.float64]:
        """Command at `instants` [s]."""
        index = np.searchsorted(self.times, instants + 1e-9, side="right") - 1
        return np.where(index >= 0, np.asarray(self.accelerations)[np.maximum(index, 0)], 0.0)


@dataclass(frozen=True, repr=False)
class Event(Parameters):
    """What is the same for every rule and controller of a comparison: train, rail, line, driver, noise."""

    error = SimulationError

    name: str
    train: Train
    rail: Rail
    command: DriverCommand
    onboard: Onboard = field(default_factory=Onboard)
    line: Line = field(default_factory=Line)
    receptivity: Receptivity = field(default_factory=Receptivity)
    failures: Mapping[int, float] = field(default_factory=dict, hash=False)
    """Instant [s] at which a traction unit, 0 = foremost, loses its motors."""
    duration: float = quantity(30.0, "s", above=0.0)
    """Length of the run."""
    initial_speed: float = quantity(0.0, "km/h", least=-np.inf)
    """Speed at the start."""
    initial_position: float = quantity(0.0, "m", least=-np.inf)
    """Position of the train's front at the start."""
    step: float = quantity(STEP, "s", above=0.0)
    """Longest integration step: the control period is divided into equal steps, shorter still where the train is stiff."""
    record_period: float = quantity(0.01, "s", above=0.0)
    """Time between two recorded instants."""
    target_speed: float | None = quantity(None, "km/h")
    """Speed up to which time and distance are measured."""
    seed: int = quantity(0, "1")
    """What drew the event; it draws nothing here."""

    def _find_faults(self) -> Iterator[str]:
        period = self.onboard.period
        if self.ticks < 1:
            yield f"`duration` must not be below the control period {period!r}"
        if self.record_period > self.duration:
            yield "`record_period` must not exceed `duration`"
        yield from self.size_faults(min(self.step, period))
        if self.ticks * self.train.axle_count > MOST_AXLE_RECORDS:
            reason = f"{self.ticks} instants of {self.train.axle_count} axles exceed {MOST_AXLE_RECORDS:g}"
            yield f"`duration` is too long: {reason}"

    def size_faults(self, step: float) -> Iterator[str]:
        """Why the event is too long with integration steps of `step` [s]."""
        steps, axles = self.duration / step, self.train.axle_count
        if not steps * axles <= MOST_AXLE_STEPS:
            reason = (
                f"{steps:.2g} steps of {step:.2g} s of {axles} axles exceed {MOST_AXLE_STEPS:g}"
            )
            yield f"`duration` is too long: {reason}; choose a shorter one, or a longer step"

    def __repr__(self) -> str:
        start = f"{self.duration:g} s from {3.6 * self.initial_speed:g} km/h"
        return f"<Event {self.name!r}: {start}, seed {self.seed}, train {self.train.name!r}>"

    @property
    def ticks(self) -> int:
        """Number of control instants."""
        return round(self.duration / self.onboard.period)

    @cached_property
    def hash(self) -> str:
        """Hash of everything that defines the event: equal events have equal hashes."""
        return hashlib.sha256(canonical(self).encode()).hexdigest()[:16]

    @cached_property
    def inputs_hash(self) -> str:
        """Hash of what a run begins with: events that differ in seeds alone have equal ones if nothing is drawn."""
        digest = hashlib.sha256()
        for array in self._template:
            plain = np.ascontiguousarray(array).view(np.uint8) if array.size else array
            digest.update(f"{array.shape}".encode() + plain.tobytes())
        return digest.hexdigest()[:16]

    def world(self) -> World:
        """A fresh world of a run; raises `InputError` where train, rail and computers do not fit together."""
        return World(*(array.copy() for array in self._template))

    @cached_property
    def _template(self) -> World:
        return world_of(self)


def canonical(value: Any) -> str:
    """One text for equal values, of which hashes are made: records, sequences, mappings part by part, arrays by entry."""
    kind = type(value)
    if is_dataclass(value):
        named = ", ".join(
            f"{item.name}={canonical(getattr(value, item.name))}"
            for item in fields(value)
            if not (item.metadata.get("later") and getattr(value, item.name) == item.default)
        )
        return f"{getattr(kind, 'hashed_as', kind.__qualname__)}({named})"
    if isinstance(value, tuple | list):
        return f"{kind.__name__}({', '.join(map(canonical, value))})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k!r}: {canonical(inner)}" for k, inner in value.items()) + "}"
    if isinstance(value, np.ndarray):
        return f"array({value.tolist()!r}, dtype={value.dtype})"
    return repr(value)
