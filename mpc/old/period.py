"""The optimal control problem of a control period and its real-time iteration; the period of units and groups in Python.

In: measured state, model parameters, targets, slip limits. Out: torques over the horizon, warm started by shifting.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from alloc.old.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.old.plant.model import Floats
from alloc.old.records import ByReference, address_of
from mpc.old.arrays import PREPARE, RATE, SLOPE, TANGENT
from mpc.old.belief import GroupBelief, UnitBelief
from mpc.old.condensing import AxleTerms, Cost, CostWeights, UnitTerms, simulate, trajectory_cost
from mpc.old.generated import compiled_group
from mpc.old.model import (
    Units,
    group_of,
    slip_matrix,
    stiffness_of,
    torque_per_coefficient,
    unit_model,
    unit_of_axle,
)
from mpc.old.settings import MpcError, MpcSettings, Weights
from mpc.old.solver import (
    NO_SOLUTION,
    NOT_FINITE,
    Addresses,
    Rules,
    ahead,
    hold,
    iterate,
    period,
    prepare,
    shift,
)

# The data of the optimal control problem of one control period, and its answer; `mpc.old.reference` states it whole.
#
# Everything counts positive in the direction of the demand, so braking and driving are one problem. The problem is for
# one unit or a group; with one unit, plain numbers may replace entries per unit.


class HorizonProblem(NamedTuple):
    """Data of the problem of one control period; the cost is that of `mpc.old.condensing`."""

    state: Floats
    """State of the model now, (axles + 1 + units,)."""
    parameters: Floats
    """Parameters of the model, see `mpc.old.model.parameters`."""
    slip_limit: Floats
    """Slip velocity that each axle should stay below [m/s], (axles,)."""
    target: float | Floats
    """Torque wanted of each motor of each unit [N m], (units,); of a group only their total counts."""
    before: float | Floats
    """Torque command of the period before [N m], (units,)."""
    upper: float | Floats
    """Greatest torque command [N m], (units,); the least is zero."""
    reference: float | Floats = 0.0
    """Torque of an even split [N m], (units,), which decides who gives the total of a group."""


class HorizonSolution(NamedTuple):
    """Answer of a solver."""

    torques: Floats
    """Torque commands over the horizon [N m], step by step, (horizon * units,)."""
    cost: float
    residual: float
    """Optimality residual: largest change of a torque, over the torque scale, by a projected gradient step.

    For the real-time iteration, as cost, that of the last linearisation, before the last step."""
    iterations: int
    status: str
    """"ok", or what went wrong."""


class Problem(NamedTuple):
    """The whole problem of a period, of a unit or of a group, for `mpc.old.solve`."""

    units: Units
    settings: MpcSettings
    period: HorizonProblem
    guess: Floats | None = None
    """Torques to start from [N m], (horizon, units); None: those of the period before, held."""

    @property
    def evenness(self) -> float:
        """Weight of that term of the cost; a unit alone has nobody to share with."""
        alone = isinstance(self.units, UnitContext)
        return 0.0 if alone else self.settings.group.evenness

    def numbers(self) -> list[Floats]:
        """Data of the period as arrays of their full size; raises `MpcError` where one has another."""
        model, found = unit_model(self.units), []
        sizes = model.states, model.parameters.numel(), model.axles, *[model.units] * 4
        for name, value, size in zip(self.period._fields, self.period, sizes, strict=True):
            if np.size(value) not in (1, size):
                raise MpcError(f"mpc: {name} has {np.size(value)} numbers; give it {size}")
            found.append(np.broadcast_to(np.asarray(value, dtype=float), size))
        return found

    def guessed(self) -> Floats:
        """The guess within its bounds, (horizon, units)."""
        now, shape = self.period, (self.settings.horizon, len(group_of(self.units)))
        guess = now.before if self.guess is None else np.reshape(self.guess, shape)
        return np.clip(np.broadcast_to(guess, shape), 0.0, now.upper)


class Plan(NamedTuple):
    """What `mpc.old.solve` answers."""

    torques: Floats
    """Torque commands [N m], (horizon, units)."""
    states: Floats
    """From the measured one on, (horizon + 1, states), see `mpc.old.model.UnitModel`."""
    slack: Floats
    """Slip beyond its limit at the end of each step, over the scale of slip, (horizon, axles)."""
    cost: float
    status: str
    """"ok", or what went wrong: the rest is then not to be used."""
    iterations: int
    solve_time: float
    """Measured [s]; without what is made once for all problems of a shape."""


def weights_of(units: Units, settings: MpcSettings) -> Weights:
    """Weights of the units' problem: changes of torque cost more where a drive twists."""
    w = settings.weights
    twists = any(context.twisting for context in group_of(units))
    return replace(w, rate=w.twisting_rate) if twists else w


def cost_of(units: Units, settings: MpcSettings, evenness: float = 0.0) -> Cost:
    """Cost as the compiled functions take it; targets, torques before, references and slip limits are still to come."""
    group, unit = group_of(units), unit_of_axle(units)
    w = weights_of(units, settings)
    mass = np.array([context.mass for context in group])
    carried = np.array([torque_per_coefficient(context) for context in group])
    share = mass / mass.sum()
    n = len(group)
    return Cost(
        slip_matrix=slip_matrix(units),
        axle=AxleTerms(np.zeros(unit.size), (share / np.bincount(unit))[unit]),
        unit=UnitTerms(np.zeros(n), np.zeros(n), np.zeros(n), w.coefficient_scale * carried, share),
        weights=CostWeights(*map(float, (w.tracking, w.slip, w.rate, evenness, w.slip_scale))),
    )


# Real-time iteration: one step of sequential quadratic programming per control period, warm started by shifting.
#
# Diehl, Bock, Schloeder, Findeisen, Nagy, Allgoewer: Real-time optimization and nonlinear model predictive control of
# processes governed by differential-algebraic equations, J. Process Control 12 (2002) 577-585. The states are condensed
# away. The whole period is one compiled call, `mpc.old.solver.iterate`.


FAILURES = {
    NOT_FINITE: "not finite",
    NO_SOLUTION: "QP not solved",
}
"""Status of what ends without a solution."""


class RealTimeIteration:
    """Solver of `HorizonProblem`; arrays are made once, and the last solution is kept as a guess.

    For one unit, or for a group as one problem; `evenness` is the weight of that term of the cost.
    """

    def __init__(self, units: Units, settings: MpcSettings, evenness: float = 0.0) -> None:
        self._settings = settings
        self.most = max(1, settings.steps_in_time(group_of(units)[0].period))
        """Most steps of a solve."""
        self._model = compiled_group(units)  # kept: compiled code has its addresses
        self._terms = cost_of(units, settings, evenness)
        made, model = unit_model(units), self._model
        self.units = made.units
        rules = Rules(
            step=float(settings.step),
            stiffness=stiffness_of(units, settings.step),
            tolerance=settings.tolerance,
        )
        addresses = Addresses(
            address_of(model.prepare, PREPARE),
            address_of(model.slope, SLOPE),
            address_of(model.rate, RATE),
            address_of(model.tangent, TANGENT),
        )
        self.period = period(
            addresses,
            model.nonzeros,
            self._terms,
            rules,
            settings.horizon,
            (made.parameters.numel(), model.constants),
        )
        self._period = ByReference(self.period)
        self._iterate = iterate
        self.torques = self.period.guess.torques
        """The guess, [N m], (horizon * units,)."""

    def shift(self) -> None:
        """Move the guess on by one period."""
        shift(self._period)

    def restart(self, torque: float | np.ndarray) -> None:
        """Discard the guess: hold `torque` [N m], (units,), over the horizon."""
        self._terms.unit.before[:] = torque
        hold(self._period)

    def take(self, problem: HorizonProblem) -> None:
        """Copy what is new in a period to where the compiled code reads it, and set the model's parameters."""
        now, axle, unit = self.period.now, self._terms.axle, self._terms.unit
        now.state[:], now.parameters[:] = problem.state, problem.parameters
        now.upper.reshape(-1, self.units)[:] = problem.upper
        axle.slip_limit[:] = problem.slip_limit
        unit.target[:], unit.before[:] = problem.target, problem.before
        unit.reference[:] = problem.reference
        prepare(self._period)

    def course(self, torques: Floats) -> tuple[Floats, float]:
        """States (horizon + 1, states) from that of the last problem on under `torques` [N m], (horizon * units,); cost."""
        now, guess, rules = self.period.now, self.period.guess, self.period.rules
        substeps = int(now.substeps[0])
        guess.nodes[0] = now.state
        simulate(
            self._model.slope, torques, now.constants, rules.step / substeps, substeps, guess.nodes, guess.scratch,
        )  # fmt: skip
        return guess.nodes.copy(), trajectory_cost(guess.nodes, torques, ByReference(self._terms))

    def ahead(self, problem: HorizonProblem, time: float) -> HorizonProblem:
        """The problem from the state on that is predicted after `time` [s] under the torques before."""
        self.take(problem)
        ahead(time, self._period)
        return problem._replace(state=self.period.now.state.copy())

    def solve(self, problem: HorizonProblem) -> HorizonSolution:
        """Improve the guess by one step, and by more while the residual before the last one exceeds `settings.tolerance`.

        At most `most` in all. A solution with another status than "ok" must not be used; the guess is then to be restarted.
        """
        self.take(problem)
        cost, residual, done, end = self._iterate(self.most, self._period)
        status = FAILURES.get(end, "ok")
        return HorizonSolution(self.torques.copy(), cost, residual, done, status)


Iteration = Callable[..., RealTimeIteration]
"""Makes a solver as `RealTimeIteration` is made; another solver derives from it and has its own `solve`."""

_iteration = lru_cache(maxsize=16)(RealTimeIteration)


def solve_compiled(problem: Problem) -> Plan:
    """The answer of as many steps from the guess on as the settings allow, see `mpc.old.solve`."""
    units, settings, now, _ = problem
    alone = problem.evenness == 0.0
    solver = _iteration(units if alone else group_of(units), settings, problem.evenness)
    solver.restart(now.before)
    solver.torques[:] = problem.guessed().ravel()
    begun = time.perf_counter()
    found = solver.solve(now)
    took = time.perf_counter() - begun
    states, cost = solver.course(found.torques)
    excess = solver.period.terms.slip_matrix @ states[1:].T - np.reshape(now.slip_limit, (-1, 1))
    return Plan(
        found.torques.reshape(settings.horizon, -1), states, np.maximum(excess.T / settings.weights.slip_scale, 0.0),
        cost, found.status, found.iterations, took,
    )  # fmt: skip


# What the controllers of a unit and of a group share: one answer per control period.
#
# A controller updates its belief about the rail, asks the real-time iteration for the best torques over the horizon,
# and commands the first. A solver that fails, is too slow or is given what is no number is answered with ok = False;
# the unit then cuts and ramps. What is raised is a fault of the program and ends the run. Braking is driving mirrored:
# every law of a unit is odd.


class PredictiveController:
    """Controller of the units of `contexts` as one problem; a subclass says what it believes and what it asks.

    Arrays of its methods are (units,), or (axles,) unit by unit, and count positive in the direction of the demand.
    """

    belief: UnitBelief | GroupBelief

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings, solver: RealTimeIteration
    ) -> None:
        self.settings = settings
        self._solver = solver
        self._axles = sum(context.axles for context in contexts)
        self._late = settings.steps_in_time(contexts[0].period) < 1
        self._period = contexts[0].period
        self._shifts = math.isclose(self._period, settings.step)
        self._sign = 0.0
        self._observed = 0.0
        """Direction that the observers count in; 0: a reading was missed."""
        self._before = np.zeros(len(contexts))
        self._in_force = self._before
        """Signed torques of the present period, if computing takes one."""
        self._found = "ok"
        """Status of the torques that will act next, if computing takes a period."""

    def _believe(
        self, speed: Floats, omega: Floats, torque: Floats, wanted: Floats, estimate: Floats
    ) -> None:
        """Take in the readings; `wanted`: torques that the motors could give; `estimate`: each unit's of its coefficient."""
        raise NotImplementedError

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        """The problem of this period; `limit`: of the motors."""
        raise NotImplementedError

    def _answer(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        torques, status, residual, steps = self._decide(senses)
        if status == "ok" and steps > 0 and self._late:
            status = "late"
        elapsed = steps * self.settings.step_time
        if status != "ok":
            self._sign = (
                0.0  # guess anew: what the units do meanwhile is not known here, but observed
            )
        if self.settings.computing_delay:
            torques, status, self._found = self._in_force, self._found, status
        if status != "ok":
            return [TorqueDecision(0.0, False, status, elapsed, residual) for _ in senses]
        return [TorqueDecision(float(u), True, status, elapsed, residual) for u in torques]

    def _decide(self, senses: Sequence[UnitSense]) -> tuple[Floats, str, float, int]:
        """Torques, status, residual, and SQP steps taken."""
        self._in_force = self._sign * self._before
        columns = np.array(
            [(s.speed, s.torque, s.target, s.drive_limit, s.brake_limit) for s in senses]
        ).T
        omega = np.concatenate([sense.omega for sense in senses])
        if not (np.isfinite(columns).all() and np.isfinite(omega).all()):
            self._observed = 0.0
            return self._before, "reading not finite", math.nan, 0
        if omega.size != self._axles:
            raise ValueError(f"{omega.size} angular speeds for {self._axles} axles")
        speed, torque, target, drive_limit, brake_limit = columns
        total = float(target.sum())
        sign = math.copysign(1.0, total) if total else self._sign or 1.0
        if sign != self._observed:
            self.belief.forget_forces()
            self._observed = sign
        if sign != self._sign:
            self._before = np.maximum(sign * torque, 0.0)
            self._solver.restart(self._before)
            self._sign = sign
        elif self._shifts:
            self._solver.shift()
        speed, omega, torque = sign * speed, sign * omega, sign * torque
        limit = drive_limit if sign > 0.0 else brake_limit
        estimate = np.array([sense.coefficient for sense in senses])
        self._believe(speed, omega, torque, np.minimum(sign * target, limit), estimate)
        if total == 0.0:
            self._before = self._in_force = np.zeros(len(senses))
            self._solver.restart(0.0)
            return self._before, "ok", 0.0, 0
        if self.settings.computing_delay:
            # that the driver wants less now needs no computing
            self._before = min(1.0, abs(total) / max(self._before.sum(), 1e-9)) * self._before
            self._in_force = sign * self._before
        problem = self._problem(speed, omega, torque, sign * target, limit)
        if self.settings.computing_delay and self.settings.compensated:
            problem = self._solver.ahead(problem, self._period)
        solution = self._solver.solve(problem)
        self._before = solution.torques[: len(senses)].copy()
        return sign * self._before, solution.status, solution.residual, solution.iterations
