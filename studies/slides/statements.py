"""What the table of the sweep `slide-protection` says, target by target and finding by finding."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from studies.core.ensemble_range import over_members
from studies.core.statement import Interval, Statement, single
from studies.core.verdict import decide, decided, over_cases
from studies.slides.electric import electric_statement
from studies.slides.ensemble_statements import (
    held_out_statement,
    logarithm_statement,
    members_statement,
)
from studies.slides.extrapolation import beyond_statement
from studies.slides.targets import (
    TABLE_3,
    TARGETS,
    front,
    reached,
    target_numbers,
)

STEP_DISTANCE, STEP_DAMAGE = 0.05, 0.01
"""By how much halving the step may move a distance [m], and Q as a share."""
JITTER_DISTANCE = 0.05
"""Standard deviation of a distance [m] that noise of 1e-4 on every parameter may make."""
COMPUTING = 10.0
"""Computing time [ms] per simulated second."""


def tables(table: pd.DataFrame, part: str = "tables") -> dict[str, float]:
    """The targets' numbers from the rows of a part."""
    rows = table[table["part"] == part].set_index(["cars", "setting"])
    stops: Any = rows[["distance", "damage"]].to_dict("index")
    return target_numbers(stops)


def slide_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements of the sweep: those of the set in use, each with the verdicts of the ensemble's members."""
    own = table[table["member"].isna()]
    members = [rows for _, rows in table[table["member"].notna()].groupby("member", sort=True)]
    of_members = [_of_a_set(rows) for rows in members]
    return [
        *(
            over_members(statement, [others[k] for others in of_members])
            for k, statement in enumerate(_of_a_set(own))
        ),
        held_out_statement(own[own["part"] == "held out"]),
        logarithm_statement(own[own["part"] == "held out"]),
        _step(own),
        _jitter(own),
        members_statement(table),
        beyond_statement(table),
        _computing(own),
    ]


def _of_a_set(table: pd.DataFrame) -> list[Statement]:
    """What is said of every set alike, from its rows."""
    found = tables(table)
    return [
        _targets("Table 3", "the braking distances of one, two and three cars are the source's",
                 found, [f"distance {cars}" for cars in TABLE_3]),
        _targets("Table 4", "with the sensitivity alone changed, Q and distance are the source's",
                 found, [name for name in TARGETS if not name.startswith("distance")]),
        _short_trains(found),
        *_slips(table),
        _no_lock(table),
        _trade(table),
        _rivals(table),
        electric_statement(table),
    ]  # fmt: skip


def _targets(name: str, claim: str, found: dict[str, float], targets: list[str]) -> Statement:
    return over_cases(
        name, claim, {f"reached: {target}": reached(target, found[target]) for target in targets},
        {f"{TARGETS[t].meaning} [{TARGETS[t].unit}]; source {TARGETS[t].value:.4g}": found[t] for t in targets},
        "parameters calibrated on these very tables; tolerances: "
        + ", ".join(f"{target} {TARGETS[target].tolerance:.3g}" for target in targets),
    )  # fmt: skip


def _short_trains(found: dict[str, float]) -> Statement:
    distances = [found[f"distance {cars}"] for cars in (1, 2, 3)]
    return decided(
        "short trains", "short trains brake longer in rain", {"": bool(np.all(np.diff(distances) < 0.0))},
        {f"distance of {k + 1} cars [m]": value for k, value in enumerate(distances)},
    )  # fmt: skip


def _slips(table: pd.DataFrame) -> list[Statement]:
    rows = table[(table["part"] == "tables") & (table["cars"] == 3)].set_index("setting")
    slip = {
        name: 100.0 * np.array([rows.loc[name, f"slip_{i + 1}"] for i in range(12)], dtype=float)
        for name in rows.index
    }
    claims: tuple[tuple[str, str, Callable[[Any], Any]], ...] = (
        ("first axle", "the first axle slides most", lambda s: s.argmax() == 0),
        ("even axles", "within a bogie the rear axle slides less, since the valves act per bogie",
         lambda s: (s[1::2] < s[0::2]).all()),
        ("further back", "cars further back slide less",
         lambda s: (np.diff(s.reshape(3, 4).mean(axis=1)) < 0.0).all()),
    )  # fmt: skip
    return [
        decided(
            name,
            claim,
            {f"at {setting} sensitivity": bool(test(s)) for setting, s in slip.items()},
            {f"mean slip of axle {i + 1}, medium [%]": slip["medium"][i] for i in range(12)},
            "mean slip ratio while the train runs above 5 km/h",
            partly=bool(test(slip["medium"])),
        )
        for name, claim, test in claims
    ]


def _no_lock(table: pd.DataFrame) -> Statement:
    own = table[table["part"].isin(["tables", "halved", "pareto"])]
    without = table[table["part"] == "none"].iloc[0]
    free, tried = own["locked_time"] == 0.0, own["part"] == "pareto"
    return Statement(
        "no lock",
        "no wheel locks above 5 km/h under fuzzy slide protection, at any sensitivity",
        decide(free[~tried], free[tried]),
        {
            "longest time at a stand, over the axles [s]": single(own["locked_time"].max()),
            "without slide protection [s]": single(without["locked_time"]),
        },
        tuple(f"not at sensitivity {x:.3g}" for x in own["sensitivity"][own["locked_time"] > 0.0]),
    )


def _trade(table: pd.DataFrame) -> Statement:
    rows = table[table["part"] == "pareto"].sort_values("sensitivity")
    settings = table[(table["part"] == "tables") & (table["cars"] == 3)].set_index("setting")
    beaten = {
        name: int(((rows["distance"] < row["distance"]) & (rows["damage"] < row["damage"])).sum())
        for name, row in settings.iterrows()
    }
    share = len(front(rows)) / len(rows)
    return over_cases(
        "trade", "the sensitivity trades distance for Q: the three settings lie on the front of what it can give",
        {f"at {name} sensitivity": not count for name, count in beaten.items()},
        {
            "rank correlation of sensitivity and Q": rows["sensitivity"].corr(rows["damage"], method="spearman"),
            "sensitivities on the front, of those tried": Interval(share, math.nan, math.nan, len(rows)),
            **{f"sensitivities that beat {name} in both": count for name, count in beaten.items()},
        },
    )  # fmt: skip


def _rivals(table: pd.DataFrame) -> Statement:
    own = front(table[table["part"] == "pareto"])
    plain = table[table["part"] == "threshold"]
    reach = np.interp(plain["damage"], own["damage"][::-1], own["distance"][::-1])
    longer = {
        f"hold {row['hold']:g}, release {row['release']:g}": (
            float(row["distance"] - most),
            float(row["damage"]),
        )
        for (_, row), most in zip(plain.iterrows(), reach, strict=True)
    }  # distance [m] and Q [kJ]
    without = table[table["part"] == "none"].iloc[0]
    return over_cases(
        "threshold", "at the same Q the fuzzy slide protection brakes shorter than plain thresholds",
        {f"with {law}": metres > 0.0 for law, (metres, _) in longer.items()},
        {
            **{f"{law}: longer by [m]": metres for law, (metres, _) in longer.items()},
            **{f"{law}: Q [kJ]": q for law, (_, q) in longer.items()},
            "without slide protection: distance [m]": without["distance"],
            "without slide protection: Q [kJ]": without["damage"],
        },
        "distance at the same Q interpolated on the front; curve flat beyond its peak, so long slides cost no adhesion here",
    )  # fmt: skip


def _step(table: pd.DataFrame) -> Statement:
    runs = table.set_index(["cars", "setting"])
    whole, halved = (runs[runs["part"] == part] for part in ("tables", "halved"))
    distance = (halved["distance"] - whole["distance"]).abs()
    q = (halved["damage"] / whole["damage"] - 1.0).abs()
    met = (distance <= STEP_DISTANCE) & (q <= STEP_DAMAGE)
    return over_cases(
        "step", "halving the step moves distances by at most 0.05 m and Q by at most 1 %",
        {f"with {cars} cars, {setting}: {metres:.3f} m, {100 * share:.2f} %": good
         for (cars, setting), metres, share, good in zip(met.index, distance, q, met, strict=True)},
        {"largest change of a distance [m]": distance.max(), "largest change of Q [%]": 100.0 * q.max()},
    )  # fmt: skip


def _jitter(table: pd.DataFrame) -> Statement:
    rows = table[table["part"] == "jitter"]
    spread = rows[list(TARGETS)].std()
    return over_cases(
        "jitter", "noise of 1e-4 on every parameter moves distances by at most 0.05 m (standard deviation)",
        {f"of {name}": spread[name] <= JITTER_DISTANCE for name in (f"distance {cars}" for cars in TABLE_3)},
        {
            **{f"{name} [{TARGETS[name].unit}]: mean, least and greatest; deviation {spread[name]:.2g}":
               Interval(rows[name].mean(), rows[name].min(), rows[name].max(), len(rows)) for name in TARGETS},
            **{f"share of draws that reach {name}": float(np.mean([reached(name, v) for v in rows[name]]))
               for name in TARGETS},
        },
        "limits are ranges, not confidence",
    )  # fmt: skip


def _computing(table: pd.DataFrame) -> Statement:
    rows = table[(table["part"] == "tables") & (table["cars"] == 3)]
    value = float(rows["computing"].min())
    return decided(
        "computing", "a simulated second of twelve axles at 1 ms takes at most 10 ms of computing",
        {"": value <= COMPUTING},
        {"least of the runs of three cars [ms per simulated s]": value},
        "of the machine that made the table; the least, for others may have disturbed it",
    )  # fmt: skip
