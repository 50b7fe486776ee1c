"""What the compiled plant works in: scratch arrays, what it remembers between steps, and sizes."""

from typing import NamedTuple

import numpy as np

from alloc.plant.model import Floats, Layout, Model


class Workspace(NamedTuple):
    """Scratch of the compiled plant, and what it remembers between steps."""

    peak: Floats  # (axles, lanes)
    mu: Floats
    car: Floats  # (4, cars, lanes): static force, unloading, rail force, drag
    body: Floats  # (bodies, lanes) force
    unit: Floats  # (4, units, lanes): rim speed sum, drive limit, brake limit, wheel speed
    row: Floats  # (5, lanes)
    patch_time: Floats  # (patches, lanes)
    stage: Floats  # (rows, lanes)
    slope: Floats  # (rows, lanes)
    total: Floats  # (rows, lanes)
    cleaned: Floats  # (cells, lanes) degree of cleaning of each rail cell, a ring by position
    cell: np.ndarray  # (axles, lanes) cell of each axle at the end of the last step
    delay_target: Floats  # (groups, slots, lanes)
    delay_valve: Floats
    delay_steps: np.ndarray  # (groups,)
    clock: np.ndarray  # (1,) steps taken
    target: Floats  # (groups, lanes) delayed
    valve: Floats


def workspace(model: Model, step: float) -> Workspace:
    """Scratch for `model` advanced with `step` [s]."""
    n, lanes = model.layout, model.lanes
    length = sum(car.length for car in model.train.cars)
    cells = int(length / model.environment.cleaning_spacing) + 256
    steps = np.array(
        [round(brake.dead_time / step) for brake in model.train.brake_groups], dtype=np.int64
    )
    slots = int(steps.max(initial=0)) + 1
    return Workspace(
        peak=np.zeros((n.axles, lanes)),
        mu=np.zeros((n.axles, lanes)),
        car=np.zeros((4, n.cars, lanes)),
        body=np.zeros((n.bodies, lanes)),
        unit=np.zeros((4, n.units, lanes)),
        row=np.zeros((5, lanes)),
        patch_time=np.zeros((model.environment.patch.shape[0], lanes)),
        stage=np.zeros((n.rows, lanes)),
        slope=np.zeros((n.rows, lanes)),
        total=np.zeros((n.rows, lanes)),
        cleaned=np.zeros((cells if model.environment.conditioned else 1, lanes)),
        cell=np.full((n.axles, lanes), np.iinfo(np.int64).min, dtype=np.int64),
        delay_target=np.zeros((n.groups, slots, lanes)),
        delay_valve=np.zeros((n.groups, slots, lanes)),
        delay_steps=steps,
        clock=np.zeros(1, dtype=np.int64),
        target=np.zeros((n.groups, lanes)),
        valve=np.zeros((n.groups, lanes)),
    )


class Rows(NamedTuple):
    """Sizes for compiled code; `Layout` is a Python object that Numba does not see through."""

    bodies: int
    axles: int
    cars: int
    units: int
    groups: int


def rows(layout: Layout) -> Rows:
    """Sizes of `layout` for compiled code."""
    return Rows(layout.bodies, layout.axles, layout.cars, layout.units, layout.groups)
