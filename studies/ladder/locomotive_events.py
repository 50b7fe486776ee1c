"""Random events of a locomotive with load transfer, in six kinds: dry, wet and mixed rail, all motors or one failed.

The kinds are those of Railway Sciences 4(1):22 (2025), of which the
abstract alone could be read: levels, train and places are assumed.
"""

from typing import Any

from studies.core.drawn_events import DrawnEvents, Quantity, uniform
from studies.files.units import stated
from studies.ladder.events import TRAINS, rail_keys, train_of
from studies.ladder.statements import LOCOMOTIVE
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

DURATION = 15.0
"""Length of an event [s]."""
RAILS = ("dry", "wet", "mixed")
STATES = ("all motors", "one failed")
KINDS = len(RAILS) * len(STATES)
DRY, WET = 0.30, 0.15
"""Coefficient that the rail offers at 15 km/h before `level_factor`."""
ACCELERATION = 4.3
"""Command [km/h/s]: a coefficient of 0.26, nearly all that the motors of the locomotive can ask for."""
WET_STRETCHES = ((8.0, 20.0), (35.0, 55.0))
"""Where a mixed rail is wet [m]; dry between."""
FAILURE_TIME = 4.0
"""Instant at which a motor fails [s], under full torque."""

QUANTITIES: dict[str, Quantity] = {
    "rail": Quantity(
        "each of three in its turn", "as in the source; mixed: wet stretches on dry rail",
        lambda _, d: RAILS[d["number"] % len(RAILS)],
    ),
    "motors": Quantity(
        "all, or one failed, each for three events in its turn", "as in the source",
        lambda _, d: STATES[d["number"] // len(RAILS) % len(STATES)],
    ),
    "curve": Quantity(
        "piecewise and Polach's of wet rail, each for six events in its turn", "as the ladder",
        lambda _, d: ("piecewise", "polach")[d["number"] // KINDS % 2],
    ),
    "residual_ratio": uniform(0.5, 0.9, " of the peak at infinite slip (piecewise only)", "as the ladder"),
    "level_factor": uniform(0.9, 1.1, " times the level of dry or wet rail", "assumed"),
    "failed_unit": Quantity(
        "one of six axles, all alike", "load transfer makes the axles differ",
        lambda g, _: int(g.integers(1, 7)),
    ),
    "scatter": uniform(0.002, 0.008, ", correlated over 20 m", "as the ladder"),
    "speed_noise_kmh": uniform(0.0, 0.04, " km/h", "as the ladder"),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("locomotive", QUANTITIES, stream=(11,), numbered=True)
draw, event_name = EVENTS.draw, EVENTS.event_name


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = draw(seed, k)
    base, changes = TRAINS[LOCOMOTIVE]
    level = d["level_factor"] * (WET if d["rail"] == "wet" else DRY)
    patches: list[dict[str, Any]] = [
        {"factor": WET / DRY, "start_m": start, "end_m": end, "edge_m": 2.0}
        for start, end in (WET_STRETCHES if d["rail"] == "mixed" else ())
    ]
    failed = d["motors"] == "one failed"
    return shipped_scenario(base).changed(
        name=event_name(seed, k),
        title=f"{d['rail']} rail, {d['motors']}: event {k} of the locomotive",
        case=None,
        duration_s=duration,
        variation=None,  # drawn here
        load_transfer=True,
        command=[{"time_s": 0.0, "acceleration_kmhs": ACCELERATION}],
        failures=[{"unit": d["failed_unit"], "time_s": FAILURE_TIME}] if failed else [],
        rail=rail_keys(d["curve"], d["residual_ratio"], level, train_of(LOCOMOTIVE))
        | {
            "increments": {"law": "logarithmic"},
            "scatter": d["scatter"],
            "scatter_length_m": 20.0,
            "patches": patches,
        },
        belief={"curve": {"kind": "piecewise"}},
        onboard={"sensors": {"speed_noise_kmh": stated("_kmh", d["speed_noise_kmh"])}},
        **changes,
    )
