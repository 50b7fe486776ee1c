"""The sweeps `braking` and `printed`: events of multiple units, arms that are the printed rule, verdicts."""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest

from alloc.metrics import evaluate
from studies.core.drawn_events import COMPARED
from studies.core.job import simulate_job
from studies.core.statement import FAILS, HOLDS
from studies.patent import braking_study, printed_study
from studies.patent.printed_study import ARMS, CHANGES, CORRECTED, KINDS, PRINTED
from studies.stops.blended_events import EVENTS, HAULED


def braking_table(gain: float = 0.01, events: int = 60) -> pd.DataFrame:
    """Every rule but `alone` and `sharing` has a deceleration better by `gain`; every other stop has headroom."""
    noise = np.random.default_rng(5)
    rows = []
    for k, controller, rule in product(range(events), COMPARED, braking_study.RULES):
        values = dict.fromkeys(braking_study.NUMBERS, 1.0) | {"headroom": 0.02 * (k % 2)}
        better = gain * (rule not in ("alone", "sharing"))
        values["acceleration_ratio"] = 0.9 + better + 0.1 * gain * noise.normal()
        rows.append(
            {"scenario": f"stop-{k}", "rule": rule, "controller": controller, "status": "ok"}
            | values
        )
    return pd.DataFrame(rows)  # fmt: skip


def printed_table(loss: float = 0.01, events: int = 40) -> pd.DataFrame:
    """What is not corrected uses less of the bound by `loss`."""
    noise = np.random.default_rng(6)
    rows = []
    for kind, k, controller, arm in product(KINDS, range(events), COMPARED, ARMS):
        values = dict.fromkeys(printed_study.NUMBERS, 1.0)
        values["bound_use"] = 0.95 - loss * (arm != CORRECTED) + 0.1 * loss * noise.normal()
        event = f"{kind}-{k}"
        where = {"scenario": event, "event": event, "kind": kind, "arm": arm}
        rows.append(where | {"controller": controller, "status": "ok"} | values)
    return pd.DataFrame(rows)


def test_verdicts_follow_the_differences():
    for gain, expected in ((0.01, HOLDS), (-0.01, FAILS)):
        found = {
            one.name: one.verdict for one in braking_study.braking_statements(braking_table(gain))
        }
        assert len(found) == len(braking_study.CLAIMS)
        for name, verdict in found.items():
            assert verdict == expected or name.startswith("f: sharing"), name
    for loss, expected in ((0.01, HOLDS), (-0.01, FAILS)):
        statements = printed_study.printed_statements(printed_table(loss))
        assert {one.verdict for one in statements} == {expected}


def test_stops_are_those_of_multiple_units_and_each_comes_once():
    numbers = [braking_study.stop_of(k) for k in range(30)]
    assert numbers == sorted(set(numbers))
    assert not {EVENTS.draw(3, number)["train"] for number in numbers} & set(HAULED)
    assert len({EVENTS.draw(3, number)["curve"] for number in numbers}) == 7


def test_all_deviations_taken_back_by_keys_are_the_printed_rule():
    """And each of them alone changes some stop."""
    acts = set()
    for k in range(3):
        jobs = [one for one in printed_study.cells(7, k) if one.controller == COMPARED[0]]
        stops = jobs[len(ARMS) :]  # a start has no air brake: (18) changes nothing there
        found = [evaluate(simulate_job(one)) for one in stops]
        acts |= {
            arm for arm, one in zip(ARMS, found, strict=True) if one["damage"] != found[0]["damage"]
        }
    assert acts == set(ARMS[1:])
    merged = {}
    for key, value in (one for changes in CHANGES.values() for one in changes.items()):
        merged[key] = merged.get(key, {}) | value if isinstance(value, dict) else value
    whole = printed_study._with(stops[0].scenario, merged, "all")
    by_keys = evaluate(simulate_job(replace(stops[0], scenario=whole)))
    assert by_keys == pytest.approx(found[-1], rel=0.0, abs=0.0, nan_ok=True)


def test_rows_say_their_event_and_arm():
    cells = printed_study.cells(7, 0)
    rows = [{"scenario": one.scenario.name, "rule": one.rule} for one in cells]
    found = printed_study.meant(pd.DataFrame(rows), 7, 1)
    arms = [arm for _ in KINDS for arm in ARMS for _ in COMPARED]
    assert found["arm"].tolist() == arms
    assert found["kind"].tolist() == [kind for kind in KINDS for _ in ARMS for _ in COMPARED]
    assert PRINTED in arms
    assert found["event"].nunique() == len(KINDS)
