"""The contract of rules and of `simulate` with several threads: each answer is that of a call alone."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from alloc.rules import RULES


def from_threads(*arguments):
    """What `from_threads.py` found, in a process that may die."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.rules.from_threads", *arguments],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def found():
    return from_threads()


@pytest.mark.parametrize("rule", RULES.shipped())
def test_answers_in_threads_are_those_in_sequence(found, rule):
    assert found[rule]["problems"] > 0
    assert found[rule]["same_status"]
    assert found[rule]["apart"] <= 1e-9


def test_the_first_question_may_come_from_all_threads_at_once(found):
    assert set(found["known"]) == {len(RULES.shipped())}


def test_an_interrupt_is_heard_after_solves_in_threads(found):
    assert found["hears_interrupts"]


def test_runs_in_threads_are_those_in_sequence():
    found = from_threads("run")["run"]
    assert found["rule_calls"] > 20
    assert found["apart"] <= 1e-9
