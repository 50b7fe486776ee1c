"""The on-board computers equal their second transcription, control period by control period, under random signals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from alloc.onboard.brakes import (
    brake_receiver,
    foresee_torque,
    restrain_blind_units,
    set_brake_targets,
    set_targets,
)
from alloc.onboard.distribution import (
    PROBE,
    ROOM,
    distribute,
    prepare_allocation,
)
from alloc.onboard.equipment import equipment
from alloc.onboard.increment_learning import NO_LEARNING, IncrementLearning
from alloc.onboard.laws import SUPPLY
from alloc.onboard.parameters import (
    Belief,
    Braking,
    Dropout,
    Onboard,
    ReferenceSpeed,
    Sensors,
    Telegrams,
)
from alloc.onboard.sensing import sense
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.onboard.telegrams import (
    DETECTED,
    ESTIMATE,
    SLOTS,
    caps_by_slips,
    channel,
    collect,
    count_slips,
    hear_reports,
    send,
    write_reports,
)
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.rules.rule import Caps, Trigger
from tests.cases import looped
from tests.onboard.uneven import uneven_train
from tests.uncompiled.computers import Computers

GROWTH = tuple(0.002 * k + 0.0003 * k**2 for k in range(20))


ONBOARD = Onboard(
    belief=Belief(increments=GROWTH),
    sensors=Sensors(load_error=0.03, seed=2),
    telegrams=Telegrams(period=0.04, latency=0.02, jitter=0.03, loss=0.2, silence=0.1),
    reference=ReferenceSpeed(source="truth"),
    hold_time=0.3,
    rise_time=0.15,
)


LOST = tuple(
    Dropout(axle, 0.05, until)
    for axle, until in ((1, 0.2), (4, 0.3), (5, 0.3), (6, 0.25), (7, 0.3))
)


ONBOARDS = {
    "plain": (ONBOARD, {}, True),
    "coupled": (ONBOARD, {"coupled": True}, False),
    "dropouts": (replace(ONBOARD, sensors=replace(ONBOARD.sensors, dropouts=LOST)), {"coupled": True}, True),
    "blind": (replace(ONBOARD, sensors=replace(ONBOARD.sensors, dropouts=LOST)), {}, False),
    "sensorless": (
        replace(ONBOARD, sensors=Sensors(sensorless_pole=30.0, speed_quantum=0.02, radius_error=0.004, seed=4)), {}, False,
    ),
    "without air": (replace(ONBOARD, inertia_in_limit=False), {"braked": False}, True),
    "not blended": (replace(ONBOARD, braking=Braking(blended=False)), {}, False),
    "as printed": (
        replace(ONBOARD, braking=Braking(blend_time=0.3, inertia_in_estimate=False, air_force="command")),
        {}, True,
    ),
    "running mean": (
        replace(ONBOARD, learning=IncrementLearning("running-mean", first=2, further=1, stored=3.0)), {}, False,
    ),
    "running mean, held": (
        replace(ONBOARD, learning=IncrementLearning("running-mean", "held", first=1, further=2)), {"coupled": True}, True,
    ),
    "gaussian": (
        replace(
            ONBOARD, sensors=replace(ONBOARD.sensors, dropouts=LOST), learning=IncrementLearning("gaussian", drift=1e-5)
        ),
        {}, False,
    ),
    "gaussian, held": (replace(ONBOARD, learning=IncrementLearning("gaussian", "held")), {}, False),
}  # fmt: skip


def agree(name, found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12, err_msg=name)


def compare(m, twin, names):
    for name, value in names.items():
        agree(name, value, getattr(twin, name))
    for name, count in twin.counts.items():
        assert getattr(m.counter, name)[0] == count, name


@looped("seed", range(3))
@looped("trigger", ["limited", "slip", "own slips"])
@pytest.mark.parametrize("case", ONBOARDS)
def test_periods_equal_their_second_transcription(case, trigger, seed):
    onboard, options, periodic = ONBOARDS[case]
    own_slips = trigger == "own slips"
    onboard = replace(onboard, trigger="slip" if own_slips else trigger)
    rng = np.random.default_rng(seed)
    model = build(uneven_train(**options), Rail(0.15))
    eq = equipment(model, onboard)
    rule = RuleSettings(0, Trigger.STEPWISE if periodic else Trigger.LIMITED)
    if own_slips:
        rule = RuleSettings(0, Trigger.ANY_SLIP, Caps.DETECTED)
    st = settings(onboard, rule, "none")
    speed, n, groups = 12.0, eq.axles.size, eq.group.unit.size
    m, twin = memory(eq, speed, 0.08), Computers(eq, st, speed, 0.08)
    pressure, valve = np.zeros(groups), np.zeros(groups)
    direction, commanded = (1.0, -1.0, -1.0)[seed], 0.0
    failing, away, asked = rng.random(n) < 0.3, rng.random() < 0.5, 0
    for tick in range(45):
        time = tick * st.period
        if tick % 6 == 0:
            commanded = float(direction * rng.choice([0.0, 0.4, 0.8, 1.0]))
        speed += 0.5 * commanded * st.period
        slip = direction * rng.exponential(0.25, eq.axle_radius.size) * (rng.random() < 0.6)
        omega = (speed + slip + 0.3 * rng.standard_normal() * (tick % 4 == 0)) / eq.axle_radius
        noise = 0.02 * rng.standard_normal(omega.size)
        torque = direction * rng.uniform(-50.0, 600.0, n)
        service = ~(failing & (tick > 20)) | (tick > 35)
        failed = bool((service != m.in_service).any())
        m.in_service[:] = service
        cylinders = rng.uniform(0.0, 300e3, groups)
        twin.reference = m.reference[:] = speed + 0.05 * rng.standard_normal(m.reference.size)
        sense(eq, st, m, time, commanded, omega, torque, cylinders, noise)
        twin.sense(time, commanded, omega, torque, cylinders, noise, service)
        compare(m, twin, {
            "speed": m.speed, "reference": m.reference, "axle_omega": m.axle_omega, "worst_slip": m.worst_slip,
            "acceleration": m.unit.computed_acceleration, "coefficient": m.unit.coefficient_estimate,
            "slipping": m.unit.slipping, "drive_limit": m.drive_limit,
            "brake_limit": m.brake_limit, "limit_max": m.limit_max, "torque": m.torque,
            "estimate": m.lead.estimate[0], "slipped": m.lead.slipped[0], "detected": m.lead.detected[0],
            "axles_seen": m.unit.axles_seen, "allocate": m.lead.allocate[0], "air_there": m.air_force,
        })  # fmt: skip
        delay, fate = rng.random((2, n))
        factor = m.unit.torque_factor[:] = np.where(
            rng.random(n) < 0.7, 1.0, rng.uniform(0.9, 1.0, n)
        )
        relieved, slides = rng.random(n) < 0.1, rng.random(groups) < 0.03
        m.estimate.relief.share[:] = 1.0 - 0.5 * relieved
        m.slide.action[:] = np.where(slides, 2, SUPPLY)
        sliding = np.isin(np.arange(n), eq.group.unit[slides])
        write_reports(eq, st, m, time, commanded)
        hear_reports(eq, st, m, time, tick, delay, fate)
        twin.report(time, tick, commanded, delay, fate, factor, relieved, sliding)
        m.estimate.relief.share[:] = 1.0
        compare(m, twin, {"delivered": m.delivered, "limited": m.limited, "slips": m.slipping,
                          "limited_at": m.report.limited_at, "slipped_at": m.report.slipped_at,
                          "by_rail": m.by_rail})  # fmt: skip
        # the leader knows whether it is relieved when it compares
        m.estimate.relief.share[:] = 1.0 - 0.5 * relieved
        needed = prepare_allocation(eq, st, m, time, tick, commanded, failed)
        m.estimate.relief.share[:] = 1.0
        assert needed == twin.prepare(time, tick, commanded, failed)
        asked += needed
        compare(m, twin, {"cap": m.cap, "first": m.lead.unit[0], "estimate": m.lead.estimate[0],
                          "marks": m.demonstrated, "upper_bound": m.upper_bound, "increment": m.learnt.increment,
                          "spread": m.learnt.deviation, "heard_of": m.learning.taken_at})  # fmt: skip
        agree("number of data", m.learning.series.increment_data.sum(), len(twin.data))
        if needed and trigger == "limited":
            agree("most", m.most, twin.most)
        if needed:  # any answer will do
            twin.limit_wanted = m.limit_wanted[:] = twin.expected * rng.uniform(0.3, 1.2, n)
            twin.limit_wanted = twin.limit_wanted.copy()
            twin.case = m.train.case[0] = float(rng.integers(1, 3))
            m.train.level[0] = 0.1
        elif m.train.case[0] == 0.0:
            assert np.isnan(m.train.level[0])
        delay, fate = rng.random((2, n))
        if away and tick > 12:
            fate[:] = 0.0  # the line is dead: units fall back
        distribute(eq, st, m, time, tick, delay, fate)
        twin.distribute(time, tick, delay, fate)
        compare(m, twin, {
            "limit": m.unit.limit, "limit_wanted": m.limit_wanted, "received": m.received,
            "fallen_back": m.unit.fallen_back, "case": m.train.case[0], "expected": m.train.expected[0],
        })  # fmt: skip
        braking = eq.blended and commanded < 0.0
        if braking:
            set_brake_targets(eq, st, m)
            twin.brake_targets()
        else:
            set_targets(eq, st, m, commanded)
            twin.targets(commanded)
        restrain_blind_units(st, m)
        twin.restrain()
        compare(m, twin, {"target": m.unit.torque_target, "air": m.unit.air_brake_force, "rise": m.rise,
                          "brake_rise": m.lead.brake_rise[0], "taken": m.taken, "kept": m.kept})  # fmt: skip
        twin.torque_command = m.unit.torque_command[:] = m.unit.torque_target * rng.uniform(
            0.6, 1.0, n
        )
        twin.torque_command = twin.torque_command.copy()
        for j in range(n):
            foresee_torque(eq, m, j, m.unit.torque_command[j])
        twin.foresee(twin.torque_command)
        brake_receiver(eq, st, m, tick, braking, pressure, valve)
        agree("pressure", pressure, twin.pressures(braking))
    assert asked > 2
    assert (len(twin.data) > 5) >= ("held" in case)


def test_a_train_without_motors_has_nobody_to_tell_and_brakes_by_plan():
    train = uneven_train()
    model = build(replace(train, cars=(train.cars[0], train.cars[4])), Rail(0.15))
    onboard = Onboard(rise_time=0.02, reference=ReferenceSpeed(source="truth"))
    eq = equipment(model, onboard)
    st = settings(onboard, RuleSettings(0, Trigger.PERIOD, Caps.TRUE), "none")
    m, pressure, valve = memory(eq, 10.0, 0.0), np.zeros(4), np.zeros(4)
    empty, omega = np.zeros(0), 10.0 / eq.axle_radius
    for tick in range(3):
        sense(eq, st, m, 0.01 * tick, -0.8, omega, empty, pressure, np.zeros(8))
        write_reports(eq, st, m, 0.01 * tick, -0.8)
        hear_reports(eq, st, m, 0.01 * tick, tick, empty, empty)
        assert not prepare_allocation(eq, st, m, 0.01 * tick, tick, -0.8, False)
        distribute(eq, st, m, 0.01 * tick, tick, empty, empty)
        set_brake_targets(eq, st, m)
        brake_receiver(eq, st, m, tick, True, pressure, valve)
    assert m.lead.brake_rise[0] == 1.0
    assert m.counter.telegrams_sent[0] == 0
    a, b, c = eq.group.friction.T
    force = eq.group.gain * pressure * (a / (3.6 * m.reference[0] + b) + c)
    np.testing.assert_allclose(
        (force * eq.group.axles).sum(), 0.8 * train_mass(model, eq), rtol=1e-9
    )


def train_mass(model, eq):
    """Mass with what the wheelsets resist, up to how much the foremost axle of a bogie differs from the other."""
    return float(
        (eq.group.weight / 9.80665 * (1.0 + eq.group.inertia) * eq.group.axles).sum()
        * eq.brake_share
        * 9.80665
    )


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
        mark=np.zeros(units),
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


@looped(
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


def test_a_unit_that_searches_has_room_where_the_rule_goes_by_its_own_mark():
    own = rules(caps=Caps.DELIVERED)
    memory = told([1], delivered=(0.16, 0.15, 0.16))
    prepare(memory, own, tick=20)
    assert memory.upper_bound[1] == pytest.approx(ROOM * 0.15, rel=1e-12)
    assert memory.cap[1] == 0.15
    memory = told([1], delivered=(0.16, 0.15, 0.16), slipping=[1])
    prepare(memory, own, tick=20)
    assert memory.upper_bound[1] == pytest.approx(PROBE * 0.15, rel=1e-12)


OWN = rules(Trigger.TELEGRAM, Caps.DELIVERED)


def test_who_was_never_limited_counts_as_the_best_of_those_that_were():
    memory = told([0, 1], delivered=(0.12, 0.18, 0.16))
    prepare(memory, OWN, tick=20)
    assert memory.mark == pytest.approx([0.12, 0.18, 0.18], rel=1e-12)
    assert memory.cap == pytest.approx([0.12, 0.18, np.inf], rel=1e-12)
    none = told()
    prepare(none, OWN, tick=20)
    assert none.mark == pytest.approx([0.16] * 3, rel=1e-12)  # the plan


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


class BrakedTrain:
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
    train = BrakedTrain()
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
    train = BrakedTrain()
    st = train.st._replace(rule=train.st.rule._replace(caps=Caps.FRONT))
    assert train.needed(st) == train.plan


UNITS = 3


def said(value):
    """What each unit would say: one number and its negative."""
    return np.array([[value + j, -value - j] for j in range(UNITS)])


@looped("seed", range(5))
def test_what_is_read_is_what_was_sent_last_of_all_that_has_arrived(seed):
    line = channel(UNITS, 2, np.inf)
    rng = np.random.default_rng(seed)
    posted = []
    for tick in range(200):
        time = 0.01 * tick
        if tick % 3 == 0 and rng.random() < 0.8:
            delay = rng.uniform(0.0, 0.12)
            send(line, 2, time, delay, said(time))
            posted.append((time + delay, time))
        collect(line, 2, time)
        arrived = [sent for arrival, sent in posted if arrival <= time + 1e-9]
        if arrived:
            assert line.newest[2] == max(arrived)
            assert line.read[2, 0] == max(arrived) + 2
        else:
            assert np.isinf(line.read[2, 0])


def test_a_line_carries_sixteen_telegrams_and_what_is_more_is_lost():
    line = channel(UNITS, 2, np.inf)
    assert SLOTS == 16
    for k in range(SLOTS + 3):
        send(line, 1, 0.1 * k, 10.0, said(float(k)))
    assert collect(line, 1, 100.0)
    assert line.read[1, 0] == SLOTS - 1 + 1  # unit 1 says one more
    assert np.isinf(line.arrival).all()
    send(line, 1, 200.0, 0.0, said(70.0))
    assert collect(line, 1, 200.0)
    assert line.read[1, 0] == 71.0


SHARED_PLAN, HOLD = 0.16, 5.0


INCREMENTS = SimpleNamespace(increment=np.array([0.01, 0.03, 0.06, 0.07]))


HOLDING = SimpleNamespace(hold_time=HOLD)


def heard(**slips):
    """Memory of a leader that has heard of slips: `u1=(0.12, 3.0)` is unit 1, which found 0.12 at 3 s."""
    read = np.tile([SHARED_PLAN, np.nan, -np.inf, 0.0, -np.inf], (4, 1))
    for unit, (estimate, detected) in slips.items():
        read[int(unit[1:]), [ESTIMATE, DETECTED]] = estimate, detected
    report = SimpleNamespace(line=SimpleNamespace(read=read), counted=np.full(4, -np.inf))
    train = SimpleNamespace(expected=np.array([SHARED_PLAN]))
    return SimpleNamespace(report=report, train=train, learnt=INCREMENTS, cap=np.zeros(4))


def caps(time, **slips):
    memory = heard(**slips)
    assert count_slips(HOLDING, memory, time) == (True, True)
    caps_by_slips(HOLDING, memory, time)
    return memory.cap


def test_the_leaders_slip_alone_gives_the_caps_of_equation_5():
    assert caps(4.0, u0=(0.10, 3.0)) == pytest.approx([0.10, 0.12, 0.15, 0.16], rel=1e-12)
    assert caps(4.0, u0=(0.0, 3.0)) == pytest.approx([0.0, 0.02, 0.05, 0.06], rel=1e-12)


@looped(("time", "own"), [(3.5 + HOLD, 0.19), (3.51 + HOLD, 0.15)])
def test_a_slip_older_than_the_hold_time_gives_no_cap(time, own):
    found = caps(time, u0=(0.10, 6.0), u2=(0.19, 3.5))
    assert found == pytest.approx([0.10, 0.12, own, 0.16], rel=1e-12)


def test_a_slip_in_the_rear_alone_leaves_the_plan_to_the_units_ahead():
    assert caps(4.0, u2=(0.11, 3.5)) == pytest.approx(
        [SHARED_PLAN, SHARED_PLAN, 0.11, 0.12], rel=1e-12
    )


PLAN, STORED = 0.16, (0.0, 0.01, 0.02, 0.03)


MEAN = IncrementLearning("running-mean", first=3, further=2, stored=4.0)


@looped("hide", ["", "relieved", "failed", "blind", "no demand"])
def test_a_unit_tells_only_of_slips_under_its_own_control(hide):
    belief = Belief(unit_increments=STORED)
    onboard = Onboard(belief=belief, learning=MEAN, reference=ReferenceSpeed(source="truth"))
    eq = equipment(build(uneven_train(), Rail(0.15)), onboard)
    st, m = settings(onboard, RuleSettings(0), "none"), memory(eq, 12.0, PLAN)
    m.unit.torque_command[:] = m.torque[:] = 500.0
    m.unit.coefficient_estimate[:] = PLAN
    m.estimate.relief.share[2] = 0.99 if hide == "relieved" else 1.0
    m.in_service[2] = hide != "failed"
    if hide == "blind":
        m.unit.axles_seen[2] = 0.0
        m.axle_seen[eq.axle_unit == 2] = False
    commanded = 0.0 if hide == "no demand" else PLAN / eq.planned_share
    omega = (12.0 + 1.0) / eq.axle_radius
    sense(eq, st, m, 0.3, commanded, omega, m.torque, np.zeros(8), np.zeros(20))
    told = np.isfinite(m.report.own[:, DETECTED])
    hidden = {"": [], "no demand": [0, 1, 2, 3]}.get(hide, [2])
    assert told.tolist() == [j not in hidden for j in range(4)]
    np.testing.assert_array_equal(m.report.own[told, DETECTED], 0.3)
    estimate = np.clip(m.unit.coefficient_estimate, 0.0, 1.0)
    np.testing.assert_array_equal(m.report.own[told, ESTIMATE], estimate[told])
