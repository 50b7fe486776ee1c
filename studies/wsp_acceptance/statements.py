"""Statements of the sweep `wsp-acceptance`: aims set beforehand, each over the stops that bear on it."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import pandas as pd

from studies.core.statement import Interval, Statement
from studies.core.verdict import decided
from studies.wsp_acceptance.stop_cases import BELIEF, DRAWN, LEVELS, UNIFORM, discs

POINTS = 0.025
"""Most by which the adhesion used may fall short of that with the true speed."""
LEAST_USED = {0.03: 0.85, 0.0: 0.82}
"""Adhesion above which a share must be used, and the smallest share of it."""
MOST_DAMAGE = 5e3
"""Wheel damage [kJ] of the three-car train."""
ROUNDING = 0.005
"""Of adhesion used, and as a share of Q, within which nothing counts as worse than before."""


class Before(NamedTuple):
    """A stop of the three-car train with each car's reference as it was: adhesion used, Q [kJ]."""

    used: float
    damage: float


BEFORE: Mapping[tuple[str, float], Before] = {
    ("piecewise", 0.08): Before(0.8841, 4112.3),
    ("piecewise", 0.12): Before(0.8485, 1471.8),
    ("polach", 0.08): Before(0.8677, 3548.2),
    ("polach", 0.12): Before(0.8810, 1616.0),
    ("slip-ratio", 0.08): Before(0.9610, 4719.3),
    ("slip-ratio", 0.12): Before(0.9041, 2434.2),
}
"""Curve and level -> stop from 100 km/h with the fastest axle of each car, falling by 1.35 m/s2 at most, as reference."""
THREE = discs(3).name

Met = Callable[[pd.DataFrame], "pd.Series[bool]"]
"""Which of the stops meet a claim."""


def acceptance_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements, on the rows that succeeded."""
    plain, belief = table[table["part"] != BELIEF], table[table["part"] == BELIEF]
    compared = plain[plain["true_speed_adhesion_used"].notna()] if len(plain) else plain
    uniform = plain[(plain["part"] == UNIFORM) & (plain["grade_permille"] == 0.0)]
    low = uniform[uniform["adhesion"] <= LEVELS[-1]]  # above, filling the cylinders is what costs
    three = uniform[(uniform["train"] == THREE) & (uniform["speed_kmh"].round(3) == 100.0)]
    before = three[[key in BEFORE for key in zip(three["curve"], three["adhesion"], strict=True)]]
    return [
        _over(
            "no lock", "no wheel locks above 5 km/h, on any curve and level", plain, _no_lock,
            {"locked axle s, most": _most(plain, "locked_axle_s"), "longest lock [s]": _most(plain, "longest_lock_s")},
        ),
        _over(
            "stands", "every train stands, where the rail stops it", plain, lambda rows: rows["stopped"].astype(bool),
            {"distance over that of a perfect stop, most": _most(plain, "over_perfect")},
        ),
        _over(
            "estimate", "adhesion used is within 2.5 points of that with the true speed", compared,
            lambda rows: _short(rows) <= POINTS,
            {"short of the true speed [points]: mean, least and most": _range(100.0 * _short(compared))},
        ),
        _over(
            "used", "at least 0.85 of the adhesion is used from 0.03 to 0.08, and 0.82 below", low, _enough,
            {f"used at {level:g}: mean, least and most": _range(low["adhesion_used"][low["adhesion"] == level])
             for level in sorted(set(low["adhesion"]))},
        ),
        _over(
            "damage", "Q is at most 5 MJ for three cars from 100 km/h", three,
            lambda rows: rows["damage_kj"] <= MOST_DAMAGE, {"Q [kJ]: mean, least and most": _range(three["damage_kj"])},
        ),
        _over(
            "belief", "no wheel locks with shoe friction wrong by 15 % and an unknown gradient of 30 per mille, at once",
            belief, _no_lock, {"locked axle s, most": _most(belief, "locked_axle_s")},
        ),
        _over(
            "before", "at 0.08 and above it is no worse than with the reference before", before, _no_worse,
            {f"{name} before, {curve} {level:g}": value for (curve, level), old in BEFORE.items()
             if len(before) for name, value in (("used", old.used), ("Q [kJ]", old.damage))},
        ),
        _over(
            "drawn", "drawn stops lock no wheel and stay within 2.5 points of the true speed", table[table["part"] == DRAWN],
            lambda rows: _no_lock(rows) & (_short(rows) <= POINTS), {},
        ),
    ]  # fmt: skip


def _over(
    name: str, claim: str, rows: pd.DataFrame, met: Met, numbers: Mapping[str, Interval | float]
) -> Statement:
    """A claim over stops that count alike; the stops that do not meet it are told by part, train and curve."""
    good = met(rows).astype(bool) if len(rows) else pd.Series(dtype=bool)
    share = Interval(float(good.mean()), math.nan, math.nan, len(good))
    broken = rows[~good]
    groups = broken.groupby(["part", "train", "curve"], sort=False) if len(broken) else ()
    words = {
        f"with {part}, {train}, {curve}: {_levels(own)}": False
        for (part, train, curve), own in groups
    }
    return decided(
        name, claim, {**words, "": True} if len(rows) else {}, {"stops that meet it": share, **numbers},
        "every stop counts, and all must meet it; limits are ranges, not confidence", enough=len(rows) > 0,
    )  # fmt: skip


def _levels(rows: pd.DataFrame) -> str:
    """Levels at which a claim is not met, each with how often where it is more than once."""
    counts = rows["adhesion"].round(3).value_counts(sort=False).sort_index()
    return ", ".join(f"{level:g}" + (f" ({n})" if n > 1 else "") for level, n in counts.items())


def _no_lock(rows: pd.DataFrame) -> "pd.Series[bool]":
    return rows["locked_axle_s"] == 0.0


def _short(rows: pd.DataFrame) -> "pd.Series[float]":
    """By how much the adhesion used falls short of that with the true speed."""
    return rows["true_speed_adhesion_used"] - rows["adhesion_used"]


def _enough(rows: pd.DataFrame) -> "pd.Series[bool]":
    least = rows["adhesion"].map(
        lambda level: next(share for start, share in LEAST_USED.items() if level >= start)
    )
    return rows["stopped"].astype(bool) & (rows["adhesion_used"] >= least)


def _no_worse(rows: pd.DataFrame) -> "pd.Series[bool]":
    keys = zip(rows["curve"], rows["adhesion"], strict=True)
    old = pd.DataFrame([BEFORE[key] for key in keys], index=rows.index)
    return (rows["adhesion_used"] >= old["used"] - ROUNDING) & (
        rows["damage_kj"] <= old["damage"] * (1.0 + ROUNDING)
    )


def _most(rows: pd.DataFrame, column: str) -> float:
    return float(rows[column].max())


def _range(values: "pd.Series[float]") -> Interval:
    return Interval(values.mean(), values.min(), values.max(), len(values))
