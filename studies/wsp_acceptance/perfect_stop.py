"""The shortest stop that a rail allows: every axle uses all the adhesion of its place until the train stands."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from alloc.plant.laws import GRAVITY, gradient_force
from alloc.plant.model import Floats, Model

REFERENCE_SPEED = 15.0
"""Speed [m/s] at which a rail of any curve offers the level that it is named after."""
LONGEST_STOP = 20_000
"""Distance [m] within which a train stops, if ever."""
BLOCK = 500
"""Metres of rail that are looked up at once."""


class PerfectStop(NamedTuple):
    """Distance [m] and time [s]; infinite where the train does not stop."""

    distance: float
    time: float


def adhesion_offered(model: Model, front: ArrayLike) -> Floats:
    """Mean adhesion coefficient over the axles, weighted with their loads, at positions of the train's `front` [m].

    It is the maximum of the rail's curve at `REFERENCE_SPEED`. Edges of patches count as sharp: over the whole of a patch
    that is the same. Rails with a speed law or scatter have no such level.
    """
    rail, s = model.rail, model.structure
    place = np.asarray(front)[:, None] + s.axle_offset
    factor = np.ones(place.shape)
    for patch in rail.patches:
        factor *= np.where((place >= patch.start) & (place < patch.end), patch.factor, 1.0)
    kinds, which = np.unique(factor, return_inverse=True)
    contact = model.environment.contact
    limit, _ = rail.curve.limit(rail.level * kinds[:, None], REFERENCE_SPEED, contact)
    limit = np.broadcast_to(limit, (kinds.size, s.static_load.size))
    offered = limit[which.reshape(factor.shape), np.arange(s.static_load.size)]
    return np.asarray(offered @ s.static_load / s.static_load.sum())


def grade_met(model: Model, front: ArrayLike) -> Floats:
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
    carried = float(model.structure.static_load.sum())
    energy, time = 0.5 * speed * speed, 0.0  # kinetic energy per mass; a metre at a time
    for start in range(0, LONGEST_STOP, BLOCK):
        middles = start + 0.5 + np.arange(BLOCK)
        forces = adhesion_offered(model, middles) * carried
        forces += gradient_force(mass, grade_met(model, middles))
        for k, force in enumerate(forces.tolist()):
            v = math.sqrt(2.0 * energy)
            rest = energy - (force + a + b * v + c * v * v) / mass
            share = 1.0 if rest > 0.0 else energy / (energy - rest)
            time += 2.0 * share / (v + math.sqrt(2.0 * max(rest, 0.0)))
            if rest <= 0.0:
                return PerfectStop(start + k + share, time)
            energy = rest
    return PerfectStop(math.inf, math.inf)


def adhesion_share(model: Model, speed: float, distance: float, end_speed: float = 0.0) -> float:
    """Adhesion used over a stop: kinetic and potential energy taken over `distance` [m], over what the rail offered there.

    On level rail of one adhesion mu it is (v0^2 / 2 s) / (mu g). So running resistance counts as used, and rotating masses
    count for nothing: each wheelset's own brake stops it.
    """
    climbed = distance * float(grade_met(model, _middles(distance)).mean())
    taken = 0.5 * (speed**2 - end_speed**2) - GRAVITY * climbed
    return taken / energy_offered(model, distance)


def energy_offered(model: Model, distance: float) -> float:
    """Energy per mass [m2/s2] that the rail's adhesion could take over `distance` [m]."""
    return GRAVITY * distance * float(adhesion_offered(model, _middles(distance)).mean())


def _middles(distance: float) -> Floats:
    """Middles of pieces of about a metre."""
    metres = max(round(distance), 1)
    return np.asarray((np.arange(metres) + 0.5) * (distance / metres))
