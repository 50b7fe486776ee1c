"""The benchmark: rules and controllers on one population of slip events, and the place of a part of one's own.

Rules meet every event under several controllers, controllers where units act alone, and on the first events with a knob of
theirs at other values. The rows are stored in the repository, so that a part of one's own is ranked by its runs alone.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from alloc.compilation import ROOT
from alloc.evaluation.metrics import evaluate
from alloc.files import write_whole
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from alloc.run.simulation import simulate
from studies import StudyError
from studies import run_cell as runs
from studies.compare import MOST_OVER, NEGLIGIBLE, mark_of, meanings
from studies.files.scenario import Scenario
from studies.population import population
from studies.runner.plugins import load_plugins, try_own_parts
from studies.runner.row_key import LIBRARIES, hash_sources
from studies.runner.study import WIDE, Cell, Row, Study
from studies.statistics import (
    Claim,
    Interval,
    Numbers,
    Statement,
    forest,
    in_digits,
    judge,
    mean,
    means,
    share,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Parts = Mapping[str, "pd.Series[bool]"]
"""Parts of the events by words, as truth by event."""

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
    "cut-and-ramp": ("recover", (0.5, 0.65, 0.8, 0.9)),
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
    said = {"scenario": one.name, "rule": rule, "controller": law, "seed": k, **about}
    name = "/".join([one.name, rule, law, *map(str, knob or ())])
    sources = runs.sources(one, rule.removesuffix(REPORTED), law)
    return Cell(name, (one, rule, law, k, knob), said | {"knob": knob and knob[1]}, sources)


REPORTED = "-reported"


def run(
    scenario: Scenario, rule: str, controller: str, k: int, knob: tuple[str, float] | None = None
) -> Row:
    """The stored metrics of a run, and whether rule and controller worked; `knob`: a parameter at another value."""
    law = CONTROLLERS.find(controller).tuned(**dict([knob])) if knob else controller
    shared = RULES.find(rule.removesuffix(REPORTED))
    if rule.endswith(REPORTED):
        shared = shared.with_belief(RULES[SHARING].belief.name)
    found = simulate(runs.event_of(scenario, k), shared, law)
    numbers = evaluate(found)
    return {name: numbers[name] for name in KEPT} | runs.status(found)


# the stored rows

STORED = ("docs/tables/benchmark.parquet", "studies/benchmark.parquet")
"""In a clone, and in an installed package."""


def store(rows: pd.DataFrame, path: Path) -> None:
    """Write rows in little room, with what they were computed by."""
    kept = ["scenario", "seed", "rule", "controller", "knob", *population.STRATA, *KEPT, "status"]
    small = rows[kept].astype({"knob": float} | dict.fromkeys(KEPT, "float32"))
    small.attrs = {"sources": hash_sources(run), **{name: version(name) for name in LIBRARIES}}
    write_whole(path, partial(small.to_parquet, index=False, compression="zstd"))


def stored() -> pd.DataFrame:
    """The stored rows; `attrs` say what computed them. Raises `StudyError` where there are none."""
    for one in STORED:
        if (ROOT / one).is_file():
            return pd.read_parquet(ROOT / one)
    raise StudyError(f"{ROOT / STORED[0]} is missing; run readhesion benchmark")


def is_stale() -> bool:
    """Whether the stored rows were computed by other sources than these."""
    return bool(stored().attrs.get("sources") != hash_sources(run))


# what comes out

WORSE = 0.3
"""Points of the bound lost from which on an event counts as harmed."""


def used(rows: pd.DataFrame, controller: str, metric: str = "bound_use") -> pd.DataFrame:
    """A metric with a row for each event in which every rule worked, a column for each rule."""
    own = runs.complete(as_shipped(rows, "controller", controller))
    return own.pivot(index="scenario", columns="rule", values=metric)


def as_shipped(rows: pd.DataFrame, kind: str, name: str) -> pd.DataFrame:
    """Rows of a rule or a controller, with every controller as it ships."""
    return rows[(rows[kind] == name) & rows["knob"].isna()]


def strata(rows: pd.DataFrame) -> Parts:
    """Parts of the events: headroom, case, fleet, noise, lag, what is special."""
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


def _within(parts: Parts, events: pd.Index, names: Iterable[str] = ()) -> Parts:
    """Parts of these events: all, or those of these names."""
    return {name: parts[name].reindex(events, fill_value=False) for name in names or parts}


def _line(gain: "pd.Series[float]", parts: Parts, names: Iterable[str]) -> Row:
    """What a row of a table says of gains [points] by event."""
    within = _within(parts, gain.index, names)
    some = {name: mean(gain[true]).text(2, sign=True) for name, true in within.items()}
    harmed = share(gain < -WORSE).text(0, 100.0)
    return some | {
        "worst [points]": in_digits(gain.min(), 1, True),
        "harmed [% of events]": harmed,
    }


SHOWN = ("headroom above 1 point", "starts", "receptive stops", "blended stops")
COSTS: Numbers = {
    "Q over alone [kJ]": ("damage", 1, 1.0),
    "slip over alone [axle s]": ("slip_time", 1, 1.0),
    "time lost over alone [s]": ("time_lost", 2, 1.0),
    "way lost over alone [m]": ("distance_lost", 1, 1.0),
}
"""What a rule adds to `BASE`."""


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Every rule under every controller: use of the bound, gain over `BASE` and where, worst case, costs."""
    parts, lines = strata(rows), []
    for law, rules in UNDER.items():
        good = runs.complete(as_shipped(rows, "controller", law))
        for rule in rules:
            own = runs.paired(good, law, rule, (BASE,))
            gain = 100.0 * own["bound_use"] - 100.0 * own[f"bound_use_{BASE}"]
            known = next((words for words, alike in TOLD_ALIKE.items() if rule in alike), "–")
            line: Row = {"controller": law, "rule": rule, "told": known, "events": len(own)}
            line["used [%]"] = mean(100.0 * own["bound_use"]).text(1)
            line["gain over alone [points]"] = mean(gain).text(2, sign=True)
            line |= _line(gain, parts, SHOWN)
            line["beyond the plan [%]"] = mean(100.0 * own["over_delivery"]).text(2)
            excess = 100.0 * own["event_excess"].median()
            line["Q over the least of its impulse [%, median]"] = in_digits(excess, 0, False)
            lines.append(line | means(own, COSTS, BASE))
    return pd.DataFrame(lines)


def alone(rows: pd.DataFrame, metric: str = "bound_use") -> pd.DataFrame:
    """As `used`, where units act alone, and with a column for each controller."""
    own = runs.complete(as_shipped(rows, "rule", BASE))
    return own.pivot(index="scenario", columns="controller", values=metric)


SPENT: Numbers = {
    "Q [kJ]": ("damage", 0, 1.0),
    "slip [axle s]": ("slip_time", 1, 1.0),
    "jerk [m/s3]": ("jerk_rms", 2, 1.0),
    "locked [axle s]": ("locked_time", 2, 1.0),
}
"""What a controller costs."""


def controllers(rows: pd.DataFrame) -> pd.DataFrame:
    """Every controller where units act alone, the best first; gains are over perturb-observe."""
    parts, every = strata(rows), 100.0 * alone(rows)
    good = runs.complete(as_shipped(rows, "rule", BASE))
    names = ("starts", "receptive stops", "blended stops", "locomotives", "noise above 0.05 km/h")
    lines = []
    for law in every.mean().sort_values(ascending=False).index:
        own, gain = every[law], every[law] - every[SEARCH]
        line: Row = {"controller": law, "events": len(own), "used [%]": mean(own).text(1)}
        line["over perturb-observe [points]"] = mean(gain).text(2, sign=True)
        line |= _line(gain, parts, names)
        lines.append(line | means(good[good["controller"] == law], SPENT))
    return pd.DataFrame(lines)


def front(rows: pd.DataFrame) -> pd.DataFrame:
    """Bound used, wheel damage and jerk of controllers at values of their knobs, over the same events."""
    swept = set(rows.loc[rows["knob"].notna(), "scenario"])
    own = runs.complete(rows[(rows["rule"] == BASE) & rows["scenario"].isin(swept)])
    lines = []
    for law, (knob, _) in KNOBS.items():
        usual = CONTROLLERS[law].memory.columns[knob].default
        for value, part in own[own["controller"] == law].fillna({"knob": usual}).groupby("knob"):
            line = {"controller": law, "knob": knob, "value": float(value), "own": value == usual}
            used, *costs = (part[name].mean() for name in ("bound_use", "damage", "jerk_rms"))
            line |= {"events": len(part), "used [%]": 100.0 * used}
            lines.append(line | dict(zip(("Q [kJ]", "jerk [m/s3]"), costs, strict=True)))
    return pd.DataFrame(lines)


SAID = (
    ("mpc", SEARCH, "this project"),
    (SEARCH, "cut-and-ramp", "this project"),
    (SEARCH, "pi-creep", "this project"),
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
                                parts=_within(parts, own.index)))  # fmt: skip
    own = 100.0 * alone(rows)
    for name, other, source in SAID:
        text = f"uses more of the bound than {other} ({source}) [points]"
        claims.append(Claim(f"{name} over {other}", text, own[name] - own[other], 0.0, digits=2,
                            parts=_within(parts, own.index)))  # fmt: skip
    return judge(claims)


def figure(rows: pd.DataFrame) -> "Figure":
    """Gain of each rule over `BASE` under each controller, and the fronts of the controllers."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(WIDE, 5.6), layout="constrained")
    above, below = drawn.subplots(2, 3, height_ratios=(3, 2))
    parts = strata(rows)
    for axes, law in zip(above, UNDER, strict=True):
        own = 100.0 * used(rows, law)
        (wide,) = _within(parts, own.index, SHOWN[:1]).values()
        numbers: dict[str, list[Interval]] = {rule: [] for rule in SHARERS}
        for rule in set(SHARERS) & set(UNDER[law]):
            gain = own[rule] - own[BASE]
            numbers[rule] = [mean(gain), mean(gain[wide])]
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
    more_tables={"controllers": controllers, "front": front},
)

# the place of a part of one's own


def named(rule: str, controller: str) -> tuple[str, str]:
    """Which part of a pair is ranked, a controller where units act alone, and what it is compared with."""
    return (controller, SEARCH) if rule == BASE else (rule, BASE)


def _beside(
    rows: pd.DataFrame, own: pd.DataFrame, rule: str, controller: str, metric: str = "bound_use"
) -> tuple["pd.Series[float]", pd.DataFrame]:
    """A metric of one's own pair, and that of the stored parts beside it over the same events."""
    good = own[own["status"] == "ok"].set_index("scenario")[metric].astype("float32")
    same = rows[rows["scenario"].isin(good.index)]
    others = alone(same, metric) if rule == BASE else used(same, controller, metric)
    return good[others.index], others


def places(rows: pd.DataFrame, own: pd.DataFrame, rule: str, controller: str) -> pd.DataFrame:
    """One's `own` pair of `rule` and `controller` among those stored, a row for each part, the best first.

    `used` [%]; `less`, by how much one's own is ahead [points], with its interval; `tied` where they cannot be told apart;
    `mark`, see `told`.
    """
    (mine, others), (own_over, over) = (
        _beside(rows, own, rule, controller, metric) for metric in ("bound_use", "over_delivery")
    )
    name, _ = named(rule, controller)
    found, lines = {**others, name: mine}, []
    for one, values in found.items():
        less, beyond = mean(100.0 * (mine - values)), own_over if one == name else over[one]
        lines.append({
            "name": one, "used": 100.0 * float(values.mean()), "less": less.value, "low": less.low, "high": less.high,
            "tied": less.tied(100.0 * NEGLIGIBLE), "mark": mark_of(one, beyond.mean()),
        })  # fmt: skip
    made = pd.DataFrame(lines).sort_values("used", ascending=False, kind="stable")
    return made.reset_index(drop=True)


def gains(rows: pd.DataFrame, own: pd.DataFrame, rule: str, controller: str) -> pd.DataFrame:
    """Gain of one's own over what it is compared with, see `named`, by parts of the events: mean with interval [points],
    worst case, share of events harmed."""
    mine, others = _beside(rows, own, rule, controller)
    gain = 100.0 * (mine - others[named(rule, controller)[1]])
    lines = []
    for words, true in {"all": gain.notna(), **_within(strata(rows), gain.index)}.items():
        some = gain[true]
        found, harmed = mean(some), share(some < -WORSE)
        lines.append({
            "events": words, "number": len(some), "gain": found.value, "low": found.low, "high": found.high,
            "worst": some.min(), "harmed": harmed.value,
        })  # fmt: skip
    return pd.DataFrame(lines)


def own_study(rule: str, controller: str) -> Study:
    """The runs of one pair on the population, and its place among the stored ones. Raises `StudyError`: see `stored`."""

    def own_cells(events: int, seed: int) -> list[Cell]:
        if events > population.EVENTS:
            raise StudyError(f"events = {events}: rows of {population.EVENTS} are stored")
        return [_cell(population.event(seed, k), rule, controller, k) for k in range(events)]

    rows = stored()
    return replace(
        STUDY,
        name=f"rank-{rule}-{controller}",
        question=f"where {named(rule, controller)[0]} stands among all",
        cells=own_cells,
        table=lambda own: places(rows, own, rule, controller),
        figure=None,
        statements=None,
        more_tables={"gains": lambda own: gains(rows, own, rule, controller)},
    )


def pairs_of(part: str, under: str) -> list[tuple[str, str]]:
    """Pairs of rule and controller that rank the parts of a file, or the part of this name; rules run `under` a controller.

    Raises `InputError` for a part that does not exist or does not work, and a controller of which no rules are stored.
    """
    if under not in UNDER:
        raise StudyError(f"--under {under}: rows are stored of {', '.join(UNDER)}")
    names = [part]
    if part.endswith(".py"):
        (module,) = load_plugins([part])
        names = [one for registry in (RULES, CONTROLLERS) for one in registry
                 if registry.origin(one) == module.__name__]  # fmt: skip
        if not names:
            raise StudyError(f"{part}: it registers no rule and no controller")
    found = [(BASE, one) if one in CONTROLLERS else (RULES.find(one).name, under) for one in names]
    try_own_parts(*zip(*found, strict=True))
    return found


def told(pair: tuple[str, str], tables: Mapping[str, pd.DataFrame]) -> Sequence[str]:
    """The tables of `own_study`, for a terminal of 80 columns."""
    (name, reference), (places, gains) = named(*pair), tables.values()
    under = "where units act alone" if pair[0] == BASE else f"under {pair[1]}"
    said = [f"{name} {under}"]
    place = 0
    said += [f"{'place':>5}  {'':16} {'used %':>7}  {name + ' less it [95 %]':>24}"]
    for one in places.itertuples():
        place += one.mark == ""
        shown = "" if one.mark else f"{place}{'=' if one.tied else ''}"
        found = Interval(one.less, one.low, one.high, gains["number"].max())
        less = "" if one.name == name else found.text(2, sign=True)
        own = ">" if one.name == name else " "
        said.append(f"{own}{shown:>4}  {one.name + one.mark:16} {one.used:7.1f}  {less:>24}")
    said += ["", f"{name} less {reference}:"]
    said.append(f"  {'events':28}  {'points [95 %]':>22} {'worst':>6} {'harmed %':>10}")
    for one in gains.itertuples():
        harmed = in_digits(100.0 * one.harmed, 0, False) if one.number else ""
        worst = in_digits(one.worst, 1, True) if one.number else ""
        gain = Interval(one.gain, one.low, one.high, one.number).text(2, sign=True)
        said.append(f"  {one.events:24}{one.number:>4}  {gain:>22} {worst:>6} {harmed:>10}")
    said += meanings(said, {
        "=": f"= cannot be told from {name}: the interval holds 0, or less than {100 * NEGLIGIBLE:g} points",
        "°": "° knows the rail, as nobody on board can; has no place",
        "*": f"* delivers more than {MOST_OVER:.0%} beyond the plan; has no place",
    })  # fmt: skip
    return [*said, f"harmed: loses more than {WORSE:g} points"]
