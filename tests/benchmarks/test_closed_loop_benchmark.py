"""Solvers of the horizon's problem as controllers in the closed loop, see `closed_loop.py`: `make bench` alone runs it.

Events were drawn after the bounds had been set.
"""

import numpy as np
import pytest

from tests.benchmarks import closed_loop
from tests.benchmarks.closed_loop_events import drawn_event

pytestmark = pytest.mark.skipif(
    "not config.getoption('benchmark_enable')", reason="runs for minutes: run with make bench"
)

SEED, EVENTS = 2026, 3
SAME_USE = 0.005
"""Difference of the adhesion used that a solver may have in an event from the own iteration, both converged or neither."""
EXACT = 1e-6
"""Error of a quadratic program's solution up to which the iteration must run as the own; that of others is only told."""
LEAST_SPEED_UP = 20.0
"""Of the compiled step, with belief and search, over a solver that converges, in medians of CPU time."""


@pytest.fixture(scope="module")
def found():
    """Runs of the ways so far, by name."""
    return {}


@pytest.mark.parametrize("way", closed_loop.ways(), ids=lambda way: way.name)
def test_in_the_closed_loop(benchmark, found, way):
    if way.missing:
        pytest.skip(way.missing)
    events = [drawn_event(SEED, k) for k in range(EVENTS)]
    runs = benchmark.pedantic(lambda: [closed_loop.run(way, event) for event in events], rounds=1)
    found[way.name] = runs
    row = closed_loop.table(runs).iloc[0]
    benchmark.extra_info |= {name: float(value) for name, value in row.items()}
    print("\n" + closed_loop.text(runs))
    assert row["failures"] == 0
    reference = closed_loop.OWN_CONVERGED if way.converges else closed_loop.COMPILED
    different = closed_loop.differences([*found[reference], *runs], reference)[way.name]
    benchmark.extra_info["difference of the adhesion used"] = different
    if way.converges or way.name == closed_loop.OWN or row["step_error"] < EXACT:
        assert different < SAME_USE
    if way.converges and way.name != closed_loop.OWN_CONVERGED:
        times, own = (
            np.concatenate([one.asked.times for one in found[name]])
            for name in (way.name, closed_loop.COMPILED)
        )
        assert np.median(times) > LEAST_SPEED_UP * np.median(own)
