"""Random legal scenarios, extreme ones among them: the same number gives the same event, rule and controller."""

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from alloc.event import Event, longest_duration
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import CURVES
from alloc.plant.sets import SETS
from alloc.rules import RULES
from studies.core.job import is_hosted
from studies.files.strict import parse
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario
from tests.studies.test_bad_input_battery import KEYS

AXLE_STEPS = 1e5
"""Integration steps times axles of a run at most: it ends early."""
COMPILED = [name for name in CONTROLLERS if not is_hosted(name)]
MOST_ODD = 5
"""Keys that take an odd value at most."""
SHARE_OF_TABLES = 0.25
"""Share of the scenarios that have each table of a scenario that may be left out."""


def drawn(number: int, controllers: list[str] | None = None) -> tuple[Event, str, str]:
    """Event, rule and controller of this number; the controller is one of `controllers` (default: all compiled ones)."""
    rng = np.random.default_rng([37, number])
    content = _usual(rng)
    for key in rng.permutation(len(KEYS))[: rng.integers(MOST_ODD + 1)]:
        changed = copy.deepcopy(content)
        _put(changed, KEYS[key], _odd(rng))
        content = changed if _event(changed) is not None else content
    event = _event(content)
    while event is None:  # what is usual for itself need not fit together
        content = _usual(rng)
        event = _event(content)
    rule = str(rng.choice([*RULES, "greedy", "exact", "cooperative"]))
    return _short(event), rule, str(rng.choice(controllers or COMPILED))


def _event(content: dict[str, Any]) -> Event | None:
    try:
        return parse(Scenario, content, "own.toml").event(content["duration_s"] > 0.1)
    except StudyError:
        return None


def _short(event: Event) -> Event:
    """The event, so short that it has few steps."""
    most = longest_duration(event.model, event.longest_step, event.record_period, AXLE_STEPS)
    duration = min(event.duration, max(most, event.onboard.period))
    return replace(event, duration=duration, record_period=min(event.record_period, duration))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _odd(rng: np.random.Generator) -> float:
    """A number that may be legal somewhere."""
    return float(rng.choice([0.0, 1.0, -1.0, 10.0, 1e9, _log(rng, 1e-6, 1e9), rng.uniform()]))


def _put(content: dict[str, Any], key: tuple[Any, ...], value: float) -> None:
    """Set a key of `KEYS`, in a table that is made if it is not there."""
    place, base, name = key
    for k, (table, several) in enumerate(place):
        needed = dict(base) if k == len(place) - 1 else {}
        content = content.setdefault(table, [needed] if several else needed)
        if several:
            content += [] if content else [needed]
            content = content[0]
    content[name] = int(value) if name in ("unit", "axle", "in_series") else value


def _usual(rng: np.random.Generator) -> dict[str, Any]:
    """A scenario of usual parts: trains, couplers, rails, lines, drivers, sensors and telegrams."""
    speed = float(rng.choice([0.0, rng.uniform(0.0, 20.0), rng.uniform(0.0, 300.0)]))
    duration = float(rng.choice([0.01, _log(rng, 0.1, 8.0)], p=[0.05, 0.95]))
    content: dict[str, Any] = {
        "name": "drawn", "title": "drawn", "train": str(rng.choice(list(SETS))), "duration_s": duration,
        "initial_speed_kmh": speed, "target_speed_kmh": rng.uniform(0.0, 1.2) * speed,
        "record_period_s": float(rng.choice([0.01, 0.05, _log(rng, 0.01, 1.0) * duration], p=[0.7, 0.2, 0.1])),
        "reversed": bool(rng.random() < 0.2), "load_transfer": bool(rng.random() < 0.5),
        "command": [
            {"time_s": float(time), "acceleration_kmhs": float(rng.choice([-1.0, 0.0, 1.0]) * _log(rng, 0.1, 10.0))}
            for time in np.cumsum(rng.uniform(0.0, 1.5, rng.integers(1, 4))) - rng.uniform(0.0, 1.5)
        ],
        "rail": {
            "level": _log(rng, 0.01, 0.6), "curve": {"kind": str(rng.choice(list(CURVES)))},
            "increments": {"law": str(rng.choice(["none", "logarithmic"]))}, "scatter": 0.02 * rng.random(),
            "conditioning": 0.2 * rng.random(), "patches": [
                {"factor": _log(rng, 0.1, 2.0), "start_m": at, "end_m": at + rng.uniform(1.0, 50.0)}
                for at in rng.uniform(-50.0, 100.0, rng.integers(0, 3)).tolist()
            ],
        },
    }  # fmt: skip
    content |= dict(_tables(rng))
    return content


def _tables(rng: np.random.Generator) -> Iterator[tuple[str, Any]]:
    """Some of the tables that may be left out."""
    spring = {"stiffness_n_per_m": _log(rng, 1e5, 1e8), "damping_ns_per_m": _log(rng, 1e3, 1e9)}
    spring |= {"slack_mm": _log(rng, 0.1, 100.0), "stiffening_n_per_m3": _log(rng, 1e6, 1e11)}
    coupled = rng.random()
    if coupled < 0.7:
        yield ("coupler", spring) if coupled < 0.5 else ("draft_gear", {})
    onboard = {
        "sensors": {
            "speed_noise_kmh": _log(rng, 0.01, 1.0), "speed_quantum_kmh": _log(rng, 0.01, 1.0),
            "load_error": 0.1 * rng.random(), "radius_error": 0.02 * rng.random(),
        },
        "telegrams": {"loss": rng.random(), "jitter_s": 0.2 * rng.random(), "latency_s": 0.5 * rng.random()},
        "period_s": float(rng.choice([0.005, 0.01, 0.02])), "learning": {"kind": "gaussian"},
        "reference": {"source": str(rng.choice(["estimate", "estimate", "truth"]))},
        "trigger": str(rng.choice(["limited", "slip"])), "limit_rate": _log(rng, 0.01, 10.0),
    }  # fmt: skip
    tables: dict[str, Any] = {
        "line": {"sections": [{"start_m": 0.0, "grade_permille": rng.uniform(-40.0, 40.0)}]},
        "receptivity": {"mean": rng.random(), "amplitude": 0.5 * rng.random()},
        "failures": [{"unit": 1, "time_s": rng.random()}], "inverter_group": str(rng.choice(["1C4M", "1C2M", "1C1M"])),
        "belief": {"mass_factor": _log(rng, 0.5, 2.0), "coupler_factor": _log(rng, 0.1, 10.0)},
    }  # fmt: skip
    yield from ((name, table) for name, table in tables.items() if rng.random() < SHARE_OF_TABLES)
    yield "onboard", {name: one for name, one in onboard.items() if rng.random() < SHARE_OF_TABLES}
