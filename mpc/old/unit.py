"""The readhesion MPC of one traction unit: its problem, its compiled control period, and the same in Python as reference.

In: a `UnitSense`. Out: a torque command. It tracks the demand within the slip limit that `mpc.old.slip_search` finds; where the
solver fails, the unit cuts and ramps.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import float64, void

from alloc.old.compilation import equation
from alloc.old.onboard.host import STEP, CompiledController, TorqueDecision, UnitContext, UnitSense
from alloc.old.plant.adhesion import PiecewiseCurve
from alloc.old.plant.model import Floats, Ints
from alloc.old.records import ByReference, address_of, stored_at
from mpc.old.arrays import inlined, sweep
from mpc.old.belief import BeliefRecord, UnitBelief, belief_of, believe, with_predicted_curve
from mpc.old.estimator import predicted_curve
from mpc.old.model import Units, air_place, curve_place, parameters, torque_per_coefficient
from mpc.old.period import (
    FAILURES,
    HorizonProblem,
    HorizonSolution,
    Iteration,
    PredictiveController,
    Problem,
    RealTimeIteration,
)
from mpc.old.reference import solve
from mpc.old.settings import MpcSettings
from mpc.old.slip_search import slip_limit
from mpc.old.solver import ENDED, Period, ahead, empty_period, hold, iterate, shift

# How much of a demand that the rail does not carry the cost tracks.
#
# The limit of slip is soft. The further a demand lies above what the rail carries, the more it pulls slip beyond the
# limit: a locomotive that is asked for five times its adhesion stood at one and a half times the slip sought on a
# narrow peak, beyond the peak believed, and its slip no longer followed the search. At rest, the pull of the torque t
# that is tracked and that of the slip s beyond its limit balance. In coefficients mu of the motors' torque, with the
# torque scale's coefficient c,
#
#     tracking (t - mu) / c^2 = slip (excess / slip scale^2) ds / dmu,    ds / dmu >= s / mu,
#
# for curves bend down. So slip exceeds its limit by no more than the share `EXCESS` if
#
#     t <= mu + EXCESS (slip / tracking) (c s / slip scale)^2 / mu.
#
# On wide peaks this is more than any demand. Source: this project.


EXCESS = 0.1
"""Share of the slip limit by which a demand may pull slip beyond it."""

LEAST = 1e-3
"""Least coefficient that is believed to be carried here: where there is none, all demand is tracked."""


@equation
def tracked_coefficient(held, slip, scale, tracking, penalty, slip_scale):
    """Largest coefficient that is tracked where the rail carries `held` at the `slip` limit [m/s].

    `scale`: coefficient of the torque scale; `tracking`, `penalty` and `slip_scale` [m/s]: those of
    `mpc.old.condensing.CostWeights`.
    """
    carried = held if held > LEAST else LEAST
    part = scale * slip / slip_scale
    return carried + EXCESS * penalty / tracking * part * part / carried


# From what a unit reads and believes to the problem of the period, compiled.


class UnitProblem(NamedTuple):
    """Belief and solver of a unit, and what is between them."""

    carried: float
    """Greatest torque per believed coefficient, headroom included [N m], at the motor as is `per_coefficient`."""
    per_coefficient: float
    """Torque for a coefficient of 1 [N m]."""
    air: int
    """Place of other brakes' torque among the parameters of the model, see `mpc.old.model.air_place`."""
    curve: int
    """That of the curve, see `mpc.old.model.curve_place`."""
    belief: BeliefRecord
    solver: Period


def unit_problem(
    context: UnitContext, settings: MpcSettings, belief: BeliefRecord, solver: Period
) -> UnitProblem:
    """The unit's problem at the start of a run; `solver`: where the problem is written to."""
    solver.now.parameters[:] = parameters(context, belief.axles.peak)
    per_coefficient = float(torque_per_coefficient(context))
    carried = (1.0 + settings.headroom) * per_coefficient
    return UnitProblem(
        carried,
        per_coefficient,
        air_place(context).start,
        curve_place(context).start,
        belief,
        solver,
    )


def empty_problem() -> UnitProblem:
    """A problem of hardly any size, of whose kind all others are."""
    context = UnitContext(0, 1, 0.4, 100.0, 5.0, 1e5, 4e4, 0.01, PiecewiseCurve(), 0.01)
    return UnitProblem(0.0, 0.0, 0, 0, belief_of(context, MpcSettings()), empty_period())


UNIT_PROBLEM = ByReference(empty_problem()).kind


@sweep(void(UNIT_PROBLEM, float64, float64))
def pose(u, target, limit):
    """Write the problem of this period, except the state; in the direction of the demand. `limit` [N m]: of the motors."""
    now, axles, search = u.solver.now, u.belief.axles, u.belief.search
    least, most_slip = np.inf, slip_limit(search)
    for i in range(axles.peak.size):
        now.parameters[i] = axles.peak[i]
        u.solver.terms.axle.slip_limit[i] = most_slip
        least = min(least, axles.peak[i])
    now.parameters[axles.peak.size] = u.belief.drag.grade[0]
    now.parameters[u.curve], now.parameters[u.curve + 1] = predicted_curve(u.belief.curve, axles)
    air, load = u.belief.air.coefficient[0], 0.0
    for i in range(axles.peak.size):
        load += u.belief.load[i] / axles.peak.size
    now.parameters[u.air] = air * u.belief.constants.radius * load
    most = max(min(min(target, limit), least * u.carried - air * u.per_coefficient), 0.0)
    for k in range(now.upper.size):
        now.upper[k] = most
    terms, w = u.solver.terms, u.solver.terms.weights
    most = tracked_coefficient(
        least - air,
        most_slip,
        terms.unit.scale[0] / u.per_coefficient,
        w.tracking,
        w.slip,
        w.slip_scale,
    )
    terms.unit.target[0] = min(target, most * u.per_coefficient)


class OptiIteration(RealTimeIteration):
    """Solves the problem to convergence as `mpc.old.reference` states it, from its last solution on."""

    solver = "ipopt"
    """One of those of `mpc.old.solve`."""

    def __init__(self, units: Units, settings: MpcSettings, evenness: float = 0.0) -> None:
        super().__init__(units, settings, evenness)
        self._units = units

    def solve(self, problem: HorizonProblem) -> HorizonSolution:
        """As the loop's solver; the residual is not known (nan)."""
        plan = solve(Problem(self._units, self._settings, problem, self.torques), self.solver)
        if plan.status == "ok":
            self.torques[:] = plan.torques.ravel()
        return HorizonSolution(
            self.torques.copy(), plan.cost, math.nan, plan.iterations, plan.status
        )


class MpcController(PredictiveController):
    """Readhesion MPC of one unit; a `HostController`.

    It follows the target torque, keeps the slip at the best value that `mpc.old.slip_search` finds, and avoids changes of
    torque; see `MpcSettings` for the weights. `iteration` makes its solver: belief, limits and problem are the same for all
    solvers.
    """

    belief: UnitBelief

    def __init__(
        self,
        context: UnitContext,
        settings: MpcSettings | None = None,
        iteration: Iteration = RealTimeIteration,
    ) -> None:
        settings = settings or MpcSettings()
        predicted = with_predicted_curve(context)
        solver = iteration(predicted, settings)
        super().__init__([context], settings, solver)
        self.belief = UnitBelief(context, settings)
        self._unit = unit_problem(predicted, settings, self.belief.record, solver.period)
        self._record = ByReference(self._unit)

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period."""
        return self._answer([sense])[0]

    def _believe(
        self, speed: Floats, omega: Floats, torque: Floats, wanted: Floats, estimate: Floats
    ) -> None:
        own = (float(values[0]) for values in (torque, wanted, estimate))
        self.belief.update(float(speed[0]), omega, *own)

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        pose(self._record, target[0], limit[0])
        now, terms = self._unit.solver.now, self._unit.solver.terms
        state = np.concatenate([speed, omega, torque])
        return HorizonProblem(
            state, now.parameters, terms.axle.slip_limit, terms.unit.target, self._before, now.upper[:1]
        )  # fmt: skip


# A control period of one unit's readhesion MPC as one compiled function, which the simulation's loop calls by its
# address.
#
# It follows the target torque, keeps the slip at the best value that `mpc.old.slip_search` finds, and avoids changes of
# torque; see `MpcSettings` for the weights. If the solver fails, is too slow or gets an input that is not a number, its
# answer is not usable; the unit then cuts and ramps. Braking is mirrored driving: every law of a unit is odd.
# `mpc.old.period` is the same in Python, for groups and for other solvers.


STATUSES = ("ok", *FAILURES.values(), "reading not finite", "late")
"""Status by number: the ends of `mpc.old.solver` from `ENDED` on, then those of the period itself."""
NOT_A_NUMBER, LATE = len(STATUSES) - 2, len(STATUSES) - 1


class Times(NamedTuple):
    """Settings of time."""

    most: int
    """Largest number of SQP steps in a period."""
    late: bool
    """Whether not even one of them ends in time."""
    shifts: bool
    """Whether the guess is shifted by a step of the horizon every period."""
    step: float
    """Time that an SQP step takes on board [s]."""
    period: float
    """Control period [s]."""
    delayed: bool
    """Whether a command acts a period after the readings from which it was computed."""
    predicted: bool
    """Whether it is computed from the state predicted for that instant."""


class UnitState(NamedTuple):
    """Complete state of a unit's controller."""

    times: Times
    problem: UnitProblem
    sign: Floats
    """Direction of the demand of the last period; 0: start again, (1,)."""
    observed: Floats
    """Direction in which the observers count; 0: a reading was missed, (1,)."""
    found: Ints
    """Status of the command that will act next, if commands are delayed, (1,)."""


def times_of(context: UnitContext, settings: MpcSettings) -> Times:
    """Settings of time of a unit."""
    most = settings.steps_in_time(context.period)
    shifts = math.isclose(context.period, settings.step)
    delayed = settings.computing_delay > 0
    return Times(
        max(1, most), most < 1, shifts, float(settings.step_time), float(context.period),
        delayed, bool(delayed and settings.compensated),
    )  # fmt: skip


def _at_start(times: Times, problem: UnitProblem) -> UnitState:
    """State of a unit's controller before its first period."""
    return UnitState(times, problem, np.zeros(1), np.zeros(1), np.zeros(1, dtype=np.int64))


def _kind() -> Any:
    """Numba's type of a `UnitState`."""
    times = Times(1, False, True, 0.0, 0.0, False, False)
    return ByReference(_at_start(times, empty_problem())).kind


state_at = stored_at(_kind())


@inlined
def _finite(reading, omega):
    """Whether all readings that count are numbers."""
    total = abs(reading.speed) + abs(reading.torque) + abs(reading.target)
    total += abs(reading.drive_limit) + abs(reading.brake_limit)
    for i in range(omega.size):
        total += abs(omega[i])
    return total < np.inf


@inlined
def _start(u, reading):
    """Know the direction of the demand; where it changes, start anew."""
    before = u.problem.solver.terms.unit.before
    sign = u.sign[0] if u.sign[0] != 0.0 else 1.0
    if reading.target != 0.0:
        sign = 1.0 if reading.target > 0.0 else -1.0
    if sign != u.observed[0]:
        u.problem.belief.fresh[0] = True
        u.observed[0] = sign
    if sign != u.sign[0]:
        before[0] = max(sign * reading.torque, 0.0)
        hold(u.problem.solver)
        u.sign[0] = sign
    elif u.times.shifts:
        shift(u.problem.solver)


@inlined
def _decide(u, reading, omega, answer):
    """Fill the answer; returns the status of the command that these readings lead to."""
    before = u.problem.solver.terms.unit.before
    in_force = u.sign[0] * before[0]
    answer.torque = in_force
    if not _finite(reading, omega):
        u.observed[0] = 0.0
        return NOT_A_NUMBER
    _start(u, reading)
    sign, p, n = u.sign[0], u.problem.solver, omega.size
    state = p.now.state
    state[0], state[1 + n] = sign * reading.speed, sign * reading.torque
    for i in range(n):
        state[1 + i] = sign * omega[i]
    limit = reading.drive_limit if sign > 0.0 else reading.brake_limit
    wanted = min(sign * reading.target, limit)
    believe(u.problem.belief, state[0], state[1 : 1 + n], state[1 + n], wanted, reading.coefficient)
    if reading.target == 0.0:
        before[0] = answer.torque = answer.residual = 0.0
        hold(p)
        return 0
    if u.times.delayed:
        # that the driver wants less now needs no computing
        before[0] *= min(1.0, abs(reading.target) / max(before[0], 1e-9))
        in_force = sign * before[0]
    pose(u.problem, sign * reading.target, limit)
    if u.times.predicted:
        ahead(u.times.period, p)
    _, residual, done, end = iterate(u.times.most, p)
    answer.solve_time = done * u.times.step
    before[0], answer.residual = p.guess.torques[0], residual
    answer.torque = in_force if u.times.delayed else sign * before[0]
    if end > ENDED:
        return end - ENDED
    return LATE if u.times.late else 0


@sweep(STEP.signature)
def unit_step(address, reading, omega, answer):
    """A control period, see `alloc.old.onboard.host.STEP`; `address`: of a `UnitState`."""
    u = state_at(address)
    answer.residual, answer.solve_time = np.nan, 0.0
    status = _decide(u, reading, omega, answer)
    if status != 0:
        u.sign[0] = 0.0  # guess anew: what the unit does meanwhile is not known here, but observed
    if u.times.delayed:
        status, u.found[0] = u.found[0], status
    answer.status, answer.usable = status, int(status == 0)
    if status != 0:
        answer.torque = 0.0


def compiled_unit(context: UnitContext, settings: MpcSettings | None = None) -> CompiledController:
    """The compiled readhesion MPC of a unit at the start of a run."""
    settings = settings or MpcSettings()
    predicted = with_predicted_curve(context)
    solver = RealTimeIteration(predicted, settings)
    problem = unit_problem(predicted, settings, belief_of(context, settings), solver.period)
    record = ByReference(_at_start(times_of(context, settings), problem))
    return CompiledController(
        address_of(unit_step, STEP), record.address, STATUSES, (record, solver)
    )
