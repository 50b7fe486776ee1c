"""Random legal scenarios: each ends, and is finite, balanced, and within its limits and its metrics' ranges."""

from alloc.metrics import evaluate
from alloc.simulation import simulate
from tests.studies.random_scenarios import AXLE_STEPS, drawn

COUNT = 250


def test_random_legal_scenarios_give_runs_that_keep_every_law():
    failures, single, coupled = [], 0, 0
    for number in range(COUNT):
        event, rule, controller = drawn(number)
        try:
            run = simulate(event, rule, controller)  # which checks the run
            evaluate(run)  # and its metrics
        except Exception as error:
            failures.append(f"{number}: {rule}, {controller}: {type(error).__name__}: {error}")
        else:
            single += run.sizes["time"] == 1
            coupled += run.sizes["coupler"] > 0
    assert not failures, "\n".join(failures)
    # the draws have what they are meant to have
    assert single > COUNT / 50
    assert coupled > COUNT / 4
    assert AXLE_STEPS >= 1e5
