"""Running time by steps of distance, as timetable programs calculate it: the train as one mass, without wheels or control.

The scheme of TrainRuns.jl: a mass point at the train's front, explicit Euler in the distance. The same effort, resistance
and limits as in the simulated run, for comparison with it and with such programs.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.files.study_error import StudyError
from studies.lines.driving_style import FASTEST, Coasting, DrivingStyle, Leg
from studies.lines.train_forces import TrainForces
from studies.railtoolkit.records import Section

Floats = NDArray[np.float64]

USUAL_STEP = 20.0
"""Step [m] of TrainRuns.jl where nothing else is set."""
FALL = 0.19
"""Share of the kinetic energy that a train loses at most in a step without effort; a tenth of its speed."""


@dataclass(frozen=True)
class DistanceRun:
    """Position of the front [m], speed [m/s] and time [s] at the ends of the steps, (points,)."""

    position: Floats
    speed: Floats
    time: Floats

    @property
    def running_time(self) -> float:
        """[s]"""
        return float(self.time[-1])


def run_by_distance(
    forces: TrainForces,
    sections: Sequence[Section],
    legs: Sequence[Leg],
    step: float = USUAL_STEP,
    style: DrivingStyle = FASTEST,
    spread: bool = False,
) -> DistanceRun:
    """Run the `legs` over the line's `sections`, in steps of `step` [m] or less.

    Over a step the acceleration is that of its beginning, so the error falls with the first power of the step. Steps end
    where gradient or limit change, and where a limit or a braking curve is met. `spread`: each car is where it stands, in
    place of a mass point at the front. Raises `StudyError` where the train cannot climb.
    """
    x, t = sections[0].start, 0.0
    points = [(x, 0.0, t)]
    for leg in legs:
        points += _run_leg(forces, sections, leg, step, style, spread, x, t)
        x, t = leg.profile.end, points[-1][2] + (leg.stop.dwell or 0.0)
        points.append((x, 0.0, t))
    columns = np.array(points).T
    return DistanceRun(*columns)


def _run_leg(
    forces: TrainForces, sections: Sequence[Section], leg: Leg, step: float, style: DrivingStyle,
    spread: bool, x: float, t: float,
) -> list[tuple[float, float, float]]:  # fmt: skip
    """Position, speed and time after each step from standstill at `x` [m] and `t` [s] to the stop."""
    profile, b, v = leg.profile, leg.profile.deceleration, 0.0
    starts = [section.start for section in sections]
    coasting = Coasting(style)
    points = []
    while x < profile.end - 1e-9:
        limit = profile.limit(x)
        section = sections[max(bisect_right(starts, x) - 1, 0)]
        change = min(profile.next_change(x), section.end, profile.end)
        reach = min(step, change - x)
        climbing = forces.climbing_at(x) if spread else forces.climbing(section.grade)
        resistance = forces.level_resistance(v) + climbing
        rolls = coasting(profile, x, v)
        pull = 0.0 if rolls else style.effort * forces.effort(v)
        a = (pull - resistance) / forces.inertia
        if v >= limit:
            a = min(a, 0.0)  # held: with less than all effort, or the brake
        if rolls and a < 0.0:
            reach = min(reach, FALL * v**2 / (-2.0 * a))  # it pulls again before it stands
        if v**2 + 2.0 * a * reach <= 0.0:
            raise StudyError(
                f"the train cannot climb at {x:.0f} m: effort {1e-3 * pull:.1f} kN, "
                f"resistance and gradient {1e-3 * resistance:.1f} kN"
            )
        if a > 0.0:
            reach = min(reach, (limit**2 - v**2) / (2.0 * a))
        room = profile.braking_speed(x) ** 2 - v**2
        braking = room <= 2.0 * (a + b) * reach
        if braking and a + b > 0.0:
            reach = max(room, 0.0) / (2.0 * (a + b))
        after = min(math.sqrt(v**2 + 2.0 * a * reach), limit)
        x, t, v = x + reach, t + (2.0 * reach / (v + after) if reach > 0.0 else 0.0), after
        points.append((x, v, t))
        if braking:
            station, speed = profile.next_fall(x)
            t += (v - speed) / b
            x, v = station, speed
            points.append((x, v, t))
    return points
