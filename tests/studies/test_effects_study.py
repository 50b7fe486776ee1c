"""The sweep `effects`: starts that differ in their motors alone, rows that say their effect, verdicts of made-up tables."""

from itertools import product

import numpy as np
import pandas as pd

from studies.core.statement import FAILS, HOLDS
from studies.ladder.effects_study import ARMS, CLAIMS, EFFECTS, EFFECTS_STUDY, NUMBERS, cells, meant

USED = dict(zip(ARMS, (0.90, 0.92, 0.94, 0.91, 0.96, 1.0), strict=True))
"""What each arm uses of its bound in the order of `ARMS`, so that every order holds."""


def effects_table(turned: str = "", starts: int = 40) -> pd.DataFrame:
    """Every arm uses as much of its bound as `USED` says; under the effect `turned` as much less than the whole."""
    noise = np.random.default_rng(8)
    rows = []
    for k, effect, arm in product(range(starts), EFFECTS, ARMS):
        used = 1.9 - USED[arm] if effect == turned else USED[arm]
        values = dict.fromkeys(NUMBERS, 1.0) | {"bound_use": used + 0.001 * noise.normal()}
        where = {"scenario": f"{k}-{effect}", "event": f"{k}", "effect": effect, "status": "ok"}
        rows.append(where | {"rule": arm.rule, "controller": arm.controller} | values)
    return pd.DataFrame(rows)


def test_an_order_fails_under_the_effect_that_turns_it_round_and_no_other():
    for turned in ("", "series", "lag 100 ms"):
        found = {one.name: one.verdict for one in EFFECTS_STUDY.statements(effects_table(turned))}
        assert len(found) == len(CLAIMS)
        for name, verdict in found.items():
            assert verdict == (FAILS if turned and name.startswith(f"{turned}:") else HOLDS), name


def test_starts_differ_in_their_motors_alone_and_rows_say_their_effect():
    jobs = cells(3, 1)
    assert len(jobs) == len(ARMS) * len(EFFECTS)
    plain = jobs[0].scenario
    for job in jobs:
        own = job.scenario
        assert own.changed(name=plain.name, motors=None) == plain
    rows = pd.DataFrame([{"scenario": one.scenario.name} for one in jobs])
    found = meant(rows, 3, 2)
    assert found["effect"].tolist() == [effect for effect in EFFECTS for _ in ARMS]
    assert found["event"].nunique() == 1
