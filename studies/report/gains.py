"""What each rule gains over `alone` in each event, by how much there is to gain, measured as in the study `headroom`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from studies.core.collection import study_folder
from studies.core.drawn_events import complete
from studies.core.store import ROWS
from studies.patent.headroom_study import BASE, BOUND, HEADROOM, gain, pairs_of, rules_of
from studies.report.replay import Replay


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
