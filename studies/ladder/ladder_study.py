"""The ladder of readhesion controllers, from none to MPC: all of them meet the same random events with the same noise."""

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise

import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, family
from studies.core.drawn_events import complete, paired
from studies.core.job import Job
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Interval, Statement, in_words
from studies.core.study import EachEvent, Study
from studies.ladder.events import DURATION, EVENTS, measure, scenario

LADDER = (
    "none", "table", "cut-and-ramp", "pi-creep", "perturb-observe", "steepest-gradient", "mpc",
)  # fmt: skip
"""Controllers from the simplest on."""
LOCOMOTIVE = "locomotive and wagons"
SEARCHING = ("perturb-observe", "steepest-gradient")
"""Creep controllers that look for the peak; pi-creep is the same loop without search."""
YARDSTICKS = {
    0.90: "what adaptive trackers of the adhesion's peak are published with",
    0.95: "what JP5484215 expects of readhesion control on its own",
}
"""Share of adhesion used, and whose it is."""
NOTICED = 0.01
"""Fluctuation of torque, as a share of the plan's, above which a search is visible in it."""
STUDENT = f"{INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}, after Holm over all claims"
IN_PARTS = f"{STUDENT}, parts after Bonferroni"
SLOW = "arXiv 2406.13650"
PERCENT = in_words("{:.1f} % [{:.1f}, {:.1f}] (n = {})", 100)
SECONDS = in_words("{:.2f} s [{:.2f}, {:.2f}] (n = {})")

METRICS = {
    "utilisation_short": "adhesion used where short",
    "search_time": "search time [s]",
    "unfinished_searches": "share of searches unfinished",
    "torque_fluctuation": "torque fluctuation over plan",
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "jerk_rms": "jerk rms [m/s3]",
    "effort_ratio": "effort over plan",
}
"""Metric -> what a statement calls it."""

PARTS = {
    "one inverter per car": "train == 'one inverter per car'",
    "one inverter per axle": "train == 'one inverter per axle'",
    "a locomotive without free axle": f"train == '{LOCOMOTIVE}'",
    "a narrow peak (piecewise)": "curve == piecewise",
    "a wide peak (Polach)": "curve == polach",
    "even rail": "scatter == 0 and patch_factor == 1",
    "scatter or a patch": "scatter > 0 or patch_factor < 1",
}
"""Parts of the events, by what was drawn."""
DRAWN = ("train", "curve", "scatter", "patch_factor")
"""What `PARTS` ask of an event."""


def less(name: str, others: Iterable[str], metrics: Iterable[str] = METRICS) -> dict[str, str]:
    """Paired differences of metrics, controller `name` less each other, by what a statement calls them."""
    return {
        f"{METRICS[metric]}, less {other}": f"{metric}@{name} - {metric}@{other}"
        for other in others
        for metric in metrics
    }


def yardstick(bar: float, name: str, parts: Mapping[str, str] = PARTS) -> Claim:
    """The claim that `name` uses more than `bar` of the adhesion where a unit is short of it."""
    return Claim(
        f"{bar:.0%}: {name}", f"{name} uses {bar:.0%} of the adhesion where a unit is short of it ({YARDSTICKS[bar]})",
        f"utilisation_short@{name}", AT_LEAST, bar, reason=YARDSTICKS[bar], parts=parts, show=PERCENT,
        numbers={text: f"{metric}@{name}" for metric, text in METRICS.items()},
        method=f"mean over events above {bar:.0%}; {IN_PARTS}",
    )  # fmt: skip


def better(
    title: str, claim: str, metric: str, name: str, other: str, parts: Mapping[str, str], more: bool = True,
    show: Callable[[Interval], str] = PERCENT, source: str = "",
) -> Claim:  # fmt: skip
    """The claim that a metric is greater under `name` than under `other`, or less, by paired differences."""
    return Claim(
        title, claim, f"{metric}@{name} - {metric}@{other}", AT_LEAST if more else AT_MOST,
        reason="better is more, or less, on the mean of the pairs", source=source, parts=parts, show=show,
        numbers=less(name, [other]),
        method=f"mean of paired differences {'above' if more else 'below'} 0; {IN_PARTS}",
    )  # fmt: skip


def _searching(name: str) -> list[Claim]:
    """Weaknesses that are ascribed to a controller because it searches."""
    fluctuation = "torque_fluctuation"
    changing, still = f"wrong_steps_changing@{name}", f"wrong_steps_still@{name}"
    return [
        Claim(
            f"slow: {name}", f"{name} searches longer than the MPC, which predicts ({SLOW}: slow search)",
            f"search_time@{name} - search_time@mpc", reason="slow is longer than who predicts",
            source=SLOW, parts=PARTS, show=SECONDS,
            numbers=less(name, ("mpc", "pi-creep", "cut-and-ramp"), ["search_time"]),
            method=f"mean of paired differences above 0; {STUDENT}; unfinished searches count until they end",
        ),
        Claim(
            f"restless: {name}", f"{name} lets the torque fluctuate about the peak ({SLOW})",
            f"{fluctuation}@{name} - {fluctuation}@pi-creep", AT_LEAST, NOTICED,
            reason="share of the plan's torque above which a search is visible in it", source=SLOW, parts=PARTS,
            show=PERCENT,
            numbers=less(name, ("pi-creep", "cut-and-ramp", "mpc"), [fluctuation]),
            method=f"rms about the 1 s mean, more than pi-creep's, the same loop without search, by {NOTICED:.0%} of the "
            f"plan's torque; {STUDENT}",
        ),
        Claim(
            f"misled: {name}", f"{name} steps away from the peak more often while the rail changes ({SLOW})",
            f"{changing} - {still}", reason="misled is more often wrong than on a still rail", source=SLOW, parts=PARTS,
            show=PERCENT,
            # without a free axle slip is not known, and no step can be called an answer to another
            only=f"train != '{LOCOMOTIVE}'",
            numbers={
                "share of steps away from the peak, rail changing": changing,
                "share of steps away from the peak, rail still": still,
                "difference": f"{changing} - {still}",
            },
            method="steps of the mean slip over 0.3 s, of units off the peak by 30 %; the rail changes by 1 % or more; "
            f"trains with a free axle; paired by event, {STUDENT}",
        ),
    ]  # fmt: skip


CLAIMS = (
    *(yardstick(bar, name) for bar in YARDSTICKS for name in LADDER[1:]),
    *(
        better(f"rung: {name}", f"{name} uses more of the adhesion where a unit is short of it than {below}",
               "utilisation_short", name, below, PARTS)
        for below, name in pairwise(LADDER)
    ),
    *(claim for kind in zip(*map(_searching, SEARCHING), strict=True) for claim in kind),
)  # fmt: skip
"""What is claimed of the ladder."""


def ladder_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on a table of `studies.ladder.ladder_study`, of events in which no controller failed."""
    numbers = [*METRICS, "wrong_steps_still", "wrong_steps_changing"]
    return family((paired(table, "controller", numbers, DRAWN), CLAIMS))


RULE = "alone"
"""Units exchange nothing: the result of a run depends on its readhesion controller alone."""


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` under every controller."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k, measure) for controller in LADDER]


LADDER_STUDY = Study(
    name="ladder",
    question="readhesion controllers from none to MPC: adhesion used, search time, fluctuation, slip, damage",
    default_events=30,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: ladder_statements(complete(table)),
    claims=CLAIMS,
)
