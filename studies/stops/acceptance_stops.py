"""The shortest stop that a rail allows: every axle uses all the adhesion of its place until the train stands."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from alloc.event import STEP, DriverCommand, Event, longest_duration
from alloc.onboard.brakes import SlideProtection
from alloc.onboard.parameters import Braking, Onboard, ReferenceSpeed
from alloc.plant.adhesion import POLACH_WET, AdhesionCurve, PiecewiseCurve, SlipRatioCurve
from alloc.plant.laws import GRAVITY, gradient_force, running_resistance
from alloc.plant.model import Floats, Model, build, level_for
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.train import Car, Train
from studies.files.study_error import StudyError
from studies.slides.jp4209318 import CYCLE, FULL_BRAKE, slide_protection

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


CURVES: dict[str, AdhesionCurve] = {
    "piecewise": PiecewiseCurve(),
    "polach": POLACH_WET,
    "slip-ratio": SlipRatioCurve(),
}
"""The curves by name, each with its default parameters."""
PROTECTION = slide_protection(law="fuzzy")
"""The one setting that all stops are made with: medium sensitivity, every 20 ms."""
APPLICATION = 10.0
"""Time [s] that a stop may take beyond the perfect one: cylinders fill, and a first slide is caught."""
USED_LEAST = 0.3
"""Adhesion used with which a train still stops within the run."""
ROLLING = 3.0
"""Time [s] for which the train rolls before it brakes. Its computers then know the gradient, as after any run."""
ENDLESS = 90.0
"""Time [s] of a run where the rail stops nobody."""

Levels = float | Sequence[tuple[float, float]]
"""Adhesion of the rail: one number, or from each position [m] on another; the first counts from ever before."""


def air_braked(train: Train) -> Train:
    """The same train without its motors: it brakes with air alone. Raises `StudyError` where it has no air brake."""
    if not train.brake_groups:
        raise StudyError(f"train {train.name!r} has no air brake; slide protection acts on one")
    return replace(train, cars=tuple(_without_motors(car) for car in train.cars))


def _without_motors(car: Car) -> Car:
    return replace(car, motors=None, driven=(False,) * len(car.driven))


def gripping(train: Train, factor: float) -> Train:
    """The same train with this share of its shoe friction; its computers do not know."""
    return replace(
        train,
        cars=tuple(
            replace(car, air_brake=replace(car.air_brake, friction_factor=factor))
            if car.air_brake
            else car
            for car in train.cars
        ),
    )


def rail_of(curve: str, levels: Levels, train: Train) -> Rail:
    """Rail of a curve, named in `CURVES`, whose maximum under `train` at 15 m/s is the level."""
    law = CURVES[curve]
    steps = [(-math.inf, levels)] if isinstance(levels, (int, float)) else list(levels)
    level = {a: level_for(law, a, REFERENCE_SPEED, train) for a in {a for _, a in steps}}
    friction = [level[adhesion] for _, adhesion in steps]
    ends = [start for start, _ in steps[1:]] + [1e6]
    patches = tuple(
        Patch(factor / friction[0], start, end)
        for (start, _), end, factor in zip(steps, ends, friction, strict=True)
        if factor != friction[0]
    )
    return Rail(friction[0], patches=patches, curve=law)


class SpecifiedStop(NamedTuple):
    """Specification of a stop, and the perfect stop from the same speed."""

    event: Event
    perfect: PerfectStop

    def under(self, reference: ReferenceSpeed) -> "SpecifiedStop":
        """The same stop with another reference speed of the train's computers."""
        onboard = replace(self.event.onboard, reference=reference)
        return self._replace(event=replace(self.event, onboard=onboard))


def stop_of(
    train: Train,
    curve: str,
    mu: Levels,
    speed: float,
    grade: float = 0.0,
    protection: SlideProtection = PROTECTION,
    duration: float | None = None,
    rolling: float = ROLLING,
) -> SpecifiedStop:
    """Full braking with air alone from `speed` [m/s] to a stand on a rail of adhesion `mu`.

    `grade`: rise per run. `duration` [s]: where none is given, long enough for a train that uses `USED_LEAST` of the
    adhesion, or as long as a run may be. The train rolls for `rolling` [s], and brakes from position 0 on.
    Raises `StudyError` where the train has no air brake.
    """
    braked, rail, line = air_braked(train), rail_of(curve, mu, train), Line(grades=(grade,))
    model = build(braked, rail, line, span=(0.0, float(LONGEST_STOP)))
    best = perfect_stop(model, speed)
    if duration is None:
        wanted = ENDLESS if math.isinf(best.time) else APPLICATION + best.time / USED_LEAST
        duration = min(wanted, longest_duration(model, STEP, CYCLE) - rolling)
    held = gradient_force(train.mass, grade) + running_resistance(speed, *train.resistance, 1.0)
    slowing = held / (train.mass + train.rotating_mass)
    start, way = speed + slowing * rolling, (speed + 0.5 * slowing * rolling) * rolling
    event = Event(
        name=event_name(curve, mu, grade),
        model=build(braked, rail, line, span=(-way, start * duration)),
        command=DriverCommand((rolling,), (FULL_BRAKE,)),
        # what is asked for is applied at once: the cylinders' dead time and lag are all the delay
        onboard=Onboard(
            period=CYCLE,
            rise_time=CYCLE,
            braking=Braking(slide_protection=protection, release_speed=0.0),
        ),
        duration=rolling + duration,
        initial_speed=start,
        initial_position=-way,
        record_period=CYCLE,
        target_speed=0.0,
    )
    return SpecifiedStop(event, best)


def event_name(curve: str, mu: Levels, grade: float = 0.0) -> str:
    """Name of a stop, such as "polach 0.08 > 0.03 -30 per mille"."""
    steps = [mu] if isinstance(mu, (int, float)) else [level for _, level in mu]
    shown = " > ".join(f"{level:g}" for level in steps[:3]) + (" > ..." if len(steps) > 3 else "")
    slope = f" {1e3 * grade:+g} per mille" if grade else ""
    return f"{curve} {shown}{slope}"
