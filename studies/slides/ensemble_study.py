"""Which sets of undisclosed parameters reach the tables of JP4209318, and what do they say of two cars if not told?"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from studies.core.calibration import RANGE, median_of, needed, range_of, walk
from studies.core.cell import Task
from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction, how_many
from studies.core.statement import Statement, in_words
from studies.core.study import Study, study_folder
from studies.slides.jp4209318 import (
    BOUNDS,
    CALIBRATED,
    FILE,
    HOLD_OUT,
    HOLD_OUT_TOLERANCE,
    MOST_MEMBERS,
    OUTCOMES,
    PRINTED_NUMBERS,
    SEED,
    TABLE_3,
    TARGETS,
    Undisclosed,
    chosen,
    draw,
    from_unit_cube,
    implausible,
    logarithm,
    misfit_up_to,
    outcomes,
    reaches,
    row_of,
    to_unit_cube,
    undisclosed_of,
    unreached,
)

# Claims about the ensemble of the slide protection's calibration: how large it is, what it determines and predicts.

LEAST_MEMBERS = 50
"""Sets that make an ensemble."""
NARROW = 0.25
"""A parameter is determined where 90 % of the members lie within this share of its range."""
SHARP = 0.1
"""A combination is determined where the members' standard deviation is this share of the prior's, or less."""
SETTLED, MOVING = 0.5, 0.2
"""Shift of a parameter's mean over the sampler's second half, in standard deviations, up to which it has settled; and the
share of steps that walkers take which are free to go anywhere."""
NOISES = (1e-4, 1e-2)
"""Standard deviations of relative noise on every parameter of every member."""
PARAMETERS = len(BOUNDS)


NOT_TOLD = "the tables do not tell which set is right"
LARGE = Claim(
    "ensemble", f"at least {LEAST_MEMBERS} sets reach all that is printed, within the tolerances", "sets", AT_LEAST,
    LEAST_MEMBERS, exact=True, reason=NOT_TOLD, show=in_words("so many: {:.0f}"),
    method=f"CMA-ES from drawn sets, then differential evolution Monte Carlo; {RANGE}",
)  # fmt: skip
IN_USE = Claim(
    "set in use", "the set in use reaches all that is printed, as the others of the ensemble do", "reached", AT_LEAST, 1.0,
    exact=True, reason="what is used must be as printed", show=in_words("so far"),
    method="it was found by damped least squares and a random search nearby; one walker started there",
)  # fmt: skip
DETERMINED = Claim(
    "determined", "the printed numbers determine the undisclosed curves and rules", "width", AT_MOST, NARROW, each="shown",
    exact=True, reason="a quarter of a range is little",
    method=f"combinations: principal axes of the members in the unit cube; determined: 90 % within {100 * NARROW:g} % of "
    f"the range; members descend from few searches, so their widths are lower bounds; {RANGE}",
)  # fmt: skip
FORGOTTEN = Claim(
    "settled", "the sampler has forgotten where its walkers began",
    cases=(
        Claim("at rest", mean="shift", side=AT_MOST, value=SETTLED, exact=True, reason="means no longer move"),
        Claim("free enough", mean="moved", value=MOVING, exact=True, reason="walkers that may go anywhere move as often",
              show=in_words("walkers take {:.0f} % of their steps", 100.0)),
    ),
    numbers={
        "largest shift of a parameter's mean over the second half [standard deviations]": "shift",
        "mean share of steps that walkers take at last": "moved",
    },
    method=f"at most {SETTLED:g} and at least {MOVING:g}; where not, the ensemble is narrower than the posterior",
)  # fmt: skip
HELD_OUT_CLAIMS = (
    Claim(
        "held out", "fitted to one and three cars only, the distance of two cars comes out within 1 %",
        f"|'{HOLD_OUT}' - {TABLE_3[2]}| <= {HOLD_OUT_TOLERANCE}", AT_LEAST, 1.0, exact=True,
        reason="a prediction is as near as what was fitted", method=RANGE,
    ),
    Claim(
        "logarithm",
        f"fitted to one and three cars only, {PARAMETERS} parameters predict two cars better than the two of a logarithm",
        f"|'{HOLD_OUT}' - {TABLE_3[2]}| < {abs(logarithm(2) - TABLE_3[2])}", AT_LEAST, 0.5 + 1e-9, exact=True,
        reason="more than half of the fits are nearer",
        method=f"a + b ln(cars); better: more than half of the fits are nearer; {RANGE}",
    ),
)  # fmt: skip
"""What fits to one and three cars alone predict of two, and whether better than a curve of two parameters through both."""
MEMBERS_CLAIM = Claim(
    "members", "every set of the ensemble reaches all that is printed", "on_target == 0", AT_MOST, exact=True,
    reason="the ensemble is of such sets", show=how_many("in", "sets"), method=f"one draw of noise each; {RANGE}",
)  # fmt: skip
CLAIMS = (LARGE, IN_USE, DETERMINED, FORGOTTEN, *HELD_OUT_CLAIMS)


def ensemble_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements of the sweep `slide-calibration`."""
    members = distinct(table[table["arm"] == "all"])
    return [
        _large(table, members),
        _in_use(table, members),
        _determined(members),
        _settled(table),
        *held_out_statements(distinct(table[table["arm"] == "held out"], HOLD_OUT)),
    ]


def distinct(rows: pd.DataFrame, leave_out: str | None = None) -> pd.DataFrame:
    """Distinct sets that reach every target but `leave_out`, in the order of the rows."""
    good = np.array([reaches(row, leave_out) for row in rows.to_dict("records")], dtype=bool)
    return rows[good].drop_duplicates(subset=list(BOUNDS))


def _large(table: pd.DataFrame, members: pd.DataFrame) -> Statement:
    firsts = table[(table["stage"] == "start") & (table["rank"] == 0)]
    reached = pd.Series(
        [reaches(r, None if r["arm"] == "all" else HOLD_OUT) for r in firsts.to_dict("records")],
        dtype=bool,
    )
    numbers = {
        "free parameters": PARAMETERS,
        "printed numbers that they meet": PRINTED_NUMBERS,
        "distinct sets that reach all": len(members),
        "share of the searches from the prior that end on target": reached,
        "sets run by a search; its range": median_of(firsts["evaluations"]),
        "mean share of steps that a walker takes": table["accepted"].mean(),
    }
    return conjunction(
        pd.DataFrame({"sets": [len(members)]}), LARGE, numbers=numbers, least_events=0
    )


def _in_use(table: pd.DataFrame, members: pd.DataFrame) -> Statement:
    """The set in use was found otherwise: is it one of the ensemble, or far from the rest of it?"""
    row = table[table["stage"] == "shipped"].iloc[0]
    others = members[members["stage"] != "shipped"]
    outside = [
        name for name in BOUNDS
        if len(others) and not others[name].min() <= row[name] <= others[name].max()
    ]  # fmt: skip
    numbers = {
        "its misfit; range of the others'": range_of(float(row["misfit"]), others["misfit"]),
        "share of the others that miss less":
            float((others["misfit"] < row["misfit"]).mean()) if len(others) else math.nan,
        "parameters in which it lies outside of all others": len(outside),
    }  # fmt: skip
    return conjunction(
        pd.DataFrame({"reached": [reaches(row.to_dict())]}), IN_USE, numbers=numbers, least_events=0,
        further={f"within the others in {name}": False for name in outside},
    )  # fmt: skip


def _determined(members: pd.DataFrame) -> Statement:
    points = np.array([to_unit_cube(undisclosed_of(row)) for _, row in members.iterrows()])
    low, high = (
        np.percentile(points, (5.0, 95.0), axis=0) if len(points) else (np.zeros(PARAMETERS),) * 2
    )
    widths = pd.DataFrame({"width": high - low}, index=list(BOUNDS))
    widths["shown"] = [
        f"{name}: 90 % of the members within {100.0 * width:.0f} % of its range"
        for name, width in widths["width"].items()
    ]
    spread = _spread(points)
    numbers = {
        **{f"{name}: first; range": range_of(float(members[name].iloc[0]), members[name]) for name in BOUNDS},
        "parameters determined": int((widths["width"] <= NARROW).sum()),
        f"combinations, of {PARAMETERS}, with at most {SHARP:g} of the prior's deviation": int((spread <= SHARP).sum()),
        "least deviation of a combination over the prior's": float(spread.min(initial=math.inf)),
        "greatest": float(spread.max(initial=0.0)),
    }  # fmt: skip
    return conjunction(widths, DETERMINED, numbers=numbers)


def _spread(points: np.ndarray) -> np.ndarray:
    """Standard deviations along the principal axes over that of the even prior, growing, (parameters,)."""
    if len(points) < 2:
        return np.zeros(PARAMETERS)
    variances = np.linalg.eigvalsh(np.cov(points.T))
    return np.asarray(np.sqrt(np.maximum(variances, 0.0) * 12.0))


def _settled(table: pd.DataFrame) -> Statement:
    """Whether the sampler went on long enough for its walkers to have forgotten where they began."""
    rows = table[(table["stage"] == "sampled") & (table["walker"] >= 0)]
    last = rows["generation"].max()
    shift = np.full(PARAMETERS, np.nan)
    if last >= 2:
        cubes = {
            g: np.array([to_unit_cube(undisclosed_of(r)) for _, r in rows[rows["generation"] == g].iterrows()])
            for g in (last // 2, last)
        }  # fmt: skip
        middle, end = cubes.values()
        shift = np.abs(end.mean(axis=0) - middle.mean(axis=0)) / end.std(axis=0)
    moved = float(rows.loc[rows["generation"] == last, "accepted"].mean())
    worst = list(BOUNDS)[int(np.argmax(shift))] if last >= 2 else "too few steps"
    rest, free = FORGOTTEN.cases
    named = replace(FORGOTTEN, cases=(replace(rest, show=in_words(worst)), free))
    found = pd.DataFrame({"shift": [np.max(shift)], "moved": [moved]})
    return conjunction(found, named, least_events=0)


def held_out_statements(rows: pd.DataFrame) -> list[Statement]:
    """What fits to one and three cars alone predict of two. `rows`: outcomes of such fits."""
    errors = rows[HOLD_OUT] - TABLE_3[2]
    near, nearer = (claim.values(rows) for claim in HELD_OUT_CLAIMS)
    rest = [
        name for _, row in rows.iterrows()
        for name in unreached({one: float(row[one]) for one in OUTCOMES}) if name != HOLD_OUT
    ]  # fmt: skip
    predicted, better = HELD_OUT_CLAIMS
    return [
        conjunction(
            rows, predicted, least_events=1, partly=bool(near.any()),
            further={f"reached by every fit: {name}": False for name in dict.fromkeys(rest)},
            numbers={
                "fits": len(rows),
                "predicted distance of 2 cars [m], median and range; source 414": median_of(rows[HOLD_OUT]),
                "error [%], median and range": median_of(100.0 * errors / TABLE_3[2]),
                "share of the fits within 1 %": near,
            },
        ),
        conjunction(
            rows, better, least_events=1,
            numbers={
                "logarithm through one and three cars: distance of 2 cars [m]; source 414": logarithm(2),
                "its error [m]": logarithm(2) - TABLE_3[2],
                "error of the fits, magnitude [m], median and range": median_of(errors.abs()),
                "share of the fits that are nearer than the logarithm": nearer,
            },
        ),
    ]  # fmt: skip


def members_statement(table: pd.DataFrame) -> Statement:
    """Whether the members stand as they are stored, and what noise leaves of them."""
    rows = table[table["part"] == "member"]
    noisy = table[table["part"] == "noise"]
    numbers = {
        "free parameters": PARAMETERS,
        "printed numbers": PRINTED_NUMBERS,
        "sets": len(rows),
        **{f"share still on target after noise of {size:g} on every parameter":
           _on_target(noisy[noisy["noise"] == size]) for size in NOISES},
        **{f"{name}: in use; range": range_of(float(rows[name].iloc[0]), rows[name]) for name in BOUNDS},
        **{f"{name} [{target.unit}]: in use; range": range_of(float(rows[name].iloc[0]), rows[name])
           for name, target in TARGETS.items()},
    }  # fmt: skip
    return conjunction(rows.assign(on_target=_on_target(rows)), MEMBERS_CLAIM, numbers=numbers, least_events=0)  # fmt: skip


def _on_target(rows: pd.DataFrame) -> "pd.Series[bool]":
    return pd.Series(
        [not unreached({one: float(row[one]) for one in OUTCOMES}) for _, row in rows.iterrows()],
        index=rows.index, dtype=bool,
    )  # fmt: skip


# Sets of undisclosed parameters that reach the tables of JP4209318: an evolution strategy finds some, a sampler the
# rest.
#
# The prior is even over `BOUNDS` (over the logarithm of some) and 0 where adhesion is implausible. Every target has a
# normal error whose standard deviation is half its tolerance: the posterior's logarithm is minus twice the misfit.
#
# - CMA-ES (Hansen, "The CMA evolution strategy: a tutorial", 2016; package cma) goes from a point of the prior to the
# targets. It needs no gradient, which valves that switch roughen, and gets by with 1000 to 2000 sets in 15 dimensions.
# - Walkers (`studies.core.calibration`, package emcee) go on from what several such searches found.

Floats = NDArray[np.float64]
Row = dict[str, Any]

FIRST_WIDTH = 0.15
"""Standard deviation that the search begins with, as a share of every range."""
POPULATION = 12
"""Sets of a generation of the search: the usual 4 + 3 ln 15."""
KEPT = 12
"""Sets that a search passes on: the best of its last three generations, which are as wide as what it has learnt."""
IMPLAUSIBLE = 1e4
"""Misfit from which implausible sets are ranked by how far they are from plausible; none that is run has as much."""
SHARPNESS = 2.0
"""Sharpness of the posterior, whose logarithm is this multiple of minus the misfit."""
DISORDER = 10.0
"""What slips out of the source's order take from it: such a set is taken once in e^10 times."""

HOPELESS = 20.0
"""A set that misses by this much more than twice the walkers' median is not run to its end."""
NEARNESS = (0.002, 0.02)
"""Least and greatest standard deviation of sets drawn around those found, as a share of every range."""
POOR = 8.0
"""Misfit beyond which such a set is not run to its end: that of a set that misses every target by its tolerance."""
PASSED = (*BOUNDS, *OUTCOMES, "misfit", "misfit without 2", "unreached")
"""Columns of a walker."""


def tried_row(undisclosed: Undisclosed) -> Row:
    """Row of a set."""
    return row_of(undisclosed, outcomes(undisclosed))


def search(start: Undisclosed, seed: int, leave_out: str | None, evaluations: int) -> list[Row]:
    """Rows of the last and best sets of CMA-ES from `start`, which ends at the first that reaches all targets.

    `evaluations`: largest number of sets to run. The target `leave_out` is not required.
    """
    cma = needed("cma")
    strategy = cma.CMAEvolutionStrategy(
        to_unit_cube(start).tolist(), FIRST_WIDTH,
        {"seed": 1 + seed, "bounds": [0.0, 1.0], "popsize": POPULATION, "verbose": -9},
    )  # fmt: skip
    generations: list[list[Row]] = []
    most, run, reached = np.inf, 0, False
    while run < evaluations and not reached:
        points = strategy.ask()
        tried = [_tried(from_unit_cube(np.asarray(point)), most, leave_out) for point in points]
        values = [value for value, _ in tried]
        strategy.tell(points, values)
        run += sum(value < IMPLAUSIBLE for value in values)
        most = float(np.median(values))  # the worse half only has to be known as worse
        generations = [*generations[-2:], [row for _, row in tried if row is not None]]
        reached = any(reaches(row, leave_out) for row in generations[-1])
    last = [row for rows in generations for row in rows]
    last.sort(key=lambda row: (not reaches(row, leave_out), float(row[_column(leave_out)])))
    return [{"rank": k, "evaluations": run, **row} for k, row in enumerate(last[:KEPT])]


def _column(leave_out: str | None) -> str:
    return "misfit" if leave_out is None else "misfit without 2"


def _tried(
    undisclosed: Undisclosed, most: float, leave_out: str | None
) -> tuple[float, Row | None]:
    """Misfit and row of a set; or a bound of its misfit that is above `most`, and None."""
    off = implausible(undisclosed)
    if off > 0.0:
        return IMPLAUSIBLE * (1.0 + off), None
    value, found = misfit_up_to(undisclosed, most, leave_out)
    return value, None if found is None else row_of(undisclosed, found)


def sample(walkers: Sequence[Row], seed: int, leave_out: str | None, steps: int) -> list[Row]:
    """A row per walker after this number of `steps` of the sampler; and one per set on the way that reaches all targets."""
    column = _column(leave_out)
    points = np.array([to_unit_cube(undisclosed_of(row)) for row in walkers])
    most = 2.0 * float(np.median([float(row[column]) for row in walkers])) + HOPELESS
    rows = {point.tobytes(): row for point, row in zip(points, walkers, strict=True)}

    def log_posterior(point: Floats) -> float:
        if np.any((point < 0.0) | (point > 1.0)):
            return -np.inf
        _, row = _tried(from_unit_cube(point), most, leave_out)
        if row is None:
            return -np.inf
        rows[point.tobytes()] = row
        return _log_posterior(row, column)

    values = np.array([_log_posterior(row, column) for row in walkers])
    walked = walk(points, values, log_posterior, seed, steps)
    # a walker that stayed keeps its row: to the cube and back its set would be rounded
    found = [rows.pop(point.tobytes()) for point in walked.points]
    for point in points:
        rows.pop(point.tobytes(), None)
    passed = [row for row in rows.values() if reaches(row, leave_out)]
    return [
        *(
            {"walker": k, "accepted": float(share), **{name: row[name] for name in PASSED}}
            for k, (row, share) in enumerate(zip(found, walked.accepted, strict=True))
        ),
        *({"walker": -1, **{name: row[name] for name in PASSED}} for row in passed),
    ]


def _log_posterior(row: Row, column: str) -> float:
    return -SHARPNESS * float(row[column]) - DISORDER * (float(row["slides"]) > 0.0)


def around(found: Sequence[Row], seed: int, draws: int) -> list[Row]:
    """Rows of the sets that reach all targets, among sets drawn around those `found`, each about one of these.

    Switching valves make the misfit rough. So few of the sets near a good one reach all targets, however near they are.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(draws):
        start = to_unit_cube(undisclosed_of(found[int(rng.integers(len(found)))]))
        width = np.exp(rng.uniform(*np.log(NEARNESS)))
        point = np.clip(start + width * rng.standard_normal(start.size), 0.0, 1.0)
        _, row = _tried(from_unit_cube(point), POOR, None)
        if row is not None and reaches(row):
            rows.append({name: row[name] for name in PASSED})
    return rows


ARMS: Mapping[str, str | None] = {"all": None, "held out": HOLD_OUT}
"""What is asked of a set, and the target that is left out."""
STARTS = 1
"""Points of the prior from which sets are sought in each arm; `--events` asks for more."""
NEAR, NEARBY = 23, 0.02
"""Walkers that begin near the set in use, and the standard deviation of their distance as a share of every range."""


@dataclass(frozen=True)
class Effort:
    """How much is run; a small one is for tests."""

    evaluations: int = 2500
    """Sets that a search may run; one in ten or fewer needs more."""
    generations: int = 4
    """Pieces of work of the sampler."""
    steps: int = 10
    """Its steps in each."""
    clouds: int = 10
    """Pieces of work that draw sets around those found."""
    draws: int = 60
    """Draws in each."""


WHOLE = Effort()


def first_cells(seed: int, starts: int, effort: Effort = WHOLE) -> list[Task]:
    """The shipped set, and a search from each start of the prior in each arm."""
    for package in ("cma", "emcee"):
        needed(package)
    return [
        Task("shipped", tried_row, (CALIBRATED,), (("arm", "all"), ("stage", "shipped"))),
        *(
            Task(f"near/{k}", noisy_row, (CALIBRATED, seed, k), (("arm", "all"), ("stage", "near")))
            for k in range(NEAR)
        ),
        *(
            Task(
                f"{arm}/start/{k}", search, (one, _number(seed, arm, k), leave_out, effort.evaluations),
                (("arm", arm), ("stage", "start"), ("start", k)),
            )
            for k, one in enumerate(draw(starts, seed))
            for arm, leave_out in ARMS.items()
        ),
    ]  # fmt: skip


def noisy_row(undisclosed: Undisclosed, seed: int, k: int) -> Row:
    """Row of the draw `k` of noise on a set, kept within the ranges: a walker near it."""
    noise = np.random.default_rng([seed, k]).standard_normal(len(BOUNDS))
    return tried_row(from_unit_cube(np.clip(to_unit_cube(undisclosed) + NEARBY * noise, 0.0, 1.0)))


def later_cells(
    generation: int, seed: int, starts: int, table: pd.DataFrame, effort: Effort = WHOLE
) -> list[Task]:
    """The sampler's next steps from where the walkers are; the first from the set in use, near it, and what searches found.

    Only with all targets: walkers that start from fits of two cars would be long in forgetting them.
    """
    if generation >= effort.generations:
        return []
    own = table[table["arm"] == "all"]
    if generation:
        latest = own[(own["generation"] == generation - 1) & (own["walker"] >= 0)]
        rows = latest.sort_values("walker")
    else:
        rows = own.drop_duplicates(subset=list(BOUNDS))
    walkers = rows[list(PASSED)].to_dict("records")
    return [
        Task(
            f"all/generation/{generation}", sample,
            (walkers, _number(seed, "all", starts + generation), None, effort.steps),
            (("arm", "all"), ("stage", "sampled"), ("generation", generation)),
        )
    ]  # fmt: skip


def cloud_cells(
    cloud: int, seed: int, starts: int, table: pd.DataFrame, effort: Effort = WHOLE
) -> list[Task]:
    """More sets around all that reach everything so far."""
    if cloud >= effort.clouds:
        return []
    found = distinct(table[table["arm"] == "all"])
    if found.empty:
        return []
    number = _number(seed, "all", 1000 + cloud)
    arguments = (found[list(PASSED)].to_dict("records"), number, effort.draws)
    columns = (("arm", "all"), ("stage", "around"), ("generation", WHOLE.generations + cloud))
    return [Task(f"all/around/{cloud}", around, arguments, columns)]


def _number(seed: int, arm: str, k: int) -> int:
    """Seed of a piece of work, below 2^31."""
    drawn = np.random.SeedSequence([seed, list(ARMS).index(arm), k]).generate_state(1)[0]
    return int(drawn) % (2**31 - 2)


SLIDE_CALIBRATION = Study(
    name="slide-calibration",
    question="which sets of what JP4209318 does not disclose reach its Tables 3 and 4, and how far apart they lie",
    default_events=STARTS,  # points of the prior from which sets are sought
    step=STARTS,
    cells=first_cells,
    later=(
        *(partial(later_cells, generation) for generation in range(WHOLE.generations)),
        *(partial(cloud_cells, cloud) for cloud in range(WHOLE.clouds)),
    ),
    judge=ensemble_statements,
    claims=CLAIMS,
    whole=True,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the members from the sweep's table, whose missing rows are run first."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    parser.add_argument("--out", type=Path, default=FILE)
    given = parser.parse_args(arguments)
    folder = study_folder(given.results, SLIDE_CALIBRATION.name)
    table = SLIDE_CALIBRATION.run(folder, SLIDE_CALIBRATION.default_events, given.seed, given.jobs)
    parts = [chosen(table, arm, leave_out).head(MOST_MEMBERS) for arm, leave_out in ARMS.items()]
    pd.concat(parts)[["arm", *BOUNDS]].to_csv(given.out, index=False)
    print(", ".join(f"{arm}: {len(part)} sets" for arm, part in zip(ARMS, parts, strict=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
