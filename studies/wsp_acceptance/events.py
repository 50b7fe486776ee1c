"""Full brake applications on rails of very low adhesion: train, curve, levels along the rail, gradient."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from alloc.event import STEP, DriverCommand, Event, longest_duration
from alloc.onboard.brakes import SlideProtection
from alloc.onboard.parameters import Braking, Onboard, ReferenceSpeed
from alloc.plant.adhesion import POLACH_WET, AdhesionCurve, PiecewiseCurve, SlipRatioCurve
from alloc.plant.laws import gradient_force, running_resistance
from alloc.plant.model import build, level_for
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.train import Car, Train
from studies.files.study_error import StudyError
from studies.slides.jp4209318 import CYCLE, FULL_BRAKE, slide_protection
from studies.wsp_acceptance.perfect_stop import (
    LONGEST_STOP,
    REFERENCE_SPEED,
    PerfectStop,
    perfect_stop,
)

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
