"""Where a page comes from: command, versions, hashes, seeds and machine, and the publications behind what was run."""

import hashlib
import inspect
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from alloc.citations import Citation, uses
from alloc.metrics import METRICS
from alloc.plant.adhesion import CURVES
from alloc.recording import provenance
from alloc.rules import RULES
from studies.citation.run_parts import module_of_controller, module_text, train_text
from studies.comparison.grid import Grid
from studies.core.plugins import plugin_modules
from studies.scenario.loading import SCENARIOS
from studies.scenario.scenario import Scenario

PLANT = ("alloc.plant.laws", "alloc.plant.rail", "alloc.onboard.laws")
"""Modules whose laws every run obeys."""
TIMED = ("rule_time", "controller_time", "controller_median", "controller_p99")
"""Metrics that measure how long something took to compute, which no other run repeats."""


@dataclass(frozen=True)
class EventOrigin:
    """A scenario of the page."""

    name: str
    title: str
    hash: str
    seeds: tuple[int, ...]
    runs: int
    curve: str


def facts(table: pd.DataFrame, command: str) -> dict[str, str]:
    """Data that a reader needs to make the same page: name -> value."""
    found = provenance()
    versions = [
        f"{name.removeprefix('version_')} {value}"
        for name, value in found.items()
        if name.startswith("version_")
    ]
    good = int((table["status"] == "ok").sum())
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "command": command,
        "made": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "versions": ", ".join([*versions, f"plotly {version('plotly')}"]),
        "git revision": found["git_revision"],
        **({"plug-ins": ", ".join(plug_ins)} if (plug_ins := plugin_modules()) else {}),
        "machine": f"{platform.platform()}, {_processor()}, {cores} cores in use",
        "runs": f"{len(table)} runs, {'all' if good == len(table) else f'of which {good}'} count",
        "hash of the code": ", ".join(sorted(set(table["code_hash"]))),
        "hash of the rows": hash_of_rows(table),
    }


def hash_of_rows(table: pd.DataFrame) -> str:
    """Hash of the cells, their status and their metrics, except for those that measure computing time."""
    names = sorted(name for name in METRICS if name in table and name not in TIMED)
    digest = hashlib.sha256()
    for row in table[["cell", "status", *names]].itertuples(index=False):
        digest.update(repr(tuple(row)).encode())
    return digest.hexdigest()[:16]


def events(table: pd.DataFrame, scenarios: Sequence[Scenario]) -> list[EventOrigin]:
    """The scenarios with their hashes and seeds."""
    found = []
    for one in scenarios:
        rows = table[table["scenario"] == one.name]
        seeds = tuple(sorted({int(seed) for seed in rows["seed"]}))
        found.append(EventOrigin(one.name, one.title, one.hash(), seeds, len(rows), one.rail.curve.kind))  # fmt: skip
    return found


def cited(grid: Grid) -> dict[Citation, list[str]]:
    """The publications that the parts of a comparison name in their files: publication -> the parts."""
    texts = {"the plant": " ".join(map(module_text, PLANT))}
    for name in grid.rules:
        texts[f"rule {name}"] = f"{RULES[name].description} {module_text(RULES.origin(name))}"
    for name in dict.fromkeys((*grid.controllers, *grid.once)):
        texts[f"controller {name}"] = module_text(module_of_controller(name))
    for one in grid.scenarios:
        texts[f"event {one.name}"] = _scenario_text(one)
        texts[f"train {one.train}"] = train_text(one.event().model.train)
        kind = one.rail.curve.kind
        texts[f"curve {kind}"] = inspect.getdoc(CURVES[kind]) or ""
    for module in sorted({METRICS.origin(name) for name in METRICS}):
        texts[f"metrics of {module.rpartition('.')[2]}"] = module_text(module)
    return uses(texts)


def _scenario_text(one: Scenario) -> str:
    """What a scenario's file says beside its keys."""
    known = SCENARIOS.get(one.name)
    return known.read_text() if isinstance(known, Path) else f"{one.title} {one.description}"


def _processor() -> str:
    """What the system calls its processor."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
