"""Random slip events for Monte Carlo studies: every drawn quantity in one table, each with its distribution and reason."""

from typing import Any

import numpy as np

from alloc.plant.equations import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
from studies.claims.drawn_events import DrawnEvents, Quantity, sometimes, uniform
from studies.scenario.loading import load_scenario
from studies.scenario.scenario import Scenario

BASE = "wet-start"
"""Scenario that every event is a change of: the eight-car commuter train pulls away at 3.0 km/h/s."""
DURATION = 12.0
"""Length of an event [s]; at its end, near 36 km/h, the motors still reach the plan."""
CARS = 8
BELIEVED_SLOPE = 0.0166
"""Slope of the increments that the train believes in, in every event: what is stored changes less than the weather."""
OFFSET_OF_SLOPE = -0.0066 / 0.0083
"""Offset over slope in JP5484215 (15)."""
REFERENCE_SPEED = 15.0 / 3.6
"""Speed at which rails of different speed laws have the drawn level [m/s]."""


LEVELS = {"summer": (0.138, 0.012), "winter": (0.118, 0.018)}
"""Mean and standard deviation of the level by season."""
LEVEL_BOUNDS = (0.06, 0.20)

QUANTITIES: dict[str, Quantity] = {
    "season": Quantity(
        "summer or winter, equally likely",
        "JP5484215 names the difference between summer and winter as what a preset pattern cannot follow",
        lambda g, _: str(g.choice(list(LEVELS))),
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
    "patch_factor": sometimes(
        0.3, 0.6, 0.9, " times the coefficient", 1.0, "assumed: leaves, oil or a leaking drain do not lie everywhere",
    ),
    "patch_start_m": uniform(5.0, 40.0, " m", "assumed: met during the event"),
    "patch_length_m": uniform(20.0, 60.0, " m", "assumed: one to three cars"),
    "speed_law": Quantity(
        "none in half, Curtius-Kniffler and JP5484215 (12) in a quarter each",
        "adhesion falls with speed; how much over the first 36 km/h is disputed",
        lambda g, _: str(g.choice(["none", "curtius-kniffler", "shinkansen"], p=[0.5, 0.25, 0.25])),
    ),
    "load_t": uniform(
        0.0, 8.0, " t per car on the mean", "12 t is a crowded car; up to 8 t the motors reach the plan throughout"
    ),
    "tilt": uniform(
        -0.8, 0.8, ": the load's growth from the middle to the rear end, over its mean",
        "assumed: passengers gather near stairs at one end of the platform",
    ),
    "load_error": uniform(0.0, 0.05, "", "assumed: pressure of air springs"),
    "speed_noise_kmh": uniform(0.0, 0.04, " km/h", "twice the scenario scattered-rail at most"),
    "telegram_loss": uniform(0.0, 0.05, "", "the scenario scattered-rail at most"),
    "grade_permille": sometimes(
        0.4, 5.0, 20.0, " per mille uphill", 0.0, "most stations are level; 20 per mille as in gradient-start"
    ),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("random", QUANTITIES)
draw, event_name, drawn_table = EVENTS.draw, EVENTS.event_name, EVENTS.table


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = draw(seed, k)
    if d["speed_law"] == "none":
        level = d["level"]
    else:
        level = d["level"] / hyperbolic_speed_law(REFERENCE_SPEED, *SPEED_LAWS[d["speed_law"]])
    position = np.linspace(-1.0, 1.0, CARS)
    patch = {
        "factor": d["patch_factor"],
        "start_m": d["patch_start_m"],
        "end_m": d["patch_start_m"] + d["patch_length_m"],
        "edge_m": 4.0,
    }
    return load_scenario(BASE).changed(
        name=event_name(seed, k),
        title=f"random event {k}",
        case=None,
        duration_s=duration,
        load_t=tuple((d["load_t"] * (1.0 + d["tilt"] * position)).tolist()),
        rail={
            "level": float(level),
            "speed_law": d["speed_law"],
            "increments": _increments(d["slope"]),
            "scatter": d["scatter"],
            "scatter_length_m": 20.0,
            "patches": [patch] if d["patch_factor"] < 1.0 else [],
        },
        line={"sections": [{"start_m": -1000.0, "grade_permille": d["grade_permille"]}]},
        belief={"increments": _increments(BELIEVED_SLOPE)},
        onboard={
            "sensors": {"speed_noise_kmh": d["speed_noise_kmh"], "load_error": d["load_error"]},
            "telegrams": {"jitter_s": 0.03, "loss": d["telegram_loss"]},
        },
    )


def _increments(slope: float) -> dict[str, Any]:
    return {"law": "logarithmic", "slope": slope, "offset": OFFSET_OF_SLOPE * slope}
