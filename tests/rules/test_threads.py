"""The contract of `simulate` and of the registry with several threads; that of rules is a law of `alloc.rules.testing`."""

import json
import subprocess
import sys
from pathlib import Path

from alloc.rules import RULES


def test_runs_in_threads_are_those_in_sequence_and_an_interrupt_is_heard_after_solves():
    done = subprocess.run(
        [sys.executable, "-m", "tests.rules.from_threads"],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    # the first question comes from all threads at once
    assert set(found["known"]) == {len(RULES.shipped())}
    assert found["run"]["rule_calls"] > 20
    assert found["run"]["apart"] <= 1e-9
    assert found["hears_interrupts"]
