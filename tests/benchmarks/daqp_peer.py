"""The reference of the compiled real-time iteration: its loop in Python, its quadratic programs solved by DAQP.

DAQP is Arnstroem, Bemporad, Axehall: A dual active-set solver for embedded quadratic programming, IEEE Trans. Automatic
Control 67 (2022) 4362-4369.
"""

import daqp
import numpy as np

from tests.benchmarks.python_iteration import PythonIteration

PRIMAL_TOLERANCE = 1e-12
"""Violation of a bound that DAQP leaves, in scaled torques."""


class DaqpIteration(PythonIteration):
    """The iteration with DAQP's own interface, set up once."""

    def __init__(self, units, settings, evenness=0.0):
        super().__init__(units, settings, evenness)
        n = self.torques.size
        self._daqp = daqp.Model()
        self._daqp.setup(
            np.eye(n), np.zeros(n), np.zeros((0, n)), np.ones(n), -np.ones(n), np.zeros(n, dtype=np.int32),
        )  # fmt: skip
        self._daqp.settings = {**self._daqp.settings, "primal_tol": PRIMAL_TOLERANCE}

    def program(self, hessian, gradient, lower, upper):
        """As any."""
        changed = self._daqp.update(H=hessian, f=gradient, bupper=upper, blower=lower)
        step, _, flag, _ = self._daqp.solve()
        assert min(changed, flag) >= 0
        return step
