"""What the study `calibration` says: whether a set does as the paper says, how narrow each parameter is, and the unit."""

import numpy as np
import pandas as pd

from studies.core.statement import (
    CONDITIONS,
    FAILS,
    HOLDS,
    Interval,
    Statement,
    share_interval,
    single,
)
from studies.readhesion_paper.calibration import NOT_ASKED_OF_ALL, RANGES, best, fulfilling
from studies.readhesion_paper.findings import CLAIMS

NARROW = 2.0
"""A parameter is narrowly determined where the largest value that fulfils all is at most this multiple of the least."""
NEAR_BEST = 1.5
"""Sets whose objective is at most this multiple of the best one's are as good for all that the paper prints."""
WORDS = {
    "residual_ratio": "mu_inf over mu_max",
    "rise": "T_u [s]",
    "fall": "T_d [s]",
    "time_constant": "tau [s]",
}
"""Name of each parameter, with its unit."""


def calibration_statements(table: pd.DataFrame) -> list[Statement]:
    """Whether there is a set that does as the paper says, how narrow each parameter is, and the unit."""
    good, chosen = fulfilling(table), best(table)
    near = table[table["objective"] <= NEAR_BEST * chosen["objective"]]
    same, other = (near[near["unit"] == chosen["unit"]], near[near["unit"] != chosen["unit"]])
    return [
        _exists(table, good, chosen),
        *(_narrow(name, chosen, good, same) for name in RANGES),
        _unit(table, good, chosen, other),
        _all_at_once(table),
    ]


def _exists(table: pd.DataFrame, good: pd.DataFrame, chosen: pd.Series) -> Statement:
    missing = [name for name in CLAIMS if not chosen[f"met: {name}"]]
    met = len(CLAIMS) - len(missing)
    return Statement(
        "a set exists",
        "some values of what is not printed make the controller do all that the paper says",
        HOLDS if not missing else (CONDITIONS if len(good) else FAILS),
        {
            f"findings met by the best set, of {len(CLAIMS)}": single(met),
            "its objective": single(chosen["objective"]),
            "objective of the values assumed": single(
                table.loc[table["stage"] == "assumed", "objective"].head(1).min()
            ),
            "share of wide samples that fulfil all but the half-slip": share_interval(
                table.index[table["stage"] == "wide"].isin(good.index)
            ),
        },
        tuple(f"not met: {CLAIMS[name]}" for name in missing),
        f"Latin hypercube and simplex method; fulfils: all findings but {', '.join(NOT_ASKED_OF_ALL)}",
    )


def _narrow(name: str, chosen: pd.Series, good: pd.DataFrame, near: pd.DataFrame) -> Statement:
    low, high = float(good[name].min()), float(good[name].max())
    narrow = len(good) > 1 and high <= NARROW * low
    return Statement(
        f"narrow: {name}",
        f"the paper's findings determine {WORDS[name]} to within a factor of {NARROW:g}",
        HOLDS if narrow else FAILS,
        {
            f"{WORDS[name]}: best; range of the sets that fulfil": Interval(
                float(chosen[name]), low, high, len(good)
            ),
            f"{WORDS[name]}: best; range near the best objective": Interval(
                float(chosen[name]), float(near[name].min()), float(near[name].max()), len(near)
            ),
        },
        method=f"limits are ranges, not confidence; near: the same unit, objective up to {NEAR_BEST:g} times the best one's",
    )


def _unit(
    table: pd.DataFrame, good: pd.DataFrame, chosen: pd.Series, near: pd.DataFrame
) -> Statement:
    """`near`: sets in the other unit that come near the best objective."""
    others = table[table["unit"] != chosen["unit"]]
    numbers = {"sets near the best objective in the other unit": single(len(near))}
    missing: tuple[str, ...] = ()
    if len(others):
        rival = others.sort_values("objective", kind="stable").iloc[0]
        missing = tuple(
            f"not met in {rival['unit']}: {CLAIMS[name]}"
            for name in CLAIMS
            if not rival[f"met: {name}"]
        )
        numbers |= {
            f"objective of the best set in {row['unit']}": single(row["objective"])
            for row in (chosen, rival)
        }
        numbers |= {
            f"{words} of the best set in {rival['unit']}; range of those near": Interval(
                float(rival[name]), float(near[name].min()), float(near[name].max()), len(near)
            )
            for name, words in WORDS.items()
        }
    return Statement(
        "unit",
        f"a_0 and a_w are meant in {chosen['unit']}: in the other unit no set comes near",
        HOLDS if len(good) and near.empty else FAILS,
        numbers,
        missing,
        f"near: objective up to {NEAR_BEST:g} times that of the best set that fulfils most",
    )


def _all_at_once(table: pd.DataFrame) -> Statement:
    """The half-slip stands apart: by how much other findings must give way to it."""
    half = table[table[[f"met: {name}" for name in NOT_ASKED_OF_ALL]].all(axis=1)]
    some = table[table[[f"met: {name}" for name in NOT_ASKED_OF_ALL]].any(axis=1)]
    return Statement(
        "half-slip",
        "the half-slip at mu_lim 0.16 goes together with the other findings",
        HOLDS if len(half) and half["met"].max() == len(CLAIMS) else FAILS,
        {
            "sets with both its findings": single(len(half)),
            "most findings met with both": single(half["met"].max() if len(half) else np.nan),
            "most findings met with one of them": single(
                some["met"].max() if len(some) else np.nan
            ),
        },
    )
