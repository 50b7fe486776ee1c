"""Statements of the sweep `sanders`: the trial's rows, the best placement, and the gain of sharing the brake force."""

import pandas as pd

from studies.core.statement import Interval, Statement, mean_interval
from studies.core.verdict import LEAST_EVENTS, Bound, decided, over_cases
from studies.sanders.calibration import FITTED, TOLERANCE
from studies.sanders.placement import PLACEMENTS, SHARINGS, USUAL
from studies.sanders.trial import DISTANCES

EQUAL, RAISED, BY_SAND = SHARINGS
COUNTS = 0.02
"""Share of a distance that counts as a difference; within it slide protection and rail differ from day to day."""
SHARING_METHOD = (
    "exact level over the coefficients that the calibrated law gives the cars at the initial speed, on the mean level of "
    "the rail; no car is asked for more than its full brake"
)


def sander_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements of the sweep, from rows that succeeded."""
    return [
        _fit(table),
        _prediction(table),
        *_next_door(table),
        _best(table),
        *(_sharing(table, sharing) for sharing in (RAISED, BY_SAND)),
        _together(table),
    ]


def misses(table: pd.DataFrame, units: int = 2, curve: str = "slip-ratio") -> dict[str, float]:
    """Distance over the trial's less 1, by row; without sanders the trial has only a bound."""
    rows = table[(table["part"] == "trial") & (table["units"] == units) & (table["curve"] == curve)]
    found = rows.set_index("kind")["distance"]
    return {kind: float(found[kind]) / metres - 1.0 for kind, metres in DISTANCES.items()}


def _met(kind: str, miss: float) -> bool:
    return miss > 0.0 if kind == "none" else abs(miss) <= TOLERANCE


def _rows(found: dict[str, float]) -> dict[str, float]:
    return {f"{kind}: over {DISTANCES[kind]:g} m by [%]": 100.0 * miss for kind, miss in found.items()}  # fmt: skip


def _fit(table: pd.DataFrame) -> Statement:
    found = {kind: miss for kind, miss in misses(table).items() if kind in FITTED}
    return over_cases(
        "fitted", f"the rows of the trial that the law is fitted to come out within {TOLERANCE:.0%}",
        {kind: _met(kind, miss) for kind, miss in found.items()}, _rows(found),
        "sanded coefficient, saturation and decay by least squares, slip measured from the estimated speed",
    )  # fmt: skip


def _prediction(table: pd.DataFrame) -> Statement:
    found = {kind: miss for kind, miss in misses(table).items() if kind not in FITTED}
    return over_cases(
        "predicted", f"the other rows follow: within {TOLERANCE:.0%}, and without sanders beyond 1200 m",
        {kind: _met(kind, miss) for kind, miss in found.items()}, _rows(found),
    )  # fmt: skip


def _next_door(table: pd.DataFrame) -> list[Statement]:
    statements = []
    for name, units, curve in (("one unit", 1, "slip-ratio"), ("Polach's curve", 2, "polach")):
        found = misses(table, units, curve)
        statements.append(
            over_cases(
                f"next door: {name}",
                f"the same law gives the trial's rows within {TOLERANCE:.0%} here too",
                {kind: _met(kind, miss) for kind, miss in found.items()},
                _rows(found),
                "the trial's report in public does not say which rows are of one unit and which of two",
            )
        )
    return statements


def relative(table: pd.DataFrame) -> pd.DataFrame:
    """Distance of every arm over that of the usual placement with equal sharing, (events, arms)."""
    rows = table[table["part"] == "placement"]
    wide = rows.pivot(index="event", columns=["placement", "sharing"], values="distance")
    return wide.div(wide[(USUAL, EQUAL)], axis=0)


def arms(table: pd.DataFrame) -> dict[tuple[str, str], Interval]:
    """Mean over events of `relative`, by placement and sharing."""
    wide = relative(table)
    return {(place, sharing): mean_interval(wide[(place, sharing)])
            for place in PLACEMENTS for sharing in SHARINGS}  # fmt: skip


def _best(table: pd.DataFrame) -> Statement:
    found = {place: interval for (place, how), interval in arms(table).items() if how == EQUAL}
    best = min(found, key=lambda place: found[place].value)
    wide = relative(table)
    ahead = {place: wide[(place, EQUAL)] - wide[(best, EQUAL)] for place in PLACEMENTS if place != best}  # fmt: skip
    return over_cases(
        "placement", f"with the brake force shared equally, the same sand stops soonest at {best}",
        {f"against {place}": Bound("", longer, least=0.0) for place, longer in ahead.items()},
        {f"{place}, distance over that of {USUAL}": interval for place, interval in found.items()},
        "mean over events of the ratio of distances; holds if the paired difference from every other placement is above 0 "
        "with 95 %",
    )  # fmt: skip


def _together(table: pd.DataFrame) -> Statement:
    """Whether the best place depends on how the brake force is shared."""
    wide, found = relative(table), arms(table)
    alone = min(PLACEMENTS, key=lambda place: found[(place, EQUAL)].value)
    place, sharing = min(found, key=lambda arm: found[arm].value)
    gain = wide[(alone, EQUAL)] - wide[(place, sharing)]
    return decided(
        "together", f"placement and sharing chosen together stop sooner: {place}, shared {sharing}",
        {"": sharing != EQUAL and Bound("", gain, least=0.0)},
        {
            f"distance over that of {USUAL} with equal sharing": found[(place, sharing)],
            f"{alone} with equal sharing, the best place then": found[(alone, EQUAL)],
            f"the same place with equal sharing ({place})": found[(place, EQUAL)],
            "shorter than the best with equal sharing by": gain,
        },
        "holds if the paired difference is above 0 with 95 %, does not where equal sharing is best",
        enough=len(wide) >= LEAST_EVENTS,
    )  # fmt: skip


def _sharing(table: pd.DataFrame, sharing: str) -> Statement:
    wide, found = relative(table), arms(table)
    gain = {place: wide[(place, EQUAL)] - wide[(place, sharing)] for place in PLACEMENTS}
    damage = _ratio(table, "damage", sharing)
    return over_cases(
        f"sharing: {sharing}",
        f"brake force shared {sharing} instead of equally shortens the stop by {COUNTS:.0%} or more",
        {f"with the sand at {place}": Bound("", shorter, least=COUNTS) for place, shorter in gain.items()},
        {
            **{f"{place}: shorter by, of the distance of {USUAL}": value for place, value in gain.items()},
            **{f"{place}: distance over that of {USUAL}": found[(place, sharing)] for place in PLACEMENTS},
            "wheel damage over that of equal sharing": damage,
        },
        SHARING_METHOD,
    )  # fmt: skip


def _ratio(table: pd.DataFrame, number: str, sharing: str) -> Interval:
    """Mean over events of a number's sum over placements, over that of equal sharing."""
    rows = table[table["part"] == "placement"]
    total = rows.pivot_table(index="event", columns="sharing", values=number, aggfunc="sum")
    return mean_interval(total[sharing] / total[EQUAL])
