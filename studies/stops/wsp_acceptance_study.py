"""One setting of the slide protection from adhesion 0.02 up, on every curve, for 1 to 8 cars, beside the true speed."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd

from alloc.onboard.parameters import ReferenceSpeed
from studies.core.cell import Task
from studies.core.claims import AT_LEAST, Claim, conjunction, quantity
from studies.core.statement import Interval, Statement
from studies.core.study import Study
from studies.files.study_error import StudyError
from studies.stops.acceptance_cases import (
    BELIEF,
    DRAWN,
    LAWS,
    LEVELS,
    UNIFORM,
    StopCase,
    chosen_cases,
    discs,
    drawn_case,
    measured,
    stopped_run,
    table_cases,
)

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
SHORT = "true_speed_adhesion_used - adhesion_used"
"""By how much the adhesion used falls short of that with the true speed."""
NO_LOCK, NEAR = "locked_axle_s == 0", f"{SHORT} <= {POINTS}"
USUAL = f"part != '{BELIEF}'"
LEVEL_RAIL = f"part == '{UNIFORM}' and grade_permille == 0"
THREE = f"{LEVEL_RAIL} and train == '{discs(3).name}' and |speed_kmh - 100| < 0.0005"
(BREAK, ABOVE), (_, BELOW) = LEAST_USED.items()
MOST_LOCKED = ("locked axle s, most", "largest of locked_axle_s")


def _aim(
    name: str, claim: str, met: str, reason: str, only: str = "", numbers: Mapping[str, str] | None = None
) -> Claim:  # fmt: skip
    """That every stop that bears on it meets a condition."""
    return Claim(
        name, claim, met, AT_LEAST, 1.0, only=only, exact=True, reason=reason, numbers=numbers or {},
        method="every stop counts, and all must meet it; limits are ranges, not confidence",
    )  # fmt: skip


CLAIMS = (
    _aim("no lock", "no wheel locks above 5 km/h, on any curve and level", NO_LOCK, "a locked wheel is flattened", USUAL,
         dict([MOST_LOCKED, ("longest lock [s]", "largest of longest_lock_s")])),
    _aim("stands", "every train stands, where the rail stops it", "stopped == 1", "a brake stops the train", USUAL,
         {"distance over that of a perfect stop, most": "largest of over_perfect"}),
    _aim("estimate", "adhesion used is within 2.5 points of that with the true speed", NEAR,
         "the reference speed costs little", f"{USUAL} and true_speed_adhesion_used >= 0"),
    # above the highest level, filling the cylinders is what costs
    _aim("used", "at least 0.85 of the adhesion is used from 0.03 to 0.08, and 0.82 below",
         f"stopped == 1 and adhesion >= {BREAK} and adhesion_used >= {ABOVE} or "
         f"stopped == 1 and adhesion < {BREAK} and adhesion_used >= {BELOW}",
         "aim of this project", f"{LEVEL_RAIL} and adhesion <= {LEVELS[-1]}"),
    _aim("damage", "Q is at most 5 MJ for three cars from 100 km/h", f"damage_kj <= {MOST_DAMAGE}", "aim of this project",
         THREE),
    _aim("belief", "no wheel locks with shoe friction wrong by 15 % and an unknown gradient of 30 per mille, at once",
         NO_LOCK, "a locked wheel is flattened", f"part == '{BELIEF}'", dict([MOST_LOCKED])),
    _aim("before", "at 0.08 and above it is no worse than with the reference before",
         " or ".join(
             f"curve == '{curve}' and adhesion == {level} and adhesion_used >= {old.used - ROUNDING} and "
             f"damage_kj <= {old.damage * (1.0 + ROUNDING)}"
             for (curve, level), old in BEFORE.items()
         ),
         "low adhesion is not paid for elsewhere",
         " or ".join(f"{THREE} and adhesion == {level}" for level in dict.fromkeys(level for _, level in BEFORE))),
    _aim("drawn", "drawn stops lock no wheel and stay within 2.5 points of the true speed", f"{NO_LOCK} and {NEAR}",
         "the same aims on rails drawn at random", f"part == '{DRAWN}'"),
)  # fmt: skip


def acceptance_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements, on the rows that succeeded."""
    return [_over(claim, table) for claim in CLAIMS]


def _over(claim: Claim, stops: pd.DataFrame) -> Statement:
    """A claim over stops that count alike; the stops that do not meet it are told by part, train and curve."""
    rows = claim.bearing(stops)
    good = claim.values(stops).astype(bool)
    broken = rows[~good]
    groups = broken.groupby(["part", "train", "curve"], sort=False) if len(broken) else ()
    words = {
        f"with {part}, {train}, {curve}: {_levels(own)}": False
        for (part, train, curve), own in groups
    }
    share = Interval(float(good.mean()), math.nan, math.nan, len(good))
    numbers = {"stops that meet it": share} | _ranges(claim.name, rows)
    return conjunction(rows, claim, words, numbers=numbers, least_events=1)


def _ranges(name: str, rows: pd.DataFrame) -> dict[str, Interval | float]:
    """Numbers of a claim with their range over the stops."""
    if name == "estimate":
        return {
            "short of the true speed [points]: mean, least and most": _range(
                100.0 * quantity(rows, SHORT)
            )
        }
    if name == "damage":
        return {"Q [kJ]: mean, least and most": _range(rows["damage_kj"])}
    if name == "used":
        return {f"used at {level:g}: mean, least and most": _range(rows["adhesion_used"][rows["adhesion"] == level])
                for level in sorted(set(rows["adhesion"]))}  # fmt: skip
    if name == "before" and len(rows):
        return {f"{word} before, {curve} {level:g}": value for (curve, level), old in BEFORE.items()
                for word, value in (("used", old.used), ("Q [kJ]", old.damage))}  # fmt: skip
    return {}


def _levels(rows: pd.DataFrame) -> str:
    """Levels at which a claim is not met, each with how often where it is more than once."""
    counts = rows["adhesion"].round(3).value_counts(sort=False).sort_index()
    return ", ".join(f"{level:g}" + (f" ({n})" if n > 1 else "") for level, n in counts.items())


def _range(values: "pd.Series[float]") -> Interval:
    return Interval(values.mean(), values.min(), values.max(), len(values))


TRUE = "true_speed_"
"""Beginning of the columns of the stop with the true speed."""


def stop_row(case: StopCase) -> dict[str, Any]:
    """Measures of a stop and, where it is compared, those of the same one with the true speed."""
    stop = case.stop()
    row = case.columns | {"event": stop.event.name, "reference": "estimated"}
    row |= measured(stopped_run(stop.event), stop)
    if case.compared:
        told = stop.under(ReferenceSpeed(source="truth"))
        found = measured(stopped_run(told.event), told)
        row |= {TRUE + name: value for name, value in found.items()}
    return row


def cells(
    seed: int,
    events: int,
    adhesion: Sequence[float] | None = None,
    curve: Sequence[str] | None = None,
    speed_kmh: float | None = None,
    train: str | None = None,
    law: str = "fuzzy",
) -> list[Task]:
    """The table and `events` drawn stops; or, where something is chosen, stops on uniform rail as asked for."""
    if law not in LAWS:
        raise StudyError(f"--law {law}: give one of {', '.join(LAWS)}")
    if (adhesion, curve, speed_kmh, train) == (None,) * 4:
        chosen = [*table_cases(law), *(drawn_case(seed, k, law) for k in range(events))]
    else:
        chosen = chosen_cases(adhesion, curve, speed_kmh, train, law)
    return [Task(label_of(case), stop_row, (case,), tuple(case.columns.items())) for case in chosen]


def label_of(case: StopCase) -> str:
    """Name of a case: its part, train, curve, levels and what else is not as usual."""
    levels = case.levels if isinstance(case.levels, (int, float)) else tuple(case.levels)
    parts = (case.part, case.train.name, case.curve, levels, case.speed, case.grade)
    return "/".join(map(str, (*parts, case.friction_factor, case.law)))


WSP_ACCEPTANCE = Study(
    name="wsp-acceptance",
    question="whether one setting of the slide protection serves every rail from adhesion 0.02 up",
    default_events=12,
    cells=cells,
    judge=lambda table: acceptance_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
    shown={
        "part": "part", "train": "train", "event": "event",
        "adhesion_used": "used", "true_speed_adhesion_used": "with true speed",
        "locked_axle_s": "locked [axle s]", "damage_kj": "Q [kJ]", "air_nl": "air [Nl]", "distance_m": "distance [m]",
    },
)  # fmt: skip
