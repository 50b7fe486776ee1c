"""The main comparison: every rule under every controller over the same slip events, and what each adds to `alone`."""

from collections.abc import Iterator, Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import scipy

from alloc.evaluation.metrics import METRICS
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from studies import StudyError
from studies.files.scenario import Scenario
from studies.files.scenario_files import default_scenarios
from studies.run_cell import cell, run
from studies.runner.provenance import describe_origin
from studies.runner.study import WIDE, Cell, Row, Study
from studies.standing import (
    DISTRIBUTION,
    EFFORT,
    GAIN,
    MARKS,
    Statistic,
    align_columns,
    find_mark,
    is_tied,
    list_marks,
)
from studies.statistics import Interval, draw_forest, in_digits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFERENCE = "alone"
"""Rule from which the others' differences are counted."""
COLUMNS = {
    "used": Statistic(EFFORT, 1, 100.0, compared=False, heading="used %"),
    "gain": GAIN._replace(heading="points over alone"),
    "damage": Statistic("damage", 0, heading="damage kJ"),
    "slip": Statistic("slip_time", 0, heading="slip axle s"),
}
"""The table; a metric joins it by a line here."""
CONTROLLERS_COMPARED = ("cut-and-ramp", "perturb-observe", "mpc")
LEFT_OUT = ("qp-cvxpy", "qp-robust", "wear-qp")
"""Rules that answer as another does, or are told what no train knows; they run where they are named."""
SEEDS = 2
"""Days 3 to 5 narrowed the intervals over events by 0.9 % in the median, and moved no mean by more than half of one."""
FEW = 5
"""Events below which intervals are over events and seeds, and say nothing of other events."""


class Grid(NamedTuple):
    """What is compared."""

    scenarios: Sequence[Scenario]
    rules: Sequence[str]
    controllers: Sequence[str]
    seeds: int

    def cells(self) -> list[Cell]:
        """By event, so that neighbours share what they prepare."""
        return [
            cell(scenario, rule, controller, scenario.first_seed + k)
            for scenario in self.scenarios
            for k in range(self.seeds if self.seeds > 1 and depends_on_seed(scenario) else 1)
            for controller in self.controllers
            for rule in self.rules
        ]


def depends_on_seed(scenario: Scenario) -> bool:
    """Whether anything of an event depends on the seed."""
    return scenario.event(1).inputs_hash != scenario.event(2).inputs_hash


def choose_grid(
    scenarios: Sequence[Scenario] | None = None,
    rules: Sequence[str] | None = None,
    controllers: Sequence[str] | None = None,
    seeds: int | None = None,
) -> Grid:
    """The grid of these parts; what is left out is the default. Raises `InputError` for a part that does not exist."""
    if seeds is not None and not 1 <= seeds <= 1000:
        raise StudyError(f"seeds = {seeds}: give 1 to 1000")
    chosen = tuple(dict.fromkeys(scenarios or default_scenarios()))
    names = [scenario.name for scenario in chosen]
    if twice := {name for name in names if names.count(name) > 1}:
        raise StudyError(f"two scenarios are named {twice.pop()!r}; rename one")
    rules = tuple(dict.fromkeys(rules or [name for name in RULES if name not in LEFT_OUT]))
    for name in rules:
        RULES.find(name)
    controllers = tuple(dict.fromkeys(controllers or CONTROLLERS_COMPARED))
    for name in controllers:
        CONTROLLERS.find(name)
    return Grid(chosen, rules, controllers, seeds or SEEDS)


def make_study(grid: Grid) -> Study:
    """The comparison as a study."""
    return Study(
        name="compare",
        question="every rule under every controller over the same slip events",
        cells=lambda events, seed: grid.cells(),
        run=run,
        table=lambda rows: tabulate_standings(rank_rules(rows)),
        figure=lambda rows: draw_gains(rank_rules(rows)),
        events=1,
    )


# what comes out


class Standing(NamedTuple):
    """A rule under a controller: means over events of means over seeds, and differences from `alone` paired by event."""

    controller: str
    rule: str
    events: int
    runs: int
    numbers: Mapping[str, Interval]
    """By the names of `COLUMNS` and of `DISTRIBUTION`."""
    over_delivery: float
    tied: bool
    """Whether it cannot be told from the best of those that a train can carry out."""
    gap: str
    """Greatest `rule_gap` of its runs, degraded ones too; as three decimals it would be zero, and empty without a solver."""
    mark: str
    """One of `MARKS`, and † where rule or controller failed in some run."""

    @property
    def name(self) -> str:
        """The rule with its marks."""
        return self.rule + self.mark + ("=" if self.tied else "")


def check_parts(rows: pd.DataFrame) -> None:
    """Raise `StudyError` where a rule or a controller of these rows is not registered."""
    kinds: Any = (("rule", RULES), ("controller", CONTROLLERS))
    for kind, parts in kinds:
        for name in rows[kind].unique():
            if name not in parts:
                raise StudyError(
                    f"the {kind} {name!r} of this comparison is not registered: "
                    "name the file that registers it, readhesion --plugin FILE before the command"
                )


def rank_rules(rows: pd.DataFrame) -> list[Standing]:
    """Every rule under every controller, over the events that all its rules have; the best first, slow controllers last."""
    standings = []
    for controller in rows.loc[rows["status"] == "ok", "controller"].unique():
        group = _rank_under(rows[rows["controller"] == controller], str(controller))
        standings += sorted(group, key=lambda standing: -standing.numbers["used"].value)
    return standings


def _rank_under(rows: pd.DataFrame, controller: str) -> Iterator[Standing]:
    good, failed = rows[rows["status"] == "ok"], set(rows.loc[rows["status"] != "ok", "rule"])
    rules = list(dict.fromkeys(good["rule"]))
    metrics = dict.fromkeys([*(column.metric for column in COLUMNS.values()), "over_delivery"])
    means = good.pivot(index=["scenario", "seed"], columns="rule", values=list(metrics))
    means = means.loc[means[EFFORT][rules].notna().all(axis=1)]  # rules are paired by seed
    count, events = len(means), means.index.get_level_values("scenario").nunique()
    if events >= FEW:
        means = means.groupby(level="scenario").mean()
    runs = {rule: means.xs(rule, axis=1, level="rule") for rule in rules}
    reference = runs.get(REFERENCE, runs[rules[0]] * np.nan)  # without it there is no difference

    over = {rule: float(runs[rule]["over_delivery"].mean()) for rule in rules}
    marks = {rule: find_mark(rule, over[rule]) for rule in rules}
    ranked = [rule for rule in rules if not marks[rule]]
    best = max(ranked, key=lambda rule: runs[rule][EFFORT].mean(), default="")
    gaps, columns = rows.groupby("rule")["rule_gap"].max(), {**COLUMNS, **DISTRIBUTION}
    for rule in rules:
        numbers = {name: column.measure(runs[rule], reference) for name, column in columns.items()}
        tied = rule in ranked and (rule == best or is_tied(runs[best], runs[rule]))
        mark = marks[rule] + "†" * (rule in failed)
        gap = f"{gaps[rule]:.0e}".replace("nan", "")
        yield Standing(controller, rule, events, count, numbers, over[rule], tied, gap, mark)


def tabulate_standings(standings: Sequence[Standing]) -> pd.DataFrame:
    """Standings as numbers: shares of the bound, kJ, axle seconds, with intervals; how gains are spread, without."""
    rows = []
    for standing in standings:
        row: Row = {}
        for field, value in standing._asdict().items():
            if field != "numbers":
                row[field] = value
                continue
            for name, number in value.items():
                row[name] = number.value
                if name in COLUMNS:
                    row |= {f"{name}_low": number.low, f"{name}_high": number.high}
        rows.append(row)
    return pd.DataFrame(rows)


def group_by_controller(standings: Sequence[Standing]) -> dict[str, list[Standing]]:
    """Standings of each controller, the best first."""
    groups: dict[str, list[Standing]] = {}
    for standing in standings:
        groups.setdefault(standing.controller, []).append(standing)
    return groups


def format_standings(standings: Sequence[Standing]) -> list[str]:
    """The table for a terminal of 80 columns, a block for each controller, and what its marks mean."""
    lines = []
    for controller, group in group_by_controller(standings).items():
        table = [["rule", *(column.heading or name for name, column in COLUMNS.items())]]
        for standing in group:
            texts = [_shorten(column, standing.numbers[name]) for name, column in COLUMNS.items()]
            table.append([standing.name, *texts])
        differences = "".join(text for row in table[1:] for text in row[2:])
        less = f", less {REFERENCE}" if differences else ""
        less += " with 95 % intervals" if "[" in differences else ""
        lines += ["", f"under {controller}{less}:", *align_columns(table)]
    marks = {"=": "not to be told from the best", **MARKS, "†": "some runs failed and are left out"}
    lines += list_marks(lines, marks | {"*": f"{MARKS['*']}, not ranked"})
    for line in list_information([standing.rule for standing in standings]):
        lines += wrap(line, 78, subsequent_indent="  ", break_on_hyphens=False)
    return lines


def _shorten(column: Statistic, number: Interval) -> str:
    """A number for a terminal; nothing for no difference, and no interval of what is no difference."""
    if not column.compared:
        return in_digits(column.scale * number.value, column.digits, False)
    if not number.events or not (number.value or number.high):
        return ""
    return number.text(column.digits, column.scale, sign=True)


def list_information(rules: Sequence[str]) -> list[str]:
    """Which rules know what, where they differ: then a comparison is of information too."""
    groups: dict[str, list[str]] = {}
    for name in dict.fromkeys(rules):
        rule = RULES.get(name)
        if name != REFERENCE and rule:
            groups.setdefault(rule.belief.description, []).append(name)
    if len(groups) < 2:
        return []
    return [f"{', '.join(names)}: given {description}" for description, names in groups.items()]


def summarise_standings(standings: Sequence[Standing]) -> str:
    """The answer, a sentence for each controller."""
    sentences = []
    for controller, group in group_by_controller(standings).items():
        tied = [standing for standing in group if standing.tied]
        if len(group) < 2 or not tied or not tied[0].numbers["gain"].events:
            continue
        names = ", ".join(standing.rule for standing in tied[:3])
        names += f" and {len(tied) - 3} more" if len(tied) > 3 else ""
        verb = "cannot be told apart" if len(tied) > 1 else "uses most"
        gain = tied[0].numbers["gain"].text(2, 100.0, sign=True)
        sentence = f"Under {controller}, {names} {verb}: {gain} points over {REFERENCE}"
        for bound in [standing for standing in group if "°" in standing.mark][:1]:
            gain = f"{100 * bound.numbers['gain'].value:+.2f}"
            sentence += f"; {bound.rule}, which knows the rail, {gain}"
        sentences.append(f"{sentence}.")
    if sentences and standings[0].events < FEW:
        sentences.append("Intervals are over seeds of few events and say nothing of others.")
    return (
        "\n".join(sentences) or f"Nothing was compared with {REFERENCE}: the table has the numbers."
    )


def export_comparison(rows: pd.DataFrame) -> dict[str, Any]:
    """What a program reads: about the comparison, the metrics, and every event under every rule and controller."""
    names, cases = [name for name in METRICS if name in rows], []
    columns = ["scenario", "rule", "controller"]
    for case, runs in rows.groupby(columns, sort=False):
        good, bad = runs.loc[runs["status"] == "ok", names], runs[runs["status"] != "ok"]
        centre, n = good.mean(), good.count()
        half = good.std() * (scipy.stats.t.ppf(0.975, (n - 1).clip(1)) / np.sqrt(n))
        numbers = dict.fromkeys(names) | {
            name: {"mean": float(centre[name]), "half_width": float(half.fillna(0.0)[name])}
            for name in names
            if n[name]
        }
        reasons = list(dict.fromkeys(bad["reason"]))
        cases.append(
            dict(zip(columns, case, strict=True))
            | {"seeds": len(runs), "failed": len(bad), "reasons": reasons, "metrics": numbers}
        )
    standings = rank_rules(rows)
    return {
        "about": {
            "runs": len(rows),
            "answer": summarise_standings(standings).splitlines(),
            **describe_origin(),
        },
        "metrics": {
            name: {"unit": METRICS[name].unit, "description": METRICS[name].description}
            for name in names
        },
        "standings": tabulate_standings(standings).to_dict(orient="records"),
        "rows": cases,
    }


def draw_gains(standings: Sequence[Standing]) -> "Figure":
    """Points of the bound over `alone` with intervals, rule by rule, a panel for each controller."""
    from matplotlib.figure import Figure

    groups = group_by_controller(standings)
    height = 0.2 * len({standing.rule for standing in standings}) + 0.9
    width = min(WIDE, 2.2 * len(groups) + 1.0)
    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(1, len(groups), squeeze=False)[0]
    for axes, (controller, group) in zip(panels, groups.items(), strict=True):
        gains = {standing.rule: [standing.numbers["gain"].times(100.0)] for standing in group}
        gains.pop(REFERENCE, None)
        draw_forest(axes, gains, RULES, 0.0)
        axes.set(title=controller, xlabel=f"points over {REFERENCE}")
    return figure
