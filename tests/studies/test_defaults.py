"""What a comparison consists of when nothing is said, and what a word about it changes."""

from collections import Counter
from fnmatch import fnmatchcase

import pytest

from alloc.rules import RULES
from studies.comparison.defaults import (
    DEFAULT_SEEDS,
    KEPT_RUNS,
    SLOW_CONTROLLER,
    SLOW_RULES,
    default_grid,
    make_grid,
)
from studies.core.drawn_events import COMPARED
from studies.files.study_error import StudyError
from studies.scenario.loading import load_scenario, shipped_scenarios


def test_by_default_every_scenario_but_those_of_faults_meets_every_rule_but_the_slow_ones():
    grid = default_grid()
    shipped = [load_scenario(name) for name in shipped_scenarios()]
    wanted = [scenario.name for scenario in shipped if scenario.in_default_comparison]
    assert [scenario.name for scenario in grid.scenarios] == wanted
    assert 8 <= len(wanted) < len(shipped)
    assert set(grid.rules) == set(RULES) - set(SLOW_RULES)
    assert grid.seeds == tuple(range(DEFAULT_SEEDS))
    assert DEFAULT_SEEDS >= 5
    assert not grid.fixed
    cells = Counter((job.scenario.name, job.rule, job.controller) for job in grid.jobs())
    seeds = dict.fromkeys(COMPARED, DEFAULT_SEEDS) | {SLOW_CONTROLLER: 1}
    assert cells == {
        (name, rule, controller): count
        for name in wanted
        for rule in grid.rules
        for controller, count in seeds.items()
    }


def test_the_slow_controller_meets_the_first_seed_and_all_where_it_is_named():
    scenario = load_scenario("wet-start")
    grid = make_grid([scenario], ["exact"], None, 2)
    assert {job.seed for job in grid.jobs() if job.controller == SLOW_CONTROLLER} == {0}
    named = make_grid([scenario], ["exact"], [SLOW_CONTROLLER], 2)
    assert [job.seed for job in named.jobs()] == [0, 1]


def test_every_pattern_of_runs_to_keep_matches_a_cell():
    labels = [job.label for job in default_grid().jobs()]
    for pattern in KEPT_RUNS:
        assert any(fnmatchcase(label, pattern) for label in labels)


def test_named_controllers_are_all_that_is_run():
    grid = make_grid([load_scenario("wet-start")], ["exact", "exact"], ["none"], 2)
    assert [job.label for job in grid.jobs()] == [
        "wet-start/exact/none/0",
        "wet-start/exact/none/1",
    ]


def test_slow_rules_run_when_they_are_asked_for():
    assert make_grid([load_scenario("wet-start")], ["qp-cvxpy"], ["none"], 1).rules == ("qp-cvxpy",)


@pytest.mark.parametrize("seeds", [0, -1])
def test_at_least_one_seed_is_needed(seeds):
    with pytest.raises(StudyError, match="--seeds"):
        make_grid([load_scenario("wet-start")], None, None, seeds)


def test_the_default_grid_leaves_the_joint_controllers_out():
    # they take several times as long, and answer another question
    assert {job.controller for job in default_grid().jobs()} == {*COMPARED, SLOW_CONTROLLER}
