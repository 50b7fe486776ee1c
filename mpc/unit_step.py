"""A control period of one unit's readhesion MPC as one compiled function, which the simulation's loop calls by its address.

It follows the target torque, keeps the slip at the best value that `mpc.slip_search` finds, and avoids changes of torque;
see `MpcSettings` for the weights. If the solver fails, is too slow or gets an input that is not a number, its answer is not
usable; the unit then cuts and ramps. Braking is mirrored driving: every law of a unit is odd. `mpc.control_period` is the
same in Python, for groups and for other solvers.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int64, void

from alloc.by_address import address_of, record_at
from alloc.by_reference import ByReference
from alloc.onboard.compiled_controller import STEP, CompiledController
from alloc.onboard.host import UnitContext
from alloc.plant.structure import Floats, Ints
from mpc.arrays import inlined, sweep
from mpc.belief import belief_of, believe, with_predicted_curve
from mpc.phases import feedback, preparation
from mpc.real_time import FAILURES, RealTimeIteration
from mpc.settings import MpcSettings
from mpc.slip_search import coming_slip_limit
from mpc.sqp import ENDED, ahead, hold, iterate, shift
from mpc.unit_problem import UnitProblem, empty_problem, pose, unit_problem

STATUSES = ("ok", *FAILURES.values(), "reading not finite", "late")
"""Status by number: the ends of `mpc.sqp` from `ENDED` on, then those of the period itself."""
NOT_A_NUMBER, LATE = len(STATUSES) - 2, len(STATUSES) - 1

NONE = -1
"""In place of a number of steps: there is no preparation."""


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
    apart: bool
    """Whether preparation and feedback are apart, see `mpc.phases`."""


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
    left: Ints
    """Most steps of the preparation that is to follow; `NONE`: none is, (1,)."""
    prepared: Ints
    """Steps of the preparation before the readings; `NONE`: there was none, (1,)."""


def times_of(context: UnitContext, settings: MpcSettings) -> Times:
    """Settings of time of a unit."""
    most = settings.steps_in_time(context.period)
    shifts = math.isclose(context.period, settings.step)
    delayed = settings.computing_delay > 0
    return Times(
        max(1, most), most < 1, shifts, float(settings.step_time), float(context.period),
        delayed, bool(delayed and settings.compensated), settings.phases_apart,
    )  # fmt: skip


def _at_start(times: Times, problem: UnitProblem) -> UnitState:
    """State of a unit's controller before its first period."""
    zero, whole = np.zeros(1), np.zeros(1, dtype=np.int64)
    return UnitState(times, problem, zero, zero.copy(), whole, whole + NONE, whole + NONE)


def _kind() -> Any:
    """Numba's type of a `UnitState`."""
    times = Times(1, False, True, 0.0, 0.0, False, False, False)
    return ByReference(_at_start(times, empty_problem())).kind


state_at = record_at(_kind())


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
        u.sign[0], u.prepared[0] = sign, NONE
    elif u.times.shifts and u.prepared[0] == NONE:
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
    if u.prepared[0] == NONE:
        _, residual, done, end = iterate(u.times.most, p)
        answer.solve_time = done * u.times.step
    else:
        _, residual, done, end = feedback(p)
        answer.solve_time = (u.prepared[0] + done) * u.times.step
    before[0], answer.residual = p.guess.torques[0], residual
    answer.torque = in_force if u.times.delayed else sign * before[0]
    if end > ENDED:
        return end - ENDED
    if u.times.apart:
        u.left[0] = u.times.most - done
    return LATE if u.times.late else 0


@sweep(STEP.signature)
def unit_feedback(address, reading, omega, answer):
    """What waits for the readings of a control period; parameters as those of `unit_step`."""
    u = state_at(address)
    answer.residual, answer.solve_time = np.nan, 0.0
    u.left[0] = NONE
    status = _decide(u, reading, omega, answer)
    if status != 0:
        u.sign[0] = 0.0  # guess anew: what the unit does meanwhile is not known here, but observed
    if u.times.delayed:
        status, u.found[0] = u.found[0], status
    answer.status, answer.usable = status, int(status == 0)
    if status != 0:
        answer.torque = 0.0


@sweep(void(int64))
def unit_preparation(address):
    """What can be done before the next readings, once the command is out."""
    u = state_at(address)
    u.prepared[0] = NONE
    if u.left[0] != NONE and u.sign[0] != 0.0:
        if u.times.shifts:
            shift(u.problem.solver)
        coming = coming_slip_limit(u.problem.belief.search)
        slip_limit = u.problem.solver.terms.axle.slip_limit
        for i in range(slip_limit.size):
            slip_limit[i] = coming
        done, end = preparation(u.left[0], u.times.period, u.problem.solver)
        if end > ENDED:
            u.sign[0] = 0.0
        else:
            u.prepared[0] = done


@sweep(STEP.signature)
def unit_step(address, reading, omega, answer):
    """A control period, see `alloc.onboard.compiled_controller.STEP`; `address`: of a `UnitState`."""
    unit_feedback(address, reading, omega, answer)
    unit_preparation(address)


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
