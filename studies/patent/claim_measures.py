"""What sweeps read from a recorded run beside the metrics: adhesion and its use, unit by unit, once torque is up."""

from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.registry import EITHER_WAY

SETTLING = 2.0
"""Time after the first demand [s] that is left out: torque rises in 1 s, and the first slip needs to be detected."""

EXCESS_EDGES = (0.0, 0.05, 0.10, 0.15, 0.30)
"""Bounds of the classes of a limit's excess over the true adhesion, as a share of the latter."""
SOMEWHAT_TOO_HIGH = 0.15
"""Excess up to which a limit counts as somewhat too high; the train's sigma of 0.012 is 8 % of 0.15."""

Floats = NDArray[np.float64]


def excess_column(k: int) -> str:
    """Column of the adhesion used in class `k` of `EXCESS_EDGES`."""
    return f"use_over_{round(100 * EXCESS_EDGES[k])}_{round(100 * EXCESS_EDGES[k + 1])}"


RANGES = dict.fromkeys(
    ("effort_up_to_plan", "unit_use_low", "unit_use_mean", "use_over",
     *map(excess_column, range(len(EXCESS_EDGES) - 1))), EITHER_WAY
)  # fmt: skip
"""Least and greatest value of measures that have bounds."""


def measure(run: xr.Dataset) -> dict[str, float]:
    """Numbers of one run, from `SETTLING` after the first demand on; coefficients count in the direction of the demand.

    - held_effort: rail force of the driven axles over the force that the plan's coefficient asks of them, 1 without slip.
    - reach_low, reach_high: 5 % and 95 % quantile over time of the adhesion of all units, weighted with load, over the
      plan's coefficient; front_low: the lower one of the foremost unit.
    - unit_use_low, unit_use_mean: adhesion used by the unit that uses least, and the mean over units.
    - over_share: share of units and time with a limit above the true adhesion (mean over the unit's axles).
    - over_time [s]: unit seconds under a limit of the rule that is `SOMEWHAT_TOO_HIGH`.
    - use_over: adhesion used there, and by class of excess.
    - limit_travel: total movement of the limit, up and down, mean over units, over the plan's coefficient.
    """
    time, command = run["time"].values, run["driver_command"].values
    demand = command != 0.0
    window = demand & (time >= time[int(np.argmax(demand))] + SETTLING)
    unit_of_axle = run["axle_unit"].values
    units = run.sizes["unit"]
    member = (unit_of_axle[:, None] == np.arange(units)).astype(float)
    force = (np.sign(command)[:, None] * run["rail_force"].values)[window] @ member
    available = (run["adhesion_limit"].values * run["axle_load"].values)[window] @ member
    load = run["axle_load"].values[window] @ member
    expected = run["expected"].values[window]
    limit = run["limit"].values[window]
    adhesion = run["adhesion_limit"].values[window] @ (member / member.sum(axis=0))
    reach = available.sum(axis=1) / load.sum(axis=1) / expected
    use = force.sum(axis=0) / available.sum(axis=0)
    step = float(time[1] - time[0])
    return {
        "held_effort": float(force.sum() / (expected * load.sum(axis=1)).sum()),
        "reach_low": float(np.quantile(reach, 0.05)),
        "reach_high": float(np.quantile(reach, 0.95)),
        "front_low": float(np.quantile(adhesion[:, 0] / expected, 0.05)),
        "unit_use_low": float(use.min()),
        "unit_use_mean": float(use.mean()),
        "over_share": float((limit > adhesion).mean()),
        "limit_travel": float(
            (np.abs(np.diff(limit, axis=0)).sum(axis=0) / expected.mean()).mean()
        ),
        **_under_excess(
            limit / adhesion - 1.0, force, available, run["case"].values[window] > 0.0, step
        ),
    }


def _under_excess(
    excess: Floats, force: Floats, available: Floats, ruled: NDArray[np.bool_], step: float
) -> dict[str, float]:
    """Adhesion used where a rule's limit exceeds it, as a whole up to `SOMEWHAT_TOO_HIGH` and by class."""

    def used(low: float, high: float) -> tuple[float, float]:
        chosen = (excess > low) & (excess <= high) & ruled[:, None]
        if not chosen.any():
            return float("nan"), 0.0
        return float(force[chosen].sum() / available[chosen].sum()), step * float(chosen.sum())

    use, seconds = used(0.0, SOMEWHAT_TOO_HIGH)
    classes = pairwise(EXCESS_EDGES)
    return {
        "use_over": use,
        "over_time": seconds,
        **{excess_column(k): used(*bounds)[0] for k, bounds in enumerate(classes)},
    }
