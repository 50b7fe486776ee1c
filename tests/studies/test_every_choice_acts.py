"""Every switch and every choice of a scenario acts: each of its values gives a run of its own, in some world."""

import json
from contextlib import suppress
from itertools import combinations
from typing import Any, Literal, get_args, get_origin

from studies.files.study_error import StudyError
from tests.studies import test_every_key_acts as numbers
from tests.studies.test_bad_input_battery import ALL_KEYS
from tests.studies.test_every_key_acts import content, run, shown


def choices_in(annotation: Any) -> tuple[Any, ...]:
    """Values of a switch or of a choice; () of another key."""
    if annotation is bool:
        return (False, True)
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    return tuple(value for part in get_args(annotation) for value in choices_in(part))


KEYS = [(*key[:3], values) for key in ALL_KEYS if (values := choices_in(key[3]))]
"""(path, what its table needs, name, values) of every switch and choice."""
FIRST = {"onboard": {"learning": {"first": 1, "further": 1}}}
BESIDE: dict[str, dict[str, Any]] = {
    "onboard.learning.kind": FIRST,
    **{
        f"onboard.learning.{one}": {
            "onboard": {
                "learning": {"kind": "running-mean"} | FIRST["onboard"]["learning"],
                "trigger": "slip",
            }
        }
        for one in ("reference", "update", "weight")
    },
    "onboard.braking.air_force": {"receptivity": {"mean": 0.5, "amplitude": 0.4, "period_s": 3.0}},
    "onboard.mpc.compensated": {"onboard": {"mpc": {"computing_delay": 1}}},
}
"""Keys that act only with others -> these."""
GIVEN = {"values": [0.002 * k for k in range(32)]}
"""What the choice `given` needs beside it."""
NOT_SHOWN = {
    "case": "a word for readers: it says what the event is meant to show",
    "in_default_comparison": "acts on what `readhesion compare` runs",
}
"""Keys of which no run shows anything -> why."""


def values_apart(key: tuple) -> set[tuple[Any, Any]]:
    """Pairs of a key's values that some world tells apart."""
    place, base, name, values = key
    controller = "mpc" if ("mpc", False) in place else "perturb-observe"
    pairs: set[tuple[Any, Any]] = set()
    for world in numbers.WORLDS:
        made = {}
        for value in values:
            whole = numbers.merged(world, BESIDE.get(shown(key), {}))
            given = {name: value} | (GIVEN if value == "given" else {})
            with suppress(StudyError):
                text = json.dumps(content(whole, (place, base, name), given))
                made[value] = run(text, "greedy", controller)
        pairs |= {pair for pair in combinations(made, 2) if made[pair[0]] != made[pair[1]]}
    return pairs


def test_every_value_of_a_choice_acts():
    unlike = {}
    for key in KEYS:
        if shown(key) not in NOT_SHOWN and (
            missing := set(combinations(key[3], 2)) - values_apart(key)
        ):
            unlike[shown(key)] = missing
    assert not unlike


def test_a_choice_that_nothing_reads_would_be_noticed():
    key = next(one for one in KEYS if shown(one) == "case")
    assert values_apart(key) == set()
    assert {*BESIDE, *NOT_SHOWN} <= {shown(key) for key in KEYS}
