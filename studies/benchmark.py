"""The benchmark: rules and controllers on one population of slip events, and the place of a new part.

Rules meet every event under several controllers, controllers where units act alone, and on the first events with a knob of
theirs at other values. The rows are stored in the repository, so that a new part is ranked by its runs alone.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from alloc.compilation import ROOT
from alloc.evaluation.metrics import evaluate
from alloc.files import write_whole
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from alloc.run.simulation import simulate
from studies import StudyError, run_cell, standing
from studies.files.scenario import Scenario
from studies.population import population
from studies.runner.plugins import load_plugins, try_own_parts
from studies.runner.provenance import describe_origin
from studies.runner.row_key import hash_sources
from studies.runner.study import WIDE, Cell, Row, Study
from studies.standing import DISTRIBUTION, EFFORT, GAIN, Columns, Statistic
from studies.statistics import (
    Claim,
    Interval,
    Statement,
    draw_forest,
    in_digits,
    judge,
    mean,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Strata = Mapping[str, "pd.Series[bool]"]
"""Parts of the events by name, as truth by event."""
Runs = dict[str, pd.DataFrame]
"""Rows by event of each rule or of each controller, over the same events."""
Knob = tuple[str, float]
"""Parameter of a controller, and its value."""
Pair = tuple[str, str]
"""A rule and a controller."""

# what is compared

BASE, BOUND, SHARING = "alone", "oracle", "cooperative"
"""Units that share nothing, the rule that knows the rail, this project's own."""
INFORMATION = {
    "every unit's report": ("uniform", "spread", "erp-reported", "exact-reported", SHARING, "wear"),
    "the front": ("sharing", "erp", "greedy", "exact", "qp"),
    "slips": ("greedy-literal", "greedy-tuned", "greedy-printed"),
    "nothing": ("preset", "most"),
}
"""Rules by what they are told of the rail: first compare those that are told alike. What ends with "-reported" is the rule
of that name, told what `SHARING` is told."""
REPORTED = "-reported"
SHARERS = tuple(rule for rules in INFORMATION.values() for rule in rules)
UNDER = {
    "cut-and-ramp": (BASE, *SHARERS, BOUND),
    "perturb-observe": (BASE, *SHARERS, BOUND),
    "mpc": (BASE, *INFORMATION["every unit's report"], "greedy", "exact", "most", BOUND),
}
"""Controllers under which rules are compared, and the rules; under the MPC all that are told reports and one of each other
kind, since it takes longest."""
SEARCH = "perturb-observe"
"""Controller with which all are compared where units act alone."""
KNOBS: dict[str, tuple[str, tuple[float, ...]]] = {
    "table": ("margin", (0.03, 0.06, 0.22, 0.44)),
    "cut-and-ramp": ("recover", (0.5, 0.65, 0.8, 0.9)),
    "pi-creep": ("reference", (0.03, 0.05, 0.15, 0.3)),
    "perturb-observe": ("highest", (0.06, 0.12, 0.25, 1.5)),
    "steepest-gradient": ("highest", (0.06, 0.12, 0.25, 1.5)),
    "mpc": ("price", (0.0375, 0.6, 1.2, 2.4)),
}
"""Parameter of a controller by which it gives up adhesion for less wheel damage, and values beside the one that ships."""
SWEPT = 100
"""Events on which knobs are swept: the first."""
METRICS_STORED = (
    "bound_use", "headroom", "over_delivery", "slip_time", "slip_peak", "damage", "excess_damage", "event_excess",
    "time_lost", "distance_lost", "locked_time", "jerk_rms", "effort_ratio",
)  # fmt: skip


def cells(events: int, seed: int) -> list[Cell]:
    """Each event under every pair, its number the seed of all."""
    single = [name for name in CONTROLLERS.shipped() if name not in UNDER]
    pairs = [(rule, controller) for controller, rules in UNDER.items() for rule in rules]
    pairs += [(BASE, controller) for controller in single]
    cells = list[Cell]()
    for k in range(events):
        event, drawn = population.event(seed, k), population.draw(seed, k)
        strata = {name: drawn[name] for name in population.STRATA}
        cells += [_make_cell(event, *pair, k, **strata) for pair in pairs]
        for controller, (knob, values) in KNOBS.items() if k < SWEPT else ():
            pair = BASE, controller
            cells += [_make_cell(event, *pair, k, (knob, value), **strata) for value in values]
    return cells


def _make_cell(
    event: Scenario, rule: str, controller: str, k: int, knob: Knob | None = None, **strata: Any
) -> Cell:
    columns = {"scenario": event.name, "rule": rule, "controller": controller, "seed": k, **strata}
    name = "/".join([event.name, rule, controller, *map(str, knob or ())])
    sources = run_cell.sources(event, rule.removesuffix(REPORTED), controller)
    columns["knob"] = knob and knob[1]
    return Cell(name, (event, rule, controller, k, knob), columns, sources)


def run(scenario: Scenario, rule: str, controller: str, k: int, knob: Knob | None = None) -> Row:
    """The stored metrics of a run, and whether rule and controller worked; `knob`: a parameter at another value."""
    control, share = CONTROLLERS.find(controller), RULES.find(rule.removesuffix(REPORTED))
    if knob:
        parameter, value = knob
        control = control.tuned(**{parameter: value})
    if rule.endswith(REPORTED):
        share = share.with_belief(RULES[SHARING].belief.name)
    recorded = simulate(run_cell.event_of(scenario, k), share, control)
    numbers = evaluate(recorded)
    return {name: numbers[name] for name in METRICS_STORED} | run_cell.status(recorded)


# the stored rows

STORED = ("docs/tables/benchmark.parquet", "studies/benchmark.parquet")
"""In a clone, and in an installed package."""


def store_rows(rows: pd.DataFrame, path: Path) -> None:
    """Write rows in little room, with what they were computed by."""
    parts = ["scenario", "seed", "rule", "controller", "knob", *population.STRATA]
    types = {"knob": float} | dict.fromkeys(METRICS_STORED, "float32")
    small = rows[[*parts, *METRICS_STORED, "status"]].astype(types)
    small.attrs = {"sources": hash_sources(run), **describe_origin()}
    write_whole(path, partial(small.to_parquet, index=False, compression="zstd"))


def read_stored() -> pd.DataFrame:
    """The stored rows; `attrs` say what computed them. Raises `StudyError` where there are none."""
    for path in STORED:
        if (ROOT / path).is_file():
            return pd.read_parquet(ROOT / path)
    raise StudyError(f"{ROOT / STORED[0]} is missing; run readhesion benchmark")


def is_stale() -> bool:
    """Whether the stored rows were computed by other sources than these."""
    return bool(read_stored().attrs.get("sources") != hash_sources(run))


# what comes out

WIDE_ROOM, NOISY = "headroom above 1 point", "noise above 0.05 km/h"
"""Two of the strata."""


def split_runs(rows: pd.DataFrame, part: str) -> Runs:
    """Rules under a controller, or controllers under a rule, as they ship, in the events in which all worked."""
    kind, split = ("controller", "rule") if part in UNDER else ("rule", "controller")
    good = run_cell.complete(rows[(rows[kind] == part) & rows["knob"].isna()])
    return {str(name): runs.set_index("scenario") for name, runs in good.groupby(split)}


def find_strata(rows: pd.DataFrame) -> Strata:
    """Parts of the events: headroom, case, fleet, noise, lag, what is special."""
    first = rows.drop_duplicates("scenario").set_index("scenario")
    headroom = split_runs(rows, SEARCH)[BOUND]["headroom"].reindex(first.index)
    cases = ("start", "receptive stop", "blended stop")
    return {
        WIDE_ROOM: headroom > 0.01,
        **{f"{case}s": first["case"] == case for case in cases},
        **{f"{fleet}s": first["fleet"] == fleet for fleet in population.FLEETS},
        NOISY: first["speed_noise_kmh"] > 0.05,
        "lag above 22 ms": first["lag_s"] > 0.022,
        "a unit fails": first["fails"],
        "couplers": first["coupled"],
    }


def find_gain(runs: Runs, name: str, reference: str) -> "pd.Series[float]":
    """How much more of the bound a part uses than a reference, by event [points]."""
    return 100.0 * (runs[name][EFFORT] - runs[reference][EFFORT])


USED = Statistic(EFFORT, 1, 100.0, compared=False)
EXCESS = Statistic("event_excess", 0, 100.0, False, standing.without_interval(pd.Series.median))
SPREADING = {column.heading: column for column in DISTRIBUTION.values()}
RULE_COLUMNS = {
    "used [%]": USED,
    "gain over alone [points]": GAIN,
    **dict.fromkeys((WIDE_ROOM, "starts", "receptive stops", "blended stops"), GAIN),
    **SPREADING,
    "beyond the plan [%]": Statistic("over_delivery", 2, 100.0, False),
    "Q over the least of its impulse [%, median]": EXCESS,
    "Q over alone [kJ]": Statistic("damage"),
    "slip over alone [axle s]": Statistic("slip_time"),
    "time lost over alone [s]": Statistic("time_lost", 2),
    "way lost over alone [m]": Statistic("distance_lost"),
}
CONTROLLER_COLUMNS = {
    "used [%]": USED,
    "over perturb-observe [points]": GAIN,
    **dict.fromkeys(("starts", "receptive stops", "blended stops", "locomotives", NOISY), GAIN),
    **SPREADING,
    "Q [kJ]": Statistic("damage", 0, 1.0, False),
    "slip [axle s]": Statistic("slip_time", 1, 1.0, False),
    "jerk [m/s3]": Statistic("jerk_rms", 2, 1.0, False),
    "locked [axle s]": Statistic("locked_time", 2, 1.0, False),
}


def _describe_part(runs: Runs, name: str, reference: str, columns: Columns, strata: Strata) -> Row:
    """A line of a table; a column with the name of a stratum is over its events."""
    numbers, base = runs[name], runs[reference]
    parts = {key: numbers.loc[strata[key]] if key in strata else numbers for key in columns}
    texts = {key: column.text(parts[key], base) for key, column in columns.items()}
    return {"events": len(numbers), **texts}


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Every rule under every controller: use of the bound, gain over `BASE` and where, worst case, costs."""
    strata, lines = find_strata(rows), []
    for controller, rules in UNDER.items():
        runs = split_runs(rows, controller)
        for rule in rules:
            kinds = [kind for kind, alike in INFORMATION.items() if rule in alike]
            line: Row = {"controller": controller, "rule": rule, "told": (*kinds, "–")[0]}
            lines.append(line | _describe_part(runs, rule, BASE, RULE_COLUMNS, strata))
    return pd.DataFrame(lines)


def tabulate_controllers(rows: pd.DataFrame) -> pd.DataFrame:
    """Every controller where units act alone, the best first; gains are over perturb-observe."""
    strata, runs = find_strata(rows), split_runs(rows, BASE)
    return pd.DataFrame(
        {"controller": name} | _describe_part(runs, name, SEARCH, CONTROLLER_COLUMNS, strata)
        for name in sorted(runs, key=lambda name: -runs[name][EFFORT].mean())
    )


def tabulate_front(rows: pd.DataFrame) -> pd.DataFrame:
    """Bound used, wheel damage and jerk of controllers at values of their knobs, over the same events."""
    swept = set(rows.loc[rows["knob"].notna(), "scenario"])
    good = run_cell.complete(rows[(rows["rule"] == BASE) & rows["scenario"].isin(swept)])
    lines = []
    for name, (knob, _) in KNOBS.items():
        usual = CONTROLLERS[name].memory.columns[knob].default
        runs = good[good["controller"] == name].fillna({"knob": usual})
        for value, part in runs.groupby("knob"):
            used, damage, jerk = (part[metric].mean() for metric in (EFFORT, "damage", "jerk_rms"))
            ships, events = value == usual, len(part)
            lines.append((name, knob, float(value), ships, events, 100.0 * used, damage, jerk))
    heads = "controller", "knob", "value", "own", "events", "used [%]", "Q [kJ]", "jerk [m/s3]"
    return pd.DataFrame(lines, columns=list(heads))


CLAIMED_BETTER = (("mpc", SEARCH), (SEARCH, "cut-and-ramp"), (SEARCH, "pi-creep"))
"""Controllers of which this project says that one is better than the other."""


def statements(rows: pd.DataFrame) -> list[Statement]:
    """That rules gain over units that share nothing, and what is said of controllers; one family."""
    strata, claims = find_strata(rows), []

    def add_claim(name: str, runs: Runs, part: str, reference: str, source: str = "") -> None:
        text = f"uses more of the bound than {reference}{source} [points]"
        gain = find_gain(runs, part, reference)
        claims.append(Claim(name, text, gain, 0.0, digits=2, parts=strata))

    for controller, rules in UNDER.items():
        runs = split_runs(rows, controller)
        for rule in [rule for rule in rules if rule not in (BASE, BOUND)]:
            add_claim(f"{rule}, {controller}", runs, rule, BASE)
    runs = split_runs(rows, BASE)
    for better, worse in CLAIMED_BETTER:
        source = " where units act alone (this project)"
        add_claim(f"{better} over {worse}", runs, better, worse, source)
    return judge(claims)


def figure(rows: pd.DataFrame) -> "Figure":
    """Gain of each rule over `BASE` under each controller, and the fronts of the controllers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDE, 5.6), layout="constrained")
    above, below = figure.subplots(2, 3, height_ratios=(3, 2))
    wide = find_strata(rows)[WIDE_ROOM]
    for axes, controller in zip(above, UNDER, strict=True):
        runs = split_runs(rows, controller)
        gains = {rule: find_gain(runs, rule, BASE) for rule in SHARERS if rule in UNDER[controller]}
        numbers = {rule: [mean(gain), mean(gain[wide])] for rule, gain in gains.items()}
        draw_forest(axes, {rule: numbers.get(rule, []) for rule in SHARERS}, RULES, 0.0)
        axes.set(title=f"under {controller}", xlabel="gain over alone [points]")
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set_xticks([-10, -1, 0, 1], ["\N{MINUS SIGN}10", "\N{MINUS SIGN}1", "0", "1"])
        if axes is not above[0]:
            axes.set_yticklabels([])
    points = tabulate_front(rows)
    for axes, cost in zip(below, ("Q [kJ]", "jerk [m/s3]"), strict=False):
        for name, front in points.groupby("controller", sort=False):
            look = CONTROLLERS[name]
            style = {"marker": look.marker, "color": look.colour, "label": name}
            axes.plot(front[cost], front["used [%]"], "-", **style)
        axes.set(xlabel=f"mean {cost}", ylabel="bound used [%]")
    below[2].axis("off")
    below[2].legend(*below[1].get_legend_handles_labels(), loc="center")
    return figure


QUESTION = "How much of what rail and motors allow do rules and controllers use, and at what cost?"
DRAWN = population.EVENTS, population.SEED
FURTHER = {"controllers": tabulate_controllers, "front": tabulate_front}
STUDY = Study("benchmark", QUESTION, cells, run, table, figure, statements, *DRAWN, FURTHER)

# the place of a new part


def compared_parts(rule: str, controller: str) -> tuple[str, str]:
    """Which part of a pair is ranked, a controller where units act alone, and its reference."""
    return (controller, SEARCH) if rule == BASE else (rule, BASE)


def _join_runs(rows: pd.DataFrame, new_rows: pd.DataFrame, pair: Pair) -> Runs:
    """The runs of a new pair, by the name of its part, beside the stored ones over the same events."""
    (name, reference), (rule, controller) = compared_parts(*pair), pair
    good = new_rows[new_rows["status"] == "ok"].set_index("scenario")
    same = rows[rows["scenario"].isin(good.index)]
    runs = split_runs(same, BASE if rule == BASE else controller)
    numbers = good.loc[runs[reference].index, [EFFORT, "over_delivery"]].astype("float32")
    return {**runs, name: numbers}


def tabulate_places(rows: pd.DataFrame, new_rows: pd.DataFrame, pair: Pair) -> pd.DataFrame:
    """A new pair of rule and controller among those stored, a row for each part, the best first.

    `used` [%]; `less`, by how much the new part is ahead [points], with its interval; its `median`; `tied` where `less` may
    be nothing; `mark`, see `MARKS`.
    """
    (name, _), runs = compared_parts(*pair), _join_runs(rows, new_rows, pair)
    lines = []
    for part, values in runs.items():
        leads, used = find_gain(runs, name, part), 100.0 * float(values[EFFORT].mean())
        lead = mean(leads)
        tied, mark = (
            lead.tied(100.0 * standing.NEGLIGIBLE),
            standing.find_mark(part, values["over_delivery"].mean()),
        )
        lines.append((part, used, *lead[:3], float(leads.median()), tied, mark))
    heads = ["name", "used", "less", "low", "high", "median", "tied", "mark"]
    places = pd.DataFrame(lines, columns=heads)
    return places.sort_values("used", ascending=False, kind="stable", ignore_index=True)


def tabulate_gains(rows: pd.DataFrame, new_rows: pd.DataFrame, pair: Pair) -> pd.DataFrame:
    """Gain of the new part over its reference, see `compared_parts`, by parts of the events: mean with interval, median,
    trimmed mean, worst [points], shares of events gained and harmed."""
    runs, (name, reference), lines = _join_runs(rows, new_rows, pair), compared_parts(*pair), []
    for stratum, true in {"all": runs[name][EFFORT].notna(), **find_strata(rows)}.items():
        part = runs[name].loc[true]
        gain = GAIN.measure(part, runs[reference]).times(100.0)
        line: Row = {"events": stratum, "number": len(part), "gain": gain.value}
        line |= {"low": gain.low, "high": gain.high}
        for key, column in DISTRIBUTION.items():
            factor = column.scale if column.signed else 1.0
            line[key] = factor * column.measure(part, runs[reference]).value
        lines.append(line)
    return pd.DataFrame(lines)


def rank_study(rule: str, controller: str) -> Study:
    """The runs of a pair on the population, and its place among the stored ones. Raises `StudyError`: see `read_stored`."""

    def pair_cells(events: int, seed: int) -> list[Cell]:
        if events > population.EVENTS:
            raise StudyError(f"events = {events}: rows of {population.EVENTS} are stored")
        return [_make_cell(population.event(seed, k), rule, controller, k) for k in range(events)]

    rows, pair = read_stored(), (rule, controller)
    return replace(
        STUDY,
        name=f"rank-{rule}-{controller}",
        question=f"where {compared_parts(rule, controller)[0]} stands among all",
        cells=pair_cells,
        table=lambda new_rows: tabulate_places(rows, new_rows, pair),
        figure=None,
        statements=None,
        more_tables={"gains": lambda new_rows: tabulate_gains(rows, new_rows, pair)},
    )


def find_pairs(part: str, under: str) -> list[Pair]:
    """Pairs of rule and controller that rank the parts of a file, or the part of this name; rules run `under` a controller.

    Raises `InputError` for a part that does not exist or does not work, and a controller of which no rules are stored.
    """
    if under not in UNDER:
        raise StudyError(f"--under {under}: rows are stored of {', '.join(UNDER)}")
    names = [part]
    if part.endswith(".py"):
        (module,) = load_plugins([part])
        registered = [(registry, name) for registry in (RULES, CONTROLLERS) for name in registry]
        names = [name for registry, name in registered if registry.origin(name) == module.__name__]
        if not names:
            raise StudyError(f"{part}: it registers no rule and no controller")
    rules = [name for name in names if name not in CONTROLLERS]
    pairs = [(RULES.find(name).name, under) if name in rules else (BASE, name) for name in names]
    try_own_parts(*zip(*pairs, strict=True))
    return pairs


def format_rank(pair: Pair, tables: Mapping[str, pd.DataFrame]) -> list[str]:
    """The tables of `rank_study`, for a terminal of 80 columns."""
    (name, reference), (places, gains) = compared_parts(*pair), tables.values()
    under = "where units act alone" if pair[0] == BASE else f"under {pair[1]}"
    head, count = ("place", "", "used %", f"{name} less it [95 %]", "median"), 0
    rows: list[tuple[str, ...]] = [head]
    for place in places.itertuples():
        count += place.mark == ""
        rank = "" if place.mark else f"{count}{'=' if place.tied else ''}"
        lead = Interval(place.less, place.low, place.high, gains["number"].max())
        numbers = lead.text(2, sign=True), in_digits(place.median, 2, True)
        numbers, arrow = (("", ""), ">") if place.name == name else (numbers, " ")
        rows.append((f"{arrow}{rank:>4}", place.name + place.mark, f"{place.used:.1f}", *numbers))
    lines = [f"{name} {under}", *standing.align_columns(rows, left=2)]
    rows = [("  events", "", "points [95 %]", "median", "worst", "harmed %")]
    for part in gains.itertuples():
        gain = Interval(part.gain, part.low, part.high, part.number).text(2, sign=True)
        tail = (part.median, 2, True), (part.worst, 1, True), (100.0 * part.harmed, 0, False)
        texts = [in_digits(*number) if part.number else "" for number in tail]
        rows.append((f"  {part.events}", str(part.number), gain, *texts))
    lines += ["", f"{name} less {reference}:", *standing.align_columns(rows)]
    little = f"the interval holds 0, or less than {100 * standing.NEGLIGIBLE:g} points"
    no_place = {mark: f"{meaning}; has no place" for mark, meaning in standing.MARKS.items()}
    lines += standing.list_marks(lines, {"=": f"cannot be told from {name}: {little}", **no_place})
    whole, points = gains.iloc[0], f"{100 * standing.LITTLE:g} points"
    trimmed, gained = in_digits(whole["trimmed"], 2, True), 100.0 * whole["gained"]
    lines += [f"all without the outer tenths: {trimmed}; {gained:.0f} % gain more than {points}"]
    return [*lines, f"harmed: loses more than {points}"]
