"""Stops of the study: the table of levels and curves and its surroundings, drawn stops, and stops that the user asks for."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.event import Event
from alloc.metrics.registry import record_period, series
from alloc.metrics.use import LOCK_SPEED, STANDING_SPEED, air_consumption, damage, locked_time
from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.model import build
from alloc.plant.sets import find_set
from alloc.plant.train import Car, Train
from alloc.simulation import simulate
from studies.core.drawn_events import DrawnEvents, Quantity, in_turn, sometimes, uniform
from studies.files.study_error import StudyError, unknown
from studies.scenario.train_keys import build_train
from studies.slides.jp4209318 import slide_protection, slide_train
from studies.stops.acceptance_stops import (
    CURVES,
    REFERENCE_SPEED,
    ROLLING,
    Levels,
    SpecifiedStop,
    adhesion_share,
    air_braked,
    energy_offered,
    gripping,
    perfect_stop,
    rail_of,
    stop_of,
)  # fmt: skip

LEVELS = (0.02, 0.03, 0.05, 0.08)
ABOVE = (0.12,)
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
        yield from (replace(three, levels=level) for level in ABOVE)
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
