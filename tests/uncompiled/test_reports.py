"""What units tell the leader: whether they are limited, what they deliver, and what a telegram costs in time."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.equipment import equipment
from alloc.onboard.laws import HOLD, SUPPLY
from alloc.onboard.parameters import Onboard, Telegrams
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.onboard.telegrams import (
    ACTING,
    BY_ITSELF,
    BY_NOTHING,
    BY_RAIL,
    DELIVERED,
    FILTER_TIME,
    LIMITED,
    SLIPPED,
    WHOLE,
    hear_reports,
    write_reports,
)
from alloc.plant.model import build
from alloc.plant.rail import Rail
from tests.onboard.uneven import uneven_train

PLAN = 0.08
LINES = Telegrams(period=0.1, latency=0.05, jitter=0.0, loss=0.0)


class Train:
    """Computers of four units that deliver the plan; the test changes what they find."""

    def __init__(self, telegrams=LINES):
        onboard = Onboard(telegrams=telegrams)
        self.eq = equipment(build(uneven_train(), Rail(0.15)), onboard)
        self.st = settings(onboard, RuleSettings(0), "none")
        self.eq = self.eq._replace(own_inertia=np.zeros_like(self.eq.own_inertia))
        self.m = memory(self.eq, 12.0, PLAN)
        self.n = self.eq.axles.size
        self.target(np.full(self.n, PLAN))
        self.m.unit.coefficient_estimate[:] = PLAN
        self.tick = 0

    def target(self, coefficients):
        eq = self.eq
        self.m.unit.torque_target[:] = coefficients * eq.axle_load * eq.radius / eq.gear

    def write(self, commanded=0.8):
        write_reports(self.eq, self.st, self.m, self.tick * self.st.period, commanded)
        return self.m.report.own

    def pass_time(self, ticks, commanded=0.8, delay=0.0, fate=1.0):
        """Control periods one after the other, in which everything stays."""
        for _ in range(ticks):
            self.write(commanded)
            hear_reports(
                self.eq, self.st, self.m, self.tick * self.st.period, self.tick,
                np.full(self.n, delay), np.full(self.n, fate),
            )  # fmt: skip
            self.tick += 1


@pytest.fixture
def train():
    return Train()


@pytest.mark.parametrize(("share", "limited"), [(WHOLE - 1e-6, True), (WHOLE, False), (1.0, False)])
def test_a_unit_is_limited_where_its_controller_takes_torque_away(train, share, limited):
    train.m.unit.torque_factor[2] = share
    by = BY_RAIL if limited else BY_NOTHING
    assert train.write()[:, LIMITED].tolist() == [BY_NOTHING, BY_NOTHING, by, BY_NOTHING]
    assert WHOLE == 0.985


@pytest.mark.parametrize(("part", "limited"), [(0.99 * ACTING, False), (1.01 * ACTING, True)])
def test_a_target_that_asks_little_of_the_rail_says_nothing_of_it(train, part, limited):
    train.m.unit.torque_factor[:] = 0.5
    train.target(-part * PLAN * np.ones(4))
    assert train.write(-0.8)[:, LIMITED].tolist() == [limited] * 4


def test_failed_and_blind_units_are_limited_whatever_they_deliver(train):
    train.m.in_service[1] = False
    train.m.unit.axles_seen[3] = 0.0
    train.m.unit.torque_factor[[0, 1]] = 0.5
    by = [BY_RAIL, BY_ITSELF, BY_NOTHING, BY_ITSELF]
    assert train.write()[:, LIMITED].tolist() == by
    train.pass_time(7)
    assert train.m.limited.tolist() == [True, True, False, True]
    assert train.m.by_rail.tolist() == [True, False, False, False]
    assert not train.write(0.0)[:, LIMITED].any()  # nobody asks for anything


def test_a_unit_whose_slide_protection_acts_is_limited_under_blended_brakes(train):
    groups = np.flatnonzero(train.eq.group.unit == 3)
    train.m.slide.action[groups[0]] = HOLD
    assert train.write(-0.8)[:, LIMITED].tolist() == [BY_NOTHING] * 3 + [BY_RAIL]
    assert not train.write(0.8)[:, LIMITED].any()
    train.m.slide.action[:] = SUPPLY
    train.m.slide.action[train.eq.group.unit < 0] = HOLD  # a trailer is no unit
    assert not train.write(-0.8)[:, LIMITED].any()


def test_a_unit_that_is_sounded_says_what_it_said_before(train):
    train.m.estimate.relief.share[1] = 0.99
    train.m.unit.torque_factor[:] = 0.2
    train.m.unit.coefficient_estimate[:] = 0.01
    train.m.unit.slipping[:] = 1.0
    own = train.write()
    assert own[1].tolist() == [PLAN, pytest.approx(np.nan, nan_ok=True), -np.inf, 0.0, -np.inf]
    assert own[0, DELIVERED] < PLAN
    assert own[[0, 2, 3], LIMITED].all()
    assert own[[0, 2, 3], SLIPPED].tolist() == [0.0] * 3
    train.m.in_service[1] = False  # a failure is told in any case
    assert train.write()[1, LIMITED] == BY_ITSELF


def test_the_delivered_coefficient_follows_with_its_filter_and_is_not_negative(train):
    train.m.unit.coefficient_estimate[:] = [0.03, 0.0, -0.05, PLAN]
    ticks = round(FILTER_TIME / train.st.period)
    for _ in range(ticks):
        own = train.write()
    left = (FILTER_TIME / (FILTER_TIME + train.st.period)) ** ticks
    assert left == pytest.approx(np.exp(-1.0), rel=0.03)
    wanted = np.array([0.03, 0.0, 0.0, PLAN])
    np.testing.assert_allclose(own[:, DELIVERED], wanted + left * (PLAN - wanted), rtol=1e-12)


def test_the_leader_knows_of_itself_at_once_and_of_others_by_the_next_telegram(train):
    train.pass_time(3)
    train.m.unit.torque_factor[[0, 2]] = 0.5
    train.pass_time(1)  # 0.03 s
    assert train.m.limited.tolist() == [True, False, False, False]
    train.pass_time(11)  # to 0.14 s: sent at 0.1 s, it arrives at 0.15 s
    assert train.m.limited.tolist() == [True, False, False, False]
    train.pass_time(1)
    assert train.m.limited.tolist() == [True, False, True, False]
    np.testing.assert_allclose(train.m.report.limited_at, [0.15, -np.inf, 0.1, -np.inf])
    train.m.unit.torque_factor[:] = 1.0
    train.pass_time(30)
    assert not train.m.limited.any()
    # the last time it was said that they were limited, not the last time it was heard of
    np.testing.assert_allclose(train.m.report.limited_at, [0.15, -np.inf, 0.1, -np.inf])


def test_jitter_delays_and_loss_silences_what_goes_up():
    train = Train(replace(LINES, jitter=0.04, loss=0.3))
    train.m.unit.slipping[:] = 1.0
    train.pass_time(8, delay=0.5)  # to 0.07 s: 0.05 + 0.02 s
    assert train.m.slipping.tolist() == [True] * 4
    train = Train(replace(LINES, jitter=0.04, loss=0.3))
    train.m.unit.slipping[:] = 1.0
    train.pass_time(7, delay=0.5)
    assert train.m.slipping.tolist() == [True, False, False, False]
    lost = Train(replace(LINES, jitter=0.04, loss=0.3))
    lost.m.unit.slipping[:] = 1.0
    lost.m.unit.coefficient_estimate[:] = 0.0
    lost.pass_time(100, fate=0.299)
    assert lost.m.slipping.tolist() == [True, False, False, False]
    assert lost.m.delivered[1:].tolist() == [PLAN] * 3
    assert lost.m.counter.telegrams_lost[0] == lost.m.counter.telegrams_sent[0] == 10 * 3


def test_a_slip_between_two_telegrams_is_told_with_the_next_one(train):
    train.pass_time(3)
    train.m.unit.slipping[[0, 2]] = 1.0
    train.pass_time(2)  # 0.03 and 0.04 s
    train.m.unit.slipping[:] = 0.0
    assert train.m.slipping.tolist() == [True, False, False, False]
    train.pass_time(10)  # to 0.14 s; sent at 0.1 s, it arrives at 0.15 s
    train.pass_time(1)
    np.testing.assert_allclose(train.m.report.slipped_at, [0.04, -np.inf, 0.04, -np.inf])
    assert train.m.slipping.tolist() == [
        False,
        False,
        True,
        False,
    ]  # of the leader it is longer ago
    train.pass_time(10)  # the telegram after that says when, too
    np.testing.assert_allclose(train.m.report.slipped_at, [0.04, -np.inf, 0.04, -np.inf])
    assert not train.m.slipping.any()


def test_what_is_delivered_is_told_as_it_was_when_it_was_sent(train):
    train.m.unit.coefficient_estimate[:] = 0.02
    train.pass_time(11)  # to 0.10 s; what was sent at 0.00 s has arrived at 0.05 s
    first = PLAN + train.st.period / (FILTER_TIME + train.st.period) * (0.02 - PLAN)
    np.testing.assert_allclose(train.m.delivered[1:], first, rtol=1e-12)
    np.testing.assert_allclose(train.m.delivered[0], train.m.report.own[0, DELIVERED])


@pytest.mark.parametrize("reached", [0.0, 0.6, 1.0])
def test_told_is_the_limit_that_delivers_as_much(train, reached):
    """Torque is limit x 1.1, of which the wheelsets take a tenth of the plan where the train accelerates as planned."""
    train.eq = train.eq._replace(own_inertia=np.full(train.n, 0.1))
    train.m.unit.coefficient_estimate[:] = 0.05
    for _ in range(400):
        train.m.reference[:] += reached * 0.8 * train.st.period
        told = train.write(0.8)[:, DELIVERED]
    np.testing.assert_allclose(1.1 * told - 0.1 * reached * PLAN, 0.05, rtol=1e-7)
