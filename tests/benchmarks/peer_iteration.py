"""Solvers of the whole problem in the place of the real-time iteration: in the closed loop, and on recorded problems.

They start from their last solution, shifted by a period.
"""

from collections.abc import Callable
from importlib.util import find_spec

from mpc.period import RealTimeIteration
from mpc.unit import OptiIteration
from tests.benchmarks.acados_peer import AcadosIteration
from tests.benchmarks.do_mpc_peer import DoMpcSolver
from tests.benchmarks.stages import with_numbers

TOLERANCE = 1e-8


class FatropIteration(OptiIteration):
    """The problem of `mpc.reference`, by fatrop."""

    solver = "fatrop"


class DoMpcIteration(RealTimeIteration):
    """A `RealTimeIteration` whose `solve` is do-mpc's, with the multipliers of its last solution."""

    def __init__(self, units, settings):
        super().__init__(units, settings)
        self._peer = DoMpcSolver(units, settings, tolerance=TOLERANCE, warm_start=True)

    def restart(self, torque):
        super().restart(torque)
        self._peer.forget()

    def solve(self, problem):
        solution = self._peer.solve(with_numbers(problem), self.torques)
        self.torques[:] = solution.torques
        return solution


CONVERGING: dict[str, Callable[..., RealTimeIteration]] = {
    "Opti with ipopt": OptiIteration,
    "do-mpc with ipopt": DoMpcIteration,
    "fatrop": FatropIteration,
}
"""What makes the iteration of a converging solver, by name: (units, settings) -> iteration."""

PEERS = CONVERGING | {"acados SQP_RTI": AcadosIteration}

NEEDED = {
    "do-mpc with ipopt": ("do_mpc", "do-mpc is not installed: pip install -c constraints.txt -e '.[bench]'"),
    "acados SQP_RTI": ("acados_template", "acados is not installed: see docs.acados.org"),
}  # fmt: skip
"""Package that a peer needs beside this project's, and what to say where it is not there."""


def missing(name: str) -> str:
    """Why the peer called `name` cannot be run here; empty where it can."""
    package, reason = NEEDED.get(name, ("", ""))
    return reason if package and find_spec(package) is None else ""
