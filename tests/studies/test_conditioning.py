"""Who should slip for whom: laws of a train in balance on rail that wheels clean, and what the plant makes of it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import differential_evolution

from alloc.evaluation.least_damage import COSTS, BestSplits, tabulate_splits
from studies import conditioning as study
from studies.conditioning import Balance, find_best, make_rail
from tests.cases import looped

LAWS = ("slip", "energy")


def test_without_cleaning_all_slip_alike_and_the_least_damage_of_an_instant_is_met() -> None:
    balance, slips = Balance(make_rail("slip", 0.1, 0.0)), np.array([0.01, 0.02, 0.03, 0.038])
    best = find_best(balance)
    assert best["leaders"] == balance.units
    assert best["effort_won"] == pytest.approx(0.0, abs=1e-3)
    force, power = balance.run(*balance.units * [slips])
    axles, curve = balance.units * balance.axles, balance.rail.curve
    one, ones = np.ones(1), np.ones((1, axles))
    table = np.zeros((2, 1, COSTS.size))
    top = curve.top(balance.speed, balance.rail.level)[1] * ones
    first = np.arange(0, axles + 1, balance.axles)
    tabulate_splits(
        curve.number, curve.values, one, balance.speed * ones, balance.rail.level * ones, ones[0],
        top, ones, np.full((1, balance.units), 9.0), first, *table,
    )  # fmt: skip
    for f, p in axles * np.stack([force, power], axis=1):
        splits = BestSplits(np.array([f]), np.array([p]), np.array([np.inf]), *table)
        assert splits.least(np.array([f])).item() == pytest.approx(p, rel=3e-3)


@looped("law", LAWS)
def test_slips_of_two_sizes_are_as_good_as_one_for_each_unit(law: str) -> None:
    balance = Balance(make_rail(law, 0.1, 0.6))
    best, finer = find_best(balance), find_best(balance, nodes=128)
    assert finer["won"] == pytest.approx(best["won"], abs=0.05)
    assert finer["effort_won"] == pytest.approx(best["effort_won"], abs=1e-3)
    most = study.MOST / (1.0 - study.MOST) * balance.speed
    free = differential_evolution(
        lambda slips: -study.score(*balance.run(*np.exp(slips))),
        [(np.log(1e-2), np.log(most))] * balance.units,
        vectorized=True, updating="deferred", polish=False, popsize=12, maxiter=60, rng=1,
    )  # fmt: skip
    slips = np.full(balance.units, best["rest"])
    slips[: int(best["leaders"])] = best["lead"]
    reached = float(study.score(*balance.run(*slips)).item())
    assert -free.fun < reached + 0.1
    assert best["won"] == pytest.approx(
        reached - study.score(*balance.run(*balance.units * [best["uniform"]])).item(), abs=0.05
    )


@looped(("law", "gain"), [(law, gain) for law in LAWS for gain in (0.1, 0.5, 1.5)])
def test_the_foremost_slip_no_less_and_cleaner_rail_carries_no_less(law: str, gain: float) -> None:
    best = find_best(Balance(make_rail(law, 0.08, gain)), nodes=60)
    assert best["lead"] > 0.9 * best["rest"]
    assert best["won"] >= 0.0
    assert best["effort_won"] >= 0.0
    slips = np.geomspace(0.01, 2.0, 20)
    force, power, clean = Balance(make_rail(law, 0.08, gain)).pull(np.array([[0.0], [0.5]]), slips)
    assert np.all(force[1] >= force[0] - 1e-9)
    assert np.all(clean[1] >= 0.5)
    less = Balance(make_rail(law, 0.08, 0.9 * gain)).pull(np.full(20, 0.5), slips)[0]
    assert np.all(force[1] >= less - 1e-9)
    assert np.all(power <= force * slips + 1e-12)  # no axle slips more than the first of its unit


@looped("law", LAWS)
def test_the_compiled_plant_comes_to_the_same_forces(law: str) -> None:
    rail = make_rail(law, 0.1, 0.5)
    event = replace(study.make_start(7602, 3, law), rail=rail, initial_speed=10.0)
    slips = np.array([0.4, 0.03, 0.03, 0.03])
    record = study.simulate_held(event, "pi-creep", slips)
    late = record["time"].values > 12.0  # the hindmost unit runs where the foremost has slipped
    driven = record["axle_unit"].values >= 0
    carried = record["rail_force"].values[late][:, driven].mean() / study.LOAD
    balance = Balance(event.rail, float(record["speed"].values[late].mean()))
    force, power = balance.run(*slips)
    assert carried == pytest.approx(force.item(), rel=0.01)
    spent = (record["rail_force"] * record["slip_velocity"]).values[late][:, driven].mean()
    assert spent / study.LOAD == pytest.approx(power.item(), rel=0.05)


def test_its_tables_and_figure_are_made_of_its_rows() -> None:
    rows = []
    for cell in study.cells(1, 5):
        if cell.args[0] == "start":
            rows += [row | dict(cell.columns) for row in study.run(*cell.args)]
        else:
            best = dict.fromkeys(("uniform", "mean", "lead", "rest", "leaders", "won", "lost"), 1.0)
            best |= {"effort_won": cell.args[2], "damage_won": 0.0}
            rows += [{"gain": gain} | best | dict(cell.columns) for gain in study.GAINS.tolist()]
    frame = pd.DataFrame(rows).assign(status="ok")
    assert len(study.table(frame)) == 4
    shown = study.map_table(frame)
    assert len(shown) == len(study.SHOWN) * (len(study.MAPS) + len(study.CASES))
    assert set(shown["effort won [%]"]) == {f"{100.0 * study.MIDDLE:.1f}"}
    assert len(study.figure(frame).axes) == len(study.MAPS) + 1
