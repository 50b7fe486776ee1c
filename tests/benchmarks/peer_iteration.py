"""Solvers of the whole problem in the place of the real-time iteration: in the closed loop, and on recorded problems.

They start from their last solution, shifted by a period, with its multipliers, and stop at `TOLERANCE`.
"""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec

from mpc.real_time import RealTimeIteration
from tests.benchmarks.acados_peer import AcadosIteration
from tests.benchmarks.do_mpc_peer import DoMpcSolver
from tests.benchmarks.fatrop_peer import FatropSolver
from tests.benchmarks.ipopt_peer import ReferenceSolver
from tests.benchmarks.opti_peer import OptiSolver
from tests.benchmarks.stages import with_numbers

TOLERANCE = 1e-8


class PeerIteration(RealTimeIteration):
    """A `RealTimeIteration` whose `solve` is that of a converging solver of the class `kind`."""

    def __init__(self, units, settings, *, kind, tolerance=TOLERANCE):
        super().__init__(units, settings)
        self._peer = kind(units, settings, tolerance=tolerance, warm_start=True)

    def restart(self, torque):
        super().restart(torque)
        self._peer.forget()

    def solve(self, problem):
        one = with_numbers(problem) if self.units == 1 else problem
        solution = self._peer.solve(one, self.torques)
        self.torques[:] = solution.torques
        return solution


CONVERGING = {
    "ipopt": ReferenceSolver,
    "Opti with ipopt": OptiSolver,
    "do-mpc with ipopt": DoMpcSolver,
    "fatrop": FatropSolver,
}
"""Classes of converging solvers by name."""

PEERS: dict[str, Callable[..., RealTimeIteration]] = {
    **{name: partial(PeerIteration, kind=kind) for name, kind in CONVERGING.items()},
    "acados SQP_RTI": AcadosIteration,
}
"""What makes a peer's iteration, by name: (units, settings) -> iteration."""

NEEDED = {
    "do-mpc with ipopt": ("do_mpc", "do-mpc is not installed: pip install -c constraints.txt -e '.[bench]'"),
    "acados SQP_RTI": ("acados_template", "acados is not installed: see docs.acados.org"),
}  # fmt: skip
"""Package that a peer needs beside this project's, and what to say where it is not there."""


def missing(name: str) -> str:
    """Why the peer called `name` cannot be run here; empty where it can."""
    package, reason = NEEDED.get(name, ("", ""))
    return reason if package and find_spec(package) is None else ""
