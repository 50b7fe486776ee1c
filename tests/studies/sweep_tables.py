"""Synthetic tables of the sweeps `claims` and `differences`, on which it is known what holds."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from studies.core.drawn_events import COMPARED
from studies.patent.claim_events import EXCESS_EDGES, drawn_table, excess_column
from studies.patent.claims_study import LAYERS, RULES
from studies.patent.differences_study import RULES as DIFFERENCE_RULES

Row = dict[str, Any]
Change = Callable[[Row], Row]

WITHIN, OUT = {"reach_low": 1.03, "reach_high": 1.2}, {"reach_low": 0.8, "reach_high": 0.9}
EFFORT = {"alone": 0.96, "preset": 0.97, "sharing": 0.97, "oracle": 1.0}
JERK = {"sharing": 0.30}
SLIP = {"oracle": 0.0, "exact": 3.0} | dict.fromkeys(LAYERS, 3.0)


def claim_table(events: int = 120, change: Change = lambda row: row) -> pd.DataFrame:
    """A table on which all claims hold: odd events in case A, even ones within reach. `change` alters each row."""
    noise = np.random.default_rng(7)
    rows = []
    for k, drawn in enumerate(drawn_table(0, events).to_dict("records")):
        common = float(noise.normal())
        for controller, rule in product(COMPARED, RULES):
            own = 0.002 * float(noise.normal())
            reach = WITHIN if k % 2 == 0 else OUT
            scale = 1.0 if k % 2 == 0 else 0.85
            row = {
                "rule": rule,
                "controller": controller,
                "status": "ok",
                "seed": k,
                **reach,
                "front_low": reach["reach_low"] - 0.1,
                "held_effort": scale * EFFORT.get(rule, 1.002) + own,
                "unit_use_low": (0.85 if rule == "alone" else 0.94) + own,
                "unit_use_mean": 0.96 + own,
                "over_share": 0.5,
                "over_time": 5.0,
                "use_over": 0.95 + 0.01 * common + own,
                **{excess_column(j): 0.95 + own for j in range(len(EXCESS_EDGES) - 1)},
                "jerk_rms": JERK.get(rule, 0.2) + 0.02 * common + own,
                "jerk_peak": (2.5 if rule == "sharing" else 2.0) + own,
                "limit_travel": 5.0 if rule == "sharing" else 0.2,
                "slip_time": SLIP.get(rule, 6.0) + own,
                "damage": 100.0 + common,
                "unit_detections": 3.0,
            }
            rows.append(change(row | {str(name): value for name, value in drawn.items()}))
    return pd.DataFrame(rows)


def difference_table(kind: str = "plain", n: int = 200, **values: Any) -> pd.DataFrame:
    """A table of problems of one kind and three events, in which all rules agree but for `values` of `rule` (greedy)."""
    rule = values.pop("rule", "greedy")
    problem = {
        "part": "problem", "kind": kind, "status": "ok", "case": "B", "within_reach": True, "effort": 1.0,
        "short": 0.0, "over": 0.0, "beyond": 0.0, "apart": 0.0, "unmet": False,
    }  # fmt: skip
    event = {"part": "event", "kind": kind, "status": "ok"}
    numbers = {"held_effort": 1.0, "damage": 100.0, "jerk_rms": 0.2, "slip_time": 3.0}
    rows = [
        problem | {"index": k, "rule": one} | (values if one == rule else {})
        for k in range(n)
        for one in DIFFERENCE_RULES
    ]
    rows += [
        event | {"index": k, "rule": one} | {name: v + 0.01 * k for name, v in numbers.items()}
        for k in range(3)
        for one in DIFFERENCE_RULES
    ]
    return pd.DataFrame(rows)
