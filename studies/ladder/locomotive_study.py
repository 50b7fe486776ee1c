"""A locomotive's six kinds of event under controllers of the ladder and of others, and the MPC that knows load transfer."""

import pandas as pd

from studies.core.drawn_events import complete, paired
from studies.core.family import Claim, Part, Test, compared
from studies.core.job import Job
from studies.core.statement import Statement
from studies.core.study import EachEvent, Study
from studies.ladder.locomotive_events import DURATION, EVENTS, RAILS, STATES, scenario
from studies.ladder.published import ARMS, BAR, PUBLISHED
from studies.ladder.statements import METRICS, PERCENT, STUDENT, difference, yardstick
from studies.ladder.study import RULE

HOSTED = ("mpc", "mpc-car")
"""An axle's own problem, and one problem of all axles with load transfer."""
BELOW = "cut-and-ramp"
"""The simplest controller that responds to a slip signal: the difference from it shows what another one is worth."""


def _kind(rail: str, motors: str) -> Part:
    return lambda e: (e["rail"] == rail) & (e["motors"] == motors)


PARTS: dict[str, Part] = {
    f"{rail} rail, {motors}": _kind(rail, motors) for rail in RAILS for motors in STATES
}
"""The six kinds."""


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` under every controller."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k) for controller in (*ARMS, *HOSTED)]


def locomotive_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on a table of this study, of events in which no controller failed."""
    events = paired(table, "controller", list(METRICS), ("rail", "motors"))
    pairs = [(name, BELOW) for name in (*ARMS, "mpc") if name != BELOW]
    return compared([
        *(yardstick(events, BAR, name, PARTS) for name in (*PUBLISHED, *HOSTED)),
        *(_delivers(events, name, other) for name, other in (*pairs, ("mpc-car", "mpc"))),
    ])  # fmt: skip


def _delivers(events: pd.DataFrame, name: str, other: str) -> Claim:
    return Claim(
        f"effort: {name}, {other}", f"{name} delivers more of the plan's effort than {other}",
        events, Test(lambda e: difference(e, "effort_ratio", name, other)), PARTS, PERCENT,
        {f"{text}, less {other}": difference(events, metric, name, other) for metric, text in METRICS.items()},
        f"mean of paired differences above 0; {STUDENT}, parts after Bonferroni",
    )  # fmt: skip


LOCOMOTIVE_STUDY = Study(
    name="locomotive",
    question="a locomotive with load transfer, dry, wet, mixed rail, all motors or one failed: effort, slip, damage",
    default_events=36,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: locomotive_statements(complete(table)),
)
