"""The project's own rule: the plan at least, room to search for who is limited, and everyone who can helps."""

import numpy as np
import pytest
from hypothesis import given

from alloc.metrics import evaluate
from alloc.rules import find_rule
from alloc.rules.exact import cooperative_law
from alloc.rules.rule import Units, units_of
from alloc.rules.testing import EXPECTED, problems
from alloc.simulation import simulate
from studies.scenario.loading import load_scenario

PLAN = 0.16


@given(problem=problems(24))
def test_its_law_gives_the_plan_at_least_and_within_reach_no_more_than_exact_needs(problem):
    problem = problem.changed(rate=None, previous=None)
    limit = np.empty(problem.n)
    units = units_of(problem)
    level, reached = cooperative_law(units, EXPECTED, limit)
    exact = find_rule("exact")(problem)
    np.testing.assert_equal(level, exact.level)
    assert reached == (exact.case == "B")
    most = np.minimum(max(EXPECTED, level) if reached else np.inf, units.limit_max)
    assert np.all(limit >= np.minimum(EXPECTED, units.limit_max))
    assert np.all(limit <= most + 1e-15)


def limits(cap, upper_bound, most=1.0, plan=PLAN, needed=None):
    """Limits and level of units of equal mass, limited at `cap` and open to `upper_bound`, that together need `needed`."""
    cap, upper_bound = np.asarray(cap, dtype=float), np.asarray(upper_bound, dtype=float)
    same = np.ones(cap.size)
    out = np.empty(cap.size)
    units = Units(cap, same, most * same, out, cap, cap, upper_bound, plan)
    level, reached = cooperative_law(units, plan if needed is None else needed, out)
    return out, level, reached


def test_others_make_up_for_what_a_limited_unit_lacks():
    found, level, reached = limits([0.10, np.inf, np.inf, np.inf], [0.106, np.inf, np.inf, np.inf])
    assert reached
    assert level == pytest.approx(0.18)
    assert found == pytest.approx([PLAN, 0.18, 0.18, 0.18])


def test_no_limit_is_below_the_plan_or_above_what_motors_can():
    found, _, _ = limits([0.10, 0.12, 0.2], [0.106, 0.127, 0.212], most=0.15)
    assert found == pytest.approx([0.15, 0.15, 0.15])


def test_out_of_reach_each_unit_has_room_to_search_the_best_one_too():
    found, _, reached = limits([0.10, 0.15, 0.17], [0.106, 0.159, 0.1802])
    assert not reached
    assert found == pytest.approx([PLAN, PLAN, 0.1802])


def test_what_trailers_lack_is_asked_of_units_with_room_alone():
    """One that its rail limits below the plan keeps the plan: asked for more it would slip, and fill up with air."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        needed = PLAN * rng.uniform(0.9, 1.2)
        cap = np.where(rng.random(8) < 0.4, PLAN * rng.uniform(0.3, 0.9, 8), np.inf)
        found, level, reached = limits(cap, 1.06 * cap, needed=needed)
        room = np.isinf(cap)
        assert reached == (room.any() or cap.mean() > needed)
        np.testing.assert_allclose(found[~room], PLAN)
        # what shoes give beyond their part, while cylinders empty, lowers no limit
        np.testing.assert_allclose(found[room], max(level, PLAN))
        if reached:
            assert np.where(room, level, cap).mean() == pytest.approx(needed)


@pytest.mark.parametrize(("name", "gain"), [("wet-front", 0.03), ("long-train", 0.015)])
def test_where_there_is_headroom_a_searching_controller_gains_most_of_it(name, gain):
    event = load_scenario(name).event()
    alone, own = (
        evaluate(simulate(event, rule, "perturb-observe")) for rule in ("alone", "cooperative")
    )
    assert own["bound_use"] - alone["bound_use"] > gain
    assert own["bound_use"] > 0.99
    assert own["over_delivery"] < 0.005
