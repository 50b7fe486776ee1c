"""What effort costs: the same starts under two rules, a search, and the MPC at several prices of friction.

All meet the same drawn starts with headroom (`studies.patent.headroom_study`). The price says how much force the MPC gives
up for less slip, so over it each rule has a front of wheel damage over effort. One price was chosen so that the MPC under
`wear` delivers what the search under `cooperative` does; what it then costs is claimed.
"""

from itertools import product
from typing import NamedTuple

import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, family
from studies.core.drawn_events import complete, paired, with_parts
from studies.core.job import Job
from studies.core.statement import INTERVALS_OF_MEANS, POINTS, Statement, in_words
from studies.core.study import EachEvent, Study
from studies.files.units import stated
from studies.patent import headroom_study
from studies.scenario.scenario import Scenario

RULES = ("cooperative", "wear")
PRICES = (0.15, 0.25, 0.5, 1.0)
"""Prices of friction [s/m]; the first is the MPC's default."""
CHOSEN = PRICES[1]
"""Source: 20 starts each of seeds 5100 and 5150, on the mean of which it delivers what the search does."""
SEARCH, MPC = "perturb-observe", "mpc"
NUMBERS = ("bound_use", "damage", "excess_damage", "slip_time", "jerk_rms", "over_delivery")
MOST_HARM = 0.003
"""Share of the bound below which a loss does not count, as in the other studies."""
METHOD = f"paired by start; {INTERVALS_OF_MEANS}; after Holm over all claims"


class Arm(NamedTuple):
    """A rule with a controller, and the MPC's price of friction [s/m], 0 for a search."""

    rule: str
    controller: str
    price: float = 0.0

    def of(self, metric: str) -> str:
        """Column of a metric."""
        return f"{metric}@{self.rule}/{self.price:g}"

    def __str__(self) -> str:
        """As a statement's number names it."""
        return f"{self.rule}, {self.controller}" + (f", {self.price:g} s/m" if self.price else "")


ARMS = (
    *(Arm(rule, SEARCH) for rule in RULES),
    *(Arm(rule, MPC, price) for rule, price in product(RULES, PRICES)),
)
BASE, BEST = Arm("cooperative", SEARCH), Arm("wear", MPC, CHOSEN)


def _claim(
    name: str, words: str, metric: str, sign: str, value: float, reason: str, base: Arm = BASE
) -> Claim:
    return Claim(
        name, f"{words} under {BEST} than under {base}",
        f"{BEST.of(metric)} {sign} {base.of(metric)}",
        AT_LEAST if metric == "bound_use" else AT_MOST, value, reason=reason, method=METHOD,
        show=POINTS if metric in ("bound_use", "excess_damage") else in_words("{:+.1f} [{:+.1f}, {:+.1f}] %, n = {}", 100),
        numbers={str(arm): f"{arm.of(metric)} {sign} {base.of(metric)}" for arm in ARMS},
    )  # fmt: skip


CLAIMS = (
    _claim("effort", "no less of the bound", "bound_use", "-", -MOST_HARM, "what is saved is not paid for in effort"),
    _claim("damage", "8 % less wheel damage", "damage", "beyond", -0.08, "goal of this project"),
    _claim("slip", "half the time in slip", "slip_time", "beyond", -0.5, "goal of this project"),
    _claim("jerk", "no more jerk", "jerk_rms", "beyond", 0.0, "what is saved is not paid for in comfort"),
    _claim("rule", "less excess of wheel damage", "excess_damage", "-", 0.0, "the rule has its share in it",
           Arm("cooperative", MPC, CHOSEN)),
    Claim(
        "excess", f"{BEST}: within 7 % of the least wheel damage of its effort",
        BEST.of("excess_damage"), AT_MOST, 0.07, reason="goal of this project", show=POINTS, method=METHOD,
        numbers={str(arm): arm.of("excess_damage") for arm in ARMS},
    ),
)  # fmt: skip


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per start that succeeded throughout; numbers as ``number@rule/price``."""
    rows = complete(table.assign(scenario=table["event"]))
    arm = rows["rule"] + "/" + rows["price"].map("{:g}".format)
    return paired(rows.assign(arm=arm), "arm", NUMBERS, ())


def scenario(seed: int, k: int, price: float, duration: float) -> Scenario:
    """Start `k` with this price [s/m]; 0 leaves it as it is."""
    start = headroom_study.scenario(seed, k, duration)
    onboard = start.onboard.model_dump(exclude_unset=True)
    if price:
        onboard["mpc"] = {"search": {"friction_price_s_per_m": stated("_s_per_m", price)}}
    return start.changed(name=start.name + _part(price), onboard=onboard)


def _part(price: float) -> str:
    return f"-{price:g}"


def cells(seed: int, k: int, duration: float = headroom_study.DURATION) -> list[Job]:
    """Start `k` in every arm."""
    return [
        Job(scenario(seed, k, arm.price, duration), arm.rule, arm.controller, k) for arm in ARMS
    ]


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event" and "price" [s/m]."""
    return with_parts(table, {_part(one): (one,) for one in (0.0, *PRICES)}, "price")


def statements(table: pd.DataFrame) -> list[Statement]:
    """What the effort of the search costs with the MPC under `wear`."""
    return family((pairs_of(table), CLAIMS))


EQUAL_EFFORT = Study(
    name="equal-effort",
    question="what wheel damage rule and controller save at the effort of a search",
    default_events=12,
    cells=EachEvent(cells),
    finish=meant,
    judge=statements,
    claims=CLAIMS,
)
