"""The shortest stop that a rail allows: every axle uses all the adhesion of its place until the train stands."""

import math
from typing import NamedTuple

import numpy as np

from alloc.plant.adhesion import AdhesionCurve
from alloc.plant.equations import GRAVITY, gradient_force
from alloc.plant.model import Floats, Model

REFERENCE_SPEED = 15.0
"""Speed [m/s] at which a rail of any curve offers the level that it is named after."""
STEP = 0.05
"""Step [s] of the perfect stop."""
LONGEST = 3600.0
"""Time [s] after which a train that still runs does not stop."""


class PerfectStop(NamedTuple):
    """Distance [m] and time [s]; infinite where the train does not stop."""

    distance: float
    time: float


def rest_friction(curve: AdhesionCurve, adhesion: float, speed: float = REFERENCE_SPEED) -> float:
    """Level of a rail whose `curve` has its maximum at `adhesion` at this speed [m/s]."""
    level = adhesion
    for _ in range(20):  # the maximum of Polach's curve grows a little less than in proportion
        level *= adhesion / float(curve.limit(level, speed)[0])
    return level


def adhesion_offered(model: Model, front: Floats) -> Floats:
    """Mean adhesion coefficient over the axles, weighted with their loads, at positions of the train's `front` [m].

    It is the maximum of the rail's curve at `REFERENCE_SPEED`, with patches as if their edges were sharp: over the whole of
    a patch that is the same.
    """
    rail, s = model.rail, model.structure
    place = np.asarray(front)[:, None] + s.axle_offset
    factor = np.ones(place.shape)
    for patch in rail.patches:
        factor *= np.where((place >= patch.start) & (place < patch.end), patch.factor, 1.0)
    kinds, which = np.unique(factor, return_inverse=True)
    limit, _ = rail.curve.limit(rail.level * kinds, REFERENCE_SPEED)
    return np.asarray(limit[which.reshape(factor.shape)] @ s.static_load / s.static_load.sum())


def grade_met(model: Model, front: Floats) -> Floats:
    """Mean rise per run over the cars, weighted with their masses, at positions of the train's `front` [m]."""
    s, e = model.structure, model.environment
    place = np.asarray(front)[:, None] + s.car_offset
    x = e.line_origin + e.line_spacing * np.arange(e.line.shape[1])
    return np.asarray(np.interp(place, x, e.line[0]) @ s.car_mass / s.car_mass.sum())


def perfect_stop(model: Model, speed: float) -> PerfectStop:
    """The stop from `speed` [m/s] with the front at 0, by adhesion, gradient and running resistance.

    Wheelsets are stopped by their own brakes: their inertia neither lengthens nor shortens it.
    """
    train, mass = model.train, model.train.mass
    a, b, c = train.resistance
    places = np.arange(model.span[0], model.span[1] + 1.0)
    offered, grade = adhesion_offered(model, places), grade_met(model, places)
    carried = float(model.structure.static_load.sum())
    forces = offered * carried + gradient_force(mass, grade)
    x, v, t = 0.0, speed, 0.0
    while v > 0.0:
        held = float(np.interp(x, places, forces)) + a + b * v + c * v * v
        new = v - STEP * held / mass
        if t > LONGEST or x > places[-1]:
            return PerfectStop(math.inf, math.inf)
        share = 1.0 if new >= 0.0 else v / (v - new)
        x += share * STEP * 0.5 * (v + max(new, 0.0))
        t += share * STEP
        v = new
    return PerfectStop(x, t)


def adhesion_share(model: Model, speed: float, distance: float, end_speed: float = 0.0) -> float:
    """Adhesion used over a stop: kinetic and potential energy taken over `distance` [m], over what the rail offered there.

    On level rail of one adhesion mu it is (v0^2 / 2 s) / (mu g), with the running resistance counted as used.
    """
    places = np.linspace(0.0, distance, max(int(distance), 2) + 1)
    offered = float(np.trapezoid(adhesion_offered(model, places), places))
    climbed = float(np.trapezoid(grade_met(model, places), places))
    kinetic = 0.5 * (speed**2 - end_speed**2)
    return (kinetic / GRAVITY - climbed) / offered if offered > 0.0 else math.nan
