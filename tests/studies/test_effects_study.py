"""The sweep `effects`: starts that differ in their effect alone, rows that say their effect, verdicts of made-up tables."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from alloc.plant.model import offered_by
from studies.core.drawn_events import START_SPEED
from studies.core.statement import FAILS, HOLDS
from studies.ladder.effects_study import (
    ARMS,
    CLAIMS,
    DRAWN,
    EFFECTS,
    EFFECTS_STUDY,
    NUMBERS,
    cells,
    effect_of,
    meant,
    scenario,
)

USED = dict(zip(ARMS, (0.90, 0.92, 0.94, 0.91, 0.96, 1.0, 0.89), strict=True))
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


def test_starts_differ_in_their_effect_alone_and_rows_say_it():
    jobs = cells(3, 1)
    assert len(jobs) == len(ARMS) * len(EFFECTS)
    plain = jobs[0].scenario
    for job in jobs:
        same = {"name": plain.name, "motors": None, "rail": plain.rail.model_dump()}
        own = job.scenario.changed(**same)
        assert (own == plain) == (job.controller != "pi-creep")
        assert own.changed(onboard=plain.onboard.model_dump()) == plain
    rows = pd.DataFrame([{"scenario": one.scenario.name} for one in jobs])
    found = meant(rows, 3, 2)
    assert found["effect"].tolist() == [effect for effect in EFFECTS for _ in ARMS]
    assert found["event"].nunique() == 1


def test_another_curve_offers_what_the_start_has_and_recovery_replaces_conditioning():
    for k in range(6):
        plain, rig, clean = (
            scenario(3, k, name).event().model for name in ("none", "rig curve", "recovery")
        )
        offered = [
            offered_by(one.rail.curve, one.rail.level, START_SPEED, one.structure)
            for one in (plain, rig)
        ]
        assert offered[1] == pytest.approx(offered[0], rel=1e-6)
        assert clean.rail.conditioning == 0.0
        assert clean.layout.recoveries == clean.layout.axles
        assert plain.layout.recoveries == 0


def test_what_is_drawn_covers_its_ranges():
    effects = [effect_of(DRAWN, 3, k) for k in range(200)]
    lag = np.array([one.motors["torque_lag_s"] for one in effects])
    assert lag.min() < 0.006 < 0.09 < lag.max() <= 0.1
    for chosen in (
        lambda one: "curve" in one.rail,
        lambda one: "recovered_coefficient" in one.rail,
    ):
        assert 70 < sum(map(chosen, effects)) < 130
