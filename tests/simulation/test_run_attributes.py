"""A run's attributes are typed, and what a run holds is of these types, before and after a file."""

from typing import Any, get_type_hints

from alloc.event import Event
from alloc.metrics import evaluate
from alloc.recording import RunAttributes, attributes_of, load, save
from alloc.rules import AllocationProblem, Rule
from alloc.rules.problem import Allocation
from alloc.simulation import simulate
from studies.scenario.loading import load_scenario
from studies.scenario.scenario import Scenario

HINTS = get_type_hints(RunAttributes)


def test_what_a_user_reads_is_typed():
    assert set(HINTS.values()) <= {int, float, str}
    assert get_type_hints(attributes_of)["return"] is RunAttributes
    assert get_type_hints(Rule.__call__)["return"] is Allocation
    assert get_type_hints(Scenario.event)["return"] is Event
    assert get_type_hints(evaluate)["return"] == dict[str, float]
    assert Any not in get_type_hints(simulate).values()
    for kind in (Allocation, Event, AllocationProblem, Rule):
        vague = {name for name, hint in get_type_hints(kind).items() if hint is Any}
        assert vague <= {"law"}, kind  # compiled


def test_a_run_holds_what_is_promised(tmp_path):
    event = load_scenario("wet-patch").changed(duration_s=0.2).event(seed=3)
    run = simulate(event, "alone", "cut-and-ramp")
    save(run, tmp_path / "run.nc")
    for one in (run, load(tmp_path / "run.nc")):
        found = attributes_of(one)
        assert set(found) == set(HINTS)
        wrong = {
            name: type(found[name])
            for name, kind in HINTS.items()
            if not isinstance(found[name], kind)
        }
        assert not wrong
    assert found["seed"] == 3
    assert found["rule"] == "alone"
