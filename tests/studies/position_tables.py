"""Made-up tables of the sweep `line-position`: what its statements are computed from."""

import numpy as np
import pandas as pd

from studies.resistance.driven_cases import CARS, FEEDBACK, FRONT, LEARNED, RIGHT, TAUGHT
from studies.resistance.events import QUANTITIES, column
from studies.resistance.line_position_study import ALONE, KINDS, cases_of
from studies.resistance.routes import ARMS, LADDER, rung

PEAKS = {FEEDBACK: 1.0, RIGHT: 0.5, FRONT: 0.7, CARS: 0.2, LEARNED: 0.5, TAUGHT: 0.1}
"""Disturbance of every case where every claim holds."""


def position_table(
    events: int = 20, changes: dict[tuple[str, str], float] | None = None
) -> pd.DataFrame:
    """A table in which every claim holds, but for columns in `changes`, by arm and name."""
    g = np.random.default_rng(0)
    parts = []
    for arm in (*ARMS, *map(rung, LADDER)):
        columns: dict[str, object] = {
            "event": np.arange(events),
            "route": ["commuter", "high-speed"] * (events // 2),
            "control": (["P"] * 2 + ["PI"] * 2) * (events // 4),
            "position error": np.full(events, 10.0),
        }
        numbers = {
            column(quantity, kind, case): PEAKS.get(case, 0.5)
            for case in cases_of(arm)
            for kind in KINDS
            for quantity in QUANTITIES
        }
        if arm in ARMS:
            numbers |= {f"{w}@{name}": 1.02 for w in ("W1", "W3") for name in ALONE.values()}
            numbers |= {f"W3@{LEARNED}": 1.02} if LEARNED in cases_of(arm) else {}
            numbers |= {"use share": 0.8} if "learn, then use" in cases_of(arm) else {}
        for (where, name), value in (changes or {}).items():
            if where == arm:
                assert name in numbers, name
                numbers[name] = value
        drawn = {name: value * (1.0 + 0.005 * g.standard_normal(events)) for name, value in numbers.items()}  # fmt: skip
        parts.append(pd.DataFrame(columns | drawn).assign(arm=arm, status="ok"))
    return pd.concat(parts, ignore_index=True)
