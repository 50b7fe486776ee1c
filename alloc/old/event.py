"""A slip event: what is the same for every rule and controller of a comparison.

In: train, rail, line, driver's command, belief on board, all validated. Out: an `Event`, the input of
`alloc.old.simulation.simulate`. A run that would take hours or more memory than a machine has is refused here.
"""

import hashlib
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from typing import Any

import numpy as np

from alloc.old.display import displayed
from alloc.old.errors import SimulationError
from alloc.old.onboard.equipment import Equipment, equipment
from alloc.old.onboard.parameters import Onboard
from alloc.old.plant.model import STABLE_STEP, Floats, Model
from alloc.old.records import Made

# One text for equal values: what hashes are made of. `repr` is for people, and leaves things out.


def canonical(value: Any) -> str:
    """Text of everything that `value` holds: records, sequences and mappings part by part, arrays entry by entry."""
    kind = type(value)
    if is_dataclass(value):
        named = [(item.name, getattr(value, item.name)) for item in fields(value)]
    elif isinstance(value, tuple) and hasattr(value, "_fields"):
        named = list(zip(value._fields, value, strict=True))
    elif kind is tuple:
        parts = [canonical(part) for part in value]
        return f"({parts[0]},)" if len(parts) == 1 else f"({', '.join(parts)})"
    elif kind is list:
        return f"[{', '.join(map(canonical, value))}]"
    elif kind is dict:
        return "{" + ", ".join(f"{canonical(k)}: {canonical(v)}" for k, v in value.items()) + "}"
    elif isinstance(value, np.ndarray):
        return f"array({value.tolist()!r}, dtype={value.dtype})"
    else:
        return repr(value)
    return f"{kind.__qualname__}({', '.join(f'{name}={canonical(part)}' for name, part in named)})"


# Limit of a run's size: a run that would take hours, or more memory than a machine has, is refused before it starts.


MOST_AXLE_STEPS = 3e8
"""Integration steps times axles: minutes of computing, and at most 2.4 GB of sensor noise."""
MOST_AXLE_RECORDS = 5e6
"""Recorded instants times axles: about 1 GB while the record is evaluated."""
MOST_COMMANDS = 3e7
"""Brake commands on their way to cylinders: 0.5 GB."""


def check_size(
    owner: str,
    model: Model,
    duration: float,
    period: float,
    step: float,
    record_period: float,
    most_axle_steps: float = MOST_AXLE_STEPS,
) -> None:
    """Raise `SimulationError` where a run of `duration` [s] is longer than these bounds allow, or than nothing."""
    if round(duration / period) < 1:
        raise SimulationError(
            f"{owner}: duration = {duration!r} must not be below the control period {period!r}"
        )
    axles, fastest = model.layout.axles, model.stiffness() / STABLE_STEP
    steps, records = (
        duration * max(1.0 / step, 1.0 / period, fastest),
        duration / max(record_period, period),
    )
    if not steps * axles <= most_axle_steps:
        cause = (
            f"choose a longer step than {step:g} s"
            if 1.0 / step >= fastest
            else f"choose parameters without rates as fast as {model.stiffness():.2g} 1/s"
        )
        raise SimulationError(
            f"{owner}: {steps:.2g} steps of {axles} axles exceed {most_axle_steps:g} axle-steps; choose a shorter "
            f"duration than {duration:g} s, or {cause}"
        )
    brakes = model.train.brake_groups
    dead_time = max((brake.dead_time for brake in brakes), default=0.0)
    if dead_time * len(brakes) * steps > MOST_COMMANDS * duration:
        raise SimulationError(
            f"{owner}: a dead_time of {dead_time:.3g} s of {len(brakes)} brakes holds more than {MOST_COMMANDS:g} commands; "
            "choose a shorter dead_time, or a longer step"
        )
    if records * axles > MOST_AXLE_RECORDS:
        raise SimulationError(
            f"{owner}: {records:.2g} recorded instants of {axles} axles exceed {MOST_AXLE_RECORDS:g}; choose a shorter "
            f"duration than {duration:g} s, or a record_period longer than {record_period:g} s"
        )


STEP, NOISY_STEP = 2e-3, 1e-3
"""Default integration steps [s] of an event, without and with noise on the speed sensors."""


@displayed
@dataclass(frozen=True)
class DriverCommand:
    """Acceleration [m/s2] asked for on level track, from each of `times` [s] on; zero before the first."""

    times: tuple[float, ...]
    """Increasing instants [s]."""
    accelerations: tuple[float, ...]
    """On level track, negative braking [m/s2]."""

    def __post_init__(self) -> None:
        if len(self.times) != len(self.accelerations) or not self.times:
            raise SimulationError(
                f"driver command: {len(self.times)} times and {len(self.accelerations)} accelerations; "
                "give as many of each, at least one"
            )
        SimulationError.check("driver command", self, finite=("times[]", "accelerations[]"))
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise SimulationError(f"driver command: times {self.times} must grow")

    def sampled(self, instants: Floats) -> Floats:
        """Command at `instants` [s]."""
        index = np.searchsorted(self.times, instants + 1e-9, side="right") - 1
        return np.where(index >= 0, np.asarray(self.accelerations)[np.maximum(index, 0)], 0.0)


@displayed
@dataclass(frozen=True, repr=False)
class Event:
    """What is the same for every rule and controller of a comparison: train, rail, line, driver, noise."""

    name: str
    model: Model
    command: DriverCommand
    onboard: Onboard = field(default_factory=Onboard)
    duration: float = 30.0
    """Length of the run [s]."""
    initial_speed: float = 0.0
    """[m/s]"""
    initial_position: float = 0.0
    """Position of the train's front [m]."""
    step: float | None = None
    """Longest integration step [s], see `longest_step`."""
    record_period: float = 0.01
    """Time between two recorded instants [s]."""
    target_speed: float | None = None
    """Speed [m/s] up to which time and distance are measured."""
    seed: int = 0

    @property
    def longest_step(self) -> float:
        """Integration step [s]: the control period is divided into equal steps, shorter still where the train is stiff.

        The default is 2 ms, or 1 ms with noisy sensors, since decisions near a threshold depend on small differences. Most
        metrics are then within 5e-4 of those with much smaller steps.
        """
        if self.step is not None:
            return self.step
        return NOISY_STEP if self.onboard.sensors.speed_noise > 0.0 else STEP

    def __post_init__(self) -> None:
        times = {
            "duration": self.duration,
            "step": self.longest_step,
            "record_period": self.record_period,
        }
        SimulationError.check("event", times, positive=times)
        check_size(
            "event",
            self.model,
            self.duration,
            self.onboard.period,
            self.longest_step,
            self.record_period,
        )
        SimulationError.check_order("event", self, "record_period", "duration", equal=True)

    @cached_property
    def equipment(self) -> Equipment:
        """What the train's computers believe; raises `OnboardError` where belief and train do not fit."""
        return equipment(self.model, self.onboard)

    @cached_property
    def made(self) -> Made:
        """What runs of this event share."""
        return Made()

    @cached_property
    def hash(self) -> str:
        """Hash of everything that defines the event: equal events have equal hashes."""
        model = self.model
        given = (getattr(self, item.name) for item in fields(self) if item.name != "model")
        parts = (*given, model.train, (model.rail,), model.line, model.span)
        digest = hashlib.sha256(canonical(parts).encode())
        digest.update(model.environment.failure_time.tobytes())
        digest.update(model.environment.receptivity.tobytes())
        return digest.hexdigest()[:16]

    def __repr__(self) -> str:
        return (
            f"<Event {self.name!r}: {self.duration:g} s from {3.6 * self.initial_speed:g} km/h, "
            f"seed {self.seed}, train {self.model.train.name!r}>"
        )
