"""What records show of themselves is short, has units and is escaped; what they are stays as it is."""

import copy
import pickle
import re
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import pytest

from alloc.display import LONGEST, brief, displayed, line_of
from alloc.event import canonical
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.sets import find_set
from alloc.rules import RULES, AllocationProblem, optimality
from alloc.rules.problem import CASE_B, allocation
from alloc.simulation import CONTROLLERS
from studies.scenario import load as load_scenario


@displayed
@dataclass(frozen=True)
class Made:
    """A record of this test."""

    name: str
    force: np.ndarray | None = None
    """Of each axle [kN], (n,)."""
    speed: float = 0.0
    """[m/s]"""
    note: str = ""


class Plain(NamedTuple):
    start: float
    end: float = 1.0


Shown = displayed(Plain)


def examples():
    problem = AllocationProblem(np.linspace(0.15, 0.19, 3000), 0.17)
    answer = allocation(problem, np.full(3000, 0.17), 0.17, CASE_B, 1e-3)
    scenario = load_scenario("wet-patch")
    event = scenario.event()
    train = find_set("commuter-8car")
    return [
        problem, answer, optimality(problem, answer), scenario, event, event.model, event.command, event.onboard,
        train, train.cars[0], Rail(0.2), Rail(0.2).curve, Line(), Patch(0.5), RULES["exact"],
        CONTROLLERS["mpc"], event.onboard.perturb_observe, RULES, CONTROLLERS,
    ]  # fmt: skip


EXAMPLES = examples()


@pytest.mark.parametrize("one", EXAMPLES, ids=lambda one: type(one).__name__)
def test_public_objects_print_one_line_and_show_a_table(one):
    line = repr(one)
    assert str(one) == line
    assert "\n" not in line
    assert len(line) <= (LONGEST + 1 if not isinstance(one, type(RULES)) else 300)
    table = one._repr_html_()
    assert table.startswith("<table>")
    assert table.count("<tr>") > 0
    assert not re.search(r"https?:|src=|<script|<link", table)
    assert len(table) < 20_000


def test_units_and_ranges_are_said_and_what_is_as_by_default_is_not():
    one = Made("a", np.linspace(1.0, 5.0, 3000))
    assert repr(one) == "<Made 'a': force 3000 values, 1 to 5 kN>"
    assert repr(Made("b", speed=3.0)) == "<Made 'b': speed 3 m/s>"
    assert repr(Line()) == "<Line: as by default>"
    assert '<td style="text-align: left">kN</td>' in one._repr_html_()
    assert "Of each axle, (n,)." in one._repr_html_()


def test_what_stands_in_a_record_is_escaped():
    shown = Made("<b>x</b>", note="<script>alert(1)</script> & more")._repr_html_()
    assert "<script>" not in shown
    assert "<b>" not in shown
    assert "&lt;script&gt;" in shown


def test_records_stay_what_they_are():
    first, second = (find_set("commuter-8car") for _ in range(2))
    assert first == second
    assert hash(first.cars[0]) == hash(second.cars[0])
    assert pickle.loads(pickle.dumps(first)) == first
    assert copy.copy(Shown(2.0)) == Shown(2.0) == (2.0, 1.0)
    assert repr(Shown(2.0)) == "<Plain: start 2>"
    assert pickle.loads(pickle.dumps(Patch(0.5, 1.0))) == Patch(0.5, 1.0)


def test_keys_of_results_see_what_is_not_shown():
    long = np.linspace(0.0, 1.0, 3000)
    other = long.copy()
    other[1500] += 1e-9
    one, two = Made("a", long), Made("a", other)
    assert repr(one) == repr(two)
    assert canonical(one) != canonical(two)


def test_a_record_that_is_half_made_can_be_printed():
    half = object.__new__(Made)
    object.__setattr__(half, "speed", 2.0)
    assert line_of(half) == "<Made: speed 2 m/s>"
    assert fields(half)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.float64(0.123456), "0.1235"),
        (float("nan"), "nan"),
        (True, "yes"),
        (None, "none"),
        ((1.0, 2.0), "1, 2"),
        ((), "–"),
        (np.full((2, 3), np.nan), "2 × 3 values, none is known"),
        (np.array([True] * 5 + [False]), "6 values, 5 yes"),
        ((Plain(0.0), Plain(1.0)), "2 × Plain"),
        ({"a": 1}, "a"),
        (np.mean, "mean"),
    ],
)
def test_values_in_a_few_words(value, said):
    assert brief(value) == said
