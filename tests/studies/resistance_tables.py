"""Made-up tables of the sweep `resistance`: what its statements are computed from."""

import numpy as np
import pandas as pd

from studies.resistance.driven_cases import (
    CARS,
    CASES,
    EXACT,
    FEEDBACK,
    FRONT,
    LEARNED,
    LEARNER_NAMES,
    WRONGLY,
)
from studies.resistance.events import ONE_CAR, QUANTITIES, column
from studies.resistance.study import MOUTH, SLOPE

PEAKS = {FEEDBACK: 1.0, WRONGLY: 0.6, CARS: 0.05, EXACT: 0.02, FRONT: 0.5}
"""Disturbance of every case as the source would have it; 0.2 of the others."""
BELIEFS = ("true loads", "sensors wrong", "mass learned", "sensors scaled to the mass learned")


def resistance_table(events: int = 20, **changes: float) -> pd.DataFrame:
    """A table in which every claim holds, but for columns in `changes` (their names with `_` for what is not a letter)."""
    g = np.random.default_rng(0)
    columns: dict[str, object] = {
        "event": np.arange(events),
        "route": ["commuter", "high-speed"] * (events // 2),
        "control": (["P"] * 2 + ["PI"] * 2) * (events // 4),
    }

    def noisy(value: float) -> np.ndarray:
        return value * (1.0 + 0.02 * g.standard_normal(events))

    for case in (*CASES, FRONT, CARS, EXACT):
        for kind in (MOUTH, SLOPE):
            for quantity in QUANTITIES:
                columns[column(quantity, kind, case)] = noisy(PEAKS.get(case, 0.2))
        columns[f"feedback_share@{case}"] = noisy(0.01 if case == EXACT else 0.3)
    for case, label in ONE_CAR.items():
        for kind in (MOUTH, SLOPE):
            columns |= {column(q, kind, label): noisy(PEAKS.get(case, 0.2)) for q in QUANTITIES}
    for weight in ("W1", "W2", "W3"):
        columns[f"{weight}@{LEARNED}"] = 1.0 + noisy(0.02)
        for name in LEARNER_NAMES:
            columns[f"{weight}@{name}, 3"] = columns[f"{weight}@{name}, 5"] = 1.0 + noisy(0.02)
    columns["equivalent W1"] = np.ones(events)
    for name in ("learned@3", "learned@5"):
        columns[name] = np.full(events, 3.0)
    columns["falsely learned@3"] = columns["falsely learned@5"] = np.zeros(events)
    for name in ("use", "use as printed"):
        columns |= {f"{name} share": noisy(0.8), f"{name} changes": noisy(2.0)}
        columns[f"{name} speed error"] = noisy(0.2)
    for name in ("three weights", "three weights, rotating mass not known", "five weights"):
        columns[f"mass@{name}"] = noisy(0.01)
    columns["mass@not learned"] = noisy(-0.25)
    for rail in ("dry", "slippery"):
        for belief in BELIEFS:
            columns[f"acceleration@{rail}@{belief}"] = noisy(1.0) * 0 + 1.0
            columns[f"slip_time@{rail}@{belief}"] = noisy(1.0)
        columns[f"acceleration@{rail}@sensors wrong"] = noisy(0.9)
        columns[f"acceleration@{rail}@mass learned"] = 1.0 + 0.001 * g.standard_normal(events)
    for name, value in changes.items():
        assert name in columns, name
        columns[name] = noisy(value)
    return pd.DataFrame(columns)
