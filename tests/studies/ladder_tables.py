"""Synthetic tables of the sweeps `ladder` and `curves`, on which it is known what holds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from studies.ladder import curves_study as curves
from studies.ladder.curves_study import CURVES, RULES
from studies.ladder.events import draw, event_name
from studies.ladder.ladder_study import LADDER

Row = dict[str, Any]
Change = Callable[[Row], Row]

USED = dict(zip(LADDER, (0.70, 0.80, 0.91, 0.93, 0.955, 0.965, 0.98), strict=True))
NUMBERS = {
    "search_time": 1.0, "unfinished_searches": 0.1, "torque_fluctuation": 0.04, "slip_time": 5.0, "damage": 150.0,
    "jerk_rms": 0.3, "effort_ratio": 0.9, "wrong_steps_still": 0.4, "wrong_steps_changing": 0.4,
}  # fmt: skip


def ladder_table(events: int = 60, change: Change = lambda row: row) -> pd.DataFrame:
    """Every rung uses more than the one below, and all else is alike. `change` alters each row."""
    noise = np.random.default_rng(3)
    rows = []
    for k in range(events):
        common = 0.002 * float(noise.normal())
        drawn = {name: value for name, value in draw(0, k).items() if name != "number"}
        for controller in LADDER:
            own = {name: v * (1 + 0.001 * noise.normal()) for name, v in NUMBERS.items()}
            row = {"scenario": event_name(0, k), "controller": controller, "status": "ok"}
            row |= {**own, "utilisation_short": USED[controller] + common, **drawn}
            rows.append(change(row))
    return pd.DataFrame(rows)


CURVE_NUMBERS = {"held_effort": 0.95, "utilisation": 0.9, "slip_time": 5.0, "damage": 150.0, "jerk_rms": 0.2}  # fmt: skip
GAIN = {"alone": 0.0, "greedy": 0.01, "exact": 0.02, "perturb-observe": 0.025, "mpc": 0.03}
"""What an arm delivers more than `alone`, as a share."""


def curve_table(events: int = 24, change: Change = lambda row: row) -> pd.DataFrame:
    """All metrics grow from alone over greedy, exact and perturb-observe to the MPC, alike under every curve."""
    noise = np.random.default_rng(6)
    rows = []
    for k in range(events):
        for curve in CURVES:
            arms = [(rule, "cut-and-ramp") for rule in RULES]
            arms += [(curves.SEEKING_RULE, name) for name in curves.SEEKING]
            for rule, controller in arms:
                gain = GAIN[rule if controller == "cut-and-ramp" else controller]
                gain += 0.001 * noise.normal()
                row = {"event": k, "curve": curve, "rule": rule, "controller": controller}
                row |= {name: v * (1.0 + gain) for name, v in CURVE_NUMBERS.items()}
                rows.append(change(row | {"status": "ok"}))
    return pd.DataFrame(rows)
