"""What the workers of a study share: imported in the server that they are forked from, so code is compiled or loaded once.

`studies.runner.workers` names the parts in the environment. A part that does not work, or is a plug-in's, which the server
does not know, is left to the workers: its cells say what is wrong.
"""

import gc
import json
import os
import signal
from contextlib import suppress
from itertools import zip_longest

from alloc.evaluation.metrics import evaluate
from alloc.run.simulation import simulate
from studies import RARELY
from studies.files.scenario_files import load_scenario
from studies.runner.plugins import TRIAL

PARTS = "READHESION_PARTS"
"""Environment variable: rules and controllers, as JSON."""


def prepare_code(rules: list[str], controllers: list[str]) -> None:
    """Run each part for a few control periods."""
    event = load_scenario(TRIAL[0]).changed(duration_s=TRIAL[1]).event()
    for rule, controller in zip_longest(rules, controllers):
        with suppress(Exception):
            evaluate(simulate(event, rule or rules[0], controller or controllers[0]))


gc.set_threshold(*RARELY)
if PARTS in os.environ:
    # it ends at once where the program is stopped
    interrupted = signal.signal(signal.SIGINT, signal.SIG_DFL)
    prepare_code(*json.loads(os.environ[PARTS]))
    signal.signal(signal.SIGINT, interrupted)
gc.freeze()  # a search for garbage would write to what workers share
