"""One setting of the slide protection from adhesion 0.02 up, on every curve, for 1 to 8 cars, beside the true speed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from alloc.event import STEP, DriverCommand, Event, longest_duration
from alloc.metrics.registry import record_period, series
from alloc.metrics.use import LOCK_SPEED, STANDING_SPEED, air_consumption, damage, locked_time
from alloc.onboard.brakes import SlideProtection
from alloc.onboard.parameters import Braking, Onboard, ReferenceSpeed
from alloc.plant.adhesion import POLACH_WET, AdhesionCurve, PiecewiseCurve, SlipRatioCurve
from alloc.plant.laws import GRAVITY, gradient_force, hyperbolic_speed_law, running_resistance
from alloc.plant.model import Floats, Model, build, level_for
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Car, Train
from alloc.simulation import simulate
from studies.core.cell import Task
from studies.core.claims import AT_LEAST, Claim, conjunction, quantity
from studies.core.drawn_events import DrawnEvents, Quantity, in_turn, sometimes, uniform
from studies.core.statement import Interval, Statement
from studies.core.study import Study
from studies.files.study_error import StudyError, unknown
from studies.scenario.train_file import build_train
from studies.slides.jp4209318 import CYCLE, FULL_BRAKE, slide_protection, slide_train

# The shortest stop that a rail allows: every axle uses all the adhesion of its place until the train stands.

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


# Stops of the study: the table of levels and curves and its surroundings, drawn stops, and stops that the user asks
# for.

LEVELS = (0.02, 0.03, 0.05, 0.08)
DRY = (0.12,)
"""Further levels of the three-car train, on which a protection tuned to less may brake too little."""
CARS = (1, 2, 3, 5, 8)
SPEED_KMH = 100.0
GRADE = 0.03
"""Rise per run of the gradients."""
FRICTION_ERROR = 0.15
"""Share by which shoe friction is above or below what the computers believe."""
JUMP_AT = 0.3
"""Share of the perfect stop's distance on the first level after which another level begins."""
PATCH_LEVELS = {0.08: 0.02, 0.05: 0.02, 0.03: 0.08, 0.02: 0.05}
"""Level of the rail and that of its patches."""
PATCHES, PATCH_LENGTH = 8, 30.0
"""Patches over the distance of a perfect stop without them, and the length of each [m]."""
LAWS = ("fuzzy", "threshold", "none")
FASTEST_KMH = 400.0
UNIFORM, SHOES, GRADIENT, JUMP, PATCHED, BELIEF, DRAWN = (
    "uniform", "shoes", "gradient", "jump", "patches", "belief", "drawn"
)  # fmt: skip
"""Parts of the table."""


@dataclass(frozen=True)
class StopCase:
    """A stop, with the estimated reference speed and, if `compared`, with the true one."""

    part: str
    train: Train
    curve: str
    levels: Levels
    speed: float = SPEED_KMH / 3.6
    grade: float = 0.0
    friction_factor: float = 1.0
    """True shoe friction over what the computers believe."""
    law: str = "fuzzy"
    compared: bool = True

    @property
    def adhesion(self) -> float:
        """Level at the begin of the stop."""
        return self.levels if isinstance(self.levels, (int, float)) else self.levels[0][1]

    def stop(self) -> SpecifiedStop:
        """The stop under the estimated reference speed."""
        return stop_of(
            gripping(self.train, self.friction_factor), self.curve, self.levels, self.speed, self.grade,
            slide_protection(law=self.law),
            # where beliefs are wrong the gradient begins with the brakes: nobody could have learnt it
            rolling=0.0 if self.part == BELIEF else ROLLING,
        )  # fmt: skip

    @property
    def columns(self) -> dict[str, Any]:
        """Columns that distinguish the row from others."""
        return {
            "part": self.part,
            "train": self.train.name,
            "cars": len(self.train.cars),
            "curve": self.curve,
            "adhesion": self.adhesion,
            "speed_kmh": round(3.6 * self.speed, 6),
            "grade_permille": 1e3 * self.grade,
            "friction_factor": self.friction_factor,
            "law": self.law,
        }


def discs(cars: int) -> Train:
    """The train of JP4209318, whose brakes have the same friction at all speeds."""
    return slide_train(cars)


def shoes(cars: int) -> Train:
    """The same with brake shoes whose friction falls with the speed; at `REFERENCE_SPEED` they brake as hard."""
    plain = discs(cars)
    return replace(
        plain,
        name=f"{plain.name}-shoes",
        cars=tuple(_with_shoes(car) for car in plain.cars),
    )


def _with_shoes(car: Car) -> Car:
    brake = car.air_brake
    assert brake is not None
    shoes = find_set("freight-5").cars[0].air_brake
    assert shoes is not None
    force = brake.force_per_pascal / float(hyperbolic_speed_law(REFERENCE_SPEED, *shoes.friction))
    return replace(car, air_brake=replace(brake, friction=shoes.friction, force_per_pascal=force))


def table_cases(law: str = "fuzzy") -> Iterator[StopCase]:
    """The table, and what surrounds it, from 100 km/h."""
    for curve in CURVES:
        three = StopCase(UNIFORM, discs(3), curve, LEVELS[0], law=law)
        for level in LEVELS:
            yield from (replace(three, train=discs(cars), levels=level) for cars in CARS)
            yield replace(three, part=SHOES, train=shoes(3), levels=level)
            for grade in (GRADE, -GRADE):
                if level + grade > 0.0:  # else the rail stops nobody
                    yield replace(three, part=GRADIENT, levels=level, grade=grade)
            for factor, grade in product(
                (1.0 - FRICTION_ERROR, 1.0, 1.0 + FRICTION_ERROR), (-GRADE, 0.0, GRADE)
            ):
                yield replace(
                    three, part=BELIEF, levels=level, grade=grade, friction_factor=factor, compared=False
                )  # fmt: skip
        yield from (replace(three, levels=level) for level in DRY)
        for first, then in permutations(LEVELS, 2):
            yield replace(three, part=JUMP, levels=jump(curve, first, then))
        for level, other in PATCH_LEVELS.items():
            yield replace(three, part=PATCHED, levels=patches(curve, level, other))


def jump(curve: str, first: float, then: float) -> tuple[tuple[float, float], ...]:
    """Rail of one level and, from `JUMP_AT` of the way on, another."""
    return (-math.inf, first), (JUMP_AT * _way(curve, first), then)


def patches(curve: str, level: float, other: float) -> tuple[tuple[float, float], ...]:
    """Rail of one level with `PATCHES` patches of another."""
    way = _way(curve, level) / PATCHES
    places = [(k + 0.5) * way for k in range(PATCHES)]
    return (
        (-math.inf, level),
        *(step for x in places for step in ((x, other), (x + PATCH_LENGTH, level))),
    )


def _way(curve: str, level: float) -> float:
    """Distance of a perfect stop [m]."""
    return perfect_stop(build(discs(3), rail_of(curve, level, discs(3))), SPEED_KMH / 3.6).distance


QUANTITIES: dict[str, Quantity] = {
    "cars": Quantity("1 ... 8", "as in the table", lambda g, _: int(g.integers(1, 9))),
    "brake": Quantity(
        "discs or shoes", "as in the table", lambda g, _: ("discs", "shoes")[int(g.integers(2))]
    ),
    "curve": in_turn(list(CURVES), "each in its turn", "as in the table"),
    "level": Quantity(
        "0.02 ... 0.1, uniform in its logarithm", "between the table's levels",
        lambda g, _: round(0.02 * 5.0 ** float(g.uniform()), 4),
    ),
    "speed_kmh": uniform(60.0, 160.0, " km/h", "slower and faster than the table's stops"),
    "grade_share": sometimes(
        0.5, -0.6, 0.6, " of the level", 0.0, "up or down, at most 30 per mille; the train stops"
    ),
    "friction_factor": uniform(
        1.0 - FRICTION_ERROR, 1.0 + FRICTION_ERROR, "", "shoe friction other than believed"
    ),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("stop", QUANTITIES, stream=(13,), numbered=True)


def drawn_case(seed: int, k: int, law: str = "fuzzy") -> StopCase:
    """The drawn stop of number `k`."""
    d = EVENTS.draw(seed, k)
    make = {"discs": discs, "shoes": shoes}[d["brake"]]
    grade = round(max(-GRADE, min(GRADE, d["grade_share"] * d["level"])), 4)
    return StopCase(
        DRAWN, make(d["cars"]), d["curve"], d["level"], d["speed_kmh"] / 3.6, grade, d["friction_factor"], law
    )  # fmt: skip


def chosen_cases(
    adhesion: Sequence[float] | None,
    curve: Sequence[str] | None,
    speed_kmh: float | None,
    train: str | None,
    law: str = "fuzzy",
) -> list[StopCase]:
    """Stops on uniform level rail as asked for; what is None is as in the table. Raises `StudyError` for what cannot be."""
    for level in adhesion or ():
        if not 0.0 < level <= 1.0:
            raise StudyError(f"--adhesion {level:g}: give coefficients above 0, 1 at most")
    for name in curve or ():
        if name not in CURVES:
            raise unknown("curve", name, CURVES)
    kmh = SPEED_KMH if speed_kmh is None else speed_kmh
    if not 5.0 < kmh <= FASTEST_KMH:
        raise StudyError(f"--speed-kmh {kmh:g}: give a speed above 5, {FASTEST_KMH:g} at most")
    chosen = discs(3) if train is None else build_train(train, None, None, None, reverse=False)
    return [
        StopCase(UNIFORM, air_braked(chosen), name, level, kmh / 3.6, law=law)
        for name in dict.fromkeys(curve or CURVES)
        for level in dict.fromkeys(adhesion or LEVELS)
    ]


STANDSTILL = 0.05
"""Speed [m/s] below which a train counts as standing. Down a slope it creeps, slower than this; on level rail it has 6 mm to
go."""


def stopped_run(event: Event) -> xr.Dataset:
    """The recorded run until the train stands; there are no motors, so rule and controller have nothing to do."""
    return simulate(event, "alone", "none", until_speed=STANDSTILL)


def stands(run: xr.Dataset) -> NDArray[np.bool_]:
    """Whether the train stands, (time,)."""
    return np.asarray(series(run, "speed") <= STANDSTILL)


def longest_lock(run: xr.Dataset) -> float:
    """Longest time [s] that any wheel stands while its train runs faster than 5 km/h."""
    standing = np.abs(series(run, "rim_speed")) < STANDING_SPEED
    locked = standing & (np.abs(series(run, "speed")) > LOCK_SPEED)[:, None]
    since, longest = np.zeros(locked.shape[1]), 0.0
    for now in locked:
        since = np.where(now, since + 1.0, 0.0)
        longest = max(longest, float(since.max()))
    return longest * record_period(run)


def measured(run: xr.Dataset, asked: SpecifiedStop) -> dict[str, Any]:
    """Measures of the stop that was `asked` for, from its command to the stand, or to the end if it never stood.

    The train rolls before its command.

    `adhesion_used` is as type tests have it; `adhesion_used_at_rail` leaves out what running resistance takes.
    """
    run = run.isel(time=slice(int(np.argmax(series(run, "driver_command") < 0.0)), None))
    speed, standing = series(run, "speed"), stands(run)
    end = int(np.argmax(standing)) if standing.any() else speed.size - 1
    stop = run.isel(time=slice(0, end + 1))
    position = series(stop, "position")
    distance = float(position[-1] - position[0])
    left = 0.0 if standing.any() else float(speed[-1])
    model, start = asked.event.model, float(speed[0])
    against = series(stop, "resistance_work")  # and against the gradient
    by_rail = 0.5 * (start**2 - left**2) - float(against[-1] - against[0]) / model.train.mass
    return {
        "stopped": bool(standing.any()),
        "adhesion_used": adhesion_share(model, start, distance, left),
        "adhesion_used_at_rail": by_rail / energy_offered(model, distance),
        "locked_axle_s": locked_time(stop),
        "longest_lock_s": longest_lock(stop),
        "damage_kj": damage(stop),
        "air_nl": air_consumption(stop),
        "distance_m": distance,
        "over_perfect": distance / asked.perfect.distance if standing.any() else float("nan"),
        "time_s": float(series(stop, "time")[-1] - series(stop, "time")[0]),
    }


POINTS = 0.025
"""Most by which the adhesion used may fall short of that with the true speed."""
LEAST_USED = {0.03: 0.85, 0.0: 0.82}
"""Adhesion above which a share must be used, and the smallest share of it."""
MOST_DAMAGE = 5e3
"""Wheel damage [kJ] of the three-car train."""
ROUNDING = 0.005
"""Of adhesion used, and as a share of Q, within which nothing counts as worse than before."""


class Before(NamedTuple):
    """A stop of the three-car train with each car's reference as it was: adhesion used, Q [kJ]."""

    used: float
    damage: float


BEFORE: Mapping[tuple[str, float], Before] = {
    ("piecewise", 0.08): Before(0.8841, 4112.3),
    ("piecewise", 0.12): Before(0.8485, 1471.8),
    ("polach", 0.08): Before(0.8677, 3548.2),
    ("polach", 0.12): Before(0.8810, 1616.0),
    ("slip-ratio", 0.08): Before(0.9610, 4719.3),
    ("slip-ratio", 0.12): Before(0.9041, 2434.2),
}
"""Curve and level -> stop from 100 km/h with the fastest axle of each car, falling by 1.35 m/s2 at most, as reference."""
SHORT = "true_speed_adhesion_used - adhesion_used"
"""By how much the adhesion used falls short of that with the true speed."""
NO_LOCK, NEAR = "locked_axle_s == 0", f"{SHORT} <= {POINTS}"
USUAL = f"part != '{BELIEF}'"
LEVEL_RAIL = f"part == '{UNIFORM}' and grade_permille == 0"
THREE = f"{LEVEL_RAIL} and train == '{discs(3).name}' and |speed_kmh - 100| < 0.0005"
(BREAK, ABOVE), (_, BELOW) = LEAST_USED.items()
MOST_LOCKED = ("locked axle s, most", "largest of locked_axle_s")


def _aim(
    name: str, claim: str, met: str, reason: str, only: str = "", numbers: Mapping[str, str] | None = None
) -> Claim:  # fmt: skip
    """That every stop that bears on it meets a condition."""
    return Claim(
        name, claim, met, AT_LEAST, 1.0, only=only, exact=True, reason=reason, numbers=numbers or {},
        method="every stop counts, and all must meet it; limits are ranges, not confidence",
    )  # fmt: skip


CLAIMS = (
    _aim("no lock", "no wheel locks above 5 km/h, on any curve and level", NO_LOCK, "a locked wheel is flattened", USUAL,
         dict([MOST_LOCKED, ("longest lock [s]", "largest of longest_lock_s")])),
    _aim("stands", "every train stands, where the rail stops it", "stopped == 1", "a brake stops the train", USUAL,
         {"distance over that of a perfect stop, most": "largest of over_perfect"}),
    _aim("estimate", "adhesion used is within 2.5 points of that with the true speed", NEAR,
         "the reference speed costs little", f"{USUAL} and true_speed_adhesion_used >= 0"),
    # above the highest level, filling the cylinders is what costs
    _aim("used", "at least 0.85 of the adhesion is used from 0.03 to 0.08, and 0.82 below",
         f"stopped == 1 and adhesion >= {BREAK} and adhesion_used >= {ABOVE} or "
         f"stopped == 1 and adhesion < {BREAK} and adhesion_used >= {BELOW}",
         "aim of this project", f"{LEVEL_RAIL} and adhesion <= {LEVELS[-1]}"),
    _aim("damage", "Q is at most 5 MJ for three cars from 100 km/h", f"damage_kj <= {MOST_DAMAGE}", "aim of this project",
         THREE),
    _aim("belief", "no wheel locks with shoe friction wrong by 15 % and an unknown gradient of 30 per mille, at once",
         NO_LOCK, "a locked wheel is flattened", f"part == '{BELIEF}'", dict([MOST_LOCKED])),
    _aim("before", "at 0.08 and above it is no worse than with the reference before",
         " or ".join(
             f"curve == '{curve}' and adhesion == {level} and adhesion_used >= {old.used - ROUNDING} and "
             f"damage_kj <= {old.damage * (1.0 + ROUNDING)}"
             for (curve, level), old in BEFORE.items()
         ),
         "low adhesion is not paid for elsewhere",
         " or ".join(f"{THREE} and adhesion == {level}" for level in dict.fromkeys(level for _, level in BEFORE))),
    _aim("drawn", "drawn stops lock no wheel and stay within 2.5 points of the true speed", f"{NO_LOCK} and {NEAR}",
         "the same aims on rails drawn at random", f"part == '{DRAWN}'"),
)  # fmt: skip


def acceptance_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements, on the rows that succeeded."""
    return [_over(claim, table) for claim in CLAIMS]


def _over(claim: Claim, stops: pd.DataFrame) -> Statement:
    """A claim over stops that count alike; the stops that do not meet it are told by part, train and curve."""
    rows = claim.bearing(stops)
    good = claim.values(stops).astype(bool)
    broken = rows[~good]
    groups = broken.groupby(["part", "train", "curve"], sort=False) if len(broken) else ()
    words = {
        f"with {part}, {train}, {curve}: {_levels(own)}": False
        for (part, train, curve), own in groups
    }
    share = Interval(float(good.mean()), math.nan, math.nan, len(good))
    numbers = {"stops that meet it": share} | _ranges(claim.name, rows)
    return conjunction(rows, claim, words, numbers=numbers, least_events=1)


def _ranges(name: str, rows: pd.DataFrame) -> dict[str, Interval | float]:
    """Numbers of a claim with their range over the stops."""
    if name == "estimate":
        return {
            "short of the true speed [points]: mean, least and most": _range(
                100.0 * quantity(rows, SHORT)
            )
        }
    if name == "damage":
        return {"Q [kJ]: mean, least and most": _range(rows["damage_kj"])}
    if name == "used":
        return {f"used at {level:g}: mean, least and most": _range(rows["adhesion_used"][rows["adhesion"] == level])
                for level in sorted(set(rows["adhesion"]))}  # fmt: skip
    if name == "before" and len(rows):
        return {f"{word} before, {curve} {level:g}": value for (curve, level), old in BEFORE.items()
                for word, value in (("used", old.used), ("Q [kJ]", old.damage))}  # fmt: skip
    return {}


def _levels(rows: pd.DataFrame) -> str:
    """Levels at which a claim is not met, each with how often where it is more than once."""
    counts = rows["adhesion"].round(3).value_counts(sort=False).sort_index()
    return ", ".join(f"{level:g}" + (f" ({n})" if n > 1 else "") for level, n in counts.items())


def _range(values: "pd.Series[float]") -> Interval:
    return Interval(values.mean(), values.min(), values.max(), len(values))


TRUE = "true_speed_"
"""Beginning of the columns of the stop with the true speed."""


def stop_row(case: StopCase) -> dict[str, Any]:
    """Measures of a stop and, where it is compared, those of the same one with the true speed."""
    stop = case.stop()
    row = case.columns | {"event": stop.event.name, "reference": "estimated"}
    row |= measured(stopped_run(stop.event), stop)
    if case.compared:
        told = stop.under(ReferenceSpeed(source="truth"))
        found = measured(stopped_run(told.event), told)
        row |= {TRUE + name: value for name, value in found.items()}
    return row


def cells(
    seed: int,
    events: int,
    adhesion: Sequence[float] | None = None,
    curve: Sequence[str] | None = None,
    speed_kmh: float | None = None,
    train: str | None = None,
    law: str = "fuzzy",
) -> list[Task]:
    """The table and `events` drawn stops; or, where something is chosen, stops on uniform rail as asked for."""
    if law not in LAWS:
        raise StudyError(f"--law {law}: give one of {', '.join(LAWS)}")
    if (adhesion, curve, speed_kmh, train) == (None,) * 4:
        chosen = [*table_cases(law), *(drawn_case(seed, k, law) for k in range(events))]
    else:
        chosen = chosen_cases(adhesion, curve, speed_kmh, train, law)
    return [Task(label_of(case), stop_row, (case,), tuple(case.columns.items())) for case in chosen]


def label_of(case: StopCase) -> str:
    """Name of a case: its part, train, curve, levels and what else is not as usual."""
    levels = case.levels if isinstance(case.levels, (int, float)) else tuple(case.levels)
    parts = (case.part, case.train.name, case.curve, levels, case.speed, case.grade)
    return "/".join(map(str, (*parts, case.friction_factor, case.law)))


WSP_ACCEPTANCE = Study(
    name="wsp-acceptance",
    question="whether one setting of the slide protection serves every rail from adhesion 0.02 up",
    default_events=12,
    cells=cells,
    judge=lambda table: acceptance_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
    shown={
        "part": "part", "train": "train", "event": "event",
        "adhesion_used": "used", "true_speed_adhesion_used": "with true speed",
        "locked_axle_s": "locked [axle s]", "damage_kj": "Q [kJ]", "air_nl": "air [Nl]", "distance_m": "distance [m]",
    },
)  # fmt: skip
