"""Units and sequences of problems that the MPC's solvers are timed on."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import PiecewiseCurve
from mpc.horizon import HorizonProblem
from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings
from mpc.unit_model import parameters, substeps, torque_per_coefficient, unit_model

HORIZON = 20
SPREAD = np.array([0.118, 0.12, 0.122, 0.125])
"""Peak coefficients of up to four axles."""


@dataclass(frozen=True)
class Case:
    """A unit to time; `iteration` makes the solver under test from context and settings."""

    name: str
    axles: int
    iteration: Callable[[UnitContext, MpcSettings], Any] = RealTimeIteration
    peers: tuple[str, ...] = ("ipopt", "fatrop", "acados")
    """Solvers that can take the case's problems."""
    least_speed_up: tuple[float, float] = (20.0, 40.0)
    """Over warm ipopt, in medians, with the model compiled by Numba and from C."""

    @property
    def context(self) -> UnitContext:
        return UnitContext(
            unit=0, axles=self.axles, radius=0.43, inertia=155.0, gear_ratio=7.07, axle_load=78e3,
            mass=13.75e3 * self.axles, torque_lag=5e-3, curve=PiecewiseCurve(), period=0.01,
        )  # fmt: skip

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
        step = unit_model(context).step_function(settings.step, substeps(context, settings.step))
        state = np.array([speed, *[(speed + slip) / context.radius] * self.axles, 600.0])
        solver, torque, made = self.iteration(context, settings), 600.0, []
        solver.restart(torque)
        limit = context.curve.limit(np.broadcast_to(peak, self.axles), speed)[1]
        for _ in range(number):
            made.append(HorizonProblem(state, constants, limit, target, torque, upper))
            solver.shift()
            torque = float(solver.solve(made[-1]).torques[0])
            state = np.asarray(step(state, torque, constants)).ravel()
        return made

    def readhesion(self) -> list[HorizonProblem]:
        """A second of it: wheels at 0.3 m/s of slip, more torque wanted than the rail carries."""
        return self.problems(SPREAD[: self.axles], 10.0, 900.0, 1000.0, 0.3, 100)

    def drops(self, number: int) -> list[tuple[HorizonProblem, HorizonProblem]]:
        """Pairs of problems between which the peaks fall from about 0.18 to 0.12, the unit having settled before.

        Bounds as in `MpcController`.
        """
        rng, context, pairs = np.random.default_rng(1), self.context, []
        carried = torque_per_coefficient(context)
        for _ in range(number):
            speed, target = rng.uniform(4.0, 25.0), rng.uniform(900.0, 1200.0)
            low = SPREAD[: self.axles]
            high = 0.18 / 0.12 * low
            high_bound, low_bound = (min(target, 1.1 * p.min() * carried) for p in (high, low))
            before = self.problems(high, speed, target, high_bound, 0.01, 60)[-1]
            after = before._replace(
                parameters=parameters(context, low),
                slip_limit=context.curve.limit(low, before.state[0])[1],
                upper=low_bound,
            )
            pairs.append((before, after))
        return pairs


# ipopt's problem shrinks with the axles, the QP in the torques does not; and C is no faster than Numba
CASES = [
    Case("one axle, one torque", 1, least_speed_up=(20.0, 20.0)),
    Case("four axles, one torque", 4),
]
"""Anything with the attributes of `Case` may join."""
