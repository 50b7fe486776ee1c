"""Running time by steps of distance, as timetable programs calculate it: the train as one mass, without wheels or control.

The same effort, resistance and limits as in the simulated run, for comparison with it and with such programs.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.files.study_error import StudyError
from studies.lines.speed_profile import SpeedProfile
from studies.lines.train_forces import TrainForces

Floats = NDArray[np.float64]

USUAL_STEP = 20.0
"""Step [m] of TrainRuns.jl where nothing else is set."""


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
    forces: TrainForces, profile: SpeedProfile, start: float = 0.0, step: float = USUAL_STEP
) -> DistanceRun:
    """Run from standstill at `start` [m] to the stop at the end of `profile`, in steps of `step` [m] or less.

    Explicit Euler: over a step the acceleration is that of its beginning, so the error falls with the first power of the
    step. Steps end at changes of the limit and where a limit or a braking curve is met. Raises `StudyError` where the train
    cannot climb.
    """
    b = profile.deceleration
    x, v, t = start, 0.0, 0.0
    points = [(x, v, t)]
    while x < profile.end - 1e-9:
        limit = profile.limit(x)
        change = profile.next_change(x)
        reach = min(step, change - x)
        resistance = forces.forward_resistance(x, v)
        a = (forces.effort(v) - resistance) / forces.inertia
        if v >= limit:
            a = min(a, 0.0)  # held: with less than all effort, or the brake
        if v**2 + 2.0 * a * reach <= 0.0:
            raise StudyError(
                f"the train cannot climb at {x:.0f} m: effort {1e-3 * forces.effort(v):.1f} kN, "
                f"resistance and gradient {1e-3 * resistance:.1f} kN"
            )
        if a > 0.0:
            reach = min(reach, (limit**2 - v**2) / (2.0 * a))
        room = profile.braking_speed(x) ** 2 - v**2
        braking = room <= 2.0 * (a + b) * reach
        if braking:
            reach = max(room, 0.0) / (2.0 * (a + b))
        after = min(math.sqrt(v**2 + 2.0 * a * reach), limit)
        x, t, v = x + reach, t + (2.0 * reach / (v + after) if reach > 0.0 else 0.0), after
        points.append((x, v, t))
        if braking:
            station, speed = profile.next_fall(x)
            t += (v - speed) / b
            x, v = station, speed
            points.append((x, v, t))
    columns = np.array(points).T
    return DistanceRun(*columns)
