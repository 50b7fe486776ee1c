"""Every number of a scenario acts: some value of its key changes the run, in a world that has what the key is about."""

import copy
import json
from collections.abc import Iterator, Mapping
from functools import cache
from hashlib import sha256
from itertools import zip_longest
from typing import Any

import numpy as np
import pytest

from alloc.simulation import simulate
from studies.files.strict import parse
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario
from tests.studies.test_bad_input_battery import KEYS

GROWTH = {"law": "logarithmic"}
START: dict[str, Any] = {
    "title": "start", "name": "start", "train": "commuter-8car", "duration_s": 9.0, "target_speed_kmh": 15.0,
    "command": [{"time_s": 0.0, "acceleration_kmhs": 3.0}],
    "rail": {"level": 0.2, "increments": GROWTH, "patches": [{"factor": 0.5, "start_m": 1.0, "end_m": 15.0}]},
    "onboard": {"sensors": {"speed_noise_kmh": 0.02}, "telegrams": {"loss": 0.1}},
}  # fmt: skip
STOP: dict[str, Any] = {
    "title": "stop", "name": "stop", "train": "commuter-8car", "duration_s": 12.0, "initial_speed_kmh": 50.0,
    "target_speed_kmh": 20.0, "command": [{"time_s": 1.0, "acceleration_kmhs": -4.5}],
    "rail": {"speed_law": "curtius-kniffler", "law_factor": 0.25, "increments": GROWTH},
    "onboard": {"sensors": {"speed_noise_kmh": 0.02}},
}  # fmt: skip
SLIDE = {**STOP, "onboard": {"braking": {"blended": False}}}
SANDED = {**STOP, "train": "gb-unit-8car"}
WORLDS = (START, STOP, SLIDE, SANDED)
CONTROLLERS = {
    "table": "table", "cut_and_ramp": "cut-and-ramp", "creep": "pi-creep", "perturb_observe": "perturb-observe",
    "steepest_gradient": "steepest-gradient", "fuzzy_creep": "fuzzy-creep", "fuzzy_tracking": "fuzzy-tracking",
    "swarm_tracking": "swarm-tracking", "swarm_slip": "swarm-slip", "cubature_seeking": "cubature-seeking", "mpc": "mpc",
}  # fmt: skip
"""Tables of `[onboard]` -> the controller that reads them."""
TRIED = (0.3, 2.0, 8.0, 0.05, 0.9, 40.0, 0.004, 300.0, 3.0, 0.6, 1e5, 1.0, 12.0, 0.0, 1e7)
COUNTS = (0, 1, 8, 4, 32)
"""Lengths of lists; 0 is a plain number."""
TIMED = {"controller_time", "rule_time"}


RULE_OF = {
    "belief": "greedy",
    "unit_deviation": "qp-robust",
    "hold_time_s": "greedy-literal",
    "learning": "greedy",
}
"""Table or key -> a rule that reads it, where `cooperative` does not."""
FLAT = {"rail": {"increments": {"law": "given"}}}
FUZZY = {"onboard": {"braking": {"slide_protection": {"law": "fuzzy"}}}}
SLOW = {"initial_speed_kmh": 25.0, "target_speed_kmh": 4.0}
BESIDE: dict[str, dict[str, Any]] = {
    "draft_gear.structure_n_per_m": {"train": "freight-5", "draft_gear": {"stroke_mm": 3.0}},
    "draft_gear.stroke_mm": {"train": "freight-5"},
    "draft_gear.viscosity_ns_per_m": {"train": "freight-5"},
    "rail.rear_axles": {"rail": {"rear_speed_law": [5.0, 44.0, 0.05]}},
    "rail.increments.values": FLAT,
    "rail.patches.fade_s": {"rail": {"patches": [{"until_s": 5.0}]}},
    "rail.scatter_length_m": {"rail": {"scatter": 0.1}},
    "rail.conditioning_slip": {"rail": {"conditioning": 0.2}},
    "rail.presliding_m": {"initial_speed_kmh": 8.0, "target_speed_kmh": 2.0},
    "line.tunnel_factor": {"line": {"tunnels": [{"start_m": 0.0, "end_m": 100.0}]}},
    "receptivity.period_s": {"receptivity": {"mean": 0.2, "amplitude": 0.1}},
    "belief.increments.values": {"belief": {"increments": {"law": "given"}}},
    "belief.coupler_factor": {"coupler": {"stiffness_n_per_m": 1e7}},
    "onboard.sensors.load_error": {"load_t": [8.0] * 8},
    "onboard.sensors.blind_share": {
        "onboard": {
            "sensors": {
                "dropouts": [{"axle": k, "begin_s": 1.0, "until_s": 9.0} for k in range(4, 9)]
            }
        }
    },
    "line.tunnels.start_m": {"line": {"tunnel_factor": 3.0}},
    "line.tunnels.end_m": {"line": {"tunnel_factor": 3.0}},
    **{
        f"onboard.braking.slide_protection.fuzzy.{one}": FUZZY
        for one in ("sensitivity", "slip", "rate_kmhs", "pole_per_s")
    },
    "onboard.braking.slide_protection.cut_out_speed_kmh": SLOW,
    "onboard.braking.slide_protection.refill_s": {
        "onboard": {"braking": {"slide_protection": {"time_out_s": 0.3}}}
    },
    "onboard.braking.release_speed_kmh": SLOW,
    "onboard.braking.blend_time_s": {
        "receptivity": {"mean": 0.5, "amplitude": 0.4, "period_s": 3.0}
    },
    "onboard.sanding.least_speed_kmh": SLOW,
    **{
        f"onboard.learning.{one}": {
            "onboard": {"learning": {"kind": "running-mean", "first": 1, "further": 1}}
        }
        for one in ("first", "further", "stored")
    },
    **{
        f"onboard.learning.{one}": {"onboard": {"learning": {"kind": "gaussian"}}}
        for one in ("noise", "deviation", "drift")
    },
    "onboard.mpc.search.given_share": {"onboard": {"mpc": {"search": {"seek": False}}}},
    "motors.breakdown_torque_nm": {"motors": {"kind": "induction"}},
    "motors.slip_speed_rpm": {"motors": {"kind": "induction"}},
    "motors.shaft_stiffness_nm_per_rad": {"motors": {"rotor_inertia_kgm2": 1.0}},
    "motors.shaft_damping": {"motors": {"rotor_inertia_kgm2": 1.0}},
    "rail.recovery_energy_j_per_m": {"rail": {"recovered_coefficient": 0.3}},
    "rail.recovery_time_s": {"rail": {"recovered_coefficient": 0.3}},
    "rail.recovery_left": {"rail": {"recovered_coefficient": 0.3}},
    "onboard.hold_time_s": {"onboard": {"trigger": "slip"}},
    "onboard.sanding.until_s": {"onboard": {"sanding": {"begin_s": 1.0}}},
    "onboard.reference.radius_deviation": {
        "onboard": {"reference": {"radii_compared": False}, "sensors": {"radius_error": 0.005}}
    },
}
"""Keys that act only with others -> these, as their descriptions say."""
LAWS = ([5.0, 44.0, 0.1], [6.0, 40.0, 0.05])
VALUES: dict[str, tuple[Any, ...]] = {
    "draft_gear.structure_n_per_m": (1e8, 3e8),
    "motors.breakdown_torque_nm": (3e3, 1e4),
    "rail.speed_law": LAWS,
    "rail.rear_speed_law": LAWS,
    "rail.increments.values": ([0.01] * 32, [0.02] * 32),
    "variation.level": ([0.7, 0.75], [0.9, 0.95]),
    "belief.increments.values": ([0.01] * 32, [0.02] * 32),
    "belief.unit_increments": ([0.0, 0.01, 0.02, 0.03], [0.0, 0.0, 0.0, 0.05]),
    "belief.unit_deviation": ([0.01] * 4, [0.05] * 4),
    "draft_gear.viscosity_ns_per_m": (300.0, 3e4),
    "onboard.telegrams.silence_s": (0.05, 2.0),
    "onboard.mpc.search.noise_margin": (8.0,),
    "onboard.mpc.search.lowest_kmh": (0.05, 0.28),
    "onboard.braking.slide_protection.fuzzy.slip": ([0.02, 0.05, 0.1], [0.1, 0.2, 0.4]),
    "onboard.braking.slide_protection.fuzzy.rate_kmhs": ([1.0, 4.0, 9.0], [3.0, 12.0, 30.0]),
}
"""Keys whose values are lists of a certain length or order, or of a certain size."""
NOT_SHOWN = {
    "target_speed_kmh": "acts on metrics, not on what a run records",
    "line.sections.start_m": "the first section reaches back to the start of the line; of a second one it acts",
    "onboard.mpc.belief.floor": "acts where a peak believed falls as low as this; these rails carry more",
    "onboard.mpc.deadline_s": "acts where the computer is too slow, so by the clock",
    "onboard.mpc.group.steps": "acts in mpc-car and mpc-train",
    **{
        f"onboard.reference.relief.{one}": "acts in stops longer than these"
        for one in ("longest_s", "air_doubt")
    },
}
"""Keys of which these worlds show nothing -> why."""
MOST_TRIES = 5


def shown(key: tuple) -> str:
    return ".".join([*(table for table, _ in key[0]), key[2]])


def merged(whole: Any, beside: Any) -> Any:
    """The first of two contents with what the second says; tables of a list are merged one by one."""
    if isinstance(whole, dict) and isinstance(beside, dict):
        return whole | {key: merged(whole.get(key), value) for key, value in beside.items()}
    if isinstance(whole, list) and isinstance(beside, list) and isinstance(beside[0], dict):
        return [merged(a, b) for a, b in zip_longest(whole, beside, fillvalue={})]
    return beside


def content(world: Mapping[str, Any], key: tuple, given: Mapping[str, Any]) -> dict[str, Any]:
    """The world with the key's table, which has what it needs and what is `given`, and with what the key needs beside it."""
    place, base, _ = key
    whole = merged(copy.deepcopy(dict(world)), BESIDE.get(shown(key), {}))
    if not place:
        return whole | given
    inner: Any = whole
    for table, several in place:
        inner = inner.setdefault(table, [{}] if several else {})
        inner = inner[0] if several else inner
    inner.update({name: value for name, value in base.items() if name not in inner} | given)
    return whole


def changes(key: tuple) -> Iterator[Any]:
    """Values to try: those stated for the key, else numbers of every size and lists of them."""
    if shown(key) in VALUES:
        yield from VALUES[shown(key)]
        return
    for count in COUNTS:
        for value in TRIED:
            yield [value] * count if count else value
            if not count and value == int(value):
                yield int(value)


@cache
def run(whole: str, rule: str, controller: str) -> str:
    """Digest of all that a run of this scenario (as JSON) records; many keys ask for the same run."""
    made = simulate(parse(Scenario, json.loads(whole), "own.toml").event(seed=1), rule, controller)
    digest = sha256()
    for name, one in made.data_vars.items():
        if name not in TIMED:
            values = np.ascontiguousarray(one.values + 0.0 if one.dtype.kind == "f" else one.values)
            digest.update(f"{name} {values.shape} {values.dtype}".encode() + values.tobytes())
    return digest.hexdigest()


def acts(key: tuple) -> bool:
    """Whether in some world two runs differ that have the key's table and differ in the key alone."""
    place, _, name = key
    tables = [table for table, _ in place]
    controller = next((CONTROLLERS[t] for t in tables if t in CONTROLLERS), "perturb-observe")
    rule = next((RULE_OF[t] for t in (name, *tables) if t in RULE_OF), "cooperative")
    stops_first = any(word in shown(key) for word in ("braking", "sand", "relief"))
    for world in WORLDS[::-1] if stops_first else WORLDS:
        first, tries = None, 0
        for given in ({}, *({name: value} for value in changes(key))):
            try:
                made = run(json.dumps(content(world, key, given)), rule, controller)
            except StudyError:
                continue
            if first is not None and first != made:
                return True
            first, tries = first or made, tries + 1
            if tries > MOST_TRIES:
                break
    return False


@pytest.mark.parametrize("key", [key for key in KEYS if shown(key) not in NOT_SHOWN], ids=shown)
def test_a_number_acts(key):
    assert acts(key)


def test_a_key_that_nothing_reads_would_be_noticed(monkeypatch):
    key = next(one for one in KEYS if shown(one) == "rail.patches.factor")
    monkeypatch.setitem(VALUES, "rail.patches.factor", (0.5, 0.5))
    assert not acts(key)


def test_keys_with_a_word_of_their_own_exist():
    assert {*BESIDE, *VALUES, *NOT_SHOWN} <= {shown(key) for key in KEYS}
