"""What the ensemble of the slide protection's calibration says: how large it is, what it determines and predicts."""

import math

import numpy as np
import pandas as pd

from studies.core.ensemble_range import RANGE, median_of, range_of
from studies.core.statement import Statement
from studies.core.verdict import decided
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


def ensemble_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements of the sweep `slide-calibration`."""
    members = distinct(table[table["arm"] == "all"])
    held_out = distinct(table[table["arm"] == "held out"], HOLD_OUT)
    return [
        _large(table, members),
        _in_use(table, members),
        _determined(members),
        _settled(table),
        held_out_statement(held_out),
        logarithm_statement(held_out),
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
    return decided(
        "ensemble", f"at least {LEAST_MEMBERS} sets reach all that is printed, within the tolerances",
        {f"so many: {len(members)}": len(members) >= LEAST_MEMBERS},
        {
            "free parameters": PARAMETERS,
            "printed numbers that they meet": PRINTED_NUMBERS,
            "distinct sets that reach all": len(members),
            "share of the searches from the prior that end on target": reached,
            "sets run by a search; its range": median_of(firsts["evaluations"]),
            "mean share of steps that a walker takes": table["accepted"].mean(),
        },
        f"CMA-ES from drawn sets, then differential evolution Monte Carlo; {RANGE}",
    )  # fmt: skip


def _in_use(table: pd.DataFrame, members: pd.DataFrame) -> Statement:
    """The set in use was found otherwise: is it one of the ensemble, or far from the rest of it?"""
    row = table[table["stage"] == "shipped"].iloc[0]
    others = members[members["stage"] != "shipped"]
    passes = reaches(row.to_dict())
    better = float((others["misfit"] < row["misfit"]).mean()) if len(others) else math.nan
    outside = [
        name for name in BOUNDS
        if len(others) and not others[name].min() <= row[name] <= others[name].max()
    ]  # fmt: skip
    return decided(
        "set in use", "the set in use reaches all that is printed, as the others of the ensemble do",
        {"so far": passes},
        {
            "its misfit; range of the others'": range_of(float(row["misfit"]), others["misfit"]),
            "share of the others that miss less": better,
            "parameters in which it lies outside of all others": len(outside),
        },
        "it was found by damped least squares and a random search nearby; one walker started there",
        {f"within the others in {name}": False for name in outside},
    )  # fmt: skip


def _determined(members: pd.DataFrame) -> Statement:
    points = np.array([to_unit_cube(undisclosed_of(row)) for _, row in members.iterrows()])
    low, high = (
        np.percentile(points, (5.0, 95.0), axis=0) if len(points) else (np.zeros(PARAMETERS),) * 2
    )
    widths = dict(zip(BOUNDS, (high - low).tolist(), strict=True))
    narrow = {name: width <= NARROW for name, width in widths.items()}
    spread = _spread(points)
    sharp = int((spread <= SHARP).sum())
    return decided(
        "determined", "the printed numbers determine the undisclosed curves and rules",
        {f"{name}: 90 % of the members within {100.0 * widths[name]:.0f} % of its range": met
         for name, met in narrow.items()},
        {
            **{f"{name}: first; range": range_of(float(members[name].iloc[0]), members[name]) for name in BOUNDS},
            "parameters determined": sum(narrow.values()),
            f"combinations, of {PARAMETERS}, with at most {SHARP:g} of the prior's deviation": sharp,
            "least deviation of a combination over the prior's": float(spread.min(initial=math.inf)),
            "greatest": float(spread.max(initial=0.0)),
        },
        f"combinations: principal axes of the members in the unit cube; determined: 90 % within {100 * NARROW:g} % of the "
        f"range; members descend from few searches, so their widths are lower bounds; {RANGE}",
        some=False,
    )  # fmt: skip


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
    worst = float(np.max(shift))
    moved = float(rows.loc[rows["generation"] == last, "accepted"].mean())
    return decided(
        "settled", "the sampler has forgotten where its walkers began",
        {
            f"at rest: {list(BOUNDS)[int(np.argmax(shift))]}" if worst == worst else "steps enough": worst <= SETTLED,
            f"free enough: walkers take {100.0 * moved:.0f} % of their steps": moved >= MOVING,
        },
        {
            "largest shift of a parameter's mean over the second half [standard deviations]": worst,
            "mean share of steps that walkers take at last": moved,
        },
        f"at most {SETTLED:g} and at least {MOVING:g}; where not, the ensemble is narrower than the posterior",
    )  # fmt: skip


def held_out_statement(rows: pd.DataFrame) -> Statement:
    """What fits to one and three cars alone predict of two. `rows`: outcomes of such fits."""
    errors = rows[HOLD_OUT] - TABLE_3[2]
    near = errors.abs() <= HOLD_OUT_TOLERANCE
    rest = [
        name for _, row in rows.iterrows()
        for name in unreached({one: float(row[one]) for one in OUTCOMES}) if name != HOLD_OUT
    ]  # fmt: skip
    return decided(
        "held out", "fitted to one and three cars only, the distance of two cars comes out within 1 %",
        {"": bool(near.all()) and len(rows) > 0},
        {
            "fits": len(rows),
            "predicted distance of 2 cars [m], median and range; source 414": median_of(rows[HOLD_OUT]),
            "error [%], median and range": median_of(100.0 * errors / TABLE_3[2]),
            "share of the fits within 1 %": near,
        },
        RANGE,
        further={f"reached by every fit: {name}": False for name in dict.fromkeys(rest)},
        partly=bool(near.any()),
        enough=len(rows) > 0,
    )  # fmt: skip


def logarithm_statement(rows: pd.DataFrame) -> Statement:
    """Whether the fits to one and three cars predict two better than a curve of two parameters through both."""
    errors = (rows[HOLD_OUT] - TABLE_3[2]).abs()
    curve = logarithm(2) - TABLE_3[2]
    nearer = errors < abs(curve)
    return decided(
        "logarithm",
        f"fitted to one and three cars only, {PARAMETERS} parameters predict two cars better than the two of a logarithm",
        {"": bool(nearer.mean() > 0.5) if len(rows) else False},
        {
            "logarithm through one and three cars: distance of 2 cars [m]; source 414": logarithm(2),
            "its error [m]": curve,
            "error of the fits, magnitude [m], median and range": median_of(errors),
            "share of the fits that are nearer than the logarithm": nearer,
        },
        f"a + b ln(cars); better: more than half of the fits are nearer; {RANGE}",
        enough=len(rows) > 0,
    )  # fmt: skip


def members_statement(table: pd.DataFrame) -> Statement:
    """Whether the members stand as they are stored, and what noise leaves of them."""
    rows = table[table["part"] == "member"]
    good = _on_target(rows)
    noisy = table[table["part"] == "noise"]
    return decided(
        "members", "every set of the ensemble reaches all that is printed",
        {f"{int((~good).sum())} of {len(good)}": bool(good.all())},
        {
            "free parameters": PARAMETERS,
            "printed numbers": PRINTED_NUMBERS,
            "sets": len(rows),
            **{f"share still on target after noise of {size:g} on every parameter":
               _on_target(noisy[noisy["noise"] == size]) for size in NOISES},
            **{f"{name}: in use; range": range_of(float(rows[name].iloc[0]), rows[name]) for name in BOUNDS},
            **{f"{name} [{target.unit}]: in use; range": range_of(float(rows[name].iloc[0]), rows[name])
               for name, target in TARGETS.items()},
        },
        f"one draw of noise each; {RANGE}",
    )  # fmt: skip


def _on_target(rows: pd.DataFrame) -> "pd.Series[bool]":
    return pd.Series(
        [not unreached({one: float(row[one]) for one in OUTCOMES}) for _, row in rows.iterrows()],
        dtype=bool,
    )
