"""The benchmark: rules and controllers on one population of slip events, and the place of a part of one's own.

Rules meet every event under several controllers, controllers where units act alone, and on the first events with a knob of
theirs at other values. The rows are stored in the repository, so that a part of one's own is ranked by its runs alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from alloc.compilation import ROOT
from alloc.files import write_whole
from alloc.metrics import evaluate
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from alloc.simulation import simulate
from studies import StudyError, population, runs
from studies.compare import MOST_OVER, NEGLIGIBLE
from studies.core import WIDE, Cell, Row, Study
from studies.plugins import load_plugins
from studies.row_key import LIBRARIES, decides
from studies.scenario import Scenario
from studies.statistics import Claim, Interval, Statement, forest, judge, mean, share

# what is compared

BASE, BOUND, SHARING = "alone", "oracle", "cooperative"
"""Units that share nothing, the rule that knows the rail, this project's own."""
TOLD_ALIKE = {
    "every unit's report": ("uniform", "erp-reported", "exact-reported", SHARING, "wear"),
    "the front": ("sharing", "erp", "greedy", "exact", "qp"),
    "slips": ("greedy-literal", "greedy-tuned", "greedy-printed"),
    "nothing": ("preset",),
}  # fmt: skip
"""Rules by what they are told of the rail: first compare those that are told alike. What ends with "-reported" is the rule
of that name, told what `SHARING` is told."""
SHARERS = tuple(rule for alike in TOLD_ALIKE.values() for rule in alike)
UNDER = {
    "cut-and-ramp": (BASE, *SHARERS, BOUND),
    "perturb-observe": (BASE, *SHARERS, BOUND),
    "mpc": (BASE, "uniform", "greedy", "exact", "exact-reported", SHARING, "wear", BOUND),
}
"""Controllers under which rules are compared, and the rules; under the MPC one of each kind, since it takes longest."""
SEARCH = "perturb-observe"
"""Controller with which others are compared where units act alone."""
KNOBS: dict[str, tuple[str, tuple[float, ...]]] = {
    "table": ("margin", (0.03, 0.06, 0.22, 0.44)),
    "cut-and-ramp": ("recover", (0.6, 0.75, 0.95, 1.0)),
    "pi-creep": ("reference", (0.03, 0.05, 0.15, 0.3)),
    "perturb-observe": ("highest", (0.06, 0.12, 0.25, 1.5)),
    "steepest-gradient": ("highest", (0.06, 0.12, 0.25, 1.5)),
    "mpc": ("price", (0.0375, 0.6, 1.2, 2.4)),
}
"""Parameter of a controller by which it gives up adhesion for less wheel damage, and the values beside its own."""
SWEPT = 100
"""Events on which knobs are swept: the first."""
KEPT = (
    "bound_use", "headroom", "over_delivery", "slip_time", "slip_peak", "damage", "excess_damage", "event_excess",
    "time_lost", "distance_lost", "locked_time", "jerk_rms", "effort_ratio",
)  # fmt: skip
"""Metrics that are stored."""


def cells(events: int, seed: int) -> list[Cell]:
    """Each event under every pair, its number the seed of all."""
    found = []
    for k in range(events):
        one, drawn = population.event(seed, k), population.draw(seed, k)
        about = {name: drawn[name] for name in population.STRATA}
        pairs = [(rule, law) for law, rules in UNDER.items() for rule in rules]
        pairs += [(BASE, law) for law in CONTROLLERS.shipped() if law not in (*UNDER, "mpc-opti")]
        found += [_cell(one, *pair, k, **about) for pair in pairs]
        for law, (knob, values) in KNOBS.items() if k < SWEPT else ():
            found += [_cell(one, BASE, law, k, (knob, value), **about) for value in values]
    return found


def _cell(
    one: Scenario, rule: str, law: str, k: int, knob: tuple[str, float] | None = None, **about: Any
) -> Cell:
    plain = runs.cell(one, _plain(rule), law, k, **about)
    columns = {**plain.columns, "rule": rule, "knob": knob[1] if knob else None}
    name = "/".join([one.name, rule, law, *map(str, knob or ())])
    return plain._replace(name=name, args=(one, rule, law, k, knob), columns=columns)


REPORTED = "-reported"


def _plain(rule: str) -> str:
    return rule.removesuffix(REPORTED)


def run(
    scenario: Scenario, rule: str, controller: str, k: int, knob: tuple[str, float] | None = None
) -> Row:
    """The stored metrics of a run, and whether rule and controller worked; `knob`: a parameter at another value."""
    law = CONTROLLERS.find(controller).tuned(**dict([knob])) if knob else controller
    shared = RULES.find(_plain(rule))
    if rule.endswith(REPORTED):
        shared = replace(shared, belief=RULES[SHARING].belief)
    found = simulate(runs.event_of(scenario, k), shared, law)
    numbers = evaluate(found)
    return {name: numbers[name] for name in KEPT} | runs.status(found)


# the stored rows

STORED = ("docs/tables/benchmark.parquet", "studies/benchmark.parquet")
"""In a clone, and in an installed package."""


def store(rows: pd.DataFrame, path: Path) -> None:
    """Write rows in little room, with what they were computed by."""
    kept = ["scenario", "seed", "rule", "controller", "knob", *population.STRATA, *KEPT, "status"]
    small = rows[kept].astype(dict.fromkeys(["knob", *KEPT], "float32"))
    small.attrs = {"sources": decides(run), **{name: version(name) for name in LIBRARIES}}
    writes = partial(small.to_parquet, index=False, compression="zstd")
    write_whole(path, lambda aside: writes(aside))


def stored() -> pd.DataFrame:
    """The stored rows; `attrs` say what computed them. Raises `StudyError` where there are none."""
    for one in STORED:
        if (ROOT / one).is_file():
            return pd.read_parquet(ROOT / one)
    raise StudyError(f"{ROOT / STORED[0]} is missing; run readhesion benchmark")


def is_stale(rows: pd.DataFrame) -> bool:
    """Whether stored rows were computed by other sources than these."""
    return bool(rows.attrs.get("sources") != decides(run))


# what comes out

WORSE = 0.3
"""Points of the bound lost from which on an event counts as harmed."""


def used(rows: pd.DataFrame, controller: str, metric: str = "bound_use") -> pd.DataFrame:
    """A metric with a row for each event in which every rule worked, a column for each rule."""
    own = rows[(rows["controller"] == controller) & rows["knob"].isna()]
    return runs.complete(own).pivot(index="scenario", columns="rule", values=metric)


def strata(rows: pd.DataFrame) -> "dict[str, pd.Series[bool]]":
    """Parts of the events, as truth by event: headroom, case, fleet, noise, lag, what is special."""
    first = rows.drop_duplicates("scenario").set_index("scenario")
    room = used(rows, SEARCH, "headroom")[BOUND].reindex(first.index)
    parts = {"headroom above 1 point": room > 0.01}
    parts |= {
        f"{one}s": first["case"] == one for one in ("start", "receptive stop", "blended stop")
    }
    parts |= {f"{one}s": first["fleet"] == one for one in population.FLEETS}
    parts |= {
        "noise above 0.05 km/h": first["speed_noise_kmh"] > 0.05,
        "lag above 22 ms": first["lag_s"] > 0.022,
        "a unit fails": first["fails"],
        "couplers": first["coupled"],
    }
    return parts


def _line(gain: "pd.Series[float]", parts: "Mapping[str, pd.Series[bool]]") -> Row:
    """What a row of a table says of gains [points] by event."""
    some = {name: mean(gain[parts[name].reindex(gain.index)]).text(2, sign=True) for name in parts}
    worst = f"{gain.min():+.1f}".replace("-", "\N{MINUS SIGN}") if len(gain) else "–"
    harmed = share(gain < -WORSE).text(0, 100.0)
    return {**some, "worst [points]": worst, "harmed [% of events]": harmed}


SHOWN = ("headroom above 1 point", "starts", "receptive stops", "blended stops")
COSTS = {"damage": "Q over alone [kJ]", "slip_time": "slip over alone [axle s]"}


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Every rule under every controller: use of the bound, gain over `BASE` and where, worst case, costs."""
    parts, lines = {name: strata(rows)[name] for name in SHOWN}, []
    for law, rules in UNDER.items():
        found = {name: used(rows, law, name) for name in KEPT}
        for rule in rules:
            own = found["bound_use"]
            gain = 100.0 * (own[rule] - own[BASE])
            line: Row = {"controller": law, "rule": rule, "told": _told(rule), "events": len(own)}
            line["used [%]"] = mean(100.0 * own[rule]).text(1)
            line["gain over alone [points]"] = mean(gain).text(2, sign=True)
            line |= _line(gain, parts)
            for name, words in COSTS.items():
                line[words] = mean(found[name][rule] - found[name][BASE]).text(1, sign=True)
            line["beyond the plan [%]"] = mean(100.0 * found["over_delivery"][rule]).text(2)
            line["Q over the least of its impulse [%, median]"] = _median(
                found, "event_excess", rule
            )
            lost = found["time_lost"][rule].fillna(0.0) - found["time_lost"][BASE].fillna(0.0)
            line["time lost over alone [s]"] = mean(lost[found["time_lost"][rule].notna()]).text(
                2, sign=True
            )
            way = found["distance_lost"][rule] - found["distance_lost"][BASE]
            line["way lost over alone [m]"] = mean(way).text(1, sign=True)
            lines.append(line)
    return pd.DataFrame(lines)


def _median(found: Mapping[str, pd.DataFrame], name: str, rule: str) -> str:
    return f"{100.0 * found[name][rule].median():.0f}"


def _told(rule: str) -> str:
    return next((words for words, alike in TOLD_ALIKE.items() if rule in alike), "–")


def alone(rows: pd.DataFrame) -> "dict[str, pd.DataFrame]":
    """By metric, a row for each event and a column for each controller, where units act alone."""
    own = runs.complete(rows[(rows["rule"] == BASE) & rows["knob"].isna()])
    return {name: own.pivot(index="scenario", columns="controller", values=name) for name in KEPT}


def controllers(rows: pd.DataFrame) -> pd.DataFrame:
    """Every controller where units act alone, the best first; gains are over perturb-observe."""
    parts, found = strata(rows), alone(rows)
    order = found["bound_use"].mean().sort_values(ascending=False).index
    names = ("starts", "receptive stops", "blended stops", "locomotives", "noise above 0.05 km/h")
    lines = []
    for law in order:
        own = 100.0 * found["bound_use"][law]
        gain = own - 100.0 * found["bound_use"][SEARCH]
        line: Row = {"controller": law, "events": len(own), "used [%]": mean(own).text(1)}
        line["over perturb-observe [points]"] = mean(gain).text(2, sign=True)
        line |= _line(gain, {name: parts[name] for name in names})
        for name, (words, digits) in {
            "damage": ("Q [kJ]", 0), "slip_time": ("slip [axle s]", 1), "jerk_rms": ("jerk [m/s3]", 2),
            "locked_time": ("locked [axle s]", 2),
        }.items():  # fmt: skip
            line[words] = mean(found[name][law]).text(digits)
        lines.append(line)
    return pd.DataFrame(lines)


def front(rows: pd.DataFrame) -> pd.DataFrame:
    """Bound used, wheel damage and jerk of controllers at values of their knobs, over the same events."""
    swept = set(rows.loc[rows["knob"].notna(), "scenario"])
    own = runs.complete(rows[(rows["rule"] == BASE) & rows["scenario"].isin(swept)])
    lines = []
    for law, (knob, _) in KNOBS.items():
        usual = CONTROLLERS[law].memory.columns[knob].default
        means = own[own["controller"] == law].fillna({"knob": usual}).groupby("knob")
        for value, part in means:
            line = {"controller": law, "knob": knob, "value": float(value)}
            line |= {
                "own": value == usual,
                "events": len(part),
                "used [%]": 100.0 * part["bound_use"].mean(),
            }
            lines.append(
                line | {"Q [kJ]": part["damage"].mean(), "jerk [m/s3]": part["jerk_rms"].mean()}
            )
    return pd.DataFrame(lines)


SAID = (
    ("mpc", SEARCH, "this project"),
    (SEARCH, "cut-and-ramp", "this project"),
    (SEARCH, "pi-creep", "this project"),
    ("fuzzy-creep", "pi-creep", "Tian, Daniel, Meehan 2014"),
    ("swarm-slip", "pi-creep", "Zirek, Onat 2020"),
    ("fuzzy-tracking", "steepest-gradient", "arXiv 2406.13650"),
    ("swarm-tracking", "steepest-gradient", "arXiv 2406.13650"),
    ("cubature-seeking", "steepest-gradient", "Applied Sciences 15(19), 10524"),
)
"""Controllers that are said to be better than others, and who says so."""


def statements(rows: pd.DataFrame) -> list[Statement]:
    """That rules gain over units that share nothing, and what is said of controllers; one family."""
    parts, claims = strata(rows), []
    for law, rules in UNDER.items():
        own = 100.0 * used(rows, law)
        for rule in [one for one in rules if one not in (BASE, BOUND)]:
            text = "uses more of the bound than alone [points]"
            claims.append(Claim(f"{rule}, {law}", text, own[rule] - own[BASE], 0.0, digits=2,
                                parts=_within(parts, own)))  # fmt: skip
    own = 100.0 * alone(rows)["bound_use"]
    for name, other, source in SAID:
        text = f"uses more of the bound than {other} ({source}) [points]"
        claims.append(Claim(f"{name} over {other}", text, own[name] - own[other], 0.0, digits=2,
                            parts=_within(parts, own)))  # fmt: skip
    return judge(claims)


def _within(
    parts: "Mapping[str, pd.Series[bool]]", own: pd.DataFrame
) -> "dict[str, pd.Series[bool]]":
    """Parts of the events that a table has."""
    return {name: true.reindex(own.index, fill_value=False) for name, true in parts.items()}


def figure(rows: pd.DataFrame) -> Figure:
    """Gain of each rule over `BASE` under each controller, and the fronts of the controllers."""
    drawn = Figure(figsize=(WIDE, 5.6), layout="constrained")
    above, below = drawn.subplots(2, 3, height_ratios=(3, 2))
    wide = strata(rows)[SHOWN[0]]
    for axes, law in zip(above, UNDER, strict=True):
        own = used(rows, law)
        numbers: dict[str, list[Interval]] = {}
        for rule in SHARERS:
            if rule not in UNDER[law]:
                numbers[rule] = []
                continue
            gain = 100.0 * (own[rule] - own[BASE])
            numbers[rule] = [mean(gain), mean(gain[wide.reindex(gain.index)])]
        forest(axes, numbers, RULES, 0.0)
        axes.set(title=f"under {law}", xlabel="gain over alone [points]")
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set_xticks([-10, -1, 0, 1], ["\N{MINUS SIGN}10", "\N{MINUS SIGN}1", "0", "1"])
        if axes is not above[0]:
            axes.set_yticklabels([])
    points = front(rows)
    for axes, cost in zip(below, ("Q [kJ]", "jerk [m/s3]"), strict=False):
        for law, own in points.groupby("controller", sort=False):
            look = CONTROLLERS[law]
            style = {"marker": look.marker, "color": look.colour, "label": law}
            axes.plot(own[cost], own["used [%]"], "-", **style)
        axes.set(xlabel=f"mean {cost}", ylabel="bound used [%]")
    below[2].axis("off")
    below[2].legend(*below[1].get_legend_handles_labels(), loc="center")
    return drawn


QUESTION = "How much of what rail and motors allow do rules and controllers use, and at what cost?"
STUDY = Study(
    "benchmark",
    QUESTION,
    cells,
    run,
    table,
    figure,
    statements,
    events=population.EVENTS,
    seed=population.SEED,
)

# the place of a part of one's own


def ranked(
    rows: pd.DataFrame, own: pd.DataFrame, rule: str, controller: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The place of rows of one's `own` part among those stored, of the pair `rule` and `controller`, over the same events.

    One table has every part beside it, the best first: used, difference of one's own with its interval, worst case, share
    of events harmed; `tied` where they cannot be told apart. The other has one's own gain over the stored reference, by
    strata: for a rule this is `BASE` under the same controller, for a controller perturb-observe alone.
    """
    is_rule = controller in UNDER and rule not in ("", BASE)
    both = rows[rows["scenario"].isin(own["scenario"])]
    both = both[both["knob"].isna()]
    if is_rule:
        others = used(both, controller)
        over, reference = used(both, controller, "over_delivery"), BASE
    else:
        found = alone(both)
        others, over, reference = found["bound_use"], found["over_delivery"], SEARCH
    good = own[own["status"] == "ok"].set_index("scenario")
    mine, name = good["bound_use"], rule if is_rule else controller
    others, over = others.reindex(mine.index).dropna(), over.reindex(mine.index)
    mine = mine.reindex(others.index).astype("float32")
    lines = [_standing(name, mine, mine, float(good["over_delivery"].mean()))]
    lines += [
        _standing(one, mine, others[one], float(over[one].mean())) for one in others if one != name
    ]
    places = pd.DataFrame(lines).sort_values("used", ascending=False, kind="stable")
    gain = 100.0 * (mine - others[reference])
    parts = {"all": pd.Series(True, mine.index)} | strata(both)
    by = {words: true.reindex(mine.index, fill_value=False) for words, true in parts.items()}
    gains = [{"events": words, "number": int(true.sum()), "gain": mean(gain[true]),
              "worst": float(gain[true].min()) if true.any() else np.nan,
              "harmed": share(gain[true] < -WORSE)} for words, true in by.items()]  # fmt: skip
    return places.reset_index(drop=True), pd.DataFrame(gains)


def _standing(
    name: str, mine: "pd.Series[float]", other: "pd.Series[float]", over: float
) -> dict[str, Any]:
    less: Interval = mean(100.0 * (mine - other))
    tied = bool(less.low <= 0.0 <= less.high or abs(less.value) < 100.0 * NEGLIGIBLE)
    knows = name in RULES and RULES[name].belief.knows
    mark = "°" if knows else "*" if over > MOST_OVER else ""
    return {
        "name": name,
        "used": 100.0 * float(other.mean()),
        "less": less,
        "tied": tied,
        "mark": mark,
    }


def own_study(rule: str, controller: str) -> Study:
    """The runs of one pair on the population, as a study whose rows are kept."""

    def own_cells(events: int, seed: int) -> list[Cell]:
        return [_cell(population.event(seed, k), rule, controller, k) for k in range(events)]

    about = f"rank-{rule}-{controller}", "the place of one pair", own_cells, run, pd.DataFrame
    return Study(*about, events=population.EVENTS, seed=population.SEED)


def parts_of(file: str) -> list[tuple[str, str]]:
    """Rule and controller of each part that a file registers, or of a registered name; "" for the one left open.

    Raises `InputError` where there is none.
    """
    names: list[str] = [file]
    if file.endswith(".py"):
        (module,) = load_plugins([file])
        names = [one for registry in (RULES, CONTROLLERS) for one in registry
                 if registry.origin(one) == module.__name__]  # fmt: skip
        if not names:
            raise StudyError(f"{file}: it registers no rule and no controller")
    return [("", one) if one in CONTROLLERS else (RULES.find(one).name, "") for one in names]


def told(places: pd.DataFrame, gains: pd.DataFrame, name: str, reference: str) -> Sequence[str]:
    """Both tables of `ranked` for a terminal of 80 columns."""
    place, said = 0, [f"{'place':>5}  {'':16} {'used %':>7}  {name + ' less it [95 %]':>24}"]
    for one in places.itertuples():
        place += one.mark == ""
        shown = "" if one.mark else f"{place}{'=' if one.tied else ''}"
        less = "" if one.name == name else one.less.text(2, sign=True)
        own = ">" if one.name == name else " "
        said.append(f"{own}{shown:>4}  {one.name + one.mark:16} {one.used:7.1f}  {less:>24}")
    said += ["", f"{name} less {reference}:"]
    said.append(f"  {'events':28}  {'points [95 %]':>22} {'worst':>6} {'harmed %':>10}")
    for one in gains.itertuples():
        harmed = "" if not one.number else f"{100.0 * one.harmed.value:.0f}"
        worst = "" if np.isnan(one.worst) else f"{one.worst:+.1f}".replace("-", "\N{MINUS SIGN}")
        gain = one.gain.text(2, sign=True)
        said.append(f"  {one.events:24}{one.number:>4}  {gain:>22} {worst:>6} {harmed:>10}")
    text = "\n".join(said)
    marks = {
        "=": f"= cannot be told from {name}: the interval holds 0, or less than {100 * NEGLIGIBLE:g} points",
        "°": "° knows the rail, as nobody on board can; has no place",
        "*": f"* delivers more than {MOST_OVER:.0%} beyond the plan; has no place",
    }
    said += ["", *(words for mark, words in marks.items() if mark in text)]
    return [*said, f"harmed: loses more than {WORSE:g} points"]
