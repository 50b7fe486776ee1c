"""The answer that a page begins with: how each rule stands against `alone` over all events, and in which it is better.

Rules are ranked by effort within the bound, `EFFORT`. Who delivers more than the plan is marked, and not named the best.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from alloc.metrics import METRICS
from alloc.rules import RULES
from studies.comparison.summary import (
    EFFORT,
    MOST_OVER,
    NO_MEAN,
    REFERENCE,
    RULE_CALL_TIME,
    SummaryLine,
    plus_minus,
)
from studies.comparison.table import COLUMNS, Column, applies, tells
from studies.core.drawn_events import complete
from studies.core.statement import LEAST_SHOWN, Interval, mean_interval
from studies.core.store import ROWS
from studies.core.study import study_folder
from studies.patent.headroom_study import (
    BASE,
    BOUND,
    HEADROOM,
    WORTH_SHARING,
    gain,
    pairs_of,
    rules_of,
)
from studies.report.replay import Replay

COSTS = ("slip_time", "damage", "jerk_rms")
"""What it may cost."""
EQUAL = 1e-9
"""Difference that rounding alone makes."""


@dataclass(frozen=True)
class Standing:
    """A rule under a controller less `REFERENCE` under the same one, over all events in which both have runs that count."""

    rule: str
    controller: str
    events: int
    differences: dict[str, Interval]
    """`EFFORT` and each of `COSTS`: mean over the events of the difference, and how much events differ; nan where no event
    has it."""
    over: float
    """Mean over the events of what it delivers beyond the plan, as a share of the plan."""
    better: int
    worse: int
    """Events in which the effort is more, or less, with an interval that excludes zero, or in which nothing is drawn."""
    equal: int
    """Events in which it is the same."""
    undecided: int
    """Events whose interval includes zero, or with one seed where several could be drawn."""
    idea: bool
    """Whether the rule knows what nobody on board can know."""

    @property
    def gain(self) -> float:
        """Mean over the events of the difference in `EFFORT`."""
        return self.differences[EFFORT].value

    @property
    def ranked(self) -> bool:
        """Whether it may be named the best: a train can carry it out, and it delivers what was asked for."""
        return not self.idea and not self.over > MOST_OVER


def sign_of(line: SummaryLine, metric: str, fixed: Collection[str]) -> int | None:
    """Whether a metric differs from `REFERENCE`: -1, 0 (the same) or 1; None where it is not decided.

    `fixed`: scenarios in which nothing is drawn, so that one run says all.
    """
    mean = line.differences.get(metric)
    if mean is None or mean.count == 0:
        return None
    way = 0 if abs(mean.value) <= EQUAL else int(math.copysign(1, mean.value))
    if line.scenario in fixed:
        return way
    if mean.low >= -EQUAL and mean.high <= EQUAL:
        return 0
    return way if mean.low > 0.0 or mean.high < 0.0 else None


def standings(lines: Sequence[SummaryLine], fixed: Collection[str]) -> list[Standing]:
    """Every rule but `REFERENCE` under every controller; per controller the one that gains most comes first."""
    groups: dict[tuple[str, str], list[SummaryLine]] = {}
    for line in lines:
        if line.rule != REFERENCE and EFFORT in line.differences:
            groups.setdefault((line.controller, line.rule), []).append(line)
    controllers = list(dict.fromkeys(line.controller for line in lines))
    found = [_standing(some, fixed) for some in groups.values()]
    found = [one for one in found if not math.isnan(one.gain)]
    return sorted(found, key=lambda one: (controllers.index(one.controller), -one.gain))


def _standing(lines: Sequence[SummaryLine], fixed: Collection[str]) -> Standing:
    signs = [sign_of(line, EFFORT, fixed) for line in lines]
    rule = lines[0].rule
    return Standing(
        rule, lines[0].controller, sum(line.differences[EFFORT].count > 0 for line in lines),
        {name: _over_events(lines, name) for name in (EFFORT, *COSTS)}, _known_mean([line.over for line in lines]),
        signs.count(1), signs.count(-1), signs.count(0), signs.count(None),
        rule in RULES and RULES[rule].needs_truth,
    )  # fmt: skip


def _over_events(lines: Sequence[SummaryLine], metric: str) -> Interval:
    """Mean over events of a metric's difference with its interval."""
    values = [one.differences[metric].value for one in lines if metric in one.differences]
    return mean_interval(pd.Series(values, dtype=float))


def told_interval(found: Interval, factor: float, digits: int) -> str:
    """The interval in brackets, as text; empty of fewer than `LEAST_SHOWN` events."""
    if found.count < LEAST_SHOWN:
        return ""
    return "[{}, {}]".format(*(signed(factor * end, digits) for end in (found.low, found.high)))


def signed(value: float, digits: int) -> str:
    """With its sign, a true minus, and none where it rounds to zero."""
    if math.isnan(value):
        return "–"
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "\N{MINUS SIGN}")


class Forest(NamedTuple):
    """A picture of the gains, each with its interval: all on one scale, so that rows can be compared."""

    width: float
    zero: float
    """Place of no difference [px]."""
    low: float
    """Gain at the left end [points of the bound]."""
    high: float
    """Gain at the right end [points of the bound]."""
    rows: list[tuple[float, float, float]]
    """Places of the mean and of both ends of its interval [px]; without an interval all are the mean's."""


FOREST_WIDTH, FOREST_EDGE = 150.0, 8.0
"""Width of the picture and room at its ends [px]."""


def forest(found: Sequence[Standing]) -> Forest:
    """The picture of the gains of `found`, in their order."""
    ends = []
    for one in found:
        mean = one.differences[EFFORT]
        shown = mean.count >= LEAST_SHOWN
        ends.append((mean.value, *((mean.low, mean.high) if shown else (mean.value, mean.value))))
    values = 100.0 * np.array(ends or [(0.0, 0.0, 0.0)])
    low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
    span = (high - low) or 1.0
    places = FOREST_EDGE + (FOREST_WIDTH - 2.0 * FOREST_EDGE) * (values - low) / span
    zero = FOREST_EDGE + (FOREST_WIDTH - 2.0 * FOREST_EDGE) * -low / span
    rows = [(round(m, 1), round(a, 1), round(b, 1)) for m, a, b in places.tolist()]
    return Forest(FOREST_WIDTH, round(zero, 1), low, high, rows if ends else [])


def _known_mean(values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return fmean(known) if known else math.nan


def sentences(lines: Sequence[SummaryLine], found: Sequence[Standing]) -> list[str]:
    """The answer in a few sentences, the most important first."""
    best: dict[str, Standing] = {}
    for one in found:
        if one.ranked:
            best.setdefault(one.controller, one)
    bounds = {one.controller: one for one in found if one.idea and one.rule == BOUND}
    doubts = _doubts(found, bounds)
    if best:
        own = [_at_what_price(one, bounds.get(one.controller)) for one in best.values()]
        return [
            _headline(list(best.values())),
            *_room(lines, next(iter(best.values()))),
            *own,
            *doubts,
            *_controllers(lines),
        ]
    if all(line.rule != REFERENCE for line in lines):
        return [f"Rule {REFERENCE!r} is not among the rules, so no rule can be compared with it."]
    return [*doubts, *_controllers(lines)] or [
        "There is nothing to compare: one rule under one controller."
    ]


def _headline(best: Sequence[Standing]) -> str:
    """Which rule gains most, under which controller."""
    gaining = [one for one in best if one.gain > EQUAL]
    idle = ", ".join(one.controller for one in best if one not in gaining)
    parts = []
    for rule in dict.fromkeys(one.rule for one in gaining):
        own = [
            f"{100 * one.gain:+.2f} under {one.controller}" for one in gaining if one.rule == rule
        ]
        parts.append(f"{rule} gains most ({', '.join(own)})")
    text = ""
    if parts:
        text = (
            f"Of the rules that a train can carry out, {'; '.join(parts)}: points of the bound used more than "
            f"{REFERENCE}, on the mean over the events. "
        )
    if idle:
        text += f"Under {idle}, no such rule gains anything over {REFERENCE}."
        text = text if parts else text.replace("no such rule", "no rule that a train can carry out")
    return text.strip()


def _doubts(found: Sequence[Standing], bounds: Mapping[str, Standing]) -> list[str]:
    """Which rules deliver too much to be ranked, and which use more of the bound than the rule that knows the rail."""
    said = []
    if over := [one for one in found if not one.idea and one.over > MOST_OVER]:
        told = ", ".join(
            f"{one.rule} under {one.controller} ({100 * one.over:.1f} %)" for one in over
        )
        said.append(
            f"Not ranked, since on the mean more than {100 * MOST_OVER:g} % is delivered beyond the plan: {told}."
        )
    for one in found:
        bound = bounds.get(one.controller)
        if bound is not None and not one.idea and one.gain > bound.gain + EQUAL:
            said.append(
                f"Warning: under {one.controller}, {one.rule} uses more of the bound than {bound.rule} "
                f"({100 * one.gain:+.2f} against {100 * bound.gain:+.2f} points). {bound.rule.capitalize()} knows the "
                "rail and asks for the plan alone, so where torque follows at once no way of sharing does better. Either "
                "the rule asks for more than the plan and has torque in hand when the rail recovers (delivered beyond the "
                f"plan: {100 * one.over:.1f} %), or lags of motors and brakes hold {bound.rule} up, or the bound is wrong."
            )
    return said


def _at_what_price(best: Standing, bound: Standing | None) -> str:
    events = "1 event" if best.events == 1 else f"{best.events} events"
    if best.better + best.worse + best.equal:
        text = f"Under {best.controller}, of {events}, {best.rule} uses more in {best.better} and less in {best.worse}"
        text += f"; {best.undecided} undecided." if best.undecided else "."
    else:
        text = f"Under {best.controller}, of {events}, none is decided."
    slip, damage, jerk = (best.differences[name].value for name in COSTS)
    if not math.isnan(slip + damage):
        text += f" Slip changes by {_signed(slip)} axle s and wheel damage by {_signed(damage)} kJ per event"
        text += "" if math.isnan(jerk) else f", jerk by {jerk + 0.0:+.2f} m/s³"
        text += (
            "."
            if math.isnan(best.over)
            else f"; {100 * best.over:.2f} % is delivered beyond the plan."
        )
    if bound is not None:
        text += f" {bound.rule.capitalize()}, which knows the rail, gains {100 * bound.gain:+.2f} points."
    return text


def _signed(value: float) -> str:
    """With sign and one decimal; what rounds to zero has no minus."""
    return f"{round(value, 1) + 0.0:+.1f}"


def _room(lines: Sequence[SummaryLine], best: Standing) -> list[str]:
    """In how many events there is something to share, and what the best rule gains there and elsewhere."""
    room: dict[str, float] = {}
    for rule in (
        REFERENCE,
        BOUND,
    ):  # where the rule that knows the rail was run, the train is where it could be
        for line in lines:
            if (line.rule, line.controller) == (rule, best.controller) and line.metrics[
                "headroom"
            ].count:
                room[line.scenario] = line.metrics["headroom"].value
    gains: dict[bool, list[float]] = {True: [], False: []}
    for line in lines:
        mean = line.differences.get(EFFORT)
        mine = (line.rule, line.controller) == (best.rule, best.controller)
        if mine and mean is not None and mean.count and line.scenario in room:
            gains[room[line.scenario] > WORTH_SHARING].append(mean.value)
    above, below = gains[True], gains[False]
    if not above + below:
        return []
    text = (
        f"Only sharing can use headroom. Under {best.controller} it exceeds {100 * WORTH_SHARING:g} % of the plan in "
        f"{len(above)} of {len(above) + len(below)} events"
    )
    parts = [(above, "there"), (below, "elsewhere")]
    told = [f"{100 * fmean(some):+.2f} points {where}" for some, where in parts if some]
    return [f"{text}; {best.rule} gains {', '.join(told)}."]


def _controllers(lines: Sequence[SummaryLine]) -> list[str]:
    """What the controllers reach under the reference rule, over the events that all of them have run."""
    own = [line for line in lines if line.rule == REFERENCE and line.metrics[EFFORT].count > 0]
    reached: dict[str, dict[str, float]] = {}
    for line in own:
        reached.setdefault(line.controller, {})[line.scenario] = line.metrics[EFFORT].value
    common = set.intersection(*map(set, reached.values())) if reached else set()
    if len(reached) < 2 or not common:
        return []
    parts = [
        f"{100 * fmean(values[name] for name in sorted(common)):.1f} % under {controller}"
        for controller, values in reached.items()
    ]
    return [f"For scale: {REFERENCE} uses {', '.join(parts)} of the bound."]


# What each rule gains over `alone` in each event, by how much there is to gain, measured as in the study `headroom`.


@dataclass(frozen=True)
class Gain:
    """A rule in an event; shares of the plan, effort counting up to the plan at most."""

    scenario: str
    rule: str
    controller: str
    headroom: float
    """What only sharing can reach, read under the rule `oracle` if it was run, else under `alone`."""
    gain: float
    """Delivered more than under `alone`."""
    drawn: bool = False
    """Whether it is a random event of the stored study."""


def gains_of(table: pd.DataFrame, replays: Sequence[Replay]) -> list[Gain]:
    """Gains in the replayed events, from the runs and, for headroom, from the rows of the same seed."""
    use = {one.label: one.plan_use for one in replays if one.status == "ok"}
    good = table[table["status"] == "ok"]
    keys = zip(good["scenario"], good["controller"], good["seed"], good["rule"], good["headroom"], strict=True)  # fmt: skip
    room: dict[tuple[str, str, int], dict[str, float]] = {}
    for scenario, controller, seed, rule, value in keys:
        room.setdefault((scenario, controller, seed), {})[rule] = float(value)
    found = []
    for (scenario, controller, seed), by_rule in room.items():
        base = use.get(f"{scenario}/{BASE}/{controller}/{seed}", math.nan)
        there = by_rule.get(BOUND, by_rule.get(BASE, math.nan))
        for rule in by_rule:
            own = use.get(f"{scenario}/{rule}/{controller}/{seed}", math.nan)
            if rule != BASE and math.isfinite(own - base) and math.isfinite(there):
                found.append(Gain(scenario, rule, controller, there, own - base))
    return found


def drawn_gains(results: Path, rules: Sequence[str], controllers: Sequence[str]) -> list[Gain]:
    """Gains in the random events of the study `headroom` that `results` holds under the present code; nothing is run."""
    folder = study_folder(results, HEADROOM.name)
    if not (folder / ROWS).is_dir():
        return []
    held = HEADROOM.held(folder)
    if not held:
        return []
    table = complete(HEADROOM.run(folder, held))
    found = []
    for controller in [one for one in controllers if (table["controller"] == one).any()]:
        events = pairs_of(table, controller)
        for rule in [one for one in rules_of(events) if one in rules and one != BASE]:
            pairs = zip(events.index, events["headroom"], gain(events, rule), strict=True)
            found += [Gain(str(k), rule, controller, float(x), float(y), True) for k, x, y in pairs]
    return found


def as_values(gains: Sequence[Gain]) -> list[Mapping[str, Any]]:
    """The same as plain values, rounded to a thousandth of a per cent."""
    return [
        asdict(one) | {"headroom": round(one.headroom, 5), "gain": round(one.gain, 5)}
        for one in gains
    ]


# The table of a comparison as a page shows it: a row per event, rule and controller, with values and differences.

ALWAYS = 1
"""Columns that a narrow terminal does without sooner than this are shown on demand."""
WAYS = {1: "more is better", -1: "less is better", 0: ""}


@dataclass(frozen=True)
class Heading:
    """A column as its reader sees it."""

    metric: str
    text: str
    """With line breaks where it may have them."""
    unit: str
    """Of the metric itself; the heading names the one it is shown in."""
    meaning: str
    better: str
    extra: bool
    """Shown on demand."""


@dataclass(frozen=True)
class TableCell:
    """A mean over seeds, as number in the metric's unit and as text in the heading's."""

    number: float | None
    text: str
    tint: str = ""
    """Of a difference whose interval excludes zero: "better", "worse" or, where neither is, "other"."""


@dataclass(frozen=True)
class TableRow:
    """A line of the comparison."""

    line: SummaryLine
    status: str
    """What became of runs that do not count; empty where all count."""
    values: tuple[TableCell, ...]
    differences: tuple[TableCell, ...]


NO_CELL = TableCell(None, "–")


def shown_columns(lines: Sequence[SummaryLine]) -> list[Column]:
    """Columns that apply to any line."""
    return [column for column in COLUMNS if any(tells(line, column) for line in lines)]


def headings(columns: Sequence[Column]) -> list[Heading]:
    """What stands above the columns."""
    return [_heading(column) for column in columns]


def _heading(column: Column) -> Heading:
    text = column.heading.replace("-\n", "")
    extra = column.spare > ALWAYS
    if column.metric == RULE_CALL_TIME:
        return Heading(column.metric, text, "ms", "mean time of a call of the rule", "", extra)
    found = METRICS[column.metric]
    unit = "" if found.unit == "1" else found.unit
    return Heading(column.metric, text, unit, found.description, WAYS[found.better], extra)


def table_rows(lines: Sequence[SummaryLine], columns: Sequence[Column]) -> list[TableRow]:
    """The rows, in the order of `lines`."""
    return [
        TableRow(
            line, status_of(line),
            tuple(_value(line, column) for column in columns),
            tuple(_difference(line, column) for column in columns),
        )
        for line in lines
    ]  # fmt: skip


def status_of(line: SummaryLine) -> str:
    """What became of a line's runs, in words; empty where all count."""
    counts = ((line.failed, "failed"), (line.degraded, "degraded"))
    return ", ".join(f"{count} of {line.seeds} {word}" for count, word in counts if count)


def _value(line: SummaryLine, column: Column) -> TableCell:
    if not applies(line, column):
        return NO_CELL
    mean = line.metrics[column.metric]
    text = f"{round(column.factor * mean.value, column.digits) + 0.0:.{column.digits}f}"
    return TableCell(mean.value, text + plus_minus(mean, column.factor, column.digits))


def _difference(line: SummaryLine, column: Column) -> TableCell:
    mean = line.differences.get(column.metric, NO_MEAN)
    if mean.count == 0 or not math.isfinite(mean.value):
        return NO_CELL
    digits = column.digits + (column.factor != 1.0)  # points of a per cent are worth a digit more
    text = f"{round(column.factor * mean.value, digits) + 0.0:+.{digits}f}"  # no minus zero
    text += plus_minus(mean, column.factor, digits)
    return TableCell(mean.value, text, _tint(column.metric, mean))


def _tint(metric: str, mean: Interval) -> str:
    if not (mean.low > 0.0 or mean.high < 0.0):
        return ""
    way = METRICS[metric].better * math.copysign(1, mean.value)
    return {1: "better", -1: "worse"}.get(int(way), "other")
