"""Limit of a run's size: a run that would take hours, or more memory than a machine has, is refused before it starts."""

from alloc.errors import SimulationError
from alloc.plant.model import STABLE_STEP, Model

MOST_AXLE_STEPS = 3e8
"""Integration steps times axles: minutes of computing, and at most 2.4 GB of sensor noise."""
MOST_AXLE_RECORDS = 5e6
"""Recorded instants times axles: about 2 GB while the record is evaluated."""
MOST_COMMANDS = 3e7
"""Brake commands on their way to cylinders: 0.5 GB."""


def longest_duration(
    model: Model, step: float, record_period: float, most_axle_steps: float = MOST_AXLE_STEPS
) -> float:
    """Longest run [s] of `model` that `check_size` allows, a little less."""
    steps = max(1.0 / step, model.stiffness() / STABLE_STEP)
    axles = model.layout.axles
    return 0.999 * min(most_axle_steps / steps, MOST_AXLE_RECORDS * record_period) / axles


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
