"""When the leader asks the rule, and with which caps: single steps on records made by hand, against numbers by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from alloc.onboard.distribution import KEPT, PROBE, prepare_allocation
from alloc.onboard.equipment import equipment
from alloc.onboard.increment_learning import NO_LEARNING
from alloc.onboard.parameters import Onboard
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.rules.rule import Caps, Trigger
from tests.onboard.uneven import uneven_train


def train_memory(first=0, estimate=0.10, units=3):
    """What the leader keeps: it detected a slip at 1 s and must allocate; all units work, and nothing was told."""
    lead = {
        "unit": first, "slipped": 1.0, "detected": 1.0, "estimate": estimate, "allocate": True, "needed": 0.0,
    }  # fmt: skip
    of_units = ("cap", "limit_wanted", "most", "limited_at", "since_limited", "delivered")
    values = {name: np.zeros(units) for name in of_units}
    return SimpleNamespace(
        lead=SimpleNamespace(**{name: np.array([value]) for name, value in lead.items()}),
        train=SimpleNamespace(expected=np.zeros(1), case=np.ones(1), level=np.ones(1)),
        in_service=np.arange(units) >= first,
        limit_max=np.full(units, np.inf),
        demonstrated=np.full(units, np.inf),
        learnt=SimpleNamespace(increment=np.array([0.01, 0.03, 0.06])[:units]),
        upper_bound=np.full(units, np.inf),
        by_rail=np.ones(units, bool),
        limited=np.zeros(units, bool),
        slipping=np.zeros(units, bool),
        report=SimpleNamespace(
            limited_at=np.full(units, -np.inf), slipped_at=np.full(units, -np.inf)
        ),
        **values,
    )


def rules(trigger=Trigger.LIMITED, caps=Caps.FRONT):
    """Settings of a rule that is asked so, with these caps."""
    return SimpleNamespace(
        hold_time=5.0, rise_time=1.0, period=0.01, learning=SimpleNamespace(learner=NO_LEARNING),
        rule=RuleSettings(0, trigger, caps), telegrams=SimpleNamespace(ticks=10),
    )  # fmt: skip


EQUIPMENT = SimpleNamespace(
    axles=np.full(3, 4.0),
    mass=np.array([1.0, 0.8, 1.2]),
    own_inertia=np.zeros(3),
    brake_inertia=np.full(3, 9.0),
    blended=False,
    brake_share=0.3,
    planned_share=0.2,
)


def prepare(memory, settings, time=2.0, tick=7, failed=False):
    """Whether the rule is asked at this instant, under a demand of 0.8 m/s2: a plan of 0.16."""
    return prepare_allocation(EQUIPMENT, settings, memory, time, tick, 0.8, failed)


@pytest.mark.parametrize(
    ("first", "caps"), [(0, [0.10, 0.12, 0.15]), (1, [0.08, 0.10, 0.13]), (2, [0.05, 0.07, 0.10])]
)
def test_increments_count_from_the_unit_that_leads(first, caps):
    """(5) with the increments 0.01, 0.03, 0.06: where units ahead have failed, the first sound one is the reference."""
    memory = train_memory(first)
    assert prepare(memory, rules(Trigger.SLIP))
    assert memory.cap == pytest.approx(caps, rel=1e-12)
    assert memory.train.expected[0] == pytest.approx(0.16, rel=1e-12)
    memory.lead.estimate[0] = 0.03
    prepare(memory, rules(Trigger.SLIP))
    assert memory.cap == pytest.approx(np.maximum(np.array(caps) - 0.07, 0.0), abs=1e-15)


def test_a_new_leader_takes_the_old_ones_estimate_over_at_its_own_place():
    """The rail under unit 0 carried 0.10; under unit 1 that is 0.12, so that the caps stand as they stood."""
    memory = train_memory()
    memory.in_service[0] = False
    assert prepare(memory, rules(Trigger.SLIP))
    assert memory.lead.unit[0] == 1
    assert memory.lead.estimate[0] == pytest.approx(0.12, rel=1e-12)
    assert memory.cap == pytest.approx([0.10, 0.12, 0.15], rel=1e-12)
    memory.in_service[0] = True
    prepare(memory, rules(Trigger.SLIP))
    assert memory.lead.estimate[0] == pytest.approx(0.10, rel=1e-12)


@pytest.mark.parametrize("slipped", [1.0, -np.inf])
@pytest.mark.parametrize(("time", "asked"), [(6.0, True), (6.01, False)])
def test_the_slip_signal_asks_until_the_hold_time_is_over(time, asked, slipped):
    memory, settings = train_memory(), rules(Trigger.SLIP)
    memory.lead.slipped[0] = slipped  # counts for rules that are asked with every telegram only
    assert prepare(memory, settings, time) == asked
    assert (memory.train.case[0] != 0.0) == asked
    assert memory.limit_wanted.tolist() == ([0.0] * 3 if asked else pytest.approx([0.16] * 3))
    assert prepare(memory, settings, time) == asked  # it is still marked
    memory.lead.allocate[0] = False
    assert not prepare(memory, settings, time)
    periodic = rules(Trigger.SLIPPING)
    assert prepare(memory, periodic, time, tick=20) == (asked and slipped == 1.0)
    assert not prepare(memory, periodic, time, tick=21)


def told(limited=(), delivered=(0.16, 0.16, 0.16), slipping=(), at=2.0):
    """Memory of a leader that has heard of these units that they are limited or slip, and what all deliver."""
    memory = train_memory()
    memory.train.expected[0] = 0.2 * 0.8
    memory.report.limited_at[list(limited)] = at
    memory.limited[list(limited)] = True
    memory.slipping[list(slipping)] = True
    memory.report.slipped_at[list(slipping)] = at
    memory.delivered[:] = delivered
    return memory


def test_nobody_is_asked_while_nothing_limits_the_train():
    memory = told()
    assert not prepare(memory, rules(), tick=20)
    assert memory.train.case[0] == 0.0
    assert memory.limit_wanted == pytest.approx([0.16] * 3)
    assert prepare(told(), rules(Trigger.TELEGRAM), tick=20)
    assert prepare(told(), rules(Trigger.PERIOD, Caps.TRUE), tick=21)


def test_a_rule_with_caps_of_its_own_goes_by_reports_whatever_the_trigger():
    for trigger in ("limited", "slip"):
        rule = settings(Onboard(trigger=trigger), RuleSettings(0, caps=Caps.DELIVERED), "none").rule
        assert prepare(told([1]), rules(*rule[1:]), tick=20)
        assert not prepare(told(), rules(*rule[1:]), tick=20)
    assert not prepare(told([1]), rules(Trigger.SLIP), tick=20, time=7.0)


@pytest.mark.parametrize(("time", "asked"), [(2.0, True), (2.99, True), (3.0, False)])
@pytest.mark.parametrize("unit", range(3))
def test_a_rule_is_asked_with_every_telegram_while_any_unit_is_limited(unit, time, asked):
    memory = told([unit])
    assert prepare(memory, rules(), time, tick=20) == asked
    assert not prepare(memory, rules(), time, tick=21)
    assert prepare(memory, rules(), time, tick=21, failed=True) == asked


def test_a_failed_unit_asks_at_once_and_for_as_long_as_it_lasts():
    memory = told()
    memory.in_service[2], memory.limit_max[2] = False, 0.0
    assert prepare(memory, rules(), time=100.0, tick=21, failed=True)
    assert prepare(memory, rules(), time=100.0, tick=20)
    assert not prepare(memory, rules(), time=100.0, tick=21)


def test_caps_follow_from_the_mark_of_the_foremost_limited_unit():
    """Unit 1 is limited at 0.15: 0.13 ahead of it, 0.18 behind. Who is not limited and does not slip may have the plan."""
    memory = told([1], delivered=(0.16, 0.15, 0.16))
    prepare(memory, rules(), tick=20)
    assert memory.cap == pytest.approx([0.16, PROBE * 0.15, 0.18], rel=1e-12)
    memory = told([1], delivered=(0.17, 0.15, 0.16))
    prepare(memory, rules(), tick=20)
    assert memory.cap[0] == pytest.approx(0.17, rel=1e-12)
    memory = told([1], delivered=(0.16, 0.15, 0.16), slipping=[0])
    prepare(memory, rules(), tick=20)
    assert memory.cap == pytest.approx([0.13, PROBE * 0.15, 0.18], rel=1e-12)
    memory = told([1, 2], delivered=(0.05, 0.15, 0.02))
    prepare(memory, rules(), tick=20)
    assert memory.cap == pytest.approx([0.16, PROBE * 0.15, PROBE * 0.02], rel=1e-12)


def test_no_cap_is_below_zero():
    """Unit 1 carries 0.01, which leaves -0.01 for the unit ahead of it, which slips; so none is left."""
    memory = told([1], delivered=(0.16, 0.01, 0.16), slipping=[0])
    prepare(memory, rules(), tick=20)
    assert memory.cap == pytest.approx([0.0, PROBE * 0.01, 0.16], abs=1e-15)


def test_a_limited_unit_that_slips_is_held_below_its_mark_for_the_hold_time():
    for time, cap in ((2.0, KEPT * 0.15), (7.0, KEPT * 0.15), (7.01, PROBE * 0.15)):
        memory = told([1], delivered=(0.16, 0.15, 0.16), slipping=[1])
        memory.report.limited_at[1] = time
        prepare(memory, rules(), time, tick=20)
        assert memory.cap[1] == pytest.approx(cap, rel=1e-12)


@pytest.mark.parametrize("slipping", [[1], []])
@pytest.mark.parametrize("caps", [Caps.DELIVERED, Caps.FRONT])
def test_a_mark_is_the_best_while_limited_and_moves_slowly(slipping, caps):
    """A telegram lasts 0.1 s: a fiftieth of the way down, with 5 s; up 1 % of the plan per second."""
    memory = told([1], delivered=(0.16, 0.15, 0.16), slipping=slipping)
    prepare(memory, rules(caps=caps), tick=20)
    assert memory.demonstrated.tolist() == [np.inf, 0.15, np.inf]
    # its controller must limit the torque, not its limit: there is room to look for the peak
    assert memory.upper_bound == pytest.approx([np.inf, PROBE * 0.15, np.inf], rel=1e-12)
    memory.delivered[1] = 0.10
    prepare(memory, rules(caps=caps), tick=30)
    assert (
        memory.upper_bound[1]
        == memory.demonstrated[1]
        == pytest.approx(0.15 - 0.05 / 50, rel=1e-12)
    )
    memory.delivered[1] = 0.155
    prepare(memory, rules(caps=caps), tick=40)
    assert memory.demonstrated[1] == pytest.approx(0.155, rel=1e-12)
    memory.limited[1], memory.delivered[1] = False, 0.152
    prepare(memory, rules(caps=caps), tick=50)
    assert memory.demonstrated[1] == pytest.approx(0.155 + 0.001 * 0.16, rel=1e-12)
    # held at its mark it would reach its target, and stop to search
    upper_bound = memory.demonstrated[1] if slipping else PROBE * 0.152
    assert memory.upper_bound[1] == pytest.approx(upper_bound, rel=1e-12)
    assert not prepare(memory, rules(caps=caps), time=9.0, tick=60)
    assert (
        np.isinf(memory.demonstrated).all() & np.isinf(memory.upper_bound).all()
    )  # the rail of then is not that of now


def test_a_unit_that_failed_says_nothing_of_the_rail():
    memory = told([0, 1], delivered=(0.0, 0.15, 0.16))
    memory.in_service[0], memory.limit_max[0] = False, 0.0
    prepare(memory, rules(), tick=20)
    assert memory.cap == pytest.approx([0.0, PROBE * 0.15, 0.18], rel=1e-12)
    only = told([0], delivered=(0.0, 0.16, 0.16))
    only.in_service[0], only.limit_max[0], only.by_rail[0] = False, 0.0, False
    prepare(only, rules(), tick=20)
    # nothing is known of the rail: the others need no more than what makes up for a third of the mass, 1 of 3
    assert only.cap == pytest.approx([0.0, 0.24, 0.24], rel=1e-12)
    only.limit_max[2] = 0.12  # (1.0 x 0.16 + 1.2 x 0.04) / 0.8 beyond the plan
    prepare(only, rules(), tick=20)
    assert only.cap == pytest.approx([0.0, 0.42, 0.42], rel=1e-12)


def test_a_unit_that_limits_itself_says_nothing_of_the_rail_either():
    """Unit 0 sees none of its axles and pulls with half of the plan; the other two make up for it."""
    memory = told([0], delivered=(0.08, 0.16, 0.16))
    memory.by_rail[0] = False
    prepare(memory, rules(), tick=20)
    enough = 0.16 + (0.16 - 0.08) / (0.8 + 1.2)
    assert memory.cap == pytest.approx([0.08, enough, enough], rel=1e-12)
    memory.demonstrated[0] = 0.16  # what it did while it saw its axles does not count
    prepare(memory, rules(), tick=20)
    assert memory.cap == pytest.approx([0.08, enough, enough], rel=1e-12)
    memory.delivered[0] = 0.17  # it has all that it may have
    prepare(memory, rules(), tick=20)
    assert memory.cap == pytest.approx([0.16] * 3, rel=1e-12)


def test_limits_rise_beyond_the_plan_no_faster_than_torque():
    """A telegram lasts 0.1 s: at 0.6 of the plan per rise time, 0.6 x 0.16 x 0.1 above what stood, or above the plan."""
    memory = told([0])
    memory.limit_wanted[:] = [0.10, 0.16, 0.18]
    memory.limit_max[1] = 0.165
    prepare(memory, rules(), tick=20)
    assert memory.most == pytest.approx([0.1696, 0.165, 0.1896], rel=1e-12)
    memory = told([0])
    prepare(memory, rules(Trigger.PERIOD, Caps.TRUE), tick=20)
    assert np.isinf(memory.most).all()


class Braking:
    """Computers of a train under blended brakes whose trailers' brakes have risen half way; a unit is limited."""

    def __init__(self):
        onboard = Onboard()
        self.eq = equipment(build(uneven_train(), Rail(0.15)), onboard)
        self.st = settings(onboard, RuleSettings(0, caps=Caps.DELIVERED), "none")
        self.m = memory(self.eq, 12.0, 0.0)
        self.m.lead.brake_rise[0] = 0.5
        self.plan = 0.8 * self.eq.brake_share

    def needed(self, st=None):
        prepare_allocation(self.eq, st or self.st, self.m, 2.0, 20, -0.8, False)
        return self.m.lead.needed[0]


def test_units_make_up_for_what_the_trailers_shoes_lack():
    train = Braking()
    group, eq = train.eq.group, train.eq
    trailing = group.unit < 0
    assert trailing.sum() == 4
    wanted = 0.5 * train.plan * (group.axles * group.weight)[trailing].sum()
    lacking = wanted / (eq.axles * eq.axle_load).sum()
    assert train.needed() == pytest.approx(train.plan + lacking, rel=1e-12)
    # shoes that give what is wanted of them leave nothing to make up for; the units' own do not count
    a, b, c = group.friction.T
    friction = a / (3.6 * 12.0 + b) + c
    force = 0.5 * train.plan * group.weight * (1.0 + group.inertia)
    train.m.pressure[:] = np.where(trailing, force / (group.gain * friction), 1e5)
    assert train.needed() == pytest.approx(train.plan, rel=1e-12)
    train.m.pressure[trailing] *= 0.25
    assert train.needed() == pytest.approx(train.plan + 0.75 * lacking, rel=1e-12)


def test_rules_that_know_no_more_than_the_patent_leave_the_trailers_to_themselves():
    train = Braking()
    st = train.st._replace(rule=train.st.rule._replace(caps=Caps.FRONT))
    assert train.needed(st) == train.plan
