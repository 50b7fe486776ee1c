"""The benchmark: rules and controllers on one population of slip events.

Rules meet every event under several controllers, controllers where units act alone, and on the first events with a knob of
theirs at other values. The rows are stored in the repository, so that `studies.rank` runs a new part alone.
"""

from collections.abc import Mapping
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
from studies.files.scenario_files import shipped_names
from studies.population import population
from studies.runner.provenance import describe_origin
from studies.runner.row_key import hash_sources
from studies.runner.study import WIDE, Cell, Row, Study
from studies.standing import DISTRIBUTION, EFFORT, GAIN, Columns, Statistic
from studies.statistics import Claim, Statement, draw_forest, judge, mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Strata = Mapping[str, "pd.Series[bool]"]
"""Parts of the events by name, as truth by event."""
Runs = dict[str, pd.DataFrame]
"""Rows by event of each rule or of each controller, over the same events."""
Knob = tuple[str, float]
"""Parameter of a controller, and its value."""

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
        cells += [make_cell(event, *pair, k, **strata) for pair in pairs]
        for controller, (knob, values) in KNOBS.items() if k < SWEPT else ():
            pair = BASE, controller
            cells += [make_cell(event, *pair, k, (knob, value), **strata) for value in values]
    return cells


def make_cell(
    event: Scenario, rule: str, controller: str, k: int, knob: Knob | None = None, **strata: Any
) -> Cell:
    """Event `k` under a rule and a controller, a `knob` of it at another value; its rows say `strata`."""
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
    small.attrs = {"sources": _hash_parts(), **describe_origin()}
    write_whole(path, partial(small.to_parquet, index=False, compression="zstd"))


def read_stored() -> pd.DataFrame:
    """The stored rows; `attrs` say what computed them. Raises `StudyError` where there are none."""
    for path in STORED:
        if (ROOT / path).is_file():
            return pd.read_parquet(ROOT / path)
    raise StudyError(f"{ROOT / STORED[0]} is missing; run readhesion benchmark")


def _hash_parts() -> str:
    """Of the sources behind all stored rows: controllers are called by name, so theirs count beside."""
    return hash_sources(run, tuple(sorted(map(CONTROLLERS.origin, CONTROLLERS.shipped()))))


def is_stale() -> bool:
    """Whether the stored rows were computed by other sources than these."""
    return bool(read_stored().attrs.get("sources") != _hash_parts())


def summarise_stored(compared: pd.DataFrame) -> str:
    """What the stored rows say of the rules whose rows over shipped events were `compared`; nothing of other events.

    A comparison of shipped events alone misleads: they were made to show cases of the patent.
    """
    controllers = [name for name in (SEARCH, *UNDER) if name in set(compared["controller"])]
    if not controllers or not {*compared["scenario"]} <= {*shipped_names()}:
        return ""
    rows, rules, answers = read_stored(), {*compared["rule"]} - {BASE}, []
    runs, over = split_runs(rows, controllers[0]), "over_delivery"
    ranked = [rule for rule in runs if not standing.find_mark(rule, runs[rule][over].mean())]
    gains = {rule: mean(find_gain(runs, rule, BASE)) for rule in ranked if rule in rules}
    for verb, sign in (("gain", 1.0), ("lose", -1.0)):
        sizes = {rule: sign * gain.value for rule, gain in gains.items() if not gain.tied(0.0)}
        chosen = sorted(
            (rule for rule in sizes if sizes[rule] > 0.0), key=lambda rule: -sizes[rule]
        )
        ends = dict.fromkeys(f"{sizes[rule]:.2f}" for rule in [*chosen[-1:], *chosen[:1]])
        verb += "s" * (len(chosen) == 1)
        answers += [f"{', '.join(chosen)} {verb} {' to '.join(ends)} points"] if chosen else []
    text = "The shipped events were made to show the patent's cases."
    if answers:
        events = (
            f"On {rows['scenario'].nunique()} drawn events, under {controllers[0]}, over {BASE}"
        )
        text += f" {events}: {'; '.join(answers)} (docs/sharing.md)."
    if unranked := sorted(rules - {*runs, *RULES.shipped()}):
        text += f" For {', '.join(unranked)} on drawn events, run readhesion rank."
    return text


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
    "distance lost over alone [m]": Statistic("distance_lost"),
}
CONTROLLER_COLUMNS = {
    "used [%]": USED,
    "over perturb-observe [points]": GAIN,
    **SPREADING,
    "Q [kJ]": Statistic("damage", 0, 1.0, False),
}
PART_COLUMNS = {
    **dict.fromkeys(("starts", "receptive stops", "blended stops", "locomotives", NOISY), GAIN),
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
            line: Row = {"controller": controller, "rule": rule, "given": (*kinds, "–")[0]}
            lines.append(line | _describe_part(runs, rule, BASE, RULE_COLUMNS, strata))
    return pd.DataFrame(lines)


def tabulate_controllers(rows: pd.DataFrame, columns: Columns = CONTROLLER_COLUMNS) -> pd.DataFrame:
    """Every controller where units act alone, the best first; gains are over perturb-observe."""
    strata, runs = find_strata(rows), split_runs(rows, BASE)
    return pd.DataFrame(
        {"controller": name} | _describe_part(runs, name, SEARCH, columns, strata)
        for name in sorted(runs, key=lambda name: -runs[name][EFFORT].mean())
    )


def tabulate_parts(rows: pd.DataFrame) -> pd.DataFrame:
    """The same over parts of the events, and costs: columns that would make the first table too wide for a page."""
    return tabulate_controllers(rows, PART_COLUMNS)


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
FURTHER = {"controllers": tabulate_controllers, "parts": tabulate_parts, "front": tabulate_front}
STUDY = Study("benchmark", QUESTION, cells, run, table, figure, statements, *DRAWN, FURTHER)
