"""What the leader learns from reports: single steps, against numbers by hand."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.distribution import prepare_allocation
from alloc.onboard.equipment import equipment
from alloc.onboard.increment_learning import IncrementLearning
from alloc.onboard.parameters import Belief, Onboard, ReferenceSpeed, Telegrams
from alloc.onboard.sensing import sense
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.onboard.telegrams import DETECTED, ESTIMATE, hear_reports, write_reports
from alloc.plant.model import build
from alloc.plant.rail import Rail
from tests.onboard.uneven import uneven_train

PLAN, STORED = 0.16, (0.0, 0.01, 0.02, 0.03)
MEAN = IncrementLearning("running-mean", first=3, further=2, stored=4.0)
HELD = replace(MEAN, reference="held")
GAUSS = IncrementLearning("gaussian", reference="held", noise=0.012, deviation=0.010)


class Train:
    """Computers of four units that pull with what the plan needs; the test says who slips, and at what coefficient."""

    def __init__(self, learning, trigger="slip", jitter=0.0):
        onboard = Onboard(
            belief=Belief(unit_increments=STORED), learning=learning, trigger=trigger,
            telegrams=Telegrams(period=0.1, latency=0.05, jitter=jitter, loss=0.5),
            reference=ReferenceSpeed(source="truth"),
        )  # fmt: skip
        self.eq = equipment(build(uneven_train(), Rail(0.15)), onboard)
        self.st = settings(onboard, RuleSettings(0), "none")
        self.m, self.tick = memory(self.eq, 12.0, PLAN), 0
        self.command = PLAN / self.eq.planned_share
        self.m.unit.torque_command[:] = self.m.torque[:] = 500.0
        self.m.unit.coefficient_estimate[:] = PLAN
        self.data = []
        self.asked = False

    @property
    def time(self):
        return self.tick * self.st.period

    def slip(self, unit, coefficient):
        """As `alloc.onboard.sensing` notes it."""
        self.m.report.own[unit, ESTIMATE], self.m.report.own[unit, DETECTED] = (
            coefficient,
            self.time,
        )
        if unit == self.m.lead.unit[0]:
            self.m.lead.estimate[0], self.m.lead.detected[0] = coefficient, self.time

    def fail(self, *units):
        self.m.in_service[:] = ~np.isin(range(4), units)

    def pass_time(self, seconds, lost=False, delay=0.0):
        """Control periods one after the other; notes each datum with its unit."""
        for _ in range(round(seconds / self.st.period)):
            before = self.m.learning.series.increment_data.copy()
            self.m.lead.allocate[0] = False
            write_reports(self.eq, self.st, self.m, self.time, self.command)
            hear_reports(
                self.eq, self.st, self.m, self.time, self.tick, np.full(4, delay), np.full(4, 0.0 if lost else 1.0)
            )  # fmt: skip
            self.asked |= prepare_allocation(
                self.eq, self.st, self.m, self.time, self.tick, self.command, False
            )
            taken = self.m.learning.series.increment_data - before
            assert taken.max() <= 1.0
            self.data += [
                (j, float(self.m.learning.series.increment_datum[j])) for j in np.flatnonzero(taken)
            ]
            self.tick += 1


def difference(m):
    return m.learnt.increment - m.learnt.increment[:, None]


def test_what_is_learnt_is_16_and_17_of_the_data_in_their_order():
    train = Train(HELD)
    train.slip(0, 0.10)
    shown = (0.125, 0.115, 0.135, 0.120, 0.110, 0.150)
    for coefficient in shown:
        train.slip(2, coefficient)
        train.pass_time(0.2)
    assert train.data == [(2, pytest.approx(value - 0.10)) for value in shown]
    # three, then every two: (0.02 x 4 + 0.075) / 7, then with 0.02 + 0.01 / 9; the last one waits
    first = (0.02 * 4 + 0.025 + 0.015 + 0.035) / 7
    assert train.m.learnt.increment == pytest.approx([0.0, 0.01, (first * 7 + 0.03) / 9, 0.03])
    assert train.m.learnt.behind.tolist() == [4.0, 4.0, 9.0, 4.0]
    assert train.m.learnt.waiting.tolist() == [0.0, 0.0, 1.0, 0.0]
    assert train.m.learnt.waiting_sum[2] == pytest.approx(0.05)
    assert train.m.learnt.updates.tolist() == [0.0, 0.0, 2.0, 0.0]


def test_received_is_the_leaders_coefficient_when_the_report_arrives():
    train = Train(MEAN)
    train.slip(1, 0.15)
    train.m.unit.coefficient_estimate[0] = 0.10
    train.pass_time(0.05)  # sent at once, it arrives 0.05 s later
    assert train.data == []
    train.m.unit.coefficient_estimate[0] = 0.13
    train.pass_time(0.01)
    assert train.data == [(1, pytest.approx(0.02))]


@pytest.mark.parametrize("learning", [HELD, GAUSS])
def test_lost_telegrams_change_when_something_is_learnt_and_not_what(learning):
    """As long as the leader does not slip in between, and the unit not again: a report tells of the last slip alone."""
    found = []
    for lost in (False, True):
        train = Train(learning)
        train.slip(0, 0.10)
        for unit, coefficient in ((1, 0.12), (3, 0.15), (1, 0.13), (1, 0.125), (3, 0.16)):
            train.slip(unit, coefficient)
            train.pass_time(0.4, lost)
            assert bool(train.data) >= (not lost)
            train.pass_time(0.2)
        found.append((train.data, train.m.learnt))
    assert found[0][0] == found[1][0]
    assert len(found[0][0]) == 5
    np.testing.assert_array_equal(found[0][1], found[1][1])
    received = []
    for lost in (False, True):  # not so where the reference is that of the arrival
        train = Train(MEAN)
        train.slip(1, 0.15)
        train.pass_time(0.1, lost)
        train.m.unit.coefficient_estimate[0] = 0.10
        train.pass_time(0.2)
        received += [datum for _, datum in train.data]
    assert received == pytest.approx([0.15 - PLAN, 0.05])


def test_no_datum_counts_twice_however_often_and_in_whatever_order_it_is_told():
    train = Train(MEAN, jitter=0.3)
    train.slip(2, 0.15)
    for delay in (1.0, 0.0, 0.7, 0.2, 0.0):  # telegrams overtake each other
        train.pass_time(0.1, delay=delay)
    train.slip(2, 0.14)
    for delay in (1.0, 0.0, 0.7, 0.2, 0.0):
        train.pass_time(0.1, delay=delay)
    train.pass_time(3.0)
    assert train.data == [(2, pytest.approx(0.15 - PLAN)), (2, pytest.approx(0.14 - PLAN))]


@pytest.mark.parametrize("learning", [HELD, GAUSS])
def test_a_change_of_the_leader_changes_no_difference_between_units(learning):
    train = Train(learning)
    train.slip(0, 0.10)
    train.slip(2, 0.14)
    train.pass_time(0.1)
    before = difference(train.m)
    train.fail(0)
    train.pass_time(0.3)
    assert train.m.lead.unit[0] == 1
    np.testing.assert_array_equal(difference(train.m), before)
    # what the old leader held stands at the new one's place, so a datum to it is the same as before
    train.slip(2, 0.14)
    train.pass_time(0.1)
    assert train.data == [(2, pytest.approx(0.04))] * 2
    train.slip(1, 0.12)  # the new leader's own slip: 0.01 above what the foremost unit would find
    train.slip(3, 0.15)
    train.pass_time(0.1)
    assert train.data[2:] == [(3, pytest.approx(0.15 - 0.12 + train.m.learnt.increment[1]))]
    before = difference(train.m)
    train.fail()
    train.pass_time(0.2)
    assert train.m.lead.unit[0] == 0
    np.testing.assert_array_equal(difference(train.m), before)
    # the slips of then, of either leader, are no data now
    assert len(train.data) == 3


def test_a_datum_to_a_leader_that_is_itself_uncertain_counts_less():
    train = Train(GAUSS)
    train.fail(0)
    train.pass_time(0.1)
    train.slip(1, 0.10)
    train.slip(3, 0.13)
    train.pass_time(0.1)
    noise = 0.012**2 + 0.010**2
    gain = 0.010**2 / (0.010**2 + noise)
    assert train.m.learnt.increment[3] == pytest.approx(0.03 + gain * (0.01 + 0.03 - 0.03))
    assert train.m.learnt.deviation[3] == pytest.approx(0.010 * np.sqrt(1.0 - gain))
    assert train.m.learnt.behind.tolist() == [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("learning", [MEAN, HELD, GAUSS])
@pytest.mark.parametrize("first", [0, 1])
def test_true_increments_are_a_fixed_point(learning, first):
    """Whoever leads: where every slip shows the rail, data are what is stored."""
    train = Train(learning)
    train.fail(*range(first))
    train.pass_time(0.1)
    rail = np.random.default_rng(5).uniform(0.09, 0.12, 12)
    for level in rail:
        train.m.unit.coefficient_estimate[:] = level + np.array(STORED)
        for unit in range(first, 4):
            train.slip(unit, level + STORED[unit])
        train.pass_time(0.2)
    assert len(train.data) == 12 * (3 - first)
    assert train.m.learnt.increment == pytest.approx(STORED, abs=1e-15)


@pytest.mark.parametrize("hide", ["", "relieved", "failed", "blind", "no demand"])
def test_a_unit_tells_only_of_slips_under_its_own_control(hide):
    train = Train(MEAN)
    m, eq = train.m, train.eq
    m.estimate.relief.share[2] = 0.99 if hide == "relieved" else 1.0
    m.in_service[2] = hide != "failed"
    if hide == "blind":
        m.unit.axles_seen[2] = 0.0
        m.axle_seen[eq.axle_unit == 2] = False
    commanded = 0.0 if hide == "no demand" else train.command
    omega = (12.0 + 1.0) / eq.axle_radius
    sense(eq, train.st, m, 0.3, commanded, omega, m.torque, np.zeros(8), np.zeros(20))
    told = np.isfinite(m.report.own[:, DETECTED])
    hidden = {"": [], "no demand": [0, 1, 2, 3]}.get(hide, [2])
    assert told.tolist() == [j not in hidden for j in range(4)]
    np.testing.assert_array_equal(m.report.own[told, DETECTED], 0.3)
    estimate = np.clip(m.unit.coefficient_estimate, 0.0, 1.0)
    np.testing.assert_array_equal(m.report.own[told, ESTIMATE], estimate[told])


def test_a_leader_that_finds_no_coefficient_takes_no_datum():
    for hide in ("relieved", "blind", "failed", "no demand"):
        train = Train(MEAN)
        train.m.unit.coefficient_estimate[0] = 0.0
        if hide == "relieved":
            train.m.estimate.relief.share[0] = 0.99
        elif hide == "blind":
            train.m.unit.axles_seen[0] = 0.0
        elif hide == "failed":  # which the train will know only later
            train.m.torque[0] = 0.0
        else:
            train.m.unit.torque_command[0] = 0.0
        train.slip(2, 0.15)
        train.pass_time(0.2)
        assert train.data == [], hide
        train.m.estimate.relief.share[0], train.m.unit.axles_seen[0] = 1.0, 4.0
        train.m.torque[0] = train.m.unit.torque_command[0] = 500.0
        train.pass_time(0.2)
        assert train.data == [], hide
        train.slip(2, 0.15)
        train.pass_time(0.2)
        assert len(train.data) == 1, hide


def test_what_is_held_must_be_in_force_and_a_report_not_be_older():
    train = Train(HELD)
    train.slip(2, 0.15)
    train.pass_time(0.2)
    assert train.data == []  # the leader has not slipped
    train.slip(0, 0.12)
    train.pass_time(5.0)
    train.slip(2, 0.15)
    train.pass_time(0.2)
    assert train.data == []
    for learning in (MEAN, HELD):
        train = Train(learning)
        train.slip(3, 0.15)
        train.pass_time(5.0, lost=True)
        train.slip(0, 0.12)
        train.pass_time(0.2)
        assert train.data == []


def test_an_own_slip_is_in_force_at_once_in_place_of_leader_and_increment():
    train = Train(HELD)
    train.slip(0, 0.10)
    train.pass_time(0.2)
    assert not train.asked  # nothing has happened since the leader's slip
    assert train.m.cap == pytest.approx([0.10, 0.11, 0.12, 0.13])
    train.slip(2, 0.105)
    train.pass_time(0.06)
    assert train.asked
    assert train.m.cap == pytest.approx([0.10, 0.11, 0.105, 0.13])
    train.slip(0, 0.11)
    train.pass_time(1.0)
    assert train.m.cap == pytest.approx([0.11, 0.12, 0.105, 0.14])
    train.slip(0, 0.11)
    train.pass_time(4.0)  # 5.06 s after its slip it is as the others
    assert train.m.cap == pytest.approx([0.11, 0.12, 0.13, 0.14])


def test_learnt_increments_count_at_once():
    train = Train(replace(HELD, first=1, stored=0.0))
    train.slip(0, 0.10)
    train.slip(2, 0.15)
    train.pass_time(5.0)
    train.slip(0, 0.11)
    train.pass_time(0.1)
    assert train.m.cap == pytest.approx([0.11, 0.12, 0.16, 0.14])
    by_report = Train(replace(HELD, first=1, stored=0.0), trigger="limited")
    by_report.m.unit.torque_target[:] = 1e4
    by_report.m.unit.torque_factor[0] = 0.5
    by_report.m.unit.coefficient_estimate[:] = 0.10
    by_report.m.unit.slipping[2] = 1.0  # else its cap is the plan at least
    by_report.slip(0, 0.10)
    by_report.slip(2, 0.15)
    by_report.pass_time(3.0)
    assert by_report.m.cap[2] == pytest.approx(by_report.m.demonstrated[0] + 0.05, rel=1e-12)
