"""Synthetic tables of the sweep `brake-force`, on which it is known what holds."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from studies.brake_force.faulty_car import SHORTFALLS
from studies.brake_force.measurement import AS_PLANT, TESTS
from studies.brake_force.study import CUT_OUT

Row = dict[str, Any]

KINDS = {
    "sound": (np.nan, 0.0),
    "trailer, brake cut out": (1.0, 1.0),
    "trailer, one bogie cut out": (0.5, 1.0),
    "motor car, motors failed": (0.0, 0.0),
    "motor car, motors failed and brake cut out": (1.0, 1.0),
}
"""Kind of fault: share of the force that is truly missing, and share of stops in which it is found."""


BELIEFS = ("friction +20%", "gradient +10 per mille, by speeds")
"""Errors of the estimator in the table."""


def brake_table(
    days: int = 20, change: Callable[[Row], Row] = lambda row: row, beliefs: Sequence[str] = ()
) -> pd.DataFrame:
    """A table as the report found it; `change` alters each row; with the error budget of `beliefs`, if any."""
    draw = np.random.default_rng(3)
    rows = []
    for day in range(days):
        own = 0.01 * float(draw.standard_normal())
        for name in TESTS:
            force = 750.0 if name == "emergency" else 33.0 * CUT_OUT.get(name, 0.0)
            rows.append(
                {
                    "part": "test", "test": name, "event": day, "locomotive": 60.0 * (1.0 + own),
                    "mean": force + 30.0 * own, "whole_deviation": 2.0, "true_mean": force,
                    "smooth_ratio": 0.9,
                    "covered": 0.95, "covered_own": 0.95, "covered_smooth": 0.95,
                    "error_first": {"locomotive": 7.0, "emergency": 100.0}.get(name, 15.0) * (1.0 + own),
                    "error_own": 3.0, "error_smooth": 1.0, "mean_error_first": 2.0,
                    "mean_error_own": 0.5, "force": force,
                    "shock_ratio": 1.5 + own, "swing_early": 6.0, "swing_late": 0.3 + own,
                    "shock": 30.0, "compression": 45.0, "settled": 8.0 + own,
                    "locomotive_before": 2.2, "locomotive_after": 2.2 + own,
                    "wagons_before": 30.0, "wagons_after": 7.0, "wagons_mean_after": 30.0 * own,
                    "coupler_median": 1.0, "coupler_peak": 28.0, "spikes": 8, "spike_share": 0.1,
                    "error_in_spikes": 26.0, "error_between": 12.0,
                    "opposite_at_spikes": 0.9, "opposite_between": 0.5 + own, "coupler_opposite": 3.0, "coupler_alike": 2.0,
                    "apart_in_spikes": 0.1, "apart_between": 0.04, "error_opposite": 16.0, "error_alike": 14.0,
                    "wheel_mean": force + 30.0 * own, "wheel_over_theory": 1.0 + own, "wheel_slower": 0.01,
                    **{f"{one}_over_theory": 1.0 + own for one in ("sum", "wagon", "true_sum", "true_wagon")},
                    **{f"{one}_theory_off": 0.05 for one in ("sum", "wagon")},
                    **{f"{one}_swing": 0.1 for one in ("sum", "wagon")},
                    "theory_growth": 1.3,
                }
            )  # fmt: skip
        for kind, (true, found) in KINDS.items():
            rows.append(
                {
                    "part": "allocated", "kind": kind, "event": day, "rule_calls": 2, "true_share": true,
                    "found": found, "first": found, "wrong": 0.01, "others_short": 0.8,
                }
            )  # fmt: skip
        for kind in ("sound", "another's brake cut out"):
            rows.append(
                {
                    "part": "sliding", "kind": kind, "event": day, "sliding_accused": 0.0, "wrong": 0.01, "first": 1.0,
                    "accused_blindly": 1.0, "slides": True, "not_judged": 0.125,
                }
            )  # fmt: skip
        for missing in SHORTFALLS:
            rows.append(
                {
                    "part": "driven", "missing": missing, "event": day, "wrong": 0.01, "whole": 0.005, "threshold": 0.06,
                    "found": float(np.clip(missing / 0.08 + own, 0.0, 1.0)) if missing else 0.0,
                    "error_in_deviations": 1.0,
                }
            )  # fmt: skip
    wrong = [
        row | {"part": "budget", "belief": belief}
        for belief in beliefs
        for row in rows
        if row["part"] == "test"
    ]
    dry = [
        {
            "part": "budget dry",
            "belief": belief,
            "event": day,
            "missing": missing,
            "wrong": 0.0,
            "found": float(missing > 0.0),
        }
        for belief in ((AS_PLANT, *beliefs) if beliefs else ())
        for day in range(days)
        for missing in (0.0, 0.1)
    ]
    return pd.DataFrame([change(row) for row in (*rows, *wrong, *dry)])
