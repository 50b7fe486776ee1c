"""The MPC's parts exchanged: each works, and differences are those of the same events."""

import pytest

from alloc.metrics import evaluate
from alloc.onboard.controllers import CONTROLLERS
from alloc.simulation import simulate
from mpc.bench import MEASURES, differences, exchanged
from studies.scenario import load
from tests.cases import looped
from tests.wheel import drive

PARTS = exchanged()


@looped("name", PARTS)
def test_every_part_holds_a_slip_near_the_peak(name):
    slip, mu, command, _ = drive(PARTS[name], lambda t: 0.08, 0.1, 8.0)
    assert mu[-300:].mean() > (0.8 if "inverted" in name else 0.94) * 0.08
    assert slip[-300:].max() < 0.5
    assert 0.0 < command[-300:].min() < command[-300:].max() < 0.15


def test_a_search_alone_and_a_horizon_alone_are_neither_of_the_two():
    courses = [drive(one, lambda t: 0.08, 0.15, 6.0)[2] for one in PARTS.values()]
    courses.append(drive(CONTROLLERS["mpc"], lambda t: 0.08, 0.15, 6.0)[2])
    assert len({one.tobytes() for one in courses}) == len(courses)


def test_differences_are_those_of_the_same_events():
    events = [load("wet-patch").event(seed) for seed in (0, 1)]
    found = differences(events, {"itself": CONTROLLERS["mpc"], "none": CONTROLLERS["none"]})
    assert list(found.loc["itself"]) == ["+0.00 ± 0.00"] * len(MEASURES)
    own = [
        100.0 * (evaluate(simulate(one, "alone", "none"))["bound_use"]
                 - evaluate(simulate(one, "alone", "mpc"))["bound_use"])
        for one in events
    ]  # fmt: skip
    assert float(found.loc["none"].iloc[0].split()[0]) == pytest.approx(sum(own) / 2, abs=0.006)
