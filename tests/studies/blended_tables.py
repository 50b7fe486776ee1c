"""A synthetic table of the sweep `blended`, on which it is known what holds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from studies.stops.blended_events import SOURCES, event_name
from studies.stops.blended_study import ARMS, NUMBERS, TRUTH, meant

Row = dict[str, Any]
GAINS = {"cut-and-ramp": 0.0, "perturb-observe": 0.02, "mpc": 0.04, "mpc-train": 0.06}
RULE_GAINS = {"alone": 0.0, "cooperative": 0.02, "exact": -0.02}


def blended_table(events: int = 24, change: Callable[[Row], Row] = lambda row: row) -> pd.DataFrame:
    """Later controllers use more, cooperative more and exact less than alone; the true speed is worth nothing."""
    noise = np.random.default_rng(5)
    rows = []
    for k in range(events):
        common = 0.8 + 0.1 * float(noise.uniform())
        for source in SOURCES:
            for arm in ARMS:
                gain = GAINS[arm.controller] + RULE_GAINS[arm.rule] + 2e-3 * float(noise.normal())
                row: Row = {"event": k, "source": source, **arm._asdict(), "status": "ok"}
                row |= dict.fromkeys(NUMBERS, 0.1) | {"bound_use": common + gain, "damage": 200.0}
                row |= {
                    "locked_driven": 0.0,
                    "reference_within": 0.97 + 5e-3 * float(noise.normal()),
                }
                if source == TRUTH:
                    row |= {"reference_within": np.nan, "reference_ratio": np.nan}
                rows.append(change(row))
    table = pd.DataFrame(rows)
    return table.merge(_drawn(events), on="event")


def _drawn(events: int) -> pd.DataFrame:
    """What is drawn for the first events of seed 0, as the study joins it."""
    rows = pd.DataFrame({"scenario": [event_name(0, k) for k in range(events)]})
    return meant(rows, 0, events).drop(columns=["scenario", "source"])
