"""Runs of the shipped scenarios are those that were stored: a change that moves a number of the closed loop shows here.

A run is known by the means of five of its variables. They were stored on one machine; others round differently, but by less
than `TOLERANCE`. The tests compare 64 runs, `python -m tests.test_runs_as_stored` all that are stored.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from alloc.simulation import CONTROLLERS
from studies.runs import is_slow, recorded
from studies.scenario import load, shipped

STORED = json.loads(Path(__file__).with_name("runs_as_stored.json").read_text())
"""Label run/SCENARIO/RULE/CONTROLLER -> means of the sizes of `TRACED`, nine digits each."""
TRACED = ("speed", "slip_velocity", "motor_torque", "limit", "cylinder_pressure")
TOLERANCE = 1e-6
"""Compiled for a processor without AVX and FMA, 27 of the runs had other bits and the same nine digits."""
LONGEST_SLOW = 8.0
"""Duration [s] of runs with controllers outside of the compiled loop; every shipped event slips before."""
SCENARIOS = sorted({label.split("/")[1] for label in STORED})
CELLS = sorted({label.split("/", 2)[2] for label in STORED}, reverse=True)


def chosen():
    """Every cell of rule and controller with one of the scenarios, the quick ones with two."""
    for k, scenario in enumerate(SCENARIOS):
        for j, cell in enumerate(CELLS):
            first = j % len(SCENARIOS) == k
            if first or ((j + 8) % len(SCENARIOS) == k and not is_slow(cell.split("/")[1])):
                yield f"run/{scenario}/{cell}"


def difference(label):
    """Which mean of a run is another than the stored one, and by how much of it; empty where none is."""
    _, name, rule, controller = label.split("/")
    scenario = load(name)
    if is_slow(controller):
        scenario = scenario.changed(duration_s=min(scenario.duration_s, LONGEST_SLOW))
    run = recorded(scenario, rule, controller, 0)
    means = np.array([np.nanmean(np.abs(run[one].values)) for one in TRACED])
    apart = (means - STORED[label]) / np.maximum(np.abs(means), 1e-9)
    worst = int(np.argmax(np.abs(apart)))
    return (
        f"mean of {TRACED[worst]}, by {apart[worst]:.1e}" if abs(apart[worst]) > TOLERANCE else ""
    )


def test_every_scenario_rule_and_controller_is_among_them():
    assert set(SCENARIOS) == set(shipped())
    rules, controllers = (
        set(one) for one in zip(*(cell.split("/") for cell in CELLS), strict=True)
    )
    assert controllers == set(CONTROLLERS) - {"mpc-opti"}  # minutes, and last digits of libraries
    assert {label.split("/", 2)[2] for label in chosen()} == set(CELLS)
    assert len(rules) == 20


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_runs_are_as_stored(scenario):
    labels = [label for label in chosen() if label.split("/")[1] == scenario]
    found = {label: difference(label) for label in labels}
    assert labels
    assert not {label: words for label, words in found.items() if words}


if __name__ == "__main__":
    moved = 0
    for one in STORED:
        if words := difference(one):
            moved += 1
            print(f"moved: {one}: {words}")
    print(f"{len(STORED)} runs, {moved} moved")
    sys.exit(moved > 0)
