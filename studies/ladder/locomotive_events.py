"""Random events of a locomotive with load transfer, in six kinds: dry, wet and mixed rail, all motors or one failed.

The kinds are those of Railway Sciences 4(1):22 (2025), of which the
abstract alone could be read: levels, train and places are assumed.
"""

from studies.core.drawn_events import DrawnEvents, Quantity, in_turn, uniform
from studies.core.drawn_scenarios import (
    RESIDUAL_RATIO,
    SPEED_NOISE,
    START_SPEED,
    TWO_PEAKS,
    drawn_curve,
    drawn_scenario,
    rail_offering,
    stretch,
    uneven,
)
from studies.ladder.events import TRAINS, train_of
from studies.ladder.ladder_study import LOCOMOTIVE
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
    "rail": in_turn(RAILS, "each of three in its turn", "as in the source; mixed: wet stretches on dry rail"),
    "motors": in_turn(
        STATES, "all, or one failed, each for three events in its turn", "as in the source", after=len(RAILS)
    ),
    "curve": in_turn(
        TWO_PEAKS, "piecewise and Polach's of wet rail, each for six events in its turn", "as the ladder", after=KINDS
    ),
    "residual_ratio": RESIDUAL_RATIO,
    "level_factor": uniform(0.9, 1.1, " times the level of dry or wet rail", "assumed"),
    "failed_unit": Quantity(
        "one of six axles, all alike", "load transfer makes the axles differ",
        lambda g, _: int(g.integers(1, 7)),
    ),
    "scatter": uniform(0.002, 0.008, ", correlated over 20 m", "as the ladder"),
    "speed_noise_kmh": SPEED_NOISE,
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("locomotive", QUANTITIES, stream=(11,), numbered=True)


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = EVENTS.draw(seed, k)
    base, changes = TRAINS[LOCOMOTIVE]
    level = d["level_factor"] * (WET if d["rail"] == "wet" else DRY)
    rail = rail_offering(drawn_curve(d["curve"], d), level, START_SPEED, train_of(LOCOMOTIVE))
    wet = WET_STRETCHES if d["rail"] == "mixed" else ()
    patches = (stretch(WET / DRY, *ends, edge=2.0) for ends in wet)
    failed = d["motors"] == "one failed"
    return drawn_scenario(
        base, EVENTS.event_name(seed, k), f"{d['rail']} rail, {d['motors']}: event {k} of the locomotive", duration,
        rail | {"increments": {"law": "logarithmic"}} | uneven(d["scatter"], *patches), d,
        load_transfer=True, command=[{"time_s": 0.0, "acceleration_kmhs": ACCELERATION}],
        failures=[{"unit": d["failed_unit"], "time_s": FAILURE_TIME}] if failed else [],
        belief={"curve": {"kind": "piecewise"}}, **changes,
    )  # fmt: skip
