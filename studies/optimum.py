"""What is left to win, and for whom: wheel damage of strategies above the least with which each event could be run.

A strategy is a rule with a readhesion controller. The least Q is that of the event at the strategy's own end speed
(`mpc.optimum`). What a strategy dissipates above it has three parts, by instants (`alloc.evaluation.least_damage`):

- split: where no axle slips more than at the peak of its curve, effort could be split among units at less damage
- beyond the peak: the same where an axle does
- timing: effort is delivered at instants at which it is dear, however well it is split

Each is the difference to the optimum, of which a little is left in every part.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.evaluation.least_damage import SAMPLED, find_best_splits
from alloc.evaluation.recorded_run import RecordedRun
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from alloc.run.event import Event
from alloc.run.simulation import simulate
from mpc.optimum import EventProblem, NoOptimum, Optimum
from studies import run_cell
from studies.files.scenario import Scenario
from studies.population import population
from studies.runner.study import WIDE, Cell, Row, Study
from studies.statistics import in_digits

Floats = NDArray[np.float64]
Pair = tuple[str, str]
"""Names of a rule and of a controller."""
ORACLE = "oracle", "none"
PARTS = {
    "split": ("split", "#0072b2"),
    "beyond": ("beyond the peak", "#d55e00"),
    "timing": ("timing", "#999999"),
}
"""Parts of what is above the least, with their names and colours."""


def choose_pairs(rules: Sequence[str] | None, controllers: Sequence[str] | None) -> list[Pair]:
    """Each rule with each controller, and last the oracle; raises `InputError` for an unknown name."""
    for name in rules or ():
        RULES.find(name)
    for name in controllers or ():
        CONTROLLERS.find(name)
    grid = [
        (rule, controller)
        for rule in rules or ("alone", "cooperative")
        for controller in controllers or ("perturb-observe", "mpc")
        if not RULES[rule].belief.knows
    ]
    return [*grid, ORACLE]


class Comparison(NamedTuple):
    """An event under strategies, and what was possible."""

    rows: list[Row]
    """Of each strategy: speeds, wheel damage and its parts; failed where no optimum was found."""
    runs: list[xr.Dataset]
    problem: EventProblem
    optima: list[Optimum | None]


def split_damage(run: RecordedRun, damage: float) -> Floats:
    """A wheel damage in three parts: what a better split saves with no axle beyond its peak, and with one; the rest."""
    best = run.compute_once(find_best_splits)
    if best is None or not best.power.sum() > 0.0:
        return damage * np.array([0.0, 0.0, 1.0])
    over = np.greater(run["slip_velocity"], run["peak_slip"])[:, run.driven]
    beyond = over.any(axis=1)[np.flatnonzero(run.demand)[:: run.instants(SAMPLED)]]
    saved = (best.power - best.least(best.force)) / best.power.sum()
    shares = saved[~beyond].sum(), saved[beyond].sum(), 1.0 - saved.sum()
    return damage * np.array(shares)


def compare_with_optimum(
    event: Event, pairs: Sequence[Pair], advance: Callable[[int], Any] = lambda runs: None
) -> Comparison:
    """Run the strategies, and find the least wheel damage at each one's end speed; `advance` is called after each.

    Raises `InputError` for an event whose optimum is not sought.
    """
    problem = EventProblem(event)
    rows, runs, optima = list[Row](), list[xr.Dataset](), list[Optimum | None]()
    for rule, controller in pairs:
        run = simulate(event, rule, controller)
        arrays, optimum = RecordedRun(run), None
        work = arrays["friction_work"][:, arrays.driven].sum(axis=1)
        damage = float(work[-1] - work[0])
        row: Row = {"rule": rule, "controller": controller, "speed": float(arrays["speed"][-1])}
        row |= {"damage": 1e-3 * damage} | run_cell.status(run)
        try:
            optimum = problem.least_damage(row["speed"])
            replay = RecordedRun(problem.replay(optimum))
            parts = split_damage(arrays, damage) - split_damage(replay, optimum.damage)
            row |= {"least": 1e-3 * optimum.damage, "residual": optimum.residual}
            row |= dict(zip(PARTS, (1e-3 * parts).tolist(), strict=True))
        except NoOptimum as error:
            row |= {"status": "failed", "reason": str(error)}
        rows.append(row)
        runs.append(run)
        optima.append(optimum)
        advance(1)
    return Comparison(rows, runs, problem, optima)


def lay_out(rows: Sequence[Row]) -> pd.DataFrame:
    """What is printed of an event."""
    names = {
        "speed": ("end speed [km/h]", 3.6),
        "damage": ("Q [kJ]", 1.0),
        "least": ("least [kJ]", 1.0),
    }
    lines = list[Row]()
    for row in rows:
        line: Row = {key: row[key] for key in ("rule", "controller")}
        line |= {
            head: f"{row[key] * scale:.2f}" for key, (head, scale) in names.items() if key in row
        }
        if "least" in row:
            percent = 100.0 / row["least"]
            line["above [%]"] = in_digits((row["damage"] - row["least"]) * percent, 1, False)
            line |= {
                f"{head} [%]": in_digits(row[key] * percent, 1, False)
                for key, (head, _) in PARTS.items()
            }
        lines.append(line)
    return pd.DataFrame(lines).fillna("–")


def draw_beside(comparison: Comparison) -> Figure:
    """Torques of units and slips of driven axles: a run, and beside it the optimum at the same end speed."""
    k = next(k for k, optimum in enumerate(comparison.optima) if optimum)
    run, optimum = comparison.runs[k], comparison.optima[k]
    assert optimum
    best = comparison.problem.replay(optimum)
    drawn = Figure(figsize=(WIDE, 3.2), layout="constrained")
    panels = drawn.subplots(2, 2, sharex=True, sharey="row")
    titles = f"{run.attrs['rule']}, {run.attrs['controller']}", "optimum at the same end speed"
    for column, shown, title in zip(panels.T, (run, best), titles, strict=True):
        time, driven = shown["time"].values, comparison.problem.driven
        column[0].plot(time, 1e-3 * shown["motor_torque"].values, linewidth=0.8)
        column[1].plot(time, shown["slip_velocity"].values[:, driven], linewidth=0.6)
        work = float(
            shown["friction_work"][-1, driven].sum() - shown["friction_work"][0, driven].sum()
        )
        column[0].set_title(f"{title}: Q = {1e-3 * work:.1f} kJ")
        column[1].set(xlabel="time [s]", xlim=time[[0, -1]])
    drawn.suptitle(f"{run.attrs['event']}: a line for each unit, and for each driven axle")
    panels[0, 0].set_ylabel("torque of a motor [kN m]")
    panels[1, 0].set_ylabel("slip of axles [m/s]")
    return drawn


# The study

STRATEGIES = (
    *[(rule, part) for rule in ("alone", "spread", "cooperative") for part in ("perturb-observe", "mpc")],
    ORACLE,
)  # fmt: skip


def cells(events: int, seed: int) -> list[Cell]:
    """The first starts of the population that the model has: rigid trains, no failure, rail that slip does not clean."""
    chosen, k = list[Cell](), -1
    while len(chosen) < events:
        k += 1
        d, scenario = population.draw(seed, k), population.event(seed, k)
        if d["case"] == "start" and not (d["coupled"] or d["conditioning"] or d["fails"]):
            parts = {name for pair in STRATEGIES for name in run_cell.sources(scenario, *pair)}
            columns = {"scenario": scenario.name, "curve": d["curve"]}
            args = scenario, STRATEGIES, k
            chosen.append(Cell(scenario.name, args, columns, tuple(sorted(parts))))
    return chosen


def run(scenario: Scenario, pairs: Sequence[Pair], k: int) -> list[Row]:
    """A row for each strategy of an event."""
    return compare_with_optimum(run_cell.event_of(scenario, k), pairs).rows


def sum_strategies(rows: pd.DataFrame) -> pd.DataFrame:
    """Wheel damage of all events in which an optimum was found for all strategies, and its parts [kJ], by strategy."""
    good = run_cell.complete(rows)
    strategy = (
        good["rule"] + ", " + good["controller"].where(good["rule"] != "oracle", "knows the rail")
    )
    groups = good.assign(above=good["damage"] / good["least"] - 1.0).groupby(strategy, sort=False)
    total = groups[["damage", "least", *PARTS]].sum()
    return total.assign(events=groups.size(), median=groups["above"].median())


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Of each strategy Q per event, what is above the least of all events together, its parts, and of the median event."""
    total = sum_strategies(rows)
    lines = {"strategy": total.index, "events": total["events"]}
    lines["Q [kJ]"] = [f"{value:.1f}" for value in total["damage"] / total["events"]]
    percent = 100.0 / total["least"]
    above = {"above the least [%]": total["damage"] - total["least"]}
    above |= {f"{name} [%]": total[part] for part, (name, _) in PARTS.items()}
    lines |= {
        name: [in_digits(value, 1, False) for value in part * percent]
        for name, part in above.items()
    }
    lines["median event [%]"] = [f"{100.0 * value:.1f}" for value in total["median"]]
    return pd.DataFrame(lines).reset_index(drop=True)


def figure(rows: pd.DataFrame) -> Figure:
    """Parts of what each strategy dissipates above the least."""
    total = sum_strategies(rows)[::-1]
    drawn = Figure(figsize=(WIDE, 2.4), layout="constrained")
    axes, left = drawn.subplots(), np.zeros(len(total))
    for part, (name, colour) in PARTS.items():
        share = (100.0 * total[part] / total["least"]).to_numpy()
        axes.barh(total.index, share, left=left, color=colour, label=name)
        left = left + share
    axes.set_xlabel("wheel damage above the least [% of the least]")
    axes.legend()
    return drawn


QUESTION = "How much wheel damage is left to win at the same end speed, and for whom?"
STUDY = Study("optimum", QUESTION, cells, run, table, figure, events=40, seed=population.SEED)
