"""The demonstration of JP4209318: its tables, what lies between their settings, other laws, noise, the ensemble."""

import math
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from alloc.onboard.brakes import SlideProtection, Threshold
from studies.core.calibration import over_members
from studies.core.cell import Task
from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction, how_many, meets
from studies.core.statement import Interval, Statement
from studies.core.study import Study
from studies.slides.electric import (
    BEYOND,
    ELECTRIC_BRAKE,
    STOPS,
    beyond_row,
    beyond_statement,
    electric_row,
    electric_statement,
    electric_tasks,
)
from studies.slides.electric import PART as ELECTRIC
from studies.slides.ensemble_study import (
    HELD_OUT_CLAIMS,
    MEMBERS_CLAIM,
    NOISES,
    held_out_statements,
    members_statement,
)
from studies.slides.jp4209318 import (
    CALIBRATED,
    DURATIONS,
    HALVED_STEP,
    HELD_OUT,
    MEMBERS,
    REACHED,
    STEP,
    TABLE_3,
    TABLE_4,
    TARGETS,
    Undisclosed,
    brake,
    brake_event,
    front,
    jittered,
    measures,
    outcomes,
    slide_protection,
    target_numbers,
)

# Claims about the table of the sweep `slide-protection`: target by target and finding by finding.

STEP_DISTANCE, STEP_DAMAGE = 0.05, 0.01
"""By how much halving the step may move a distance [m], and Q as a share."""
JITTER_DISTANCE = 0.05
"""Standard deviation of a distance [m] that noise of 1e-4 on every parameter may make."""
COMPUTING = 10.0
"""Computing time [ms] per simulated second."""
DISTANCES = [f"distance {cars}" for cars in TABLE_3]
SOURCE, NUMERICS = "the source finds it so", "what depends on the computation is no result"
TRIED = "part == pareto"
"""Stops with sensitivities between and beyond those of the source."""


def _table(name: str, claim: str, targets: list[str]) -> Claim:
    return Claim(
        name, claim, cases=tuple(REACHED[one] for one in targets), some=True,
        numbers={f"{TARGETS[one].meaning} [{TARGETS[one].unit}]; source {TARGETS[one].value:.4g}": f"'{one}'"
                 for one in targets},
        method="parameters calibrated on these very tables; tolerances: "
        + ", ".join(f"{one} {TARGETS[one].tolerance:.3g}" for one in targets),
    )  # fmt: skip


def _order(name: str, claim: str) -> Claim:
    """That slips of the axles have an order, by the margin by which they have it; needed at medium sensitivity alone."""
    bounds = {
        one: Claim(f"at {one} sensitivity", mean=f"'{name}, {one}'", exact=True, reason=SOURCE)
        for one in TABLE_4
    }
    return Claim(
        name, claim, cases=(bounds.pop("medium"),), besides=tuple(bounds.values()),
        numbers={f"mean slip of axle {i}, medium [%]": f"slip_{i}" for i in range(1, 13)},
        method="mean slip ratio while the train runs above 5 km/h",
    )  # fmt: skip


ORDERS = (
    _order("first axle", "the first axle slides most"),
    _order(
        "even axles", "within a bogie the rear axle slides less, since the valves act per bogie"
    ),
    _order("further back", "cars further back slide less"),
)
TABLES = (
    _table("Table 3", "the braking distances of one, two and three cars are the source's", DISTANCES),
    _table("Table 4", "with the sensitivity alone changed, Q and distance are the source's",
           [name for name in TARGETS if name not in DISTANCES]),
    Claim(
        "short trains", "short trains brake longer in rain",
        cases=tuple(
            Claim(f"longer with {few} cars than with {few + 1}", mean=f"'distance {few}' - 'distance {few + 1}'", exact=True,
                  reason=SOURCE)
            for few in (1, 2)
        ),
        numbers={f"distance of {cars} cars [m]": f"'distance {cars}'" for cars in TABLE_3},
    ),
)  # fmt: skip
NO_LOCK = Claim(
    "no lock", "no wheel locks above 5 km/h under fuzzy slide protection, at any sensitivity",
    cases=(Claim("at the source's sensitivities", mean="locked_time > 0", side=AT_MOST, only="part != pareto", exact=True,
                 reason=SOURCE, show=how_many("in", "stops")),),
    besides=(Claim("at all others", mean="locked_time > 0", side=AT_MOST, only=TRIED, exact=True,
                   reason="no setting is to flatten a wheel", show=how_many("in", "stops")),),
    numbers={"longest time at a stand, over the axles [s]": "largest of locked_time"},
)  # fmt: skip
TRADE = Claim(
    "trade", "the sensitivity trades distance for Q: the three settings lie on the front of what it can give", some=True,
    cases=tuple(
        Claim(f"at {name} sensitivity", mean=f"'sensitivities that beat {name} in both'", side=AT_MOST, exact=True,
              reason="on the front none is better in both")
        for name in TABLE_4
    ),
)  # fmt: skip
RIVALS = Claim(
    "threshold", "at the same Q the fuzzy slide protection brakes shorter than plain thresholds", "longer", each="law",
    some=True, exact=True, reason="better is shorter",
    method="distance at the same Q interpolated on the front; curve flat beyond its peak, so long slides cost no adhesion "
    "here",
)  # fmt: skip
HALVED = Claim(
    "step", "halving the step moves distances by at most 0.05 m and Q by at most 1 %",
    f"distance_change <= {STEP_DISTANCE} and damage_change <= {STEP_DAMAGE}", AT_LEAST, 1.0, each="run", some=True,
    exact=True, reason=NUMERICS, numbers={"largest change of a distance [m]": "largest of distance_change"},
)  # fmt: skip
JITTER = Claim(
    "jitter", "noise of 1e-4 on every parameter moves distances by at most 0.05 m (standard deviation)", some=True,
    cases=tuple(Claim(f"of {name}", mean=f"'{name}'", side=AT_MOST, value=JITTER_DISTANCE, exact=True, reason=NUMERICS)
                for name in DISTANCES),
    method="limits are ranges, not confidence",
)  # fmt: skip
COMPUTED = Claim(
    "computing", "a simulated second of twelve axles at 1 ms takes at most 10 ms of computing", "computing", AT_MOST,
    COMPUTING, exact=True, reason="aim of this project",
    numbers={"least of the runs of three cars [ms per simulated s]": "computing"},
    method="of the machine that made the table; the least, for others may have disturbed it",
)  # fmt: skip
CLAIMS = (
    *TABLES, *ORDERS, NO_LOCK, TRADE, RIVALS, ELECTRIC_BRAKE, *HELD_OUT_CLAIMS, HALVED, JITTER, MEMBERS_CLAIM, BEYOND,
    COMPUTED,
)  # fmt: skip


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
        *held_out_statements(own[own["part"] == "held out"]),
        _step(own),
        _jitter(own),
        members_statement(table),
        beyond_statement(table),
        conjunction(_three_cars(own)[["computing"]].min().to_frame().T, COMPUTED, least_events=0),
    ]


def _three_cars(table: pd.DataFrame) -> pd.DataFrame:
    return table[(table["part"] == "tables") & (table["cars"] == 3)]


def _of_a_set(table: pd.DataFrame) -> list[Statement]:
    """What is said of every set alike, from its rows."""
    settings = _three_cars(table).set_index("setting")
    numbers = pd.DataFrame([tables(table) | _slips(settings)])
    own = table[table["part"].isin(["tables", "halved", "pareto"])]
    without = table[table["part"] == "none"].iloc[0]
    return [
        *(conjunction(numbers, claim, least_events=0) for claim in (*TABLES, *ORDERS)),
        conjunction(
            own, NO_LOCK, least_events=0, numbers={"without slide protection [s]": float(without["locked_time"])}
        ),
        _trade(table, settings),
        _rivals(table, without),
        electric_statement(table),
    ]  # fmt: skip


def _slips(settings: pd.DataFrame) -> dict[str, float]:
    """Slips of the axles at medium sensitivity [%], and by how much those of each setting are in the source's order."""
    found: dict[str, float] = {}
    for name, row in settings.iterrows():
        slip = 100.0 * np.array([row[f"slip_{i + 1}"] for i in range(12)], dtype=float)
        if name == "medium":
            found |= {f"slip_{i + 1}": float(value) for i, value in enumerate(slip)}
        found |= {
            f"first axle, {name}": float(slip[0] - slip[1:].max()),
            f"even axles, {name}": float((slip[0::2] - slip[1::2]).min()),
            f"further back, {name}": float(-np.diff(slip.reshape(3, 4).mean(axis=1)).max()),
        }
    return found


def _trade(table: pd.DataFrame, settings: pd.DataFrame) -> Statement:
    rows = table[table["part"] == "pareto"].sort_values("sensitivity")
    beaten = {
        f"sensitivities that beat {name} in both": int(
            ((rows["distance"] < row["distance"]) & (rows["damage"] < row["damage"])).sum()
        )
        for name, row in settings.iterrows()
    }
    share = len(front(rows)) / len(rows)
    numbers = {
        "rank correlation of sensitivity and Q": rows["sensitivity"].corr(rows["damage"], method="spearman"),
        "sensitivities on the front, of those tried": Interval(share, math.nan, math.nan, len(rows)),
        **beaten,
    }  # fmt: skip
    return conjunction(pd.DataFrame([beaten]), TRADE, numbers=numbers, least_events=0)


def _rivals(table: pd.DataFrame, without: "pd.Series[Any]") -> Statement:
    own = front(table[table["part"] == "pareto"])
    plain = table[table["part"] == "threshold"]
    reach = np.interp(plain["damage"], own["damage"][::-1], own["distance"][::-1])
    laws = [f"hold {row['hold']:g}, release {row['release']:g}" for _, row in plain.iterrows()]
    longer = plain.assign(law=[f"with {law}" for law in laws], longer=plain["distance"] - reach)
    numbers = {
        **{f"{law}: longer by [m]": value for law, value in zip(laws, longer["longer"], strict=True)},
        **{f"{law}: Q [kJ]": value for law, value in zip(laws, longer["damage"], strict=True)},
        "without slide protection: distance [m]": without["distance"],
        "without slide protection: Q [kJ]": without["damage"],
    }  # fmt: skip
    return conjunction(longer, RIVALS, numbers=numbers)


def _step(table: pd.DataFrame) -> Statement:
    runs = table.set_index(["cars", "setting"])
    whole, halved = (runs[runs["part"] == part] for part in ("tables", "halved"))
    changes = pd.DataFrame({
        "distance_change": (halved["distance"] - whole["distance"]).abs(),
        "damage_change": (halved["damage"] / whole["damage"] - 1.0).abs(),
    })  # fmt: skip
    changes["run"] = [
        f"with {cars} cars, {setting}: {metres:.3f} m, {100 * share:.2f} %"
        for (cars, setting), metres, share in zip(changes.index, *changes.to_numpy().T, strict=True)
    ]  # fmt: skip
    numbers = {"largest change of Q [%]": 100.0 * changes["damage_change"].max()}
    return conjunction(changes, HALVED, numbers=numbers)


def _jitter(table: pd.DataFrame) -> Statement:
    rows = table[table["part"] == "jitter"]
    spread = rows[list(TARGETS)].std()
    numbers = {
        **{f"{name} [{TARGETS[name].unit}]: mean, least and greatest; deviation {spread[name]:.2g}":
           Interval(rows[name].mean(), rows[name].min(), rows[name].max(), len(rows)) for name in TARGETS},
        **{f"share of draws that reach {name}": float(np.mean([meets(REACHED[name], v) for v in rows[name]]))
           for name in TARGETS},
    }  # fmt: skip
    return conjunction(spread.to_frame().T, JITTER, numbers=numbers, least_events=0)


SENSITIVITIES = tuple(float(x) for x in np.geomspace(0.4, 12.0, 33))
"""Of the front of distance against Q; 1 is medium."""
THRESHOLDS = ((0.01, 0.02), (0.02, 0.04), (0.03, 0.06), (0.05, 0.10), (0.08, 0.15), (0.12, 0.25))
"""Slip ratios above which the plain threshold law holds and releases the pressure."""

Stop = tuple[dict[str, Any], SlideProtection, int, float]
"""Identity of a row; protection, cars and step of its run."""


def stops(undisclosed: Undisclosed = CALIBRATED) -> Iterator[Stop]:
    """Every run of a set; with half the step of the one in use alone."""

    def fuzzy(sensitivity: float) -> SlideProtection:
        return slide_protection(law="fuzzy", fuzzy=undisclosed.fuzzy(sensitivity))

    for step in (STEP, HALVED_STEP) if undisclosed == CALIBRATED else (STEP,):
        part = "tables" if step == STEP else "halved"
        for cars in (1, 2, 3):
            yield {"part": part, "cars": cars, "setting": "medium"}, fuzzy(1.0), cars, step
        for setting, value in undisclosed.sensitivities.items():
            if setting != "medium":
                yield {"part": part, "cars": 3, "setting": setting}, fuzzy(value), 3, step
    for value in SENSITIVITIES:
        yield {"part": "pareto", "cars": 3, "sensitivity": value}, fuzzy(value), 3, STEP
    for hold, release in THRESHOLDS:
        plain = slide_protection(law="threshold", threshold=Threshold(release=release, hold=hold))
        yield {"part": "threshold", "cars": 3, "hold": hold, "release": release}, plain, 3, STEP
    yield {"part": "none", "cars": 3}, slide_protection(law="none"), 3, STEP


def stop_row(
    protection: SlideProtection, cars: int, step: float, undisclosed: Undisclosed = CALIBRATED
) -> dict[str, Any]:
    """Measures of one stop of a set, and its computing time per simulated second [ms]."""
    found = brake(brake_event(undisclosed, cars, protection=protection, step=step))
    per_second = 1e3 * float(found.attrs["wall_time_s"]) / DURATIONS[cars]
    return {**measures(found), "computing": per_second}


def member_rows(undisclosed: Undisclosed, seed: int, k: int) -> list[dict[str, Any]]:
    """All runs of a member of the ensemble, and its draw `k` of every size of noise."""
    return [
        {"part": "member", **asdict(undisclosed), **outcomes(undisclosed)},
        *(
            {"part": "noise", "noise": size, **jittered(undisclosed, seed, k, size)}
            for size in NOISES
        ),
        *(
            {**identity, **stop_row(law, cars, step, undisclosed)}
            for identity, law, cars, step in stops(undisclosed)
        ),
        *(electric_row(group, controller, undisclosed) for group, controller in electric_tasks()),
        *(beyond_row(undisclosed, name) for name in STOPS),
    ]


def cells(seed: int, draws: int) -> list[Task]:
    """Every run with the set in use, `draws` draws of noise on it, and the first `draws` members of the ensemble."""
    return [
        *(
            Task(f"{ELECTRIC}/{group}/{controller}", electric_row, (group, controller))
            for group, controller in reversed(electric_tasks())
        ),
        *(
            Task(
                "/".join(map(str, identity.values())), stop_row, tuple(how), tuple(identity.items())
            )
            for identity, *how in stops()
        ),
        *(
            Task(f"jitter/{seed}/{k}", jittered, (CALIBRATED, seed, k), (("part", "jitter"),))
            for k in range(draws)
        ),
        *(
            Task(f"member/{seed}/{k}", member_rows, (one, seed, k), (("member", k),))
            for k, one in enumerate(MEMBERS[:draws])
        ),
        *(
            Task(f"held out/{k}", outcomes, (one,), (("part", "held out"),))
            for k, one in enumerate(HELD_OUT[:draws])
        ),
    ]


SLIDE_PROTECTION = Study(
    name="slide-protection",
    question="slide protection of JP4209318: distance, wheel damage and air by train and sensitivity",
    default_events=len(
        MEMBERS
    ),  # members of the ensemble, and draws of noise; nothing else is random
    cells=cells,
    finish=lambda table, seed, draws: table.assign(draws=draws, seed=seed),
    judge=slide_statements,
    claims=CLAIMS,
    whole=True,
)
