"""The sweep `information`: starts that differ in what the rule is told and in the demand, verdicts of made-up tables."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from studies.core.statement import FAILS, HOLDS
from studies.patent.information_study import (
    CONTROLLERS,
    DEMANDS,
    INFORMATION,
    LEVELS,
    NUMBERS,
    cells,
    meant,
    pairs_of,
)


def information_table(worth: float = 0.01, starts: int = 40) -> pd.DataFrame:
    """Every level delivers `worth` of the plan more than the one before it, at every demand."""
    noise = np.random.default_rng(5)
    rows = []
    for k, (n, level), demand, controller in product(
        range(starts), enumerate(LEVELS), DEMANDS, CONTROLLERS
    ):
        use = 0.9 + worth * (n + 0.1 * noise.normal())
        values = dict.fromkeys(NUMBERS, 1.0) | {"plan_use": use, "damage": 200.0 * demand**4 - n}
        where = {"scenario": f"{k}-{n}-{demand}", "event": f"{k}", "level": level, "demand": demand}
        rows.append(where | {"controller": controller, "status": "ok", "reason": ""} | values)
    return pd.DataFrame(rows)


def test_every_step_holds_where_more_information_brings_more_and_fails_where_it_takes_some():
    for worth, verdict in ((0.01, HOLDS), (-0.01, FAILS)):
        found = INFORMATION.statements(information_table(worth))
        assert len(found) == len(CONTROLLERS) * (len(LEVELS) - 1)
        assert {one.verdict for one in found} == {verdict}


def test_effort_has_one_scale_for_all_demands():
    pairs = pairs_of(information_table(0.0, 3))
    for demand in DEMANDS:
        assert pairs[f"effort@perturb-observe/truth/{demand:g}"].mean() == pytest.approx(
            0.9 * demand
        )


def test_starts_differ_in_level_and_demand_alone_and_rows_say_them():
    jobs = cells(3, 1, 4.0)
    assert len({job.label for job in jobs}) == len(LEVELS) * len(DEMANDS) * len(CONTROLLERS)
    base = jobs[0].scenario
    rules = [one.rule for one in LEVELS.values()]
    for job in jobs:
        one = job.scenario
        asked = one.command[0].acceleration_kmhs / base.command[0].acceleration_kmhs
        level, demand = rules.index(job.rule), one.name.rpartition("-")[2]
        assert asked == pytest.approx(float(demand) / DEMANDS[0])
        if level < 1:
            same = {"name": base.name, "command": [item.model_dump() for item in base.command]}
            assert one.changed(**same) == base
    told = meant(pd.DataFrame([{"scenario": job.scenario.name} for job in jobs]), 3, 2)
    assert set(told["level"]) == set(LEVELS)
    assert set(told["demand"]) == set(DEMANDS)
    assert told["event"].nunique() == 1
