"""Claims of the sweep `line-position`: each with each error of odometer, signals and map, against the same threshold."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, Side, family, known_in, survives
from studies.core.statement import INTERVALS_OF_MEANS, Statement
from studies.resistance.driven_cases import CARS, FEEDBACK, FRONT, LEARNED, RIGHT, TAUGHT
from studies.resistance.events import column
from studies.resistance.line_errors import AIR, ARMS, GRADIENTS, LADDER, NONE, rung
from studies.resistance.position_events import ALONE
from studies.resistance.statements import MOUTH, PATENT, SLOPE, mean_claim

KINDS = (MOUTH, SLOPE)
CONCERNED = {AIR: (MOUTH,), GRADIENTS: (SLOPE,)}
"""Places where an error of the map shows; learning must mend it there. Others show at all of them."""
EVERY_ARM = (*ARMS, *map(rung, LADDER))
OWN = "set by this project"
METHOD = (
    "one run of each case per drawn route (studies/resistance/position_events.py), with the same noise for each error; "
    "disturbances are means over tunnel mouths and over gradient changes, and then over both; "
    f"{INTERVALS_OF_MEANS}, 95 %; after Holm over all claims"
)


def ratio(quantity: str, case: str, other: str, kinds: Sequence[str] = KINDS) -> str:
    """Disturbance in one case over that in another, the mean over kinds of places."""
    ratios = [f"{column(quantity, k, case)} / {column(quantity, k, other)}" for k in kinds]
    return f"|{' + '.join(ratios)}| / {len(ratios)}"


def _compensation(quantity: str, case: str) -> dict[str, str]:
    """Disturbance with compensation, over that with feedback alone: the whole, then what goes along."""
    found = {"over feedback alone": ratio(quantity, case, FEEDBACK)}
    found |= {f"at a {kind}": ratio(quantity, case, FEEDBACK, (kind,)) for kind in KINDS}
    if case == RIGHT:
        found["memory read at the front"] = ratio(quantity, FRONT, FEEDBACK)
    return found | {"error of the position in m": "position error"}


def claims_of(arm: str) -> Iterator[Claim]:
    """What is claimed with the errors of `arm`."""

    def one(
        name: str, side: Side, value: float, reason: str, source: str, numbers: dict[str, str]
    ) -> Claim:
        label, tested = next(iter(numbers.items()))
        return mean_claim(
            f"{name} ({arm})", f"{reason} (errors: {arm})", tested, side, value, label, numbers, reason, source, METHOD
        )  # fmt: skip

    for name, quantity, reason, source in (
        ("speed", "speed_peak", "compensation lessens the disturbance of the speed", PATENT),
        ("ride", "acceleration_peak", "compensation improves the ride: less acceleration off the command", PATENT),
        ("jerk", "jerk_peak", "a better ride is less jerk too", OWN),
    ):  # fmt: skip
        yield one(f"1, 2: {name}", AT_MOST, 1.0, reason, source, _compensation(quantity, RIGHT))
        yield one(
            f"1, 2: {name}, car by car", AT_MOST, 1.0, "the same, the memory read car by car", OWN,
            _compensation(quantity, CARS),
        )  # fmt: skip
    yield one(
        "3, 4: as steady as true ones", AT_MOST, 1.25, "learning has arrived where a quarter is left to be gained",
        f"{PATENT}: almost true; a quarter {OWN}",
        {
            "over true coefficients": ratio("speed_peak", LEARNED, RIGHT),
            "over feedback alone": ratio("speed_peak", LEARNED, FEEDBACK),
        },
    )  # fmt: skip
    yield one(
        "3, 4: mass", AT_MOST, 0.05, "W3 becomes the train's mass while it compensates",
        f"{PATENT}: the mass; a twentieth {OWN}", {"relative error of W3": f"|W3@{LEARNED} - 1|"},
    )  # fmt: skip
    yield one(
        "5: in use", AT_LEAST, 0.5, "the switch comes to use what was learnt, for most of the run",
        f"{PATENT}: alternately; most {OWN}", {"share of the run": "'use share'"},
    )  # fmt: skip
    yield one(
        "6, 7: mass", AT_MOST, 0.05, "the stand-alone learner finds the train's mass",
        f"{PATENT}: the mass; a twentieth {OWN}",
        {
            "relative error of W3": f"|W3@{ALONE[3]} - 1|", "with five weights": f"|W3@{ALONE[5]} - 1|",
            "W1 over air resistance": f"W1@{ALONE[3]}",
        },
    )  # fmt: skip
    if arm != NONE:
        kinds = CONCERNED.get(arm, KINDS)
        yield one(
            "learning mends", AT_MOST, 0.9,
            "coefficients that were learnt take away a tenth of what the error of the map leaves", OWN,
            {
                "with learnt coefficients over with those of the map": ratio("speed_peak", TAUGHT, CARS, kinds),
                "over feedback alone, learnt": ratio("speed_peak", TAUGHT, FEEDBACK, kinds),
                "over feedback alone, as the map has them": ratio("speed_peak", CARS, FEEDBACK, kinds),
            },
        )  # fmt: skip


CLAIMS = {arm: tuple(claims_of(arm)) for arm in EVERY_ARM}
"""What is claimed, by arm; the claims of all arms are one family."""


def position_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table with a row per event and arm: those of each arm that has the case which a claim is about."""
    groups = {}
    for arm in [arm for arm in EVERY_ARM if (table["arm"] == arm).any()]:
        rows = table[table["arm"] == arm].set_index("event").dropna(axis="columns", how="all")
        groups[arm] = (
            rows,
            [_known(claim, rows) for claim in CLAIMS[arm] if known_in(rows, claim.mean)],
        )
    found = family(*groups.values())
    return [*_survivals(found, [arm for arm in groups if arm != NONE]), *found]


def _known(claim: Claim, rows: pd.DataFrame) -> Claim:
    """The claim with those numbers beside it whose cases are driven in this arm."""
    numbers = {words: text for words, text in claim.numbers.items() if known_in(rows, text)}
    return replace(claim, numbers=numbers)


def _survivals(found: Sequence[Statement], arms: Sequence[str]) -> list[Statement]:
    """A statement per claim over all errors, ordered by claim."""
    by_name = {one.name: one for one in found}
    over_all = []
    for claim in CLAIMS[NONE]:
        name = claim.name.removesuffix(f" ({NONE})")
        clean = by_name.get(claim.name)
        others = {arm: by_name[own] for arm in arms if (own := f"{name} ({arm})") in by_name}
        if clean is None or not clean.holds or not others:
            continue  # what is not shown to hold without errors has nothing to survive
        over_all.append(
            survives(
                f"survives: {name}", f"with every error too: {claim.reason}", clean, others, NONE,
                f"no worse than without errors ({clean.verdict}); conditions are the errors with which it is worse",
            )
        )  # fmt: skip
    return over_all
