"""What the rail and the motors allowed a train, how much of it was used, and how much of it only sharing could reach.

All forces are at the rail, summed over the axles of a traction unit [N]. A unit has one torque for all its axles, so its
weakest axle bounds it. Where a trailer brakes with air, nobody but itself can use its adhesion.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.registry import (
    NEVER_NEGATIVE,
    SHARE,
    direction,
    force_along,
    force_available,
    instants_in,
    metric,
    once_per_run,
    series,
    under_demand,
)
from alloc.onboard.reports import WHOLE

SETTLING = 2.0
"""Time [s] left out after the driver asks for more: torque rises in 1 s, and cylinders take as long to fill."""

Floats = NDArray[np.float64]


class Room(NamedTuple):
    """Forces [N] at the instants that count, (instants,) each."""

    plan: Floats
    """What the driver asks for."""
    bound: Floats
    """The largest force that the train can deliver, but no more than the plan."""
    apart: Floats
    """The largest force if each unit delivers no more than its own part of the plan."""
    force: Floats
    """Delivered force; less than 0 where a train turns wheels that its motors do not."""
    held_back: Floats
    """Shortfall from the bound at units that deliver less than they could while their own controllers limit them."""


@once_per_run
def settled(run: xr.Dataset) -> NDArray[np.bool_]:
    """Instants under demand at least `SETTLING` after the demand has grown, (time,)."""
    asked = np.abs(series(run, "driver_command"))
    wait = max(1, instants_in(run, SETTLING))
    grown = np.flatnonzero(np.diff(asked, prepend=0.0) > 0.0)
    calm = under_demand(run).copy()
    for k in grown:
        calm[k : k + wait] = False
    return calm


def _weakest(values: Floats, groups: NDArray[np.int64], count: int) -> Floats:
    """Number of its axles times the least of them, (time, group)."""
    found = np.empty((values.shape[0], count))
    for g in range(count):
        own = groups == g
        found[:, g] = own.sum() * values[:, own].min(axis=1)
    return found


@once_per_run
def room(run: xr.Dataset) -> Room:
    """Plan, bounds and force at the instants that count.

    The bound is min(plan, sum over units of min(motor limit, axles x force available at the weakest axle)). Under blended
    brakes, air makes up for the motors. Each trailer's brake group adds its own part of the plan, as far as the rail carries
    it.
    """
    chosen = settled(run)
    blended = bool(run.attrs["blended_brakes"])
    braking = direction(run)[chosen] < 0.0
    unit, group = series(run, "axle_unit"), series(run, "axle_group")
    available, force = force_available(run)[chosen], force_along(run)[chosen]
    expected = series(run, "expected")[chosen]
    driven = unit >= 0
    own = expected[:, None] * series(run, "unit_static_load")
    units = run.sizes["unit"]
    most = _weakest(available, unit, units)
    axles = np.bincount(unit[driven], minlength=units)
    at_rail = axles * series(run, "unit_gear") / series(run, "unit_radius")
    signed = np.where(
        braking[:, None],
        series(run, "brake_limit")[chosen],
        series(run, "drive_limit")[chosen],
    )
    # what turns the wheelsets comes from the motors and does not reach the rail
    turning = np.bincount(unit[driven], series(run, "axle_turning_mass")[driven], minlength=units)
    gained = np.maximum(direction(run) * series(run, "acceleration"), 0.0)[chosen]
    motors = np.maximum(at_rail * signed - turning * gained[:, None], 0.0)
    most = np.minimum(most, np.where(braking[:, None] & blended, np.inf, motors))
    plan, bound = own.sum(axis=1), most.sum(axis=1)
    apart = np.minimum(own, most).sum(axis=1)
    delivered = force[:, driven].sum(axis=1)
    if blended:
        trailing = ~driven & (group >= 0)
        numbers, inside = np.unique(group[trailing], return_inverse=True)
        planned = expected[:, None] * np.bincount(inside, series(run, "axle_static_load")[trailing])
        carried = np.minimum(planned, _weakest(available[:, trailing], inside, numbers.size))
        for total, part in (
            (plan, planned), (bound, carried), (apart, carried), (delivered, force[:, trailing]),
        ):  # fmt: skip
            total += np.where(braking, part.sum(axis=1), 0.0)
    bound = np.minimum(plan, bound)
    limited = series(run, "torque_factor")[chosen] < WHOLE
    # who resists has lost all that he could give, and no more
    unused = np.clip(most - _of_units(force, unit, units), 0.0, most)
    short = bound - np.clip(delivered, 0.0, bound)
    held_back = np.minimum((limited * unused).sum(axis=1), short)
    return Room(plan, bound, np.minimum(plan, apart), delivered, held_back)


def _of_units(values: Floats, unit: NDArray[np.int64], units: int) -> Floats:
    """Sum over the axles of each unit, (time, unit)."""
    return values @ (unit[:, None] == np.arange(units)).astype(float)


def _share(part: Floats, whole: Floats) -> float:
    return float(part.sum() / whole.sum()) if whole.sum() else float("nan")


@metric(
    "bound_use",
    "1",
    "effort, at each instant within 0 and the bound, over the most that rail and motors allow",
    +1,
    SHARE,
)
def bound_use(run: xr.Dataset) -> float:
    """Effort over the true bound of the run; nan without demand, or where nothing could be delivered.

    At each instant it counts within 0 and the bound: wheels that slow down give back for a moment what turned them, which
    says nothing of how the bound is used later.
    """
    found = room(run)
    return _share(np.clip(found.force, 0.0, found.bound), found.bound)


@metric(
    "held_back",
    "1",
    "share of the bound that readhesion controllers lose at the units they limit",
    -1,
    SHARE,
)
def held_back(run: xr.Dataset) -> float:
    """Shortfall from the bound at units whose own controllers limit them, over the bound.

    1 - `bound_use` - `held_back` is what sharing leaves: units that could carry more and are not asked to.
    """
    found = room(run)
    return _share(found.held_back, found.bound)


@metric("headroom", "1", "share of the plan that only sharing between units can reach", 0, SHARE)
def headroom(run: xr.Dataset) -> float:
    """Bound of the train less the sum of what each unit can deliver of its own part of the plan, over the plan."""
    found = room(run)
    return _share(found.bound - found.apart, found.plan)


@metric("over_delivery", "1", "effort beyond the plan, relative to it", -1, NEVER_NEGATIVE)
def over_delivery(run: xr.Dataset) -> float:
    """Effort beyond the plan, instant by instant, over the plan; `bound_use` does not count it."""
    found = room(run)
    return _share(np.maximum(found.force - found.plan, 0.0), found.plan)
