"""A locomotive's six kinds of event under controllers of the ladder and of others, and the MPC that knows load transfer.

Dry, wet and mixed rail, all motors or one failed. The kinds are those of Railway Sciences 4(1):22 (2025), of which the
abstract alone could be read: levels, train and places are assumed.
"""

import pandas as pd

from studies.core import drawn_events as shared
from studies.core.claims import family
from studies.core.drawn_events import DrawnEvents, Quantity, complete, in_turn, paired, uniform
from studies.core.job import Job
from studies.core.statement import Statement
from studies.core.study import EachEvent, Study
from studies.ladder.events import TRAINS, train_of
from studies.ladder.ladder_study import LOCOMOTIVE, METRICS, RULE, better, yardstick
from studies.ladder.published_study import ARMS, BAR, PUBLISHED
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
        shared.TWO_PEAKS, "piecewise and Polach's of wet rail, each for six events in its turn", "as the ladder", after=KINDS
    ),
    "residual_ratio": shared.RESIDUAL_RATIO,
    "level_factor": uniform(0.9, 1.1, " times the level of dry or wet rail", "assumed"),
    "failed_unit": Quantity(
        "one of six axles, all alike", "load transfer makes the axles differ",
        lambda g, _: int(g.integers(1, 7)),
    ),
    "scatter": uniform(0.002, 0.008, ", correlated over 20 m", "as the ladder"),
    "speed_noise_kmh": shared.SPEED_NOISE,
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("locomotive", QUANTITIES, stream=(11,), numbered=True)


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = EVENTS.draw(seed, k)
    base, changes = TRAINS[LOCOMOTIVE]
    level = d["level_factor"] * (WET if d["rail"] == "wet" else DRY)
    rail = shared.rail_offering(
        shared.drawn_curve(d["curve"], d), level, shared.START_SPEED, train_of(LOCOMOTIVE)
    )
    wet = WET_STRETCHES if d["rail"] == "mixed" else ()
    patches = (shared.stretch(WET / DRY, *ends, edge=2.0) for ends in wet)
    failed = d["motors"] == "one failed"
    return shared.drawn_scenario(
        base, EVENTS.event_name(seed, k), f"{d['rail']} rail, {d['motors']}: event {k} of the locomotive", duration,
        rail | {"increments": {"law": "logarithmic"}} | shared.uneven(d["scatter"], *patches), d,
        load_transfer=True, command=[{"time_s": 0.0, "acceleration_kmhs": ACCELERATION}],
        failures=[{"unit": d["failed_unit"], "time_s": FAILURE_TIME}] if failed else [],
        belief={"curve": {"kind": "piecewise"}}, **changes,
    )  # fmt: skip


HOSTED = ("mpc", "mpc-car")
"""An axle's own problem, and one problem of all axles with load transfer."""
BELOW = "cut-and-ramp"
"""The simplest controller that responds to a slip signal: the difference from it shows what another one is worth."""


PARTS = {
    f"{rail} rail, {motors}": f"rail == {rail} and motors == '{motors}'"
    for rail in RAILS
    for motors in STATES
}
"""The six kinds."""
PAIRS = (*((name, BELOW) for name in (*ARMS, "mpc") if name != BELOW), ("mpc-car", "mpc"))
CLAIMS = (
    *(yardstick(BAR, name, PARTS) for name in (*PUBLISHED, *HOSTED)),
    *(
        better(f"effort: {name}, {other}", f"{name} delivers more of the plan's effort than {other}",
               "effort_ratio", name, other, PARTS)
        for name, other in PAIRS
    ),
)  # fmt: skip


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` under every controller."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k) for controller in (*ARMS, *HOSTED)]


def locomotive_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on a table of this study, of events in which no controller failed."""
    return family((paired(table, "controller", list(METRICS), ("rail", "motors")), CLAIMS))


LOCOMOTIVE_STUDY = Study(
    name="locomotive",
    question="a locomotive with load transfer, dry, wet, mixed rail, all motors or one failed: effort, slip, damage",
    default_events=36,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: locomotive_statements(complete(table)),
    claims=CLAIMS,
)
