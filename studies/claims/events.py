"""The random slip events of the claims as scenarios."""

from typing import Any

import numpy as np

from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS
from studies.claims.quantities import BELIEVED_SLOPE, draw, event_name
from studies.files.units import stated
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

BASE = "wet-start"
"""Scenario that every event is a change of: the eight-car commuter train pulls away at 3.0 km/h/s."""
DURATION = 12.0
"""Length of an event [s]; at its end, near 36 km/h, the motors still reach the plan."""
CARS = 8
OFFSET_OF_SLOPE = -0.0066 / 0.0083
"""Offset over slope in JP5484215 (15)."""
REFERENCE_SPEED = 15.0 / 3.6
"""Speed at which rails of different speed laws have the drawn level [m/s]."""


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = draw(seed, k)
    if d["speed_law"] == "none":
        level = {"level": float(d["level"])}
    else:
        at_reference = hyperbolic_speed_law(REFERENCE_SPEED, *SPEED_LAWS[d["speed_law"]])
        level = {"law_factor": float(d["level"] / at_reference)}
    position = np.linspace(-1.0, 1.0, CARS)
    loads = d["load_t"] * (1.0 + d["tilt"] * position)
    noise = stated("_kmh", d["speed_noise_kmh"])
    patch = {
        "factor": d["patch_factor"],
        "start_m": d["patch_start_m"],
        "end_m": d["patch_start_m"] + d["patch_length_m"],
        "edge_m": 4.0,
    }
    return shipped_scenario(BASE).changed(
        name=event_name(seed, k),
        title=f"random event {k}",
        case=None,
        duration_s=duration,
        variation=None,  # drawn here
        load_t=tuple(stated("_t", load) for load in loads.tolist()),
        rail={
            **level,
            "speed_law": d["speed_law"],
            "increments": _increments(d["slope"]),
            "scatter": d["scatter"],
            "scatter_length_m": 20.0,
            "patches": [patch] if d["patch_factor"] < 1.0 else [],
        },
        line={"sections": [{"start_m": -1000.0, "grade_permille": d["grade_permille"]}]},
        belief={"increments": _increments(BELIEVED_SLOPE)},
        onboard={
            "sensors": {"speed_noise_kmh": noise, "load_error": d["load_error"]},
            "telegrams": {"jitter_s": 0.03, "loss": d["telegram_loss"]},
        },
    )


def _increments(slope: float) -> dict[str, Any]:
    return {"law": "logarithmic", "slope": slope, "offset": OFFSET_OF_SLOPE * slope}
