"""Claim 3 and effect (3) of JP5484215 in drawn blended stops: does redistribution improve the deceleration?

The stops are those of multiple units among the drawn blended stops (`studies.stops.blended_events`), since the patent is
about trains with motors in many cars. Every layer of the patent and its prior art meet the same stops.
"""

import pandas as pd

from studies.core.claims import AT_LEAST, Claim, family
from studies.core.drawn_events import COMPARED, Arm, complete, paired
from studies.core.job import Job
from studies.core.statement import INTERVALS_OF_MEANS, POINTS, Statement
from studies.core.study import EachEvent, Study
from studies.patent.claims_study import LAYERS, PATENT, less
from studies.stops.blended_events import DURATION, EVENTS, HAULED, TRAINS, scenario

PRIOR_ART = ("preset", "sharing")
"""What the patent wants to improve on, with the parameters of the claims study."""
RULES = ("alone", *PRIOR_ART, *LAYERS)
NUMBERS = (
    "acceleration_ratio", "bound_use", "slip_time", "damage", "jerk_rms", "unit_detections", "headroom",
)  # fmt: skip
WORDS = {
    "bound_use": "bound used", "slip_time": "slip [axle s]", "damage": "wheel damage [kJ]",
    "jerk_rms": "jerk rms [m/s3]",
}  # fmt: skip
"""Metric -> what a statement calls it."""
SLID = "unit_detections@alone >= 1"
"""Stops in which a unit slides under `alone`: only these call for the patent."""
PARTS = {
    "headroom above 1 % of the plan": "headroom@alone > 0.01",
    "headroom up to 1 % of the plan": "headroom@alone <= 0.01",
}
METHOD = f"stops in which a unit slides under alone, paired; {INTERVALS_OF_MEANS}; after Holm over all claims"
DECELERATION = "deceleration over plan"
_UNITS_ONLY = [k for k, name in enumerate(TRAINS) if name not in HAULED]
"""Turns of the multiple units among the trains, which take turns."""


def _improved(kind: str, words: str, arm: Arm, other: str, source: str) -> Claim:
    rule = arm.rule
    return Claim(
        f"{kind}: {' under '.join(arm)}", words, f"acceleration_ratio@{rule} - acceleration_ratio@{other}", AT_LEAST,
        reason="better is more deceleration", source=source, only=SLID, parts=PARTS, show=POINTS, method=METHOD,
        numbers={
            f"{DECELERATION}, {rule}": f"acceleration_ratio@{rule}",
            f"{DECELERATION}, {other}": f"acceleration_ratio@{other}",
            **less(rule, other, **WORDS),
        },
    )  # fmt: skip


def claims_of(controller: str) -> tuple[Claim, ...]:
    """What is claimed of the rules under a controller, over `pairs_of` stops under that controller."""
    against_alone = (
        _improved(
            "f",
            "deceleration improves over that without redistribution",
            Arm(rule, controller),
            "alone",
            PATENT,
        )
        for rule in RULES[1:]
    )
    against_prior = (
        _improved("g", "deceleration improves over that of dynamic sharing", Arm(rule, controller), "sharing", PATENT)
        for rule in LAYERS
    )  # fmt: skip
    return (*against_alone, *against_prior)


CLAIMS = tuple(claim for controller in COMPARED for claim in claims_of(controller))
"""One family."""


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per stop, with numbers as ``number@rule``."""
    return paired(table, "rule", NUMBERS, ())


def braking_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table of the study."""
    rows = complete(table)
    return family(
        *((pairs_of(rows[rows["controller"] == one]), claims_of(one)) for one in COMPARED)
    )


def stop_of(k: int) -> int:
    """Number of stop `k` among the drawn blended stops: the next one of a multiple unit."""
    turn, place = divmod(k, len(_UNITS_ONLY))
    return turn * len(TRAINS) + _UNITS_ONLY[place]


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Stop `k` under every rule and controller, the same day."""
    number = stop_of(k)
    one, day = scenario(seed, number, duration=duration), EVENTS.draw(seed, number)["day"]
    return [Job(one, rule, controller, day) for controller in COMPARED for rule in RULES]


BRAKING = Study(
    name="braking",
    question="claim 3 of JP5484215: redistribution in drawn blended stops, all rules paired",
    default_events=120,
    cells=EachEvent(cells),
    judge=braking_statements,
    claims=CLAIMS,
)
