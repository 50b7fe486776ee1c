"""The on-board computers equal their second transcription, control period by control period, under random signals."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.brakes import (
    brake_receiver,
    foresee_torque,
    restrain_blind_units,
    set_brake_targets,
    set_targets,
)
from alloc.onboard.distribution import distribute, prepare_allocation
from alloc.onboard.equipment import equipment
from alloc.onboard.increment_learning import IncrementLearning
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
from alloc.onboard.telegrams import hear_reports, write_reports
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.rules.rule import Caps, Trigger
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


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("trigger", ["limited", "slip", "own slips"])
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
