"""What information is worth: the same starts, the same controller, and more and more that the rule is told.

Every level of information meets the same drawn starts with headroom (`studies.patent.headroom_study`) at several demands of
the driver. So each has a front: the wheel damage that an effort costs, and the effort that it reaches at all.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, family
from studies.core.drawn_events import complete, paired, with_parts
from studies.core.job import Job, check_controller
from studies.core.statement import INTERVALS_OF_MEANS, POINTS, Statement
from studies.core.study import EachEvent, Study
from studies.patent import headroom_study
from studies.scenario.scenario import Scenario


class Level(NamedTuple):
    """A rule, and the telegrams that it lives on in place of those of a start."""

    rule: str
    telegrams: Mapping[str, float] = {}


PROMPT = {"period_s": 0.01, "latency_s": 0.0, "jitter_s": 0.0, "loss": 0.0}
LATE = {"latency_s": 0.5, "loss": 0.3}
LEVELS: Mapping[str, Level] = {
    "own sensors": Level("alone"),
    "late, lossy reports": Level("cooperative", LATE),
    "reports": Level("cooperative"),
    "reports, for wear": Level("wear"),
    "prompt reports": Level("cooperative", PROMPT),
    "preview with truth": Level("preview"),
    "truth": Level("oracle"),
}
"""From little to much; the reports serve two rules. Late: half a second, and three of ten telegrams lost; both are assumed,
and far beyond a train bus. Preview: reports, and the true peak at and ahead of every unit but the leader, as if those ahead
had measured it without error; no train knows so much."""
STEPS = (
    ("late, lossy reports", "own sensors"), ("reports", "late, lossy reports"), ("reports, for wear", "reports"),
    ("prompt reports", "reports"), ("preview with truth", "reports"), ("truth", "preview with truth"),
)  # fmt: skip
"""Each level and the one that it is compared with."""
DEMANDS = (0.9, 0.95, 1.0, 1.05)
"""Factors on the driver's command: points of a front. At 1 the train as a whole just reaches the plan, or nearly so."""
CONTROLLERS = ("cut-and-ramp", "perturb-observe")
NUMBERS = ("effort", "damage", "excess_damage", "slip_time", "over_delivery", "jerk_rms")
METHOD = f"paired by start; {INTERVALS_OF_MEANS}; after Holm over all claims"


def column(metric: str, controller: str, level: str, demand: float = 1.0) -> str:
    """Column of a metric under a controller at a level of information and a demand."""
    return f"{metric}@{controller}/{level}/{demand:g}"


def _step(controller: str, more: str, less: str) -> Claim:
    def columns(metric: str) -> tuple[str, str]:
        return column(metric, controller, more), column(metric, controller, less)

    effort = " - ".join(columns("effort"))
    return Claim(
        f"{controller}: {more}", f"more effort with {more} than with {less} under {controller}", effort, AT_LEAST,
        reason="who knows more can do what who knows less does", show=POINTS, method=METHOD,
        besides=(
            Claim("more slip", mean=" - ".join(columns("slip_time")), side=AT_MOST, reason="nor is it paid for in slip"),
        ),
        numbers={
            f"{metric}, {name}": one
            for metric in NUMBERS
            for name, one in zip((more, less, "difference"), (*columns(metric), " - ".join(columns(metric))), strict=True)
        },
    )  # fmt: skip


def claims_of(controllers: Sequence[str] = CONTROLLERS) -> list[Claim]:
    """What is claimed of each step to more information."""
    return [_step(controller, *step) for controller in controllers for step in STEPS]


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per start that succeeded throughout; numbers as ``number@controller/level/demand``.

    Effort counts up to the plan, as a share of the plan of demand 1, so that all demands have one scale.
    """
    rows = complete(table.assign(scenario=table["event"]))
    arm = rows["controller"] + "/" + rows["level"] + "/" + rows["demand"].map("{:g}".format)
    return paired(
        rows.assign(arm=arm, effort=rows["plan_use"] * rows["demand"]), "arm", NUMBERS, ()
    )


def scenario(seed: int, k: int, level: str, demand: float, duration: float) -> Scenario:
    """Start `k` at a level of information and a demand."""
    event = headroom_study.scenario(seed, k, duration)
    onboard = event.onboard.model_dump()
    onboard["telegrams"] = (onboard["telegrams"] or {}) | dict(LEVELS[level].telegrams)
    command: list[dict[str, Any]] = [one.model_dump() for one in event.command]
    for one in command:
        one["acceleration_kmhs"] *= demand
    return event.changed(name=event.name + _part(level, demand), onboard=onboard, command=command)


def _part(level: str, demand: float) -> str:
    return f"-{list(LEVELS).index(level)}-{demand:g}"


def cells(
    seed: int,
    k: int,
    duration: float = headroom_study.DURATION,
    controllers: Sequence[str] = CONTROLLERS,
) -> list[Job]:
    """Start `k` at every level and demand under every controller."""
    for controller in controllers:
        check_controller(controller)
    return [
        Job(scenario(seed, k, level, demand, duration), one.rule, controller, k, headroom_study.measure)
        for level, one in LEVELS.items()
        for demand in DEMANDS
        for controller in controllers
    ]  # fmt: skip


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event", "level" and "demand"."""
    parts = {_part(*one): one for one in product(LEVELS, DEMANDS)}
    return with_parts(table, parts, "level", "demand")


def statements(table: pd.DataFrame) -> list[Statement]:
    """What each step to more information brings, under each controller of the table."""
    controllers = list(dict.fromkeys(table["controller"]))
    return family((pairs_of(table), claims_of(controllers)))


INFORMATION = Study(
    name="information",
    question="what information is worth: own sensors, reports that are late or prompt, a preview of the rail, the truth",
    default_events=48,
    cells=EachEvent(cells),
    finish=meant,
    judge=statements,
    claims=claims_of,
)
