"""The random slip events of the claims: what is drawn, each with its distribution and reason, and their scenarios."""

from typing import Any

import numpy as np

from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
from studies.core import drawn_scenarios as shared
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
