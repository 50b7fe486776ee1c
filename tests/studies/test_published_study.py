"""Others' controllers meet the ladder's events and the locomotive's, and their statements say who is above whom."""

import numpy as np
import pandas as pd
import pytest

from alloc.onboard.controllers.collection import BUILT_IN
from alloc.simulation import simulate
from studies.core.claims import quantity
from studies.core.statement import FAILS, HOLDS
from studies.ladder.ladder_study import METRICS
from studies.ladder.ladder_study import cells as ladder_cells
from studies.ladder.locomotive_study import (
    DRY,
    EVENTS,
    FAILURE_TIME,
    HOSTED,
    KINDS,
    PARTS,
    RAILS,
    STATES,
    WET,
    locomotive_statements,
    scenario,
)
from studies.ladder.locomotive_study import cells as locomotive_cells
from studies.ladder.published_study import (
    ARMS,
    BAR,
    PUBLISHED,
    PUBLISHED_STUDY,
    SAID,
    published_statements,
)
from tests.studies.ladder_tables import NUMBERS


def table_of(used, events=60, controllers=ARMS):
    """A table in which controller c uses `used(c)` and searches for as much less time."""
    noise, rows = np.random.default_rng(5), []
    for k in range(events):
        for name in controllers:
            value = used(name) + 0.001 * float(noise.normal())
            row = {"scenario": f"e{k:03d}", "controller": name, "status": "ok", **NUMBERS}
            row |= {"utilisation_short": value, "effort_ratio": value, "search_time": 1.0 - value}
            row |= {
                "rail": RAILS[k % 3],
                "motors": STATES[k // 3 % 2],
                "train": "one inverter per car",
            }
            rows.append(
                row | {"curve": ("piecewise", "polach")[k % 2], "scatter": 0.0, "patch_factor": 1.0}
            )
    return pd.DataFrame(rows)


def verdicts(statements):
    return {one.name: one.verdict for one in statements}


def test_published_controllers_meet_the_ladders_own_events(tmp_path):
    jobs = PUBLISHED_STUDY.cells(0, 2)
    ladder = {job.scenario.hash() for k in range(2) for job in ladder_cells(0, k)}
    assert {job.scenario.hash() for job in jobs} == ladder
    assert [job.controller for job in jobs] == [*ARMS, *ARMS]
    table = PUBLISHED_STUDY.run(tmp_path, 1, duration=1.5)
    assert (table["status"] == "ok").all(), table["reason"].tolist()
    assert set(METRICS) | {"train", "curve", "slip_peak"} <= set(table)


@pytest.mark.parametrize("claims", [published_statements, locomotive_statements])
def test_the_bar_is_held_by_who_uses_more(claims):
    controllers = (*ARMS, *HOSTED)
    for used, verdict in ((BAR + 0.02, HOLDS), (BAR - 0.02, FAILS)):
        found = verdicts(claims(table_of(lambda _, used=used: used, controllers=controllers)))
        assert all(found[f"90%: {name}"] == verdict for name in PUBLISHED)


def test_who_is_above_another_is_said_to_be():
    best = {
        name: verdicts(published_statements(table_of(lambda c, n=name: 0.97 if c == n else 0.93)))
        for name in {name for one in SAID for name in (one.name, one.other)}
    }
    for one in SAID:
        said = f"{METRICS[one.metric]}: {one.name}, {one.other}"
        assert (best[one.name][said], best[one.other][said]) == (HOLDS, FAILS), said


def test_load_transfer_in_the_mpc_is_judged_against_the_mpc_without():
    table = table_of(lambda c: 0.95 if c == "mpc-car" else 0.9, controllers=(*ARMS, *HOSTED))
    assert verdicts(locomotive_statements(table))["effort: mpc-car, mpc"] == HOLDS


def test_six_events_are_every_rail_with_and_without_a_failed_motor():
    curves = set()
    for block in range(4):
        drawn = [EVENTS.draw(0, KINDS * block + k) for k in range(KINDS)]
        assert {(d["rail"], d["motors"]) for d in drawn} == {(r, m) for r in RAILS for m in STATES}
        assert len({d["curve"] for d in drawn}) == 1
        hosted = {job.controller for job in locomotive_cells(0, KINDS * block)} - set(BUILT_IN)
        assert hosted == set(HOSTED)
        curves |= {d["curve"] for d in drawn}
    assert curves == {"piecewise", "polach"}
    events = pd.DataFrame([EVENTS.draw(0, k) for k in range(KINDS)])
    assert [int(quantity(events, part).sum()) for part in PARTS.values()] == [1] * KINDS


@pytest.fixture(scope="module")
def runs():
    return {k: simulate(scenario(0, k).event(k), "alone", "pi-creep") for k in range(KINDS)}


def test_loads_move_to_the_rear_and_keep_their_sum(runs):
    for run in runs.values():
        load = run["axle_load"].values[:, run["axle_car"].values == 0]
        assert (load[-1] - load[0]).max() > 0.02 * load[0].mean()
        assert load[-1, 0] < load[0, 0]
        np.testing.assert_allclose(load.sum(axis=1), load[0].sum(), rtol=1e-6)


def test_rails_offer_what_they_are_called(runs):
    for k, run in runs.items():
        d, offered = EVENTS.draw(0, k), run["adhesion_limit"].values[:, :6]
        share = {"dry": 1.0, "wet": WET / DRY, "mixed": 1.0}[d["rail"]]
        assert np.median(offered[0]) == pytest.approx(d["level_factor"] * DRY * share, rel=0.1)
        if d["rail"] == "mixed":
            assert offered.min() < 0.65 * offered.max()


def test_a_failed_motor_gives_no_torque_after_its_failure_and_the_others_do(runs):
    for k, run in runs.items():
        d = EVENTS.draw(0, k)
        late = run.sel(time=slice(FAILURE_TIME + 1.0, None))
        working = np.abs(late["motor_torque"].values).max(axis=0) > 10.0
        expected = np.ones(6, dtype=bool)
        if d["motors"] == "one failed":
            expected[d["failed_unit"] - 1] = False
        assert working.tolist() == expected.tolist()
