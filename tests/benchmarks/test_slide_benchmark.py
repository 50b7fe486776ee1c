"""Cost of a braked train of twelve axles under slide protection per simulated second, at 1 ms.

`make bench` measures; as an ordinary test one short run each is made and only compared in what it yields. Bounds are on
ratios within one run, with wide margins: the machine may be busy.
"""

from dataclasses import replace

import pytest

from studies.slides.jp4209318 import CALIBRATED, brake, brake_event

SECONDS = 5.0
LAWS = ("none", "threshold", "fuzzy")


def _event(law: str):
    event = replace(brake_event(CALIBRATED), duration=SECONDS)
    braking = event.onboard.braking
    protection = replace(braking.slide_protection, law=law)
    onboard = replace(event.onboard, braking=replace(braking, slide_protection=protection))
    return replace(event, onboard=onboard)


@pytest.fixture(scope="module")
def cost():
    """Milliseconds of the compiled loop per simulated second by law, filled in as the benchmarks run."""
    return {}


@pytest.mark.parametrize("law", LAWS)
def test_cost_per_simulated_second(benchmark, cost, law):
    event = _event(law)
    run = brake(event)
    assert run.sizes["axle"] == 12
    if not benchmark.enabled:
        benchmark(lambda: None)
        return
    walls = []
    benchmark.pedantic(
        lambda: walls.append(brake(event).attrs["wall_time_s"]), rounds=25, warmup_rounds=1
    )
    cost[law] = 1e3 * min(walls) / SECONDS
    benchmark.extra_info["ms per simulated second"] = round(cost[law], 2)


def test_ratios(benchmark, cost):
    """Twenty decisions are a small part of a thousand steps; 10 ms per simulated second is the goal, told and not gated."""
    benchmark(lambda: None)
    if len(cost) < len(LAWS):
        pytest.skip("needs the costs of the whole module: run with --benchmark-enable")
    benchmark.extra_info.update({law: round(value, 2) for law, value in cost.items()})
    assert cost["fuzzy"] < 1.5 * cost["none"]
