"""Allocation and readhesion in one problem over the train, on the content of telegrams.

In: reports of some age. Out: torques that the leader wants of every unit; the units' own controllers protect their wheels.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from alloc.old.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.old.onboard.telegrams import AddedNumbers, Attachment
from alloc.old.plant.laws import GRAVITY
from alloc.old.plant.model import Floats
from mpc.old.belief import mean_curve, with_predicted_curve
from mpc.old.condensing import simulate
from mpc.old.generated import compiled_group
from mpc.old.group import CarControllers, GroupProblem, WheelsAndRail
from mpc.old.model import (
    LostShare,
    air_place,
    curve_place,
    leading,
    parameters,
    substeps,
    torque_per_coefficient,
)
from mpc.old.period import HorizonSolution
from mpc.old.settings import MpcSettings

# Content of the telegrams that the units of a train exchange under the joint MPC, as numbers.
#
# Reports go to the leader and orders come from it; the rules' own report and limit are in the same telegrams.


class Report(NamedTuple):
    """Report of a unit to the leader; in the direction of the demand."""

    time: float
    """Instant of its readings [s]."""
    speed: float
    omega: Floats
    torque: float
    command: float
    """Torque command in force from then on [N m]."""
    target: float
    """Torque that the driver wants of it [N m]; signed in a telegram, for it says which direction that is."""
    limit: float
    """Largest torque of its motors [N m]."""
    peak: Floats
    """Believed peak coefficient of its axles, (axles,)."""
    peak_slip: float
    """Of the believed curve [m/s], as is `steepness`."""
    steepness: float
    carried: float
    """Torque that its weakest axle is believed to carry beside the air brake [N m]."""
    air: float
    """Torque of the air brake at each wheelset [N m]."""
    drag: float
    """Gradient equivalent to all drag on its share of the train, see `mpc.old.belief.Drag`."""


class Order(NamedTuple):
    """What the leader wants of a unit; in force when it arrives."""

    torque: float
    """[N m], in the direction of the demand."""
    demand: float
    """Driver's demand on the unit for which it was found [N m], signed: the driver's hand acts without telegrams."""


PER_AXLE = ("omega", "peak")
PER_UNIT = tuple(name for name in Report._fields if name not in PER_AXLE)


def added_numbers(contexts: Sequence[UnitContext]) -> AddedNumbers:
    """Numbers that reports and orders take; a report has room for the unit with the most axles."""
    axles = max(context.axles for context in contexts)
    return AddedNumbers(len(PER_UNIT) + axles * len(PER_AXLE), len(Order._fields))


def write_report(report: Report, numbers: Floats) -> None:
    """Put the report into the `numbers` of a telegram, (numbers,)."""
    single = [getattr(report, name) for name in PER_UNIT]
    written = np.concatenate([single, *(getattr(report, name) for name in PER_AXLE)])
    numbers[: written.size] = written


def read_report(numbers: Floats, axles: int) -> Report | None:
    """Report of a unit with this number of `axles` in the `numbers` of a telegram; None if there is none."""
    if math.isnan(numbers[0]):
        return None
    fields: dict[str, Any] = dict(zip(PER_UNIT, numbers.tolist(), strict=False))
    each = numbers[len(PER_UNIT) : len(PER_UNIT) + axles * len(PER_AXLE)].reshape(-1, axles)
    return Report(**(fields | dict(zip(PER_AXLE, each.copy(), strict=True))))


def read_order(numbers: Floats) -> Order | None:
    """Order in the `numbers` of a telegram; None if it has none."""
    order = Order(*numbers.tolist())
    return None if math.isnan(order.torque) else order


def ordered_target(order: Order | None, sense: UnitSense) -> float:
    """Torque target of a unit [N m]: the driver's where there is no order for this direction.

    Else the order, in proportion to what the driver wants now, within what the motors can.
    """
    if order is None or order.demand * sense.target <= 0.0:
        return sense.target
    limit = sense.drive_limit if sense.target > 0.0 else sense.brake_limit
    torque = order.torque * sense.target / order.demand
    return math.copysign(min(abs(torque), limit), sense.target)


# The leader's work for the train: from reports of some age to torques for all units.
#
# It predicts every unit over the delay under the commands that are already on their way. It then solves one problem
# over all units from the instant at which its orders can act.


NO_SLIP_LIMIT = 1e3
"""Slip limit [m/s] of the train's problem: every unit searches for its best slip itself, with newer information than a
report gives. The binding constraint is the torque that a unit is believed to carry."""


class UnitForecast:
    """Predicts one unit, alone on its share of the train, over the delay."""

    def __init__(self, context: UnitContext) -> None:
        alone = replace(with_predicted_curve(context), unloading=())
        self._context, self._period = alone, context.period
        self._model = compiled_group(alone)
        self._curve, self._air = curve_place(alone), air_place(alone)
        self._substeps = substeps(alone, context.period)
        self._scratch = np.zeros((3, context.axles + 2))

    def state(self, report: Report, commands: Floats) -> Floats:
        """State (axles + 2,) after `commands` [N m], one per control period since the report."""
        nodes = np.zeros((commands.size + 1, report.omega.size + 2))
        nodes[0] = np.concatenate([[report.speed], report.omega, [report.torque]])
        if commands.size:
            values = parameters(self._context, report.peak, report.drag)
            values[self._curve] = report.peak_slip, report.steepness
            values[self._air] = report.air
            simulate(
                self._model.slope, commands, self._model.prepared(values),
                self._period / self._substeps, self._substeps, nodes, self._scratch,
            )  # fmt: skip
        return np.asarray(nodes[-1])


class JointProblem:
    """The train's problem at the unit that leads."""

    def __init__(self, contexts: Sequence[UnitContext], settings: MpcSettings) -> None:
        self.settings = settings
        # what it orders are targets, from which the units' own problems keep the drives from swinging
        contexts = [replace(context, twisting=False) for context in contexts]
        self._contexts = tuple(contexts)
        self._forecasts = [UnitForecast(context) for context in contexts]
        self._group = GroupProblem(contexts, settings, settings.group.steps)
        self._radius = [context.radius for context in contexts]
        self._pull = [
            one.axles * one.axle_load / (one.mass * GRAVITY) / torque_per_coefficient(one)
            for one in contexts
        ]
        """Rail force of each unit over its weight, per torque [1/(N m)]."""
        held = round(contexts[0].telegrams.period / settings.step)
        self._last = min(held, settings.horizon) - 1
        """Step of the horizon at which the next orders come into force."""
        self._cold = True

    def forget(self) -> None:
        """Drop the guess: the demand has changed its direction, or another unit leads."""
        self._cold = True

    def supposed(
        self, j: int, leader: Report, target: float, works: bool, leads: int = 0
    ) -> Report:
        """What counts for unit `j` of which no report is used: it rolls with the `leader`, unit `leads`.

        One that `works` gives its `target` [N m], no more. Of one whose motors have failed nothing is to be had: the others
        give its target.
        """
        one = self._contexts[j]
        peak = np.full(one.axles, self.settings.belief.initial)
        torque = target if works else 0.0
        given = leader.torque + leader.air / self._contexts[leads].gear_ratio
        return Report(
            time=leader.time,
            speed=leader.speed,
            omega=np.full(one.axles, leader.speed / one.radius),
            torque=torque,
            command=torque,
            target=target,
            limit=torque,
            peak=peak,
            peak_slip=leader.peak_slip,
            steepness=leader.steepness,
            carried=float(peak[0]) * torque_per_coefficient(one) if works else 0.0,
            air=0.0,
            # so that it has the leader's acceleration with what its own rails give
            drag=leader.drag + self._pull[j] * torque - self._pull[leads] * given,
        )

    def solve(
        self, reports: Sequence[Report], commands: Sequence[Floats], leader: int = 0
    ) -> tuple[Floats, HorizonSolution]:
        """Torque to ask of each unit [N m], (units,), and the solution behind it; the body has the speed of the `leader`.

        `commands`: per unit, the commands known for each control period from its report until the orders act. The result is
        the torque at the end of the time for which an order is in force; the course before that is left to the units. A unit
        that is limited by its rail is asked for more than it is believed to carry. Its own controller has newer information
        on its rail than a report gives, and only an axle that is pushed finds out that adhesion has returned. No unit is
        asked for more than its motors can deliver.
        """
        pairs = list(zip(reports, commands, strict=True))
        states = [f.state(*pair) for f, pair in zip(self._forecasts, pairs, strict=True)]
        before = np.array([known[-1] if known.size else r.command for r, known in pairs])
        speed = float(states[leader][0])
        slip = np.concatenate(
            [r * s[1:-1] - s[0] for r, s in zip(self._radius, states, strict=True)]
        )
        target, carried, limit, air, drag = np.array(
            [(r.target, r.carried, r.limit, r.air, r.drag) for r in reports]
        ).T
        peak = np.concatenate([r.peak for r in reports])
        curve = mean_curve([(r.peak_slip, r.steepness) for r in reports])
        state = (speed, (speed + slip) / self._group.radius, np.array([s[-1] for s in states]))
        free = np.full_like(peak, NO_SLIP_LIMIT)
        rail = WheelsAndRail(peak, free, carried, air, drag)
        problem = self._group.problem(state, rail, curve, target, before, limit)
        solver = self._group.solver
        if self._cold:
            solver.restart(before)
        else:
            for _ in range(self._last + 1):
                solver.shift()
        solution = solver.solve(problem)
        self._cold = solution.status != "ok"
        units = len(reports)
        asked = solution.torques[self._last * units : (self._last + 1) * units].copy()
        bound = asked >= self.settings.group.limited * carried
        push = np.maximum(target, (1.0 + self.settings.headroom) * asked)
        return np.minimum(np.where(bound, push, asked), limit), solution


# With the periodic telegrams each unit reports to the leader, the foremost unit that works. In the control period
# before each telegram the leader solves the joint problem on the reports that have arrived. The next telegrams bring
# every unit the torque that is wanted of it. The units' own controllers, one per car, follow the order that has arrived
# and protect their wheels every control period.


SENT_KEPT = 16
"""Orders stored per unit; older ones are never needed, because they precede every report that is still used."""


class TrainMpc:
    """Joint MPC of a train over telegrams; a `TellingController`.

    It is meant for the rule `alone`: the limits of a rule count as the driver's demand, and the joint problem distributes
    their total again. A unit from which no report has come within `Telegrams.silence` is left to the driver, and the others
    share what is wanted of them. Orders are suspended while the leader receives no report at all. A unit that no order has
    reached for the same time falls back to the driver's command. While a unit limited by its rail delivers more than it is
    believed to carry, and the others make up for its believed shortfall, the train exceeds the plan. The part of a unit
    whose motors have failed is distributed among the others. A new leader has the reports that have arrived, but no order of
    the leader before.
    """

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings | None = None
    ) -> None:
        self.settings = settings or MpcSettings()
        first, n = contexts[0], len(contexts)
        self.added = added_numbers(contexts)
        self._contexts = tuple(contexts)
        self._telegrams, self._period = first.telegrams, first.period
        self._every = max(1, round(first.telegrams.period / first.period))
        self.cars = CarControllers(contexts, self.settings)
        self.joint = JointProblem(contexts, self.settings)
        self._lost = LostShare(contexts)
        self._sent: list[list[tuple[float, float]]] = [[] for _ in range(n)]
        """What the leader remembers of its orders: instant at which each should act, and torque."""
        self._demands: dict[float, Floats] = {}
        """Driver's demand on each unit at the instants of reports that may still come, [N m]; each knows its own."""
        self._leader, self._sign = 0, 0.0
        delay = first.telegrams.latency + first.telegrams.jitter + first.period
        self._longest = first.telegrams.period + 2.0 * delay
        """Most time [s] from a report to the order made of it, without losses."""

    def connect(self, reports: Attachment, orders: Attachment) -> None:
        """Get the arrays of the telegrams' content, `added` numbers per telegram."""
        self.reports, self.orders = reports, orders

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        time = senses[0].time
        decisions = self.cars.decide([self._followed(j, sense) for j, sense in enumerate(senses)])
        self._lead(senses)
        if (round(time / self._period) + 1) % self._every:
            return decisions
        sent = self._report(senses, decisions)
        status, steps = self._order(time, senses, sent)
        spent = steps * self.settings.step_time
        leader = decisions[self._leader]
        # an unsolved joint problem suspends the orders, but the leader's own command stands: only the status tells
        decisions[self._leader] = leader._replace(
            solve_time=leader.solve_time + spent,
            status=leader.status if status == "ok" or not leader.ok else status,
        )
        return decisions

    def _silent(self, line: Attachment, j: int, time: float) -> bool:
        return bool(time - line.heard[j] > self._telegrams.silence)

    def _followed(self, j: int, sense: UnitSense) -> UnitSense:
        """What a unit's own controller is to follow: the order that has arrived, or the driver."""
        silent = self._silent(self.orders, j, sense.time)
        order = None if silent else read_order(self.orders.read[j])
        if order is None:
            return sense
        # an order is for this unit alone: what is lost elsewhere is in it
        return sense._replace(target=ordered_target(order, sense), planned=0.0)

    def _heard(self, j: int, time: float) -> Report | None:
        silent = self._silent(self.reports, j, time)
        return None if silent else read_report(self.reports.read[j], self._contexts[j].axles)

    def _lead(self, senses: Sequence[UnitSense]) -> None:
        """The foremost unit that works leads, as it does for the rules."""
        leader = leading(senses)
        if leader != self._leader:
            self._leader, self._sign = leader, 0.0  # another direction than any: it begins anew
            self._sent = [[] for _ in senses]

    def _report(
        self, senses: Sequence[UnitSense], decisions: Sequence[TorqueDecision]
    ) -> list[Report]:
        """Every unit tells what it reads, does and believes."""
        beliefs = [
            (controller.belief, k, part)
            for controller in self.cars.controllers
            for k, part in enumerate(controller.belief.parts)
        ]
        sent = []
        for j, (sense, decision, (belief, k, part)) in enumerate(
            zip(senses, decisions, beliefs, strict=True)
        ):
            sign = math.copysign(1.0, sense.target)
            top, steepness = belief.observers[k].curve
            report = Report(
                time=sense.time,
                speed=sign * sense.speed,
                omega=sign * sense.omega,
                torque=sign * sense.torque,
                command=sign * (decision.torque if decision.ok else sense.torque),
                target=sense.target,
                limit=sense.drive_limit if sense.target > 0.0 else sense.brake_limit,
                peak=belief.peak[part].copy(),
                peak_slip=top,
                steepness=steepness,
                carried=float(belief.carried_torque()[k]),
                air=float(belief.air_torque[k]),
                drag=belief.observers[k].grade,
            )
            write_report(report, self.reports.message[j])
            sent.append(report)
        return sent

    def _order(
        self, time: float, senses: Sequence[UnitSense], sent: Sequence[Report]
    ) -> tuple[str, int]:
        """The leader: take in the reports, solve, tell the orders; status of the solution and its SQP steps."""
        self._remember(time, senses)
        leader, in_service = self._leader, [sense.in_service for sense in senses]
        own = sent[leader]
        reports = [
            own if j == leader else self._heard(j, time) for j, _ in enumerate(self._contexts)
        ]
        even = self._lost.even(own.target, leader)
        demands = np.array(
            [
                even[j] if report is None else self._demand_now(report, own.target)
                for j, report in enumerate(reports)
            ]
        )
        sign = math.copysign(1.0, own.target)
        heard = [
            works and report is not None for report, works in zip(reports, in_service, strict=True)
        ]
        # the last unit that works has nobody to share with, but what the others have lost to give
        alone = sum(heard) < 2 and (all(in_service) or sum(in_service) != 1)
        if alone or np.any((demands * sign <= 0.0) & in_service):
            # or the driver has just changed his mind and not all have said so
            return self._suspend()
        if sign != self._sign:
            self.joint.forget()
            self._sign = sign
        wanted = self._lost.wanted(demands, in_service, leader, senses[leader].planned).tolist()
        upright = [
            report._replace(target=abs(demand))
            if report is not None and works
            else self.joint.supposed(j, own, abs(demand), works, leader)
            for j, (report, demand, works) in enumerate(
                zip(reports, wanted, in_service, strict=True)
            )
        ]
        acts = time + self._period + self._telegrams.latency
        asked, solution = self.joint.solve(
            upright, [self._known(j, report, acts) for j, report in enumerate(upright)], leader
        )
        if solution.status != "ok":
            self._suspend()
            return f"joint: {solution.status}", solution.iterations
        for j, (torque, demand) in enumerate(zip(asked.tolist(), wanted, strict=True)):
            self.orders.message[j] = Order(torque, demand)
            if j == leader:  # needs no telegram
                self._sent[j] = [(time + self._period, torque)]
            else:
                self._sent[j] = [*self._sent[j][-SENT_KEPT:], (acts, torque)]
        return "ok", solution.iterations

    def _remember(self, time: float, senses: Sequence[UnitSense]) -> None:
        """Keep the driver's demands as long as a report of them may come."""
        self._demands[time] = np.array([sense.target for sense in senses])
        oldest = time - self._telegrams.silence - 2.0 * self._telegrams.period
        self._demands = {t: demand for t, demand in self._demands.items() if t >= oldest}

    def _demand_now(self, report: Report, now: float) -> float:
        """Driver's demand on a unit [N m]: what it reported, grown since as much as the leader's own, which is `now`.

        Without this a rising demand looks uneven along the train, for only the leader's is not old.
        """
        then = self._demands.get(report.time)
        if then is None or then[self._leader] == 0.0:
            return 0.0
        return report.target * now / float(then[self._leader])

    def _suspend(self) -> tuple[str, int]:
        self.orders.message[:] = math.nan
        self._sign = 0.0
        return "ok", 0

    def _known(self, j: int, report: Report, acts: float) -> Floats:
        """Commands [N m] that unit `j` is expected to give each control period from its report until `acts`.

        Those that it reported, until an order sent since should act; an order only as far as the unit's rail carries it. Of
        a report that is older than telegrams without loss are, the slip counts as it was: the unit's own controller has
        protected its wheels since, and a forecast of a second under commands alone would let them run away.
        """
        begin = max(report.time, acts - self._longest)
        times = begin + self._period * np.arange(round((acts - begin) / self._period))
        commands = np.full(times.size, report.command)
        most = (1.0 + self.settings.headroom) * report.carried
        for since, torque in self._sent[j]:
            if since > report.time:
                commands[times >= since - 1e-9] = min(torque, most)
        return commands
