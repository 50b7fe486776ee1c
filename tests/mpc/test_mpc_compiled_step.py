"""The compiled step does what its reference in Python with DAQP does, for every problem."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python

from mpc.belief import with_predicted_curve
from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings
from tests.benchmarks.daqp_peer import DaqpIteration
from tests.mpc.groups import car_of_four, problem, small_cars

SETTINGS = MpcSettings()


@pytest.mark.parametrize("kind", ["unit", "unit of eight axles", "group"])
def test_every_solution_is_the_references(make_context, random_problem, kind):
    settings = replace(SETTINGS, tolerance=1e-4)
    context = make_context(axles=8 if kind == "unit of eight axles" else 4, mass=110e3)
    # the curve that units predict with: its parameters say how many substeps are taken
    context = with_predicted_curve(context)
    units, evenness = (car_of_four(), 0.05) if kind == "group" else (context, 0.0)
    own, other = (K(units, settings, evenness) for K in (RealTimeIteration, DaqpIteration))
    steps = 0
    for seed in range(12):
        data = random_problem(context, seed) if kind != "group" else problem(units, seed)
        for solver in (own, other):
            solver.restart(data.before)
        for _ in range(2):
            one, two = own.solve(data), other.solve(data)
            assert (one.status, one.iterations) == (two.status, two.iterations)
            scale = np.abs(two.torques).max()
            np.testing.assert_allclose(one.torques, two.torques, atol=1e-8 * scale)
            assert one.cost == pytest.approx(two.cost, rel=1e-8)
            assert one.residual == pytest.approx(two.residual, rel=1e-6, abs=1e-8)
            steps = max(steps, one.iterations)
    assert steps > 1


def test_the_compiled_step_allocates_nothing():
    group = small_cars(2)
    settings = replace(SETTINGS, tolerance=0.0)
    solver, data = RealTimeIteration(group, settings, 0.05), problem(group, 1)
    solver.restart(data.before)
    solver.take(data)
    _nrt_python.memsys_enable_stats()
    before = _nrt_python.memsys_get_stats_alloc()
    np.testing.assert_array_equal(_new(3), 0.0)
    assert _nrt_python.memsys_get_stats_alloc() > before, "allocations are counted"
    before = _nrt_python.memsys_get_stats_alloc()
    end = solver._iterate(5, solver._period)
    assert _nrt_python.memsys_get_stats_alloc() == before
    assert end[2] == 5
    _nrt_python.memsys_disable_stats()


@numba.njit
def _new(size):
    return np.zeros(size)
