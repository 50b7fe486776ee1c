"""Synthetic tables of the sweep `learning`, on which it is known what holds."""

import numpy as np
import pandas as pd

from alloc.estimation.increments import DIRECTIONS
from studies.patent.learning_study import ARMS, KINDS


def synthetic(error, effort=None, slip=None, excess=0.0, trains=6, stations=4):
    """A table in which the error after each station is `error(arm, station)`; a little noise keeps intervals open."""
    noise = np.random.default_rng(3)
    effort, slip = effort or {}, slip or {}
    rows = []
    for kind in KINDS:
        for train in range(trains):
            for direction in DIRECTIONS:
                for arm in ARMS:
                    for station in range(1, stations + 1):
                        little = 1e-5 * float(noise.normal())
                        biased = excess if ARMS[arm].reference == "received" else 0.0
                        rows.append({
                            **kind._asdict(), "train": train, "direction": direction,
                            "arm": arm, "station": station, "error": error(arm, station) + abs(little),
                            "bias": little, "covered": 1.0, "deviation": 0.005,
                            "effort_ratio": 0.9 + effort.get(arm, 0.0) + little,
                            "slip_time": 10.0 + slip.get(arm, 0.0) + little, "damage": 50.0 + little,
                            "unit_detections": 8.0, "rear_detections": 4.0,
                            "data": 4.0, "excess": biased + little,
                        })  # fmt: skip
    return pd.DataFrame(rows)


def falling(arm, station):
    """Learners halve the error from station to station, the others keep it."""
    return 0.02 if arm in ("no learning", "truth", "truth, held") else 0.02 * 0.3**station
