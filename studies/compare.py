"""The main comparison: every rule under every controller over the same slip events, and what each adds to `alone`."""

from collections.abc import Mapping, Sequence
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
from studies.runner.study import WIDE, Cell, Row, Study
from studies.statistics import Interval, forest, mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFERENCE, EFFORT = "alone", "bound_use"
"""Rule from which the others' differences are counted, and the metric that ranks them."""
NUMBERS = [EFFORT, "damage", "slip_time", "over_delivery"]
CONTROLLERS_COMPARED = ("cut-and-ramp", "perturb-observe", "mpc")
LEFT_OUT = ("qp-cvxpy", "qp-robust", "wear-qp")
"""Rules that answer as another does, or are told what no train knows; they run where they are named."""
SEEDS = 5
MOST_OVER = 0.01
"""Share of the plan delivered beyond it above which a rule is not ranked: the driver did not ask for that."""
NEGLIGIBLE = 1e-3
"""A tenth of a point of the bound: nobody chooses a rule by it, however sure it is."""
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
            cell(one, rule, law, one.first_seed + k)
            for one in self.scenarios
            for k in range(self.seeds if self.seeds > 1 and draws(one) else 1)
            for law in self.controllers
            for rule in self.rules
        ]


def draws(scenario: Scenario) -> bool:
    """Whether anything of an event depends on the seed."""
    return scenario.event(1).inputs_hash != scenario.event(2).inputs_hash


def grid(
    scenarios: Sequence[Scenario] | None = None,
    rules: Sequence[str] | None = None,
    controllers: Sequence[str] | None = None,
    seeds: int | None = None,
) -> Grid:
    """The grid of these parts; what is left out is the default. Raises `InputError` for a part that does not exist."""
    if seeds is not None and not 1 <= seeds <= 1000:
        raise StudyError(f"seeds = {seeds}: give 1 to 1000")
    chosen = tuple(dict.fromkeys(scenarios or default_scenarios()))
    names = [one.name for one in chosen]
    if twice := {name for name in names if names.count(name) > 1}:
        raise StudyError(f"two scenarios are named {twice.pop()!r}; rename one")
    rules = tuple(dict.fromkeys(rules or [name for name in RULES if name not in LEFT_OUT]))
    for name in rules:
        RULES.find(name)
    controllers = tuple(dict.fromkeys(controllers or CONTROLLERS_COMPARED))
    for name in controllers:
        CONTROLLERS.find(name)
    return Grid(chosen, rules, controllers, seeds or SEEDS)


def study_of(chosen: Grid) -> Study:
    """The comparison as a study."""
    return Study(
        name="compare",
        question="every rule under every controller over the same slip events",
        cells=lambda events, seed: chosen.cells(),
        run=run,
        table=lambda rows: frame(standings(rows)),
        figure=lambda rows: figure(standings(rows)),
        events=1,
    )


# what comes out


class Standing(NamedTuple):
    """A rule under a controller: means over events of means over seeds, and differences from `alone` paired by event."""

    controller: str
    rule: str
    events: int
    runs: int
    used: Interval
    gain: Interval
    damage: Interval
    slip: Interval
    over: float
    tied: bool
    """Whether it cannot be told from the best of those that a train can carry out."""
    gap: float
    """Greatest `rule_gap` of its runs, degraded ones too."""
    mark: str
    """°: knows the rail; *: delivers too much beyond the plan; †: rule or controller failed in some run."""

    @property
    def name(self) -> str:
        """The rule with its marks."""
        return self.rule + self.mark + ("=" if self.tied else "")


def standings(rows: pd.DataFrame) -> list[Standing]:
    """Every rule under every controller, over the events that all its rules have; the best first, slow controllers last."""
    laws = rows.loc[rows["status"] == "ok", "controller"].unique()
    return [one for law in laws for one in _standings(rows[rows["controller"] == law], str(law))]


def _standings(rows: pd.DataFrame, controller: str) -> list[Standing]:
    good, failed = rows[rows["status"] == "ok"], set(rows.loc[rows["status"] != "ok", "rule"])
    rules = list(dict.fromkeys(good["rule"]))
    means = good.pivot(index=["scenario", "seed"], columns="rule", values=NUMBERS)
    means = means.loc[means[EFFORT][rules].notna().all(axis=1)]  # rules are paired by seed
    runs, events = len(means), means.index.get_level_values("scenario").nunique()
    if events >= FEW:
        means = means.groupby(level="scenario").mean()

    def less(name: str, rule: str, other: str) -> Interval:
        return mean(means[name, rule] - means[name, other] if other in rules else [])

    over, gaps = means["over_delivery"].mean(), rows.groupby("rule")["rule_gap"].max()
    marks = {rule: mark_of(rule, over[rule]) for rule in rules}
    ranked = [rule for rule in rules if not marks[rule]]
    best = str(means[EFFORT][ranked].mean().idxmax()) if ranked else ""

    found = []
    for rule in rules:
        used, mark = mean(means[EFFORT, rule]), marks[rule] + "†" * (rule in failed)
        gain, damage, slip = (
            less(name, rule, REFERENCE) for name in (EFFORT, "damage", "slip_time")
        )
        tied = rule in ranked and (rule == best or less(EFFORT, best, rule).tied(NEGLIGIBLE))
        numbers = used, gain, damage, slip, float(over[rule]), tied, float(gaps[rule])
        found.append(Standing(controller, rule, events, runs, *numbers, mark))
    return sorted(found, key=lambda one: -one.used.value)


def mark_of(name: str, over: float) -> str:
    """Why a part has no place: °, it knows the rail; *, it delivers this share of the plan beyond it, which is too much."""
    return "°" if knows_the_rail(name) else "*" if over > MOST_OVER else ""


def knows_the_rail(rule: str) -> bool:
    """Of a rule that is registered; rows of a plug-in may be read without it."""
    return rule in RULES and RULES[rule].belief.knows


def frame(found: Sequence[Standing]) -> pd.DataFrame:
    """Standings as numbers: shares of the bound, kJ, axle seconds, with intervals; `gap` is empty without a solver."""
    rows = []
    for one in found:
        row: Row = {key: getattr(one, key) for key in ("controller", "rule", "events", "runs")}
        for name in ("used", "gain", "damage", "slip"):
            number: Interval = getattr(one, name)
            row |= {name: number.value, f"{name}_low": number.low, f"{name}_high": number.high}
        gap = "" if np.isnan(one.gap) else f"{one.gap:.0e}"  # three decimals would all be zero
        rows.append(
            row | {"over_delivery": one.over, "tied": one.tied, "gap": gap, "mark": one.mark}
        )
    return pd.DataFrame(rows)


def by_controller(found: Sequence[Standing]) -> dict[str, list[Standing]]:
    """Standings of each controller, the best first."""
    laws = dict.fromkeys(one.controller for one in found)
    return {law: [one for one in found if one.controller == law] for law in laws}


HEAD = ("rule", "used %", "points over alone", "damage kJ", "slip axle s")


def lines(found: Sequence[Standing]) -> list[str]:
    """The table for a terminal of 80 columns, a block for each controller, and what its marks mean."""
    said = []
    for controller, own in by_controller(found).items():
        table = [HEAD]
        for one in own:
            costs = _short(one.gain, 2, 100.0), _short(one.damage, 0), _short(one.slip, 0)
            table.append((one.name, f"{100 * one.used.value:.1f}", *costs))
        shown = [k for k in range(len(HEAD)) if any(row[k] for row in table[1:])]
        widths = [max(len(row[k]) for row in table) for k in range(len(HEAD))]
        less = f", less {REFERENCE} with 95 % intervals" if 2 in shown else ""
        said += ["", f"under {controller}{less}:"]
        for row in table:
            texts = [row[k].rjust(widths[k]) if k else row[k].ljust(widths[k]) for k in shown]
            said.append("  ".join(texts).rstrip())
    said += meanings(said, {
        "=": "= not to be told from the best",
        "°": "° knows the rail, as nobody on board can",
        "*": f"* delivers more than {MOST_OVER:.0%} beyond the plan, not ranked",
        "†": "† some runs failed and are left out",
    })  # fmt: skip
    for told in informed([one.rule for one in found]):
        said += wrap(told, 78, subsequent_indent="  ", break_on_hyphens=False)
    return said


def meanings(said: Sequence[str], marks: Mapping[str, str]) -> list[str]:
    """What those marks mean that stand in the lines of a table, after an empty line."""
    return ["", *(words for mark, words in marks.items() if any(mark in line for line in said))]


def _short(one: Interval, digits: int, scale: float = 1.0) -> str:
    return one.text(digits, scale, sign=True) if one.events and (one.value or one.high) else ""


def informed(rules: Sequence[str]) -> list[str]:
    """Which rules know what, where they differ: then a comparison is of information too."""
    groups: dict[str, list[str]] = {}
    for name in dict.fromkeys(rules):
        rule = RULES.get(name)
        if name != REFERENCE and rule:
            groups.setdefault(rule.belief.description, []).append(name)
    if len(groups) < 2:
        return []
    return [f"{', '.join(names)}: told {words}" for words, names in groups.items()]


def answer(found: Sequence[Standing]) -> str:
    """The answer, a sentence for each controller."""
    said = []
    for controller, own in by_controller(found).items():
        tied = [one for one in own if one.tied]
        if len(own) < 2 or not tied or not tied[0].gain.events:
            continue
        bound = next((one for one in own if knows_the_rail(one.rule)), None)
        names = ", ".join(one.rule for one in tied[:3])
        names += f" and {len(tied) - 3} more" if len(tied) > 3 else ""
        told = "cannot be told apart" if len(tied) > 1 else "uses most"
        ideal = (
            f"; {bound.rule}, which knows the rail, {100 * bound.gain.value:+.2f}" if bound else ""
        )
        gain = tied[0].gain.text(2, 100.0, sign=True)
        said.append(f"Under {controller}, {names} {told}: {gain} points over {REFERENCE}{ideal}.")
    if said and found[0].events < FEW:
        said.append("Intervals are over seeds of few events and say nothing of others.")
    return "\n".join(said) or f"Nothing was compared with {REFERENCE}: the table has the numbers."


def as_json(rows: pd.DataFrame) -> dict[str, Any]:
    """What a program reads: about the comparison, the metrics, and every event under every rule and controller."""
    names, found = [name for name in METRICS if name in rows], []
    for (scenario, rule, law), own in rows.groupby(["scenario", "rule", "controller"], sort=False):
        good, bad = own.loc[own["status"] == "ok", names], own[own["status"] != "ok"]
        centre, n = good.mean(), good.count()
        half = good.std() * (scipy.stats.t.ppf(0.975, (n - 1).clip(1)) / np.sqrt(n))
        known = [name for name in names if n[name]]
        numbers = dict.fromkeys(names) | {
            name: {"mean": float(centre[name]), "half_width": float(half.fillna(0.0)[name])}
            for name in known
        }
        reasons = list(dict.fromkeys(bad["reason"]))
        about = {"scenario": scenario, "rule": rule, "controller": law, "seeds": len(own)}
        found.append(about | {"failed": len(bad), "reasons": reasons, "metrics": numbers})
    metrics = {name: {"unit": METRICS[name].unit, "description": METRICS[name].description}
               for name in names}  # fmt: skip
    table = standings(rows)
    return {
        "about": {"runs": len(rows), "answer": answer(table).splitlines()},
        "metrics": metrics,
        "standings": frame(table).to_dict(orient="records"),
        "rows": found,
    }


def figure(found: Sequence[Standing]) -> "Figure":
    """Points of the bound over `alone` with intervals, rule by rule, a panel for each controller."""
    from matplotlib.figure import Figure

    laws = by_controller(found)
    height = 0.2 * len({one.rule for one in found}) + 0.9
    drawn = Figure(figsize=(min(WIDE, 2.2 * len(laws) + 1.0), height), layout="constrained")
    panels = drawn.subplots(1, len(laws), squeeze=False)[0]
    for axes, (law, own) in zip(panels, laws.items(), strict=True):
        gains = {one.rule: [one.gain.times(100.0)] for one in own if one.rule != REFERENCE}
        forest(axes, gains, RULES, 0.0)
        axes.set(title=law, xlabel=f"points over {REFERENCE}")
    return drawn
