"""The box QP as plain Python, on programs too small for its blocks of eight numbers."""

import numpy as np
import pytest

from alloc.plant.operations import WIDTH
from mpc.box_qp import ACCEPTED, box_workspace, solve_box_qp
from tests.mpc.box_programs import KINDS, program, violation


@pytest.mark.parametrize("kind", KINDS)
def test_no_slope_is_left_that_could_be_followed(kind):
    for seed in range(40):
        hessian, gradient, lower, upper = program(seed, kind, most=WIDTH)
        for start in (lower, upper, np.zeros_like(lower)):
            x = start.copy()
            steps = solve_box_qp(hessian, gradient, lower, upper, x, box_workspace(x.size))
            assert 0 <= steps <= 3 * x.size + 2
            assert violation(hessian, gradient, lower, upper, x) <= ACCEPTED
