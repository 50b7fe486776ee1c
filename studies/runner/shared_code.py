"""What the workers of a study share: imported in the server that they are forked from, so code is compiled or loaded once.

`studies.runner.workers` names the parts in the environment. A part that does not work, or is a plug-in's, which the server
does not know, is left to the workers: its cells say what is wrong.
"""

import ctypes
import gc
import json
import os
import signal
from contextlib import suppress
from itertools import zip_longest

from alloc.evaluation.metrics import evaluate
from alloc.plant.curves import POLACH_WET
from alloc.run.simulation import simulate
from studies import RARELY
from studies.files.scenario_files import load_scenario
from studies.runner.plugins import TRIAL
from studies.runner.workers import PARTS


def prepare_code(rules: list[str], controllers: list[str]) -> None:
    """Run each part for a few control periods."""
    event = load_scenario(TRIAL[0]).changed(duration_s=TRIAL[1]).event()
    for rule, controller in zip_longest(rules, controllers):
        with suppress(Exception):
            evaluate(simulate(event, rule or rules[0], controller or controllers[0]))
    POLACH_WET.top(1.0, 0.2)  # of a curve whose top is searched for


gc.set_threshold(*RARELY)
if PARTS in os.environ:
    # it ends at once where the program is stopped, or killed: Linux's PR_SET_PDEATHSIG
    interrupted, prctl = signal.signal(signal.SIGINT, signal.SIG_DFL), ctypes.CDLL(None).prctl
    prctl(1, signal.SIGKILL)
    prepare_code(*json.loads(os.environ[PARTS]))
    prctl(1, 0)
    signal.signal(signal.SIGINT, interrupted)
gc.freeze()  # a search for garbage would write to what workers share
