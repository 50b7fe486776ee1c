"""The place of a new rule or controller among the stored ones of the benchmark, and why it loses where it loses most.

The new part is run on the same events. Then the three events in which it loses most to its reference are run once more, with
both: `CAUSES` are compared.
"""

import shlex
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from alloc.evaluation.recorded_run import SLIP_FACTOR, RecordedRun, record_period
from alloc.onboard.beliefs import BELIEFS
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from alloc.schema.registry import OWN
from studies import PartFailed, StudyError, standing
from studies.benchmark import (
    BASE,
    SEARCH,
    STUDY,
    UNDER,
    Runs,
    find_gain,
    find_strata,
    make_cell,
    read_stored,
    split_runs,
)
from studies.files.scenario_files import load_scenario
from studies.population import population
from studies.run_cell import recorded
from studies.runner.plugins import load_plugins, loaded_files, slow, try_own_parts
from studies.runner.study import WIDE, Cell, Row, Study, count_missing, forecast_runs, run_study
from studies.runner.workers import count_cores
from studies.standing import DISTRIBUTION, EFFORT, GAIN
from studies.statistics import Interval, draw_forest, in_digits, mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Pair = tuple[str, str]
"""A rule and a controller."""
WORST = 3
"""Events that are named."""
STANDS_OUT = 0.05
"""Share of the time by which a cause is more than under the reference, from which on it is named."""
BESIDE = 0.01
"""Share of the plan by which a limit differs from it."""
MOST_FAILED = 0.05
"""Share of events beyond which a part that failed in them has no place."""
LONG = 10.0
"""Seconds of work that are announced before it begins."""


# its place


def compared_parts(rule: str, controller: str) -> tuple[str, str]:
    """Which part of a pair is ranked, a controller where units act alone, and its reference."""
    return (controller, SEARCH) if rule == BASE else (rule, BASE)


def _join_runs(rows: pd.DataFrame, new_rows: pd.DataFrame, pair: Pair) -> Runs:
    """The runs of a new pair, by the name of its part, beside the stored ones over the same events.

    Raises `PartFailed` where it failed in too many of them.
    """
    (name, reference), (rule, controller) = compared_parts(*pair), pair
    worked = new_rows["status"] == "ok"
    if (~worked).mean() > MOST_FAILED:
        lost = f"{(~worked).sum()} of {len(new_rows)} events failed in rank-{rule}-{controller}"
        first = new_rows[~worked].iloc[0]
        advice = f"a part has a place if at most {MOST_FAILED:.0%} fail"
        raise PartFailed(f"{lost}, first {first['scenario']}: {first['reason']}; {advice}")
    good = new_rows[worked].set_index("scenario")
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


# why it loses

CAUSES = {
    "held": "limits below the plan and what the rail gives in {} of the time",
    "asked": "the level above what the rail gives, with slip, in {} of the time",
    "late": "telegrams late: limits that are no longer meant do harm in {} of the time",
    "slip": "a slip that was not readhered for {}",
    "slips": "wheels slip in {} of the time",
    "spared": "{} of the torque held back where no wheel slips",
}
"""What may make a part lose, and its words."""


def measure_causes(run: xr.Dataset) -> dict[str, float]:
    """Share of the time under demand, over all units that work, in which each of `CAUSES` acts; of a slip the longest,
    of torque that is held back its share.

    A limit is late where the one that the leader has ordered since would do none of the harm that is done.
    """
    arrays = RecordedRun(run)
    unit, limit, plan = arrays.unit, arrays["limit"], arrays["plan"][:, None]
    slipping = np.abs(arrays["slip_velocity"]) > SLIP_FACTOR * arrays["peak_slip"]

    inside = [unit == j for j in range(limit.shape[1])]
    rail = np.column_stack([arrays["adhesion_limit"][:, j].min(axis=1) for j in inside])
    slips = np.column_stack([slipping[:, j].any(axis=1) for j in inside])
    ordered = np.where(np.isinf(arrays["wanted"]), plan, arrays["wanted"])
    motors = arrays.motors / arrays["unit_static_load"]
    within, beyond = (1.0 - BESIDE) * np.minimum(plan, motors), (1.0 + BESIDE) * plan
    held, still_held = (x < np.minimum(within, rail) for x in (limit, ordered))
    forced, still_forced = (slips & (x > np.maximum(beyond, rail)) for x in (limit, ordered))
    ordered_harm = still_held | still_forced
    torque, target = arrays["torque_command"], np.maximum(arrays["torque_target"], 1.0)
    spared = ~slips * np.clip(1.0 - torque / target, 0.0, 1.0)
    counts = arrays.demand[:, None] & (arrays["works"] > 0)
    causes = {"held": held & ordered_harm, "asked": forced & ordered_harm, "slips": slips}
    causes |= {"late": (held | forced) & ~ordered_harm, "spared": spared}
    shares = {name: float(acts.mean(where=counts)) for name, acts in causes.items()}
    streak, longest = np.zeros(unit.size), 0.0
    for slips_now in slipping[arrays.demand]:
        streak = (streak + 1.0) * slips_now
        longest = max(longest, streak.max())
    return shares | {"slip": longest / max(arrays.demand.sum(), 1)}


def find_cause(event: str, pair: Pair) -> str:
    """The one of `CAUSES` that a pair has most more of than its reference in an event of the benchmark, in words."""
    scenario, (_, reference) = load_scenario(event), compared_parts(*pair)
    base = (BASE, reference) if pair[0] == BASE else (reference, pair[1])
    with redirect_stdout(sys.stderr):  # where a part prints
        run, other_run = (recorded(scenario, *parts, scenario.first_seed) for parts in (pair, base))
    shares, base_shares = measure_causes(run), measure_causes(other_run)
    cause = max(CAUSES, key=lambda name: shares[name] - base_shares[name])
    if shares[cause] - base_shares[cause] < STANDS_OUT:
        return "no single cause stands out"
    scale, unit, digits = 100.0, "%", 0
    if cause == "slip":
        scale, unit, digits = (
            float(run["driver_command"].astype(bool).sum()) * record_period(run),
            "s",
            1,
        )
    more, usual = (f"{scale * x[cause]:.{digits}f} {unit}" for x in (shares, base_shares))
    text = CAUSES[cause].format(more)
    return text if base_shares[cause] < 0.5 * BESIDE else f"{text} ({reference}: {usual})"


def replay_command(event: str, pair: Pair) -> str:
    """What makes the run of an event again and draws it: a command, or a call where parts of a program have no file."""
    (rule, controller), figure = pair, f"event-{event[-4:]}.png"
    belief = RULES[rule].belief.name
    parts = ((RULES, rule), (CONTROLLERS, controller), (BELIEFS, belief))
    origins = [registry.origin(name) for registry, name in parts if name in registry]
    modules = [sys.modules[name] for name in origins if name.split(".")[0] not in OWN]
    files = dict.fromkeys(str(getattr(module, "__file__", "")) for module in modules)
    if not {*files} <= {*loaded_files()}:
        run = f'readhesion.simulate("{event}", "{rule}", "{controller}")'
        return f'readhesion.plot({run}, "{figure}")'
    tokens, folder = ["readhesion"], Path.cwd()
    for file in map(Path, files):
        path = file.relative_to(folder) if file.is_relative_to(folder) else file
        tokens += ["--plugin", str(path)]
    tokens += ["simulate", event, "--rule", rule]
    tokens += [] if controller == SEARCH else ["--controller", controller]
    return shlex.join([*tokens, "--figure", figure])


def tabulate_worst(rows: pd.DataFrame, new_rows: pd.DataFrame, pair: Pair) -> pd.DataFrame:
    """The events in which the new part loses most to its reference: gain [points], cause, and what replays it."""
    runs, parts = _join_runs(rows, new_rows, pair), compared_parts(*pair)
    gains = find_gain(runs, *parts).nsmallest(WORST)
    lines = [
        (event, gain, find_cause(str(event), pair), replay_command(str(event), pair))
        for event, gain in gains[gains < -100.0 * standing.LITTLE].items()
    ]
    return pd.DataFrame(lines, columns=["event", "gain", "cause", "replay"])


# the whole


def rank_study(rule: str, controller: str) -> Study:
    """The runs of a pair on the population, and its place among the stored ones. Raises `StudyError`: see `read_stored`."""

    def pair_cells(events: int, seed: int) -> list[Cell]:
        if events > population.EVENTS:
            raise StudyError(f"events = {events}: rows of {population.EVENTS} are stored")
        return [make_cell(population.event(seed, k), rule, controller, k) for k in range(events)]

    rows, pair = read_stored(), (rule, controller)
    return replace(
        STUDY,
        name=f"rank-{rule}-{controller}",
        question=f"where {compared_parts(rule, controller)[0]} stands among all",
        cells=pair_cells,
        table=lambda new_rows: tabulate_places(rows, new_rows, pair),
        figure=lambda new_rows: draw_rank(
            pair, tabulate_places(rows, new_rows, pair), tabulate_gains(rows, new_rows, pair)
        ),
        statements=None,
        more_tables={
            "gains": lambda new_rows: tabulate_gains(rows, new_rows, pair),
            "worst": lambda new_rows: tabulate_worst(rows, new_rows, pair),
        },
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
    (name, reference), (places, gains, worst) = compared_parts(*pair), tables.values()
    under = "where units act alone" if pair[0] == BASE else f"under {pair[1]}"
    head, count = ("place", "", "used %", f"{name} minus it [95 %]", "median"), 0
    rows: list[tuple[str, ...]] = [head]
    for place in places.itertuples():
        count += place.mark == ""
        rank = "" if place.mark else f"{count}{'=' if place.tied else ''}"
        lead = _lead_of(place, gains)
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
    lines += ["", f"{name} minus {reference}:", *standing.align_columns(rows)]
    little = f"the interval holds 0, or less than {100 * standing.NEGLIGIBLE:g} points"
    no_place = {mark: f"{meaning}; has no place" for mark, meaning in standing.MARKS.items()}
    lines += standing.list_marks(lines, {"=": f"cannot be told from {name}: {little}", **no_place})
    whole, points = gains.iloc[0], f"{100 * standing.LITTLE:g} points"
    trimmed, gained = in_digits(whole["trimmed"], 2, True), 100.0 * whole["gained"]
    lines += [f"mean without the best and the worst tenth of events: {trimmed}"]
    lines += [f"{gained:.0f} % of events gain more than {points}; harmed: loses more than that"]
    if len(worst):
        lines += ["", f"worst events, {name} minus {reference}:"]
    for event in worst.itertuples():
        points = in_digits(event.gain, 1, True)
        command = event.replay.replace(" --rule ", " \\\n      --rule ")
        lines += [f"  {event.event}: {points} points", f"    {event.cause}"]
        lines += f"    {command}".splitlines()
    return lines


def _lead_of(place: Any, gains: pd.DataFrame) -> Interval:
    """By how much the new part is ahead of that of a row of places [points]."""
    return Interval(place.less, place.low, place.high, gains["number"].max())


def draw_rank(pair: Pair, places: pd.DataFrame, gains: pd.DataFrame) -> "Figure":
    """Forests of a rank: the new part minus every other one, and its gain over its reference by parts of the events."""
    from matplotlib.figure import Figure

    name, reference = compared_parts(*pair)
    leads = {place.name: [_lead_of(place, gains)] for place in places.itertuples()}
    parts = {
        part.events: [Interval(part.gain, part.low, part.high, part.number)]
        for part in gains.itertuples()
    }
    figure = Figure(figsize=(WIDE, 0.16 * len(places) + 0.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_forest(left, leads, CONTROLLERS if pair[0] == BASE else RULES, 0.0)
    draw_forest(right, parts, bound=0.0)
    left.set(title=f"{name} minus others", xlabel="difference of the bound used [points]")
    right.set(title=f"{name} minus {reference}, by events", xlabel="gain [points]")
    return figure


class Ranking(pd.DataFrame):
    """The places of `rank_study`, printed as the command prints them; `attrs` have "gains" and "worst" as rows."""

    def __repr__(self) -> str:
        return str(self.attrs["text"])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def plot(self, path: str | Path | None = None) -> "Figure":
        """Its forest plot (`matplotlib.figure.Figure`); with a `path` (pdf, png, svg) it is written there."""
        figure = draw_rank(self.attrs["pair"], self, pd.DataFrame(self.attrs["gains"]))
        if path is not None:
            figure.savefig(path)
        return figure


def make_ranking(pair: Pair, tables: Mapping[str, pd.DataFrame]) -> Ranking:
    """The tables of `rank_study` as one."""
    ranking, text = Ranking(tables["table"]), "\n".join(format_rank(pair, tables))
    rows = {name: tables[name].to_dict(orient="records") for name in ("gains", "worst")}
    ranking.attrs |= rows | {"pair": pair, "text": text}
    return ranking


def announce_time(pair: Pair, folder: str | Path, events: int | None, jobs: int | None) -> None:
    """Say about how long the runs of a user's part take, by the first of them, which is made and kept, where that is long.

    Of those that `try_own_parts` has announced as slow nothing is said.
    """
    if {*pair} <= {*RULES.shipped(), *CONTROLLERS.shipped(), *slow}:
        return
    study, jobs = rank_study(*pair), jobs or count_cores()
    run_study(study, folder, 1)
    _, lacking, seconds = count_missing(study, folder, events, None)
    if lacking * seconds > LONG * jobs:
        text = forecast_runs(study, folder, events, None, jobs)
        print(f"readhesion: {text}", file=sys.stderr)
