"""Sanders: the trial's distances, pairs of sanders, and placements with two ways to share the brake force."""

from dataclasses import replace
from typing import Any

import pandas as pd

from studies.core.cell import Task
from studies.core.claims import ABOUT, Claim, conjunction
from studies.core.statement import LEAST_EVENTS, Interval, Statement, mean_interval
from studies.core.study import Study
from studies.files.study_error import StudyError
from studies.stops.sander_trial import (
    AXLES_PER_CAR,
    CALIBRATED,
    DISTANCES,
    EVENTS,
    FITTED,
    NOMINAL,
    PLACED_ON,
    PLACEMENTS,
    SHARINGS,
    SOURCE,
    SOURCES,
    TOLERANCE,
    USUAL,
    Source,
    place_row,
    stop,
)

EQUAL, RAISED, BY_SAND = SHARINGS
COUNTS = 0.02
"""Share of a distance that counts as a difference; within it slide protection and rail differ from day to day."""
SHARING_METHOD = (
    "exact level over the coefficients that the calibrated law gives the cars at the initial speed, on the mean level of "
    "the rail; no car is asked for more than its full brake"
)
BEST, BOTH = "the best place with equal sharing", "the best place and sharing"
"""Columns of `relative`: of the arm with the least mean."""
PREDICTED = tuple(kind for kind in DISTANCES if kind not in FITTED)


def _arm(place: str, sharing: str) -> str:
    return f"{place}, {sharing}"


def _trial(name: str, claim: str, kinds: tuple[str, ...], method: str = "") -> Claim:
    """That the distances of these rows are the trial's; without sanders the trial has only a bound."""
    rows = tuple(
        Claim(kind, mean=f"'{kind}'", reason="without sanders the trial has only a bound", exact=True)
        if kind == "none" else
        Claim(kind, mean=f"'{kind}'", side=ABOUT, tolerance=TOLERANCE, exact=True,
              reason="as near as trials repeat themselves")
        for kind in kinds
    )  # fmt: skip
    numbers = {f"{kind}: over {DISTANCES[kind]:g} m by [%]": f"{kind} [%]" for kind in kinds}
    return Claim(name, claim, cases=rows, some=True, numbers=numbers, method=method)


def _sharing(sharing: str) -> Claim:
    def gain(place: str) -> str:
        return f"'{_arm(place, EQUAL)}' - '{_arm(place, sharing)}'"

    return Claim(
        f"sharing: {sharing}",
        f"brake force shared {sharing} instead of equally shortens the stop by {COUNTS:.0%} or more", some=True,
        cases=tuple(
            Claim(f"with the sand at {place}", mean=gain(place), value=COUNTS, reason="within it days differ")
            for place in PLACEMENTS
        ),
        numbers={
            **{f"{place}: shorter by, of the distance of {USUAL}": gain(place) for place in PLACEMENTS},
            **{f"{place}: distance over that of {USUAL}": f"'{_arm(place, sharing)}'" for place in PLACEMENTS},
            "wheel damage over that of equal sharing": f"'wheel damage, {sharing}'",
        },
        method=SHARING_METHOD,
    )  # fmt: skip


TRIAL = {
    (2, "slip-ratio"): (
        _trial("fitted", f"the rows of the trial that the law is fitted to come out within {TOLERANCE:.0%}", tuple(FITTED),
               "sanded coefficient, saturation and decay by least squares, slip measured from the estimated speed"),
        _trial("predicted", f"the other rows follow: within {TOLERANCE:.0%}, and without sanders beyond 1200 m", PREDICTED),
    ),
    **{
        key: (
            _trial(f"next door: {name}", f"the same law gives the trial's rows within {TOLERANCE:.0%} here too",
                   tuple(DISTANCES),
                   "the trial's report in public does not say which rows are of one unit and which of two"),
        )
        for name, key in (("one unit", (1, "slip-ratio")), ("Polach's curve", (2, "polach")))
    },
}  # fmt: skip
"""What is claimed of the trial's rows, by units and curve."""
PLACEMENT = Claim(
    "placement", f"with the brake force shared equally, the same sand stops soonest at {BEST}", some=True,
    cases=tuple(
        Claim(f"against {place}", mean=f"'{_arm(place, EQUAL)}' - '{BEST}'", reason="the best is ahead of every other")
        for place in PLACEMENTS
    ),
    numbers={f"{place}, distance over that of {USUAL}": f"'{_arm(place, EQUAL)}'" for place in PLACEMENTS},
    method="mean over events of the ratio of distances; holds if the paired difference from every other placement is above "
    "0 with 95 %",
)  # fmt: skip
TOGETHER = Claim(
    "together", "placement and sharing chosen together stop sooner", f"'{BEST}' - '{BOTH}'",
    reason="a choice of both should gain something",
    method="holds if the paired difference is above 0 with 95 %, does not where equal sharing is best",
)  # fmt: skip
CLAIMS = (
    *(claim for claims in TRIAL.values() for claim in claims), PLACEMENT,
    *map(_sharing, (RAISED, BY_SAND)), TOGETHER,
)  # fmt: skip
"""What is claimed; the best place and sharing are what the table gives."""


def sander_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements of the sweep, from rows that succeeded."""
    events = relative(table)
    alone, (place, sharing) = _best(events)
    damage = table[table["part"] == "placement"].pivot_table(
        index="event", columns="sharing", values="damage", aggfunc="sum"
    )
    shares = {_arm(one, how): events[one, how] for one in PLACEMENTS for how in SHARINGS}
    ratios = {f"wheel damage, {how}": damage[how] / damage[EQUAL] for how in SHARINGS}
    wide = pd.DataFrame(
        shares | ratios | {BEST: events[alone, EQUAL], BOTH: events[place, sharing]}
    )
    others = tuple(case for case in PLACEMENT.cases if case.name != f"against {alone}")
    together = TOGETHER if sharing != EQUAL else replace(TOGETHER, mean="")
    return [
        *(
            conjunction(_misses(table, *key), claim, least_events=1)
            for key, claims in TRIAL.items() for claim in claims
        ),
        conjunction(wide, replace(PLACEMENT, claim=PLACEMENT.claim.replace(BEST, alone), cases=others)),
        *(conjunction(wide, claim) for claim in CLAIMS[-3:-1]),
        conjunction(
            wide, replace(together, claim=f"{TOGETHER.claim}: {place}, shared {sharing}"), {"": sharing != EQUAL},
            numbers={
                f"distance over that of {USUAL} with equal sharing": events[place, sharing],
                f"{alone} with equal sharing, the best place then": events[alone, EQUAL],
                f"the same place with equal sharing ({place})": events[place, EQUAL],
                "shorter than the best with equal sharing by": f"'{BEST}' - '{BOTH}'",
            },
            enough=len(wide) >= LEAST_EVENTS,
        ),
    ]  # fmt: skip


def _misses(table: pd.DataFrame, units: int, curve: str) -> pd.DataFrame:
    """Distance over the trial's less 1, by row of the trial, and the same in per cent."""
    rows = table[(table["part"] == "trial") & (table["units"] == units) & (table["curve"] == curve)]
    found = rows.set_index("kind")["distance"]
    misses = {kind: float(found[kind]) / metres - 1.0 for kind, metres in DISTANCES.items()}
    return pd.DataFrame([misses | {f"{kind} [%]": 100.0 * miss for kind, miss in misses.items()}])


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


def _best(events: pd.DataFrame) -> tuple[str, tuple[str, str]]:
    """The place with the least mean where sharing is equal, and the place and sharing with the least of all."""
    mean = {(place, how): events[place, how].mean() for place in PLACEMENTS for how in SHARINGS}
    return min(PLACEMENTS, key=lambda place: mean[place, EQUAL]), min(mean, key=lambda arm: mean[arm])  # fmt: skip


TRIALS = ((2, "slip-ratio"), (1, "slip-ratio"), (2, "polach"))
"""Units and adhesion curve: as calibrated first, then next door."""
CARS = 8


def cells(seed: int, events: int, source: Source = SOURCE) -> list[Task]:
    """The trial's rows, every pair of cars ahead of which the sand may lie, and every arm of so many drawn events."""
    if source not in SOURCES:
        raise StudyError(f"--source {source}: give one of {', '.join(SOURCES)}")
    trials = [
        _task(
            "trial", stop, (kind, CALIBRATED, units, curve), source, kind=kind, units=units, curve=curve
        )
        for units, curve in TRIALS
        for kind in DISTANCES
    ]  # fmt: skip
    pairs = [
        _task("pair", place_row, (_pair(a, b), "equal", NOMINAL, PLACED_ON[0], 0), source, first=a, second=b)
        for a in range(CARS)
        for b in range(a, CARS)
    ]  # fmt: skip
    return trials + pairs + [task for k in range(events) for task in _event(seed, k, source)]


def _pair(first: int, second: int) -> tuple[int, ...]:
    """First axles of two cars, of one where both are the same."""
    return tuple(sorted({AXLES_PER_CAR * first, AXLES_PER_CAR * second}))


def _event(seed: int, k: int, source: Source) -> list[Task]:
    drawn, curve = EVENTS.draw(seed, k), PLACED_ON[k % len(PLACED_ON)]
    return [
        _task(
            "placement", place_row, (axles, sharing, drawn, curve, k), source,
            scenario=EVENTS.event_name(seed, k), event=k, placement=name, sharing=sharing, curve=curve, **drawn,
        )
        for name, axles in PLACEMENTS.items()
        for sharing in SHARINGS
    ]  # fmt: skip


def _task(
    part: str, function: Any, arguments: tuple[Any, ...], source: Source, **columns: Any
) -> Task:
    told = {"part": part, "source": source, **columns}
    return Task("/".join(map(str, told.values())), function, (*arguments, source), tuple(told.items()))  # fmt: skip


SANDERS = Study(
    name="sanders",
    question="stopping distance with sanders: the trials of RSSB T1107, placement of the sand, sharing of the brake force",
    default_events=10,
    cells=cells,
    judge=lambda table: sander_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
