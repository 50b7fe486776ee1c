"""What a stop is judged by: adhesion used, locked axles, wheel damage, air, distance."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.event import Event
from alloc.metrics.registry import record_period, series
from alloc.metrics.use import LOCK_SPEED, STANDING_SPEED, air_consumption, damage, locked_time
from alloc.simulation import simulate
from studies.wsp_acceptance.events import SpecifiedStop
from studies.wsp_acceptance.perfect_stop import adhesion_share, energy_offered

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
