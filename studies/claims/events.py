"""Random slip events for Monte Carlo studies: every drawn quantity in one table, each with its distribution and reason."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from alloc.plant.equations import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
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


class Quantity(NamedTuple):
    """A drawn quantity: distribution and reason in words, and the draw, which may read what was drawn before it."""

    distribution: str
    reason: str
    draw: Callable[[np.random.Generator, dict[str, Any]], Any]


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
    "slope": Quantity(
        "uniform, 0 ... 0.0332: from no growth along the train to twice what it believes",
        "JP5484215 (15): 0.0083 where the planned coefficient is 0.07; in proportion 0.0166 at starting, always believed",
        lambda g, _: float(g.uniform(0.0, 2.0 * BELIEVED_SLOPE)),
    ),
    "scatter": Quantity(
        "uniform, 0 ... 0.012, correlated over 20 m",
        "JP5484215 par. on (12)-(15): 0.012 over all its measurements; one stretch of one day scatters less",
        lambda g, _: float(g.uniform(0.0, 0.012)),
    ),
    "patch_factor": Quantity(
        "none in 70 %, else the coefficient times a uniform 0.6 ... 0.9",
        "assumed: leaves, oil or a leaking drain do not lie everywhere",
        lambda g, _: float(g.uniform(0.6, 0.9)) if g.random() < 0.3 else 1.0,
    ),
    "patch_start_m": Quantity(
        "uniform, 5 ... 40 m", "assumed: met during the event", lambda g, _: float(g.uniform(5, 40))
    ),
    "patch_length_m": Quantity(
        "uniform, 20 ... 60 m", "assumed: one to three cars", lambda g, _: float(g.uniform(20, 60))
    ),
    "speed_law": Quantity(
        "none in half, Curtius-Kniffler and JP5484215 (12) in a quarter each",
        "adhesion falls with speed; how much over the first 36 km/h is disputed",
        lambda g, _: str(g.choice(["none", "curtius-kniffler", "shinkansen"], p=[0.5, 0.25, 0.25])),
    ),
    "load_t": Quantity(
        "uniform, 0 ... 8 t per car on the mean",
        "12 t is a crowded car; up to 8 t the motors reach the plan throughout",
        lambda g, _: float(g.uniform(0.0, 8.0)),
    ),
    "tilt": Quantity(
        "uniform, -0.8 ... 0.8: the load's growth from the middle to the rear end, over its mean",
        "assumed: passengers gather near stairs at one end of the platform",
        lambda g, _: float(g.uniform(-0.8, 0.8)),
    ),
    "load_error": Quantity(
        "uniform, 0 ... 0.05", "assumed: pressure of air springs", lambda g, _: float(g.uniform(0.0, 0.05))
    ),
    "speed_noise_kmh": Quantity(
        "uniform, 0 ... 0.04 km/h",
        "twice the scenario scattered-rail at most",
        lambda g, _: float(g.uniform(0.0, 0.04)),
    ),
    "telegram_loss": Quantity(
        "uniform, 0 ... 0.05", "the scenario scattered-rail at most", lambda g, _: float(g.uniform(0.0, 0.05))
    ),
    "grade_permille": Quantity(
        "0 in 60 %, else uniform, 5 ... 20 per mille uphill",
        "most stations are level; 20 per mille as in gradient-start",
        lambda g, _: float(g.uniform(5.0, 20.0)) if g.random() < 0.4 else 0.0,
    ),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""


def draw(seed: int, k: int) -> dict[str, Any]:
    """The quantities of event `k`: they follow from `seed` and `k` alone, so a longer study extends a shorter one."""
    generator = np.random.default_rng([seed, k])
    drawn: dict[str, Any] = {}
    for name, quantity in QUANTITIES.items():
        drawn[name] = quantity.draw(generator, drawn)
    return drawn


def event_name(seed: int, k: int) -> str:
    """Name of event `k`."""
    return f"random-{seed}-{k:04d}"


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


def drawn_table(seed: int, events: int) -> pd.DataFrame:
    """What was drawn, one row per event, with the scenario's name to join on."""
    rows = [{"scenario": event_name(seed, k), **draw(seed, k)} for k in range(events)]
    return pd.DataFrame(rows)
