"""What fails is seen: faults of the program end a row, solvers that fail too often take its run out of the count."""

import itertools
import math
from dataclasses import replace

import pandas as pd
import pytest

from alloc import simulation
from alloc.onboard.host import CONTROLLERS, HostedController, TorqueDecision, each_unit
from alloc.rules import RULES
from studies.comparison.summary import Grid, summarise
from studies.core.job import MOST_FAILURES
from studies.core.run import run_cells
from studies.core.store import Store

STEPS = 200
"""Control periods of the short scenario."""


class Faulty:
    """Follows its target; at every step that `faults` picks by its number, counted from 1, it does what they say."""

    def __init__(self, faults):
        self.faults, self.step = faults, 0

    def decide(self, sense):
        self.step += 1
        ok = self.faults(self.step)
        return TorqueDecision(0.5 * sense.target, ok, "ok" if ok else "no solution", 1e-4)


def divided_by_zero(step):
    return 1 / (step - 5) != 0.0


def of_no_type(step):
    return step < 5 or step + "1"


def share_fails(share):
    """A solver that fails in this share of the steps, evenly."""
    return lambda step: math.floor(step * share) == math.floor((step - 1) * share)


@pytest.fixture
def row(short, tmp_path, monkeypatch):
    """Row of the short scenario under a controller with these faults, or a rule that gives this answer."""

    def row(faults=lambda step: True, rule="alone", answer=None):
        made = HostedController("faulty", "fails as told", each_unit(lambda _: Faulty(faults)))
        monkeypatch.setitem(CONTROLLERS._parts, "mpc", made)
        if answer is not None:
            monkeypatch.setitem(RULES._parts, rule, answer)
        cells = Grid((short,), (rule,), ("mpc",), (0,)).jobs()
        return run_cells(cells, Store(tmp_path)).iloc[0]

    return row


@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        (
            divided_by_zero,
            "ZeroDivisionError: division by zero (at tests/studies/test_run_status.py:",
        ),
        (
            of_no_type,
            "TypeError: unsupported operand type(s) for +: 'int' and 'str' (at tests/studies/",
        ),
    ],
)
def test_a_controller_that_breaks_ends_the_row_with_its_traceback(row, faults, reason):
    found = row(faults)
    assert found["status"] == "failed"
    assert found["reason"].startswith(reason)
    assert f"in {faults.__name__}, from tests/studies/test_run_status.py:" in found["reason"]
    assert "alloc/onboard/host.py:" in found["reason"]
    assert "\n" not in found["reason"]


def rule_row(short, folder, monkeypatch, answer):
    """Row of the short scenario under a rule with this answer in the place of "qp"; it is asked with every telegram."""
    monkeypatch.setitem(RULES._parts, "qp", replace(RULES["qp"], answer=answer))
    longer = short.changed(duration_s=4.0)
    return run_cells(Grid((longer,), ("qp",), ("none",), (0,)).jobs(), Store(folder)).iloc[0]


@pytest.mark.parametrize("error", [ZeroDivisionError, TypeError, ValueError])
def test_a_rule_that_breaks_ends_the_row_with_its_traceback(short, tmp_path, monkeypatch, error):
    def broken(problem):
        raise error("no cap")

    found = rule_row(short, tmp_path, monkeypatch, broken)
    assert found["status"] == "failed"
    assert found["reason"].startswith(
        f"{error.__name__}: no cap (at tests/studies/test_run_status.py:"
    )
    assert "in broken, from alloc/rules/rule.py:" in found["reason"]


@pytest.mark.parametrize("share", [0.01, MOST_FAILURES, 0.055, 0.3, 1.0])
def test_the_status_follows_from_the_share_of_steps_that_failed(row, share):
    found = row(share_fails(share))
    assert found["controller_failures"] == 4 * round(share * STEPS)
    if share <= MOST_FAILURES:
        assert (found["status"], found["reason"]) == ("ok", "")
    else:
        assert found["status"] == "degraded"
        assert found["reason"] == (
            f"the controller failed in {share:.1%} of {4 * STEPS} steps, 5% are allowed; most often: no solution"
        )


@pytest.mark.parametrize("every", [2, 1000])
def test_a_rule_whose_solver_fails_too_often_degrades_its_row(short, tmp_path, monkeypatch, every):
    calls = itertools.count()

    def answer(problem):
        found = RULES["exact"](problem)
        return (
            found if next(calls) % every else replace(found, status="time over: exact level used")
        )

    found = rule_row(short, tmp_path, monkeypatch, answer)
    assert found["rule_calls"] >= 20
    assert found["rule_failures"] == math.ceil(found["rule_calls"] / every)
    if every == 1000:
        assert (found["status"], found["reason"]) == ("ok", "")
    else:
        assert found["status"] == "degraded"
        assert found["reason"].startswith(
            f"the rule failed in {found['rule_failures'] / found['rule_calls']:.1%} of "
        )
        assert found["reason"].endswith("most often: time over: exact level used")


def test_a_torque_that_is_no_number_is_a_failure(row, monkeypatch):
    monkeypatch.setattr(
        Faulty, "decide", lambda self, sense: TorqueDecision(math.nan, True, "ok", 1e-4)
    )
    found = row()
    assert found["status"] == "degraded"
    assert found["reason"].endswith("most often: torque not finite")


def test_a_step_that_is_used_but_not_ok_is_counted(row, monkeypatch):
    monkeypatch.setattr(
        Faulty, "decide", lambda self, sense: TorqueDecision(0.0, True, "joint: not finite", 1e-4)
    )
    assert row()["reason"].endswith("most often: joint: not finite")


def test_degraded_rows_are_done_and_counted_but_enter_no_mean(short, tmp_path, monkeypatch, call):
    made = HostedController(
        "faulty", "fails as told", each_unit(lambda _: Faulty(share_fails(0.3)))
    )
    monkeypatch.setitem(CONTROLLERS._parts, "mpc", made)
    cells = Grid((short,), ("alone",), ("none", "mpc"), (0,)).jobs()
    table = run_cells(cells, Store(tmp_path))
    plain, degraded = summarise(table)
    assert (plain.failed, plain.degraded, degraded.failed, degraded.degraded) == (0, 0, 0, 1)
    assert degraded.metrics["damage"].count == 0
    assert "30.0% of 800 steps" in degraded.reasons[0]
    assert Store(tmp_path).cells() == dict.fromkeys(table["cell"], True)
    seen = []
    again = run_cells(
        cells, Store(tmp_path), retry_failed=True, on_row=lambda *step: seen.append(step)
    )
    assert len(seen) == 1
    pd.testing.assert_frame_equal(again, table)


def test_a_run_that_breaks_a_law_is_a_failed_row_and_one_line(row, call, short_file, monkeypatch):
    """A filter that diverges, as the reference speed's once did with stiff couplers: nan in what is recorded of it."""
    made = simulation.to_dataset

    def diverged(*given):
        run = made(*given)
        run["reference_speed"].values[50:] = math.nan
        return run

    monkeypatch.setattr(simulation, "to_dataset", diverged)
    found = row()
    reason = "the run is not sound, its numbers count for nothing: reference_speed is not finite at 0.5 s"
    assert found["status"] == "failed"
    assert found["reason"].startswith(f"UnsoundRun: {reason} (at alloc/balance.py:")
    assert call("simulate", short_file) == (1, "", f"readhesion: {reason}\n")
