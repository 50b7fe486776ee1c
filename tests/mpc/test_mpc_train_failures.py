"""Motors that fail under the joint MPC, and telegrams that count: what is then wanted of whom, and on what knowledge."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.loop import REPORT_DELAY
from alloc.onboard.host import HostedController
from alloc.onboard.parameters import Belief, Braking, Onboard, Sensors, Telegrams
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.simulation import DriverCommand, Event, simulate
from mpc.hosted import MPC_CAR, MPC_TRAIN_IDEAL
from mpc.train import TrainMpc

FAILURE = 2.0
KNOWN = FAILURE + REPORT_DELAY
TOLD = KNOWN + 0.3
"""From then on every unit has an order that was made after the failure was known."""


class Noting(TrainMpc):
    """Notes what it is asked, tells and reads in every control period; spoils reports of a unit on request."""

    spoilt = None

    def __init__(self, contexts, settings=None):
        super().__init__(contexts, settings)
        self.notes = []

    def decide(self, senses):
        read = self.reports.read.copy(), self.orders.read.copy()
        heard = np.array([self.reports.heard, self.orders.heard])
        answers = super().decide(senses)
        if self.spoilt is not None and not senses[self.spoilt].in_service:
            self.reports.message[self.spoilt, 1:] = -7.0
        told = self.orders.message.copy()
        self.notes.append((senses, self._leader, *read, told, heard))
        return answers


def _event(failures=None, telegrams=None, level=0.3, seed=0, blended=False, **values):
    """The commuter set, of four units, on even rail."""
    model = build(find_set("commuter-8car"), Rail(level), failures=failures)
    onboard = Onboard(
        belief=Belief(), braking=Braking(blended=blended), telegrams=telegrams or Telegrams(),
        sensors=Sensors(seed=seed),
    )  # fmt: skip
    defaults = {"duration": 5.0, "initial_speed": 3.0}
    return Event("failing", model, DriverCommand((0.2,), (0.7,)), onboard, **(defaults | values))


def _run(event, spoilt=None):
    """The run, and its notes as arrays over the control periods: time, leader, read, told, limits, plan."""
    made = []

    def factory(contexts):
        made.append(Noting(contexts, contexts[0].settings))
        made[0].spoilt = spoilt
        return made[0]

    run = simulate(event, "alone", HostedController("noting", "mpc-train that notes", factory))
    notes = made[0].notes
    return run, {
        "time": np.array([senses[0].time for senses, *_ in notes]),
        "leader": np.array([note[1] for note in notes]),
        "reports": np.array([note[2] for note in notes]),
        "orders": np.array([note[3] for note in notes]),
        "told": np.array([note[4] for note in notes]),
        "heard": np.array([note[5] for note in notes]),
        "limit": np.array([[s.drive_limit * s.in_service for s in note[0]] for note in notes]),
        "planned": np.array([[s.planned for s in note[0]] for note in notes]),
        "target": np.array([[s.target for s in note[0]] for note in notes]),
    }


@pytest.fixture(scope="module")
def failed():
    return {unit: _run(_event({unit: FAILURE})) for unit in (0, 2)}


@pytest.mark.parametrize("unit", [0, 2])
def test_a_failed_unit_is_asked_for_nothing_and_the_others_for_the_plan(failed, unit):
    run, notes = failed[unit]
    torque = notes["told"][:, :, 0]
    made = np.isfinite(torque).all(axis=1)
    known = made & (notes["time"] >= KNOWN + 0.1)
    assert np.all(torque[known, unit] == 0.0)
    assert np.all(torque[made & (notes["time"] < KNOWN - 1e-9), unit] > 0.0)
    # what was planned for it the others carry, as evenly as they are
    late = notes["time"] >= TOLD + 1.0
    others = [j for j in range(4) if j != unit]
    np.testing.assert_allclose(
        torque[late].sum(axis=1), notes["planned"][late].sum(axis=1), rtol=0.01
    )
    np.testing.assert_allclose(
        torque[late][:, others], notes["planned"][late][:, others] * 4 / 3, rtol=0.02
    )
    late = run["time"].values >= TOLD + 1.0
    delivered = run["motor_torque"].values[late].sum(axis=1)
    np.testing.assert_allclose(
        delivered, run["torque_target"].values[late].max(axis=1) * 4.0, rtol=0.02
    )
    assert run.attrs["controller_failures"] == 0


def test_what_is_planned_is_the_target_of_motors_that_work_whether_or_not_they_do(failed):
    _, notes = failed[2]
    steady = notes["time"] >= 1.5
    np.testing.assert_allclose(
        notes["target"][steady][:, [0, 1, 3]], notes["planned"][steady][:, [0, 1, 3]]
    )
    np.testing.assert_allclose(notes["planned"][steady], notes["planned"][-1, 0], rtol=0.01)
    assert np.all(notes["target"][notes["time"] >= KNOWN + 0.1, 2] == 0.0)


@pytest.mark.parametrize("unit", [0, 2])
@pytest.mark.parametrize("loss", [0.0, 0.7])
def test_orders_exceed_neither_the_demand_nor_the_motors_in_service(failed, unit, loss):
    lossy = _event({unit: FAILURE}, Telegrams(loss=loss, jitter=0.05, silence=0.5))
    _, notes = failed[unit] if loss == 0.0 else _run(lossy)
    torque = notes["told"][:, :, 0]
    made = np.isfinite(torque).all(axis=1)
    assert made.mean() > 0.5
    assert np.all(torque[made].sum(axis=1) <= 1.01 * notes["planned"][made].sum(axis=1))
    orders = np.flatnonzero(made & (notes["time"] * 100 % 10 >= 8.5))
    assert orders.size > 20
    assert np.all(torque[orders] <= notes["limit"][orders] + 1e-9)


def test_motors_that_cannot_make_up_give_what_they_have():
    # at speed three units have less than the plan of four
    _, notes = _run(_event({2: FAILURE}, initial_speed=16.0))
    late = notes["time"] >= TOLD + 1.0
    limit, planned = notes["limit"][late], notes["planned"][late]
    assert np.all(limit.sum(axis=1) < 0.97 * planned.sum(axis=1))
    torque = notes["told"][late][:, :, 0]
    # of limits that sink with the speed reports tell those of 0.2 s before at most
    before = notes["limit"][np.flatnonzero(late) - 20]
    assert np.all(torque <= before + 1e-9)
    np.testing.assert_allclose(torque.sum(axis=1), limit.sum(axis=1), rtol=0.03)


def test_nothing_that_a_failed_unit_tells_is_used(failed):
    run, _ = _run(_event({2: FAILURE}), spoilt=2)
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(run[name], failed[2][0][name])


def test_where_the_leader_fails_the_next_unit_leads(failed):
    _, notes = failed[0]
    known = notes["time"] >= KNOWN - 1e-9
    assert set(notes["leader"][~known]) == {0}
    assert set(notes["leader"][known]) == {1}
    assert set(failed[2][1]["leader"]) == {0}
    # who leads is told without a telegram: in the next period it reads what it wrote; the others with the latency
    told, read = notes["told"][:, :, 0], notes["orders"][:, :, 0]
    late = np.flatnonzero(known)[2:]
    np.testing.assert_array_equal(read[late, 1], told[late - 1, 1])
    made = late[np.isin(np.round(notes["time"][late] * 100) % 10, 5)]  # 0.05 s after a telegram
    np.testing.assert_array_equal(read[made, 3], told[made - 6, 3])


@pytest.mark.parametrize("failures", [None, {0: FAILURE}])
def test_without_telegrams_every_unit_is_alone(failures):
    event = _event(failures, Telegrams(loss=1.0), level=0.12, duration=4.0)
    mute, notes = _run(event)
    alone = simulate(event, "alone", MPC_CAR)
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(mute[name], alone[name])
    assert (
        mute.attrs["telegrams_lost"]
        == mute.attrs["telegrams_sent"]
        == alone.attrs["telegrams_sent"]
    )
    assert np.isnan(notes["reports"][:, 3]).all()


@pytest.mark.parametrize("seed", [3, 4])
def test_the_telegrams_of_the_joint_mpc_are_those_of_the_rules_and_are_counted(seed):
    event = _event(telegrams=Telegrams(loss=0.4), seed=seed, duration=4.0)
    run, notes = _run(event)
    rule = simulate(event, "cooperative", "cut-and-ramp")
    sent, lost = run.attrs["telegrams_sent"], run.attrs["telegrams_lost"]
    assert (sent, lost) == (rule.attrs["telegrams_sent"], rule.attrs["telegrams_lost"])
    assert sent == 2 * 3 * 40  # three units and the leader tell each other ten times a second
    # without jitter no telegram overtakes another: each arrives at an instant of its own, unless it was counted as lost
    arrived = sum(len(set(line[line > 0.0])) for line in notes["heard"][:, :, 1:].reshape(400, 6).T)
    assert arrived == sent - lost
    np.testing.assert_array_equal(run["fallen_back"], rule["fallen_back"])


def test_the_ideal_controller_makes_up_for_a_failed_unit_too():
    run = simulate(_event({0: FAILURE}, duration=4.0), "alone", MPC_TRAIN_IDEAL)
    late = run["time"].values >= KNOWN + 0.5
    commands, targets = run["torque_command"].values[late], run["torque_target"].values[late]
    assert np.all(commands[:, 0] == 0.0)
    np.testing.assert_allclose(commands.sum(axis=1), 4.0 * targets.max(axis=1), rtol=0.01)


def test_a_blended_brake_fills_what_failed_motors_lack():
    command = {"command": DriverCommand((0.2,), (-0.7,)), "initial_speed": 20.0}
    event = _event({1: FAILURE}, blended=True)
    whole = replace(_event(blended=True), **command)
    both = [_run(replace(one, **command))[0] for one in (event, whole)]
    failed, sound = (run["acceleration"].values[run["time"].values >= 4.0].mean() for run in both)
    assert sound < -0.5
    assert failed == pytest.approx(sound, rel=0.02)
    assert both[0]["torque_command"].values[-1][1] == 0.0
    assert both[0]["air_brake_force"].values[-1][1] > 0.9 * both[0]["air_brake_force"].values.max()
