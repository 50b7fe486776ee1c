"""A locomotive's six kinds of event under controllers of the ladder and of others, and the MPC that knows load transfer."""

import pandas as pd

from studies.core.claims import family
from studies.core.drawn_events import complete, paired
from studies.core.job import Job
from studies.core.statement import Statement
from studies.core.study import EachEvent, Study
from studies.ladder.ladder_study import METRICS, RULE, better, yardstick
from studies.ladder.locomotive_events import DURATION, EVENTS, RAILS, STATES, scenario
from studies.ladder.published_study import ARMS, BAR, PUBLISHED

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
