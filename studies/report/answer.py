"""The answer that a page begins with: how each rule stands against `alone` over all events, and in which it is better."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from statistics import fmean

from alloc.rules import RULES
from studies.comparison.summary import REFERENCE, SummaryLine
from studies.patent.headroom_study import BOUND, WORTH_SHARING

GAIN = "effort_ratio"
"""What a rule is for: effort over plan."""
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
    gain: float
    """Mean over the events of the difference in effort over plan."""
    costs: dict[str, float]
    """The same of each of `COSTS`; nan where no event has it."""
    better: int
    worse: int
    """Events in which the effort is more, or less, with an interval that excludes zero, or in which nothing is drawn."""
    equal: int
    """Events in which it is the same."""
    undecided: int
    """Events whose interval includes zero, or with one seed where several could be drawn."""
    idea: bool
    """Whether the rule knows what nobody on board can know."""


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
        if line.rule != REFERENCE and GAIN in line.differences:
            groups.setdefault((line.controller, line.rule), []).append(line)
    controllers = list(dict.fromkeys(line.controller for line in lines))
    found = [_standing(some, fixed) for some in groups.values()]
    found = [one for one in found if not math.isnan(one.gain)]
    return sorted(found, key=lambda one: (controllers.index(one.controller), -one.gain))


def _standing(lines: Sequence[SummaryLine], fixed: Collection[str]) -> Standing:
    signs = [sign_of(line, GAIN, fixed) for line in lines]
    rule = lines[0].rule
    return Standing(
        rule, lines[0].controller, sum(line.differences[GAIN].count > 0 for line in lines),
        _mean(lines, GAIN), {name: _mean(lines, name) for name in COSTS},
        signs.count(1), signs.count(-1), signs.count(0), signs.count(None),
        rule in RULES and RULES[rule].needs_truth,
    )  # fmt: skip


def _mean(lines: Sequence[SummaryLine], metric: str) -> float:
    """Mean over events of a metric's difference."""
    values = [line.differences[metric].value for line in lines if metric in line.differences]
    known = [value for value in values if not math.isnan(value)]
    return fmean(known) if known else math.nan


def sentences(lines: Sequence[SummaryLine], found: Sequence[Standing]) -> list[str]:
    """The answer in a few sentences, the most important first."""
    best: dict[str, Standing] = {}
    for one in found:
        if not one.idea:
            best.setdefault(one.controller, one)
    if best:
        bounds = {one.controller: one for one in found if one.idea and one.rule == BOUND}
        own = [_at_what_price(one, bounds.get(one.controller)) for one in best.values()]
        return [
            _headline(list(best.values())),
            *_room(lines, next(iter(best.values()))),
            *own,
            *_controllers(lines),
        ]
    if all(line.rule != REFERENCE for line in lines):
        return [f"Rule {REFERENCE!r} is not among the rules, so no rule can be compared with it."]
    return _controllers(lines) or ["There is nothing to compare: one rule under one controller."]


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
            f"Of the rules that a train can carry out, {'; '.join(parts)}: points of the planned effort more than "
            f"{REFERENCE}, on the mean over the events. "
        )
    if idle:
        text += f"Under {idle}, no such rule gains anything over {REFERENCE}."
        text = text if parts else text.replace("no such rule", "no rule that a train can carry out")
    return text.strip()


def _at_what_price(best: Standing, bound: Standing | None) -> str:
    events = "1 event" if best.events == 1 else f"{best.events} events"
    if best.better + best.worse + best.equal:
        text = f"Under {best.controller}, of {events}, {best.rule} delivers more in {best.better} and less in {best.worse}"
        text += f"; {best.undecided} undecided." if best.undecided else "."
    else:
        text = f"Under {best.controller}, of {events}, none is decided."
    slip, damage = best.costs["slip_time"], best.costs["damage"]
    if not math.isnan(slip + damage):
        text += f" Slip changes by {_signed(slip)} axle s and wheel damage by {_signed(damage)} kJ per event."
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
        mean = line.differences.get(GAIN)
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
    own = [line for line in lines if line.rule == REFERENCE and line.metrics[GAIN].count > 0]
    reached: dict[str, dict[str, float]] = {}
    for line in own:
        reached.setdefault(line.controller, {})[line.scenario] = line.metrics[GAIN].value
    common = set.intersection(*map(set, reached.values())) if reached else set()
    if len(reached) < 2 or not common:
        return []
    parts = [
        f"{100 * fmean(values[name] for name in sorted(common)):.1f} % under {controller}"
        for controller, values in reached.items()
    ]
    return [f"For scale: {REFERENCE} delivers {', '.join(parts)} of the planned effort."]
