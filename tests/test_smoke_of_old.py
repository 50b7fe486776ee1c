"""The packages `old`, which wait to be replaced, still give the numbers of the page."""

import pytest

from alloc.old.metrics import evaluate
from alloc.old.simulation import simulate
from studies.scenario import load


@pytest.mark.parametrize(("rule", "used"), [("alone", 0.969), ("cooperative", 0.995)])
def test_wet_patch(rule, used):
    run = simulate(load("wet-patch").event(), rule, "perturb-observe")
    assert evaluate(run)["bound_use"] == pytest.approx(used, abs=5e-4)
