"""What the tests know of the plant beside its right side: its true environment and its energy, with NumPy."""

import numpy as np
from numpy.typing import NDArray

from alloc.plant.array_model import ArrayModel, Local
from alloc.plant.car import EFFORT_SPEED_STEP
from alloc.plant.equations import coupler_stretch, speed_decline
from alloc.plant.field import patch_factor, peak_coefficient, scatter_knot, window
from alloc.plant.model import Model
from alloc.plant.operations import maximum, minimum, sine


def coupler_spring_energy(stretch, stiffness, stiffening):
    """Elastic energy of a draft gear [J]: the integral of `coupler_spring_force`."""
    square = stretch * stretch
    return square * (0.5 * stiffness + 0.25 * stiffening * square)


def mechanical_energy(model, state):
    """Kinetic energy of bodies and wheelsets and elastic energy of couplers [J], of `state` (rows,)."""
    s, n = model.structure, model.layout
    kinetic = (0.5 * s.body_mass * state[n.speed] ** 2).sum(axis=0)
    rotating = (0.5 * s.inertia * state[n.omega] ** 2).sum(axis=0)
    stiffness, stiffening, _, slack = s.coupler.T
    position = state[n.position]
    stretch = coupler_stretch(position[:-1] - position[1:], slack)
    return kinetic + rotating + coupler_spring_energy(stretch, stiffness, stiffening).sum(axis=0)


def _table(tables: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear interpolation of each row of `tables` (rows, points) at its `x` (rows,) in grid units."""
    bounded = np.clip(x, 0.0, tables.shape[1] - 1.000001)
    k = bounded.astype(np.int64)
    row = np.arange(tables.shape[0])
    return np.asarray(tables[row, k] + (tables[row, k + 1] - tables[row, k]) * (bounded - k))


def environment_at(
    model: Model,
    time: float,
    state: NDArray[np.float64],
    cleaning: NDArray[np.float64] | None = None,
    arrays: ArrayModel | None = None,
) -> Local:
    """The true environment of `state` (rows,) at `time` [s].

    `cleaning` (axles,) is what the wheels ahead left, none if None. `arrays`: the array form of `model`
    where it exists already.
    """
    s, n, e = model.structure, model.layout, model.environment
    arrays = arrays or ArrayModel.of(model)
    position = state[n.position][s.axle_body] + s.axle_offset
    speed = state[n.speed][s.axle_body]
    patches = np.ones_like(position)
    for p in e.patch:
        weight = window(position, p[1], p[2], p[3])
        patches = patches * patch_factor(weight, window(time, p[4], p[5], p[6]), p[0])
    scatter = _table(
        np.broadcast_to(e.noise, (n.axles, e.noise.size)), scatter_knot(position, e.noise_length)
    )
    conditioning = 0.0 if cleaning is None else e.conditioning * cleaning
    decline = speed_decline(speed, e.law[1])
    peak = peak_coefficient(
        decline, e.law[0], e.law[2], patches, e.increment, scatter, conditioning
    )
    place = (state[n.position][s.car_body] + s.car_offset - e.line_origin) / e.line_spacing
    rim = arrays.unit_of_axle.T @ (s.radius * state[n.omega]) / s.unit_axles
    rim = np.abs(rim) / EFFORT_SPEED_STEP
    wave = sine(2.0 * np.pi * time / e.receptivity[2] + e.receptivity[3])
    receptivity = minimum(maximum(e.receptivity[0] + e.receptivity[1] * wave, 0.0), 1.0)
    both = np.broadcast_to
    return Local(
        peak=peak,
        grade=_table(both(e.line[0], (n.cars, e.line.shape[1])), place),
        air_factor=_table(both(e.line[1], (n.cars, e.line.shape[1])), place),
        drive_limit=_table(s.drive_table, rim),
        brake_limit=_table(s.brake_table, rim) * receptivity,
        health=(time < e.failure_time).astype(float),
    )
