"""Units and sequences of problems that the MPC's solvers are timed on."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import PiecewiseCurve
from mpc.model import Units, group_of, parameters, substeps, torque_per_coefficient, unit_model
from mpc.period import HorizonProblem, RealTimeIteration
from mpc.settings import GroupSettings, MpcSettings
from tests.benchmarks.peer_iteration import PEERS
from tests.benchmarks.unit_step import step_function

HORIZON = 20
CURVE = PiecewiseCurve()
RADIUS = 0.43
EVENNESS = GroupSettings().evenness
SPREAD = np.array([0.118, 0.12, 0.122, 0.125])
"""Peak coefficients of up to four axles."""


@dataclass(frozen=True)
class Case:
    """A unit to time, or a car whose axles are `units` of their own; `iteration` makes the solver under test."""

    name: str
    axles: int
    units: int = 1
    iteration: Callable[[Units, MpcSettings], Any] = RealTimeIteration
    peers: tuple[str, ...] = tuple(PEERS)
    """Those that can take the case's problems."""
    least_speed_up: float = 20.0
    """Over ipopt, in medians."""

    @property
    def context(self) -> Units:
        each = self.axles // self.units
        units = tuple(
            UnitContext(
                unit=k, axles=each, radius=RADIUS, inertia=155.0, gear_ratio=7.07, axle_load=78e3,
                mass=13.75e3 * each, torque_lag=5e-3, curve=CURVE, period=0.01,
            )
            for k in range(self.units)
        )  # fmt: skip
        return units if self.units > 1 else units[0]

    def problems(
        self,
        peak: float | np.ndarray,
        speed: float,
        target: float,
        upper: float,
        slip: float,
        number: int,
    ) -> list[HorizonProblem]:
        """`number` periods of a unit under its own real-time iteration, which knows the `peak`.

        From `slip` [m/s] of every wheel on, with a torque of 600 N m.
        """
        context, settings = self.context, MpcSettings(horizon=HORIZON, iterations=1)
        constants = parameters(context, peak)
        step = step_function(unit_model(context), settings.step, substeps(context, settings.step))
        m = self.units
        state = np.array([speed, *[(speed + slip) / RADIUS] * self.axles, *[600.0] * m])
        solver, torque, made = self.iteration(context, settings), self._each(600.0), []
        solver.restart(torque)
        limit = CURVE.limit(np.broadcast_to(peak, self.axles), speed)[1]
        wanted, most = self._each(target), self._each(upper)
        for _ in range(number):
            made.append(HorizonProblem(state, constants, limit, wanted, torque, most, wanted))
            solver.shift()
            torques = solver.solve(made[-1]).torques
            torque = torques[:m].copy() if m > 1 else float(torques[0])
            state = np.asarray(step(state, torque, constants)).ravel()
        return made

    def _each(self, value: float) -> float | np.ndarray:
        """The same value for each unit; a plain number where there is one, as solvers of one torque take it."""
        return np.full(self.units, value) if self.units > 1 else value

    def readhesion(self) -> list[HorizonProblem]:
        """A second of it: wheels at 0.3 m/s of slip, more torque wanted than the rail carries."""
        return self.problems(SPREAD[: self.axles], 10.0, 900.0, 1000.0, 0.3, 100)

    def drops(self, number: int) -> list[tuple[HorizonProblem, HorizonProblem]]:
        """Pairs of problems between which the peaks fall from about 0.18 to 0.12, the unit having settled before.

        Bounds as in `MpcController`.
        """
        rng, context, pairs = np.random.default_rng(1), self.context, []
        carried = torque_per_coefficient(group_of(context)[0])
        for _ in range(number):
            speed, target = rng.uniform(4.0, 25.0), rng.uniform(900.0, 1200.0)
            low = SPREAD[: self.axles]
            high = 0.18 / 0.12 * low
            high_bound, low_bound = (min(target, 1.1 * p.min() * carried) for p in (high, low))
            before = self.problems(high, speed, target, high_bound, 0.01, 60)[-1]
            after = before._replace(
                parameters=parameters(context, low),
                slip_limit=CURVE.limit(low, before.state[0])[1],
                upper=self._each(low_bound),
            )
            pairs.append((before, after))
        return pairs


CASES = [
    Case("one axle, one torque", 1),
    Case("four axles, one torque", 4),
    Case(
        "four axles, four torques",
        4,
        4,
        partial(RealTimeIteration, evenness=EVENNESS),
        ("Opti with ipopt", "fatrop"),
    ),
]
"""Anything with the attributes of `Case` may join."""
