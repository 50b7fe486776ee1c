"""The contract of `simulate` and of the registry with several threads; that of rules is a law of `alloc.rules.testing`.

Run as a program it prints JSON: in a process of its own, which may be interrupted.
"""

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np

from alloc.rules import RULES, find_rule
from alloc.simulation import simulate
from studies.scenario import load as load_scenario
from tests.rules.references import random_problem

THREADS = 8


PROBLEMS = 100_000 if os.environ.get("READHESION_FULL") else 200


def in_threads(work, count):
    """Results of `work(k)`, k = 0..count - 1, by threads that start together and take turns."""
    results, together = [None] * count, threading.Barrier(THREADS)

    def take(first):
        together.wait()
        for k in range(first, count, THREADS):
            try:
                results[k] = work(k)
            except Exception as error:  # said at the end; a thread that dies is not noticed
                results[k] = error

    threads = [threading.Thread(target=take, args=(k,)) for k in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for result in results:
        if isinstance(result, Exception):
            raise result
    return results


def hears_interrupts():
    """Whether Ctrl-C still reaches Python."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        return True
    return False


def run():
    """Largest difference of any recorded value between runs in threads and in sequence."""
    event = load_scenario("uneven-load").changed(duration_s=6.0).event(0)
    rules = RULES["qp"], RULES["greedy"]
    several = in_threads(lambda k: simulate(event, rules[k % 2]), THREADS)
    apart, calls = 0.0, 0
    for k, rule in enumerate(rules):
        one = simulate(event, rule)
        calls += one.attrs["rule_calls"]
        for other in several[k::2]:
            for name in one.data_vars:
                np.testing.assert_allclose(other[name], one[name], rtol=0.0, atol=1e-9)
                both = np.nan_to_num(one[name].values - other[name].values)
                apart = max(apart, float(np.abs(both).max(initial=0.0)))
    return {"rule_calls": calls, "apart": apart}


if __name__ == "__main__":
    sys.setswitchinterval(1e-5)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever started this may ignore it
    # the registry too is first asked by all threads at once
    found = {"known": in_threads(lambda k: len(RULES), THREADS), "run": run()}
    in_threads(lambda k: find_rule("qp")(random_problem(k)), PROBLEMS)
    print(json.dumps(found | {"hears_interrupts": hears_interrupts()}))


def test_runs_in_threads_are_those_in_sequence_and_an_interrupt_is_heard_after_solves():
    done = subprocess.run(
        [sys.executable, "-m", "tests.rules.test_threads"],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    # the first question comes from all threads at once
    assert set(found["known"]) == {len(RULES.shipped())}
    assert found["run"]["rule_calls"] > 20
    assert found["run"]["apart"] <= 1e-9
    assert found["hears_interrupts"]
