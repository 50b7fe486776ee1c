"""What a comparison consists of when nothing is said, and what a word about it changes."""

from collections import Counter
from fnmatch import fnmatchcase

from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.host import CONTROLLERS
from alloc.rules import RULES
from studies.comparison.defaults import (
    DEFAULT_SEEDS,
    KEPT_RUNS,
    SLOW_CONTROLLER,
    SLOW_RULES,
    default_grid,
    make_grid,
)
from studies.core.controllers import check_controller, is_hosted
from studies.core.drawn_events import COMPARED
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


def test_every_pattern_of_runs_to_keep_matches_a_cell():
    labels = [job.label for job in default_grid().jobs()]
    for pattern in KEPT_RUNS:
        assert any(fnmatchcase(label, pattern) for label in labels)


def test_named_controllers_are_all_that_is_run():
    """The slow one meets the first seed, and all where it is named; slow rules run when they are asked for."""
    scenario = load_scenario("wet-start")
    grid = make_grid([scenario], ["exact", "exact"], ["none"], 2)
    assert [job.label for job in grid.jobs()] == [
        "wet-start/exact/none/0",
        "wet-start/exact/none/1",
    ]
    grid = make_grid([scenario], ["exact"], None, 2)
    assert {job.seed for job in grid.jobs() if job.controller == SLOW_CONTROLLER} == {0}
    named = make_grid([scenario], ["exact"], [SLOW_CONTROLLER], 2)
    assert [job.seed for job in named.jobs()] == [0, 1]
    assert make_grid([scenario], ["qp-cvxpy"], ["none"], 1).rules == ("qp-cvxpy",)


def test_built_in_and_hosted_controllers_stand_in_one_collection():
    hosted = ["mpc", "mpc-car", "mpc-opti", "mpc-train", "mpc-train-ideal"]
    assert list(CONTROLLERS) == [*BUILT_IN, *hosted]
    assert [name for name in CONTROLLERS if is_hosted(name)] == hosted
    for name in hosted:
        assert CONTROLLERS[name].name == name
        assert CONTROLLERS.origin(name) == "mpc.hosted"
        check_controller(name)
