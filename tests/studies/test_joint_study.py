"""Allocation rules against the joint optimum: paired over the same events."""

import numpy as np
import pandas as pd
import pytest

from studies.core.statement import FAILS, HOLDS, TOO_FEW, UNDECIDED
from studies.ladder.curves_study import METRICS
from studies.ladder.joint_study import ARMS, JOINT, OPTIMUM

SHORT = 3.0
"""Length of an event [s] that is just long enough for the measures."""


def table(short: float, events: int = 20, spread: float = 0.002) -> pd.DataFrame:
    """Every arm `short` of the optimum's effort, with `spread` from event to event, on events that differ by much more."""
    noise = np.random.default_rng(5)
    rows = []
    for k in range(events):
        level = 0.7 + 0.2 * noise.random()
        for arm in (*ARMS, OPTIMUM):
            missed = 0.0 if arm == OPTIMUM else short + spread * noise.standard_normal()
            values = dict.fromkeys(METRICS, 1.0) | {"held_effort": level - missed}
            rows.append({"event": k, "status": "ok", **arm._asdict(), **values})
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("short", "spread", "verdict"),
    [(0.0, 0.002, HOLDS), (0.05, 0.002, FAILS), (0.01, 0.01, UNDECIDED)],
)
def test_the_verdict_follows_the_effort_missed(short, spread, verdict):
    found = JOINT.statements(table(short, spread=spread))
    assert len(found) == len(ARMS)
    assert {statement.verdict for statement in found} == {verdict}


def test_few_events_and_failed_ones_say_nothing():
    assert {s.verdict for s in JOINT.statements(table(0.0, events=5))} == {TOO_FEW}
    failed = table(0.0)
    failed.loc[(failed["controller"] == "mpc-train-ideal") & (failed["event"] > 4), "status"] = (
        "failed"
    )
    assert {s.verdict for s in JOINT.statements(failed)} == {TOO_FEW}


def test_every_arm_meets_the_same_event(tmp_path):
    swept = JOINT.run(tmp_path, 1, duration=SHORT)
    assert (swept["status"] == "ok").all(), swept["reason"].tolist()
    assert len(swept) == len(ARMS) + 1
    assert swept["scenario_hash"].nunique() == 1
    assert (swept["controller_failures"] == 0).all()
    again = JOINT.run(tmp_path, 1, duration=SHORT)
    pd.testing.assert_frame_equal(again, swept)
