"""A slip event: what is the same for every rule and controller of a comparison."""

import hashlib
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from alloc.canonical import canonical
from alloc.display import displayed
from alloc.errors import SimulationError
from alloc.onboard.parameters import Onboard
from alloc.plant.model import Floats, Model
from alloc.run_size import check_size

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
