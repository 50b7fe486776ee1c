"""Allocation and readhesion in one problem over the train, on what telegrams bring.

Each unit reports to the foremost one with the periodic telegrams. At the same instants the foremost unit solves the joint
problem on the reports that have arrived, and sends every unit the torque that is wanted of it. The units' own controllers,
one per car, follow the order that has arrived and protect their wheels every control period.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.onboard.telegram_line import TelegramLine
from alloc.plant.structure import Floats
from mpc.group_controller import CarControllers
from mpc.joint_problem import JointProblem, Report
from mpc.settings import MpcSettings

SENT_KEPT = 16
"""Orders remembered per unit; more cannot be younger than a report that is still used."""


class Order(NamedTuple):
    """What the foremost unit wants of another; in force when it arrives."""

    torque: float
    """[N m], in the direction of the demand."""
    demand: float
    """Driver's demand on the unit for which it was found [N m], signed: the driver's hand acts without telegrams."""


def ordered_target(order: Order | None, sense: UnitSense) -> float:
    """Torque target of a unit [N m]: the driver's where there is no order for this direction.

    Else the order, in proportion to what the driver wants now, within what the motors can.
    """
    if order is None or order.demand * sense.target <= 0.0:
        return sense.target
    limit = sense.drive_limit if sense.target > 0.0 else sense.brake_limit
    torque = order.torque * sense.target / order.demand
    return math.copysign(min(abs(torque), limit), sense.target)


class TrainMpc:
    """Joint MPC of a train over telegrams; a `TrainController`. The first unit is the foremost.

    It is meant for the rule `alone`: what a rule hands down counts as the driver's demand, and the joint problem
    distributes the total of it anew. A unit from which no report has come within `Telegrams.silence` suspends all orders; a
    unit that no order has reached for as long falls back to the driver's command. While a unit bound by its rail gives more
    than it is believed to carry, and the others make up for what it was believed to lack, the train exceeds the plan.
    """

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings | None = None
    ) -> None:
        self.settings = settings or MpcSettings()
        first, n = contexts[0], len(contexts)
        self._telegrams, self._period = first.telegrams, first.period
        self._every = max(1, round(first.telegrams.period / first.period))
        self.cars = CarControllers(contexts, self.settings)
        self.joint = JointProblem(contexts, self.settings)
        self.reports: list[TelegramLine[Report]] = [
            TelegramLine(first.telegrams, (first.seed, 3, j)) for j in range(n)
        ]
        self.orders: list[TelegramLine[Order]] = [
            TelegramLine(first.telegrams, (first.seed, 4, j)) for j in range(n)
        ]
        self._own: Order | None = None
        self._sent: list[list[tuple[float, float]]] = [[] for _ in range(n)]
        """What the foremost unit remembers of its orders: instant at which each should act, and torque."""
        self._demands: dict[float, float] = {}
        """Driver's demand on the foremost unit at the instants of reports that may still come, [N m]."""
        self._sign = 0.0

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        time = senses[0].time
        targets = [ordered_target(self._arrived(j, time), s) for j, s in enumerate(senses)]
        followed = [s._replace(target=t) for s, t in zip(senses, targets, strict=True)]
        decisions = self.cars.decide(followed)
        if round(time / self._period) % self._every:
            return decisions
        self._report(senses, decisions)
        status, steps = self._order(time)
        spent = steps * self.settings.step_time
        foremost = decisions[0]
        # an unsolved joint problem suspends the orders, but the foremost unit's own command stands: only the status tells
        decisions[0] = foremost._replace(
            solve_time=foremost.solve_time + spent,
            status=foremost.status if status == "ok" or not foremost.ok else status,
        )
        return decisions

    def _arrived(self, j: int, time: float) -> Order | None:
        if j == 0:
            return self._own
        telegram = self.orders[j].receive(time)
        return None if telegram is None else telegram.content

    def _report(self, senses: Sequence[UnitSense], decisions: Sequence[TorqueDecision]) -> None:
        """Every unit says what it reads, does and believes; the foremost to itself, without delay."""
        beliefs = [
            (controller.belief, k, part)
            for controller in self.cars.controllers
            for k, part in enumerate(controller.belief.parts)
        ]
        for j, (sense, decision, (belief, k, part)) in enumerate(
            zip(senses, decisions, beliefs, strict=True)
        ):
            sign = math.copysign(1.0, sense.target)
            report = Report(
                time=sense.time,
                speed=sign * sense.speed,
                omega=sign * sense.omega,
                torque=sign * sense.torque,
                command=sign * (decision.torque if decision.ok else sense.torque),
                target=sense.target,
                limit=sense.drive_limit if sense.target > 0.0 else sense.brake_limit,
                peak=belief.peak[part].copy(),
                slip_limit=belief.slip_limit[part].copy(),
                curve=belief.observers[k].curve,
                carried=float(belief.carried_torque()[k]),
            )
            if j == 0:
                self._latest = report
            else:
                self.reports[j].send(sense.time, report)

    def _order(self, time: float) -> tuple[str, int]:
        """The foremost unit: take in the reports, solve, send the orders; status of the solution and its SQP steps."""
        reports = [self._latest]
        for line in self.reports[1:]:
            telegram = line.receive(time)
            if telegram is None:
                return self._suspend()
            reports.append(telegram.content)
        demands = self._demands_now(time, reports)
        sign = math.copysign(1.0, demands[0])
        if demands[0] == 0.0 or any(demand * sign <= 0.0 for demand in demands):
            return self._suspend()  # the driver has just changed his mind, and not all have said so
        if sign != self._sign:
            self.joint.forget()
            self._sign = sign
        upright = [
            report._replace(target=abs(demand))
            for report, demand in zip(reports, demands, strict=True)
        ]
        acts = time + self._telegrams.latency
        asked, solution = self.joint.solve(
            upright, [self._known(j, report, acts) for j, report in enumerate(upright)]
        )
        if solution.status != "ok":
            self._suspend()
            return f"joint: {solution.status}", solution.iterations
        for j, (torque, demand) in enumerate(zip(asked, demands, strict=True)):
            order = Order(float(torque), demand)
            if j == 0:
                self._own = order
                self._sent[j] = [(time, order.torque)]
            else:
                self.orders[j].send(time, order)
                self._sent[j] = [*self._sent[j][-SENT_KEPT:], (acts, order.torque)]
        return "ok", solution.iterations

    def _demands_now(self, time: float, reports: Sequence[Report]) -> list[float]:
        """Driver's demand on each unit [N m]: what it reported, grown since as much as the foremost unit's own has.

        Without this a rising demand looks uneven along the train, for only the foremost unit's is not old.
        """
        now = reports[0].target
        self._demands[time] = now
        oldest = time - self._telegrams.silence - 2.0 * self._telegrams.period
        self._demands = {t: demand for t, demand in self._demands.items() if t >= oldest}
        demands = []
        for report in reports:
            then = self._demands.get(report.time, 0.0)
            demands.append(report.target * now / then if then else 0.0)
        return demands

    def _suspend(self) -> tuple[str, int]:
        self._own, self._sign = None, 0.0
        return "ok", 0

    def _known(self, j: int, report: Report, acts: float) -> Floats:
        """Commands [N m] that unit `j` is expected to give each control period from its report until `acts`.

        Those that it reported, until an order sent since should act; an order only as far as the unit's rail carries it.
        """
        times = report.time + self._period * np.arange(round((acts - report.time) / self._period))
        commands = np.full(times.size, report.command)
        most = (1.0 + self.settings.headroom) * report.carried
        for since, torque in self._sent[j]:
            if since > report.time:
                commands[times >= since - 1e-9] = min(torque, most)
        return commands
