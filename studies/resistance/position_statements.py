"""Statements of the sweep `line-position`: each claim with each error of odometer, signals and map."""

from collections.abc import Callable, Sequence
from typing import Literal

import pandas as pd

from studies.core.family import Claim, compared
from studies.core.statement import INTERVALS_OF_MEANS, Statement
from studies.core.threshold import Threshold
from studies.core.verdict import survives
from studies.resistance.driven_cases import CARS, FEEDBACK, FRONT, LEARNED, RIGHT, TAUGHT
from studies.resistance.events import column
from studies.resistance.line_errors import AIR, ARMS, GRADIENTS, LADDER, NONE, rung
from studies.resistance.position_events import ALONE
from studies.resistance.position_thresholds import TABLE
from studies.resistance.statements import MOUTH, SLOPE, Quantity, mean_claim

KINDS = (MOUTH, SLOPE)
CONCERNED = {AIR: (MOUTH,), GRADIENTS: (SLOPE,)}
"""Places where an error of the map shows; learning must mend it there. Others show at all of them."""
METHOD = (
    "one run of each case per drawn route (studies/resistance/position_events.py), with the same noise for each error; "
    "disturbances are means over tunnel mouths and over gradient changes, and then over both; "
    f"{INTERVALS_OF_MEANS}, 95 %; after Holm over all claims"
)


def position_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table with a row per event and arm."""
    arms = [arm for arm in (*ARMS, *map(rung, LADDER)) if (table["arm"] == arm).any()]
    rows = {arm: table[table["arm"] == arm].set_index("event") for arm in arms}
    rows = {arm: own.dropna(axis="columns", how="all") for arm, own in rows.items()}
    claims = [
        claim for arm in arms for row in TABLE if (claim := _claim(rows[arm], arm, row)) is not None
    ]
    found = compared(claims)
    return [*_survivals(found, [arm for arm in arms if arm != NONE]), *found]


def ratio(quantity: str, case: str, other: str, kinds: Sequence[str] = KINDS) -> Quantity:
    """Disturbance in one case over that in another, the mean over kinds of places."""

    def mean(e: pd.DataFrame) -> "pd.Series[float]":
        ratios = [e[column(quantity, k, case)] / e[column(quantity, k, other)] for k in kinds]
        found: pd.Series[float] = sum(ratios[1:], ratios[0]) / len(ratios)
        return found

    return mean


def _off(name: str) -> Quantity:
    return lambda e: (e[name] - 1.0).abs()


def _compensation(quantity: str, case: str) -> Callable[[str], dict[str, Quantity]]:
    """Disturbance with compensation, over that with feedback alone: the whole, then what goes along."""

    def of(arm: str) -> dict[str, Quantity]:
        found = {"over feedback alone": ratio(quantity, case, FEEDBACK)}
        found |= {f"at a {kind}": ratio(quantity, case, FEEDBACK, (kind,)) for kind in KINDS}
        if case == RIGHT:
            found["memory read at the front"] = ratio(quantity, FRONT, FEEDBACK)
        return found | {"error of the position in m": lambda e: e["position error"]}

    return of


def _mended(arm: str) -> dict[str, Quantity]:
    kinds = CONCERNED.get(arm, KINDS)
    return {
        "with learnt coefficients over with those of the map": ratio("speed_peak", TAUGHT, CARS, kinds),
        "over feedback alone, learnt": ratio("speed_peak", TAUGHT, FEEDBACK, kinds),
        "over feedback alone, as the map has them": ratio("speed_peak", CARS, FEEDBACK, kinds),
    }  # fmt: skip


QUANTITIES: dict[str, Callable[[str], dict[str, Quantity]]] = {
    "1, 2: speed": _compensation("speed_peak", RIGHT),
    "1, 2: speed, car by car": _compensation("speed_peak", CARS),
    "1, 2: ride": _compensation("acceleration_peak", RIGHT),
    "1, 2: ride, car by car": _compensation("acceleration_peak", CARS),
    "1, 2: jerk": _compensation("jerk_peak", RIGHT),
    "1, 2: jerk, car by car": _compensation("jerk_peak", CARS),
    "3, 4: as steady as true ones": lambda arm: {
        "over true coefficients": ratio("speed_peak", LEARNED, RIGHT),
        "over feedback alone": ratio("speed_peak", LEARNED, FEEDBACK),
    },
    "3, 4: mass": lambda arm: {"relative error of W3": _off(f"W3@{LEARNED}")},
    "5: in use": lambda arm: {"share of the run": lambda e: e["use share"]},
    "6, 7: mass": lambda arm: {
        "relative error of W3": _off(f"W3@{ALONE[3]}"),
        "with five weights": _off(f"W3@{ALONE[5]}"),
        "W1 over air resistance": lambda e: e[f"W1@{ALONE[3]}"],
    },
    "learning mends": _mended,
}
"""Claim -> what is tested and, after it, what goes along, in an arm."""


def _claim(rows: pd.DataFrame, arm: str, row: Threshold) -> Claim | None:
    """The claim of a threshold with the errors of `arm`; None where the arm does not bear on it."""
    if row.name == "learning mends" and arm == NONE:
        return None
    quantities = {}
    for label, quantity in QUANTITIES[row.name](arm).items():
        try:
            quantity(rows)
        except KeyError:  # a case that is not driven in this arm
            continue
        quantities[label] = quantity
    label, tested = next(iter(QUANTITIES[row.name](arm).items()))
    if label not in quantities:
        return None
    del quantities[label]
    side: Literal["<", ">"] = "<" if row.direction == "at most" else ">"
    return mean_claim(
        rows, _name(row.name, arm), f"{row.reason} (errors: {arm})", tested, side, row.value, label, quantities, METHOD
    )  # fmt: skip


def _name(claim: str, arm: str) -> str:
    return f"{claim} ({arm})"


def _survivals(found: Sequence[Statement], arms: Sequence[str]) -> list[Statement]:
    """A statement per claim over all errors, ordered by claim."""
    by_name = {one.name: one for one in found}
    told = []
    for row in TABLE:
        clean = by_name.get(_name(row.name, NONE))
        others = {arm: by_name[name] for arm in arms if (name := _name(row.name, arm)) in by_name}
        if clean is None or not clean.holds or not others:
            continue  # what is not shown to hold without errors has nothing to survive
        told.append(
            survives(
                f"survives: {row.name}", f"with every error too: {row.reason}", clean, others, NONE,
                f"no worse than without errors ({clean.verdict}); conditions are the errors with which it is worse",
            )
        )  # fmt: skip
    return told
