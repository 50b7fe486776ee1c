"""The random slip events of the claims: what is drawn, each with its distribution and reason, and their scenarios."""

from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.registry import EITHER_WAY, series
from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
from studies.core import drawn_events as shared
from studies.core.drawn_events import DrawnEvents, Quantity, one_of, uniform
from studies.scenario.scenario import Scenario

BASE = "wet-start"
"""Scenario that every event is a change of: the eight-car commuter train pulls away at 3.0 km/h/s."""
DURATION = 12.0
"""Length of an event [s]; at its end, near 36 km/h, the motors still reach the plan."""
CARS = 8
OFFSET_OF_SLOPE = -0.0066 / 0.0083
"""Offset over slope in JP5484215 (15)."""
BELIEVED_SLOPE = 0.0166
"""Slope of the increments that the train believes in, in every event: what is stored changes less than the weather."""
LEVELS = {"summer": (0.138, 0.012), "winter": (0.118, 0.018)}
"""Mean and standard deviation of the level by season."""
LEVEL_BOUNDS = (0.06, 0.20)

QUANTITIES: dict[str, Quantity] = {
    "season": one_of(
        list(LEVELS), "summer or winter, equally likely",
        "JP5484215 names the difference between summer and winter as what a preset pattern cannot follow",
    ),
    "level": Quantity(
        "normal, summer 0.138 ± 0.012, winter 0.118 ± 0.018, cut to 0.06 ... 0.20; of the first four axles at 15 km/h",
        "assumed: in summer the front often falls short and the whole does not, in winter the whole often does too",
        lambda g, d: float(np.clip(g.normal(*LEVELS[d["season"]]), *LEVEL_BOUNDS)),
    ),
    "slope": uniform(
        0.0, 2.0 * BELIEVED_SLOPE, ": from no growth along the train to twice what it believes",
        "JP5484215 (15): 0.0083 where the planned coefficient is 0.07; in proportion 0.0166 at starting, always believed",
    ),
    "scatter": uniform(
        0.0, 0.012, ", correlated over 20 m",
        "JP5484215 par. on (12)-(15): 0.012 over all its measurements; one stretch of one day scatters less",
    ),
    "patch_factor": shared.BAD_PATCH,
    "patch_start_m": uniform(5.0, 40.0, " m", "assumed: met during the event"),
    "patch_length_m": uniform(20.0, 60.0, " m", "assumed: one to three cars"),
    "speed_law": one_of(
        ["none", "curtius-kniffler", "shinkansen"],
        "none in half, Curtius-Kniffler and JP5484215 (12) in a quarter each",
        "adhesion falls with speed; how much over the first 36 km/h is disputed", [0.5, 0.25, 0.25],
    ),
    "load_t": uniform(
        0.0, 8.0, " t per car on the mean", "12 t is a crowded car; up to 8 t the motors reach the plan throughout"
    ),
    "tilt": shared.TILT,
    "load_error": shared.LOAD_ERROR,
    "speed_noise_kmh": shared.SPEED_NOISE,
    "telegram_loss": shared.TELEGRAM_LOSS,
    "grade_permille": shared.UPHILL,
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("random", QUANTITIES)
draw, event_name, drawn_table = EVENTS.draw, EVENTS.event_name, EVENTS.table


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = draw(seed, k)
    if d["speed_law"] == "none":
        level = {"level": float(d["level"])}
    else:
        at_reference = hyperbolic_speed_law(shared.START_SPEED, *SPEED_LAWS[d["speed_law"]])
        level = {"law_factor": float(d["level"] / at_reference)}
    rail = level | {"speed_law": d["speed_law"], "increments": _increments(d["slope"])}
    rail |= shared.uneven(d["scatter"], shared.drawn_patch(d))
    return shared.drawn_scenario(
        BASE, event_name(seed, k), f"random event {k}", duration, rail, d,
        load_t=shared.tilted_loads(d, CARS), line=shared.graded(d), belief={"increments": _increments(BELIEVED_SLOPE)},
    )  # fmt: skip


def _increments(slope: float) -> dict[str, Any]:
    return {"law": "logarithmic", "slope": slope, "offset": OFFSET_OF_SLOPE * slope}


# What sweeps read from a recorded run beside the metrics: adhesion and its use, unit by unit, once torque is up.

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
    time, command = series(run, "time"), series(run, "driver_command")
    demand = command != 0.0
    window = demand & (time >= time[int(np.argmax(demand))] + SETTLING)
    unit_of_axle = series(run, "axle_unit")
    units = run.sizes["unit"]
    member = (unit_of_axle[:, None] == np.arange(units)).astype(float)
    force = (np.sign(command)[:, None] * series(run, "rail_force"))[window] @ member
    available = (series(run, "adhesion_limit") * series(run, "axle_load"))[window] @ member
    load = series(run, "axle_load")[window] @ member
    planned = series(run, "planned_coefficient")[window]
    limit = series(run, "limit")[window]
    adhesion = series(run, "adhesion_limit")[window] @ (member / member.sum(axis=0))
    reach = available.sum(axis=1) / load.sum(axis=1) / planned
    use = force.sum(axis=0) / available.sum(axis=0)
    step = float(time[1] - time[0])
    return {
        "held_effort": float(force.sum() / (planned * load.sum(axis=1)).sum()),
        "reach_low": float(np.quantile(reach, 0.05)),
        "reach_high": float(np.quantile(reach, 0.95)),
        "front_low": float(np.quantile(adhesion[:, 0] / planned, 0.05)),
        "unit_use_low": float(use.min()),
        "unit_use_mean": float(use.mean()),
        "over_share": float((limit > adhesion).mean()),
        "limit_travel": float(
            (np.abs(np.diff(limit, axis=0)).sum(axis=0) / planned.mean()).mean()
        ),
        **_under_excess(
            limit / adhesion - 1.0, force, available, series(run, "case")[window] > 0.0, step
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
