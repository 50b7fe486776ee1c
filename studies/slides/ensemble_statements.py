"""Claims about the ensemble of the slide protection's calibration: how large it is, what it determines and predicts."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction, how_many
from studies.core.ensemble_range import RANGE, median_of, range_of
from studies.core.statement import Statement, in_words
from studies.slides.calibration import reaches, to_unit_cube, undisclosed_of
from studies.slides.jp4209318 import BOUNDS
from studies.slides.targets import (
    HOLD_OUT,
    HOLD_OUT_TOLERANCE,
    OUTCOMES,
    PRINTED_NUMBERS,
    TABLE_3,
    TARGETS,
    logarithm,
    unreached,
)

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


MEMBERS = "the tables do not tell which set is right"
LARGE = Claim(
    "ensemble", f"at least {LEAST_MEMBERS} sets reach all that is printed, within the tolerances", "sets", AT_LEAST,
    LEAST_MEMBERS, exact=True, reason=MEMBERS, show=in_words("so many: {:.0f}"),
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
