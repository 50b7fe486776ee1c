"""What the leader believes that each unit can carry, and when it asks its rule."""

import math

import numpy as np
import pytest

from alloc.onboard.beliefs import BELIEFS, HELD, LEAST, RISE, ROOM, SLEW
from alloc.onboard.columns import NEVER, RUN, UNIT

H, PLAN = 0.01, 0.1
BY_REPORT = "front", "delivered", "delivered always"


class Train:
    """Units whose newest report is that of the last telegram, or `late` instants older; the leader's is its own."""

    def __init__(self, n=4, late=0, tick=0, **run):
        self.units = UNIT.rows(n, delivered=PLAN, load=1e5, turning=0.05, drive_limit=2e3)
        self.units.increment = 0.002 * np.arange(n) ** 2
        self.run = RUN.rows(1, plan=PLAN, needed=PLAN, driver_command=0.8, **run)[0]
        self.reports = UNIT.record(1000, n)
        self.report_tick, self.tick, self.late = np.zeros((1000, n), int), tick, late

    def go(self, name, **reports):
        """Whether the rule is asked in this instant, in which the units report this."""
        for key, value in reports.items():
            self.units[key] = value
        k, self.run.time = self.tick, self.tick * H
        self.report_tick[k] = max(k // 10 * 10 - self.late, 0)
        self.report_tick[k, self.run.leader : self.run.leader + 1] = k
        asked = BELIEFS[name].function(k, self.units, self.reports, self.report_tick, self.run)
        for key in UNIT.recorded.names:
            self.reports[key][k] = self.units[key]
        self.tick += 1
        return asked


@pytest.mark.parametrize("name", BELIEFS)
def test_limits_return_to_the_plan_when_nothing_is_limited_or_asked_for(name):
    for plan in (PLAN, 0.0):
        train = Train(tick=10)
        train.run.plan = plan
        if plan == 0.0 or name not in ("delivered always", "known"):
            assert not train.go(name, wanted=0.07, mark=0.05)
            assert [*train.units.wanted, *train.units.mark] == [math.inf] * 8
            assert math.isnan(train.run.level)
    assert Train(0).go(name) in (False, 0)  # without units there is nothing to share


@pytest.mark.parametrize("name", BELIEFS)
def test_what_motors_can_bounds_every_belief_and_a_failed_unit_is_given_nothing(name):
    train = Train(sign=-1.0)
    train.go(name, brake_limit=500.0, works=[1, 1, 0, 1], seen=[4, 0, 4, 4], detected=0.0)
    able = 500.0 * 7.0 / (1.05 * 1e5 * 0.43)
    assert train.units.most == pytest.approx([able, 0.5 * PLAN, 0.0, able])
    train.run.braking = 1  # air does what motors cannot
    train.go(name, wanted=[0.13, 0.04, math.inf, PLAN])
    slew = np.array([0.13, PLAN, PLAN, PLAN]) + SLEW * PLAN * 0.1
    assert train.units.most == pytest.approx(slew if name in BY_REPORT else [math.inf] * 4)


def test_the_leaders_slip_counts_for_the_hold_time_and_sets_all_caps_by_increments():
    train, asked = Train(tick=100, leader=1), []
    for k in range(100, 630):
        slip = {"detected": [NEVER, 1.2, NEVER, 1.3], "held": [0, 0.06, 0, 0.01]}
        asked.append(train.go("front detected", wanted=0.06, **slip if k >= 120 else {}))
        if k == 130:
            assert train.units.cap == pytest.approx([0.058, 0.06, 0.066, 0.076])  # (5)
        if k == 300:
            train.run.plan = 0.12  # the driver asks for more
        assert (train.units.wanted[0] < math.inf) == (120 <= k <= 620)
    assert [100 + k for k in np.flatnonzero(asked)] == [120, 301]


def test_every_units_own_slip_counts_and_the_foremost_of_them_moves_those_behind():
    train, asked, caps = Train(), [], []
    for k in range(700):
        detected = [NEVER, 1.25 if k >= 125 else NEVER, NEVER, 2.0 if k >= 200 else NEVER]
        asked.append(train.go("any detected", detected=detected, held=[0.0, 0.06, 0.0, 0.05]))
        caps.append(list(train.units.cap))
    assert list(np.flatnonzero(asked)) == [130, 200, 626]  # by telegrams; the first is too old then
    assert caps[131] == pytest.approx([PLAN, 0.06, 0.066, 0.076])
    assert caps[201] == pytest.approx([PLAN, 0.06, 0.066, 0.05])
    assert caps[690] == pytest.approx([PLAN, PLAN, PLAN, 0.05])


@pytest.mark.parametrize("late", [0, 20])
@pytest.mark.parametrize("name", BY_REPORT)
def test_the_rule_is_asked_with_telegrams_from_a_limitation_until_it_is_held_no_more(name, late):
    train, asked = Train(late=late), []
    for k in range(400):
        limited = min(k // 10 * 10, 150) * H if k >= 100 else NEVER
        asked.append(train.go(name, limited=[NEVER, limited, NEVER, NEVER]))
    until = 150 + round(HELD / H)  # the instant counts, not when it is heard
    span = (0, 400) if name == "delivered always" else (100 + late, until)
    assert list(np.flatnonzero(asked)) == list(range(*span, 10))


@pytest.mark.parametrize("name", ["delivered", "delivered always"])
def test_a_limited_unit_carries_what_it_delivers_and_any_others_mark_rises(name):
    train, units, got = Train(), [], [0.04, 0.11, 0.1, 0.002]
    for k in range(101):
        limited = [min(k, 50) * H, NEVER, NEVER, k // 10 * 10 * H]
        train.go(name, limited=limited, delivered=got)
        units.append(train.units.copy())
    assert units[50].mark == pytest.approx([0.04, math.inf, math.inf, LEAST])
    assert [*units[50].searching, *units[100].searching] == [1, 0, 0, 1, 0, 0, 0, 1]
    assert units[100].cap[0] == pytest.approx(0.04 + 5 * RISE * PLAN * 0.1)
    assert units[100].reported == pytest.approx(got)


def test_the_foremost_limited_units_mark_moves_the_others_and_fades_slowly():
    train, mark = Train(), 0.03 + 0.03 * (1.0 - 0.1 / 5.0) ** 20
    for k in range(301):
        train.go(
            "front",
            limited=[NEVER, k // 10 * 10 * H, NEVER, NEVER],
            slipped=[NEVER, NEVER, k * H, NEVER],
            delivered=[0.1, 0.06 if k <= 100 else 0.03, 0.08, 0.1],
        )
        if k == 100:  # a search has room; (5) behind it; without slip no cap is below the plan
            assert train.units.cap == pytest.approx([PLAN, ROOM * 0.06, 0.066, PLAN])
    assert train.units.cap == pytest.approx([PLAN, mark, mark + 0.006, PLAN])
    train.tick = 310
    train.go("front", limited=3.1, works=[0, 1, 1, 1], delivered=[0.0, 0.07, 0.0, 0.1])
    assert list(train.units.cap[:2]) == pytest.approx([0.0, ROOM * 0.07])  # one that has failed


def test_the_oracle_alone_is_told_the_truth_every_period():
    train = Train()
    assert all(train.go("known", truth=[0.05, 0.06, 0.2, 0.3]) for _ in range(15))
    assert list(train.units.cap) == [0.05, 0.06, 0.2, 0.3]
    assert [one.name for one in BELIEFS.values() if one.knows] == ["known"]
    assert len({one.description for one in BELIEFS.values()}) == len(BELIEFS)
