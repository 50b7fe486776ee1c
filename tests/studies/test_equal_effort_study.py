"""The sweep `equal-effort`: starts that differ in the price of friction alone, and verdicts of made-up tables."""

import numpy as np
import pandas as pd

from mpc.settings import MpcSettings, SlipSearch
from studies.core.statement import FAILS, HOLDS
from studies.ladder.equal_effort_study import (
    ARMS,
    CHOSEN,
    EQUAL_EFFORT,
    MPC,
    NUMBERS,
    PRICES,
    cells,
    meant,
)
from studies.patent import headroom_study


def effort_table(saved: float = 0.1, starts: int = 20) -> pd.DataFrame:
    """At the chosen price the MPC has the search's effort at so much less wheel damage; each doubling costs a point."""
    random = np.random.default_rng(8)
    rows = []
    for k in range(starts):
        day = random.uniform(0.5, 1.5)
        for arm in ARMS:
            dearer = np.log2(arm.price / CHOSEN) if arm.price else 0.0
            less = (saved + 0.1 * dearer if arm.price else 0.0) + 0.002 * random.normal()
            values = {
                "bound_use": 0.98 - 0.01 * dearer,
                "damage": 200.0 * day * (1.0 - less),
                "excess_damage": 0.12 - 0.6 * less - 0.02 * (arm.rule == "wear"),
                "slip_time": 2.0 * day * (1.0 - 8.0 * less),
                "jerk_rms": 0.6 - 0.1 * less,
            }
            where = {"event": f"{k}", "scenario": f"{k}-{arm.price}", "rule": arm.rule}
            row = where | {"controller": arm.controller, "price": arm.price, "status": "ok"}
            rows.append(row | dict.fromkeys(NUMBERS, 0.0) | values)
    return pd.DataFrame(rows)


def test_what_is_saved_holds_and_what_is_not_fails():
    for saved, verdict in ((0.12, HOLDS), (-0.05, FAILS)):
        found = {one.name: one.verdict for one in EQUAL_EFFORT.statements(effort_table(saved))}
        assert found.pop("effort") == HOLDS
        assert found.pop("rule") == HOLDS  # the same two points in both tables
        assert set(found.values()) == {verdict}, found


def test_starts_differ_in_the_price_alone_and_rows_say_it():
    jobs = cells(3, 1, 4.0)
    assert len({job.label for job in jobs}) == len(ARMS)
    start = headroom_study.scenario(3, 1, 4.0)
    told = meant(pd.DataFrame([{"scenario": job.scenario.name} for job in jobs]), 3, 2)
    assert set(told["event"]) == {start.name}
    assert SlipSearch().friction_price == PRICES[0]
    for job, arm, price in zip(jobs, ARMS, told["price"], strict=True):
        assert price == arm.price
        settings = job.scenario.event().onboard.hosted.get(MPC, MpcSettings())
        assert settings.search == SlipSearch(friction_price=arm.price or PRICES[0])
        assert job.scenario.changed(name=start.name, onboard=start.onboard.model_dump()) == start
