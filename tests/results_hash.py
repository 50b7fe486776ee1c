"""Hashes of what the project computes: recorded runs, tables and statements. They tell whether a change moved a number.

`make results-hash` compares them with `results_hash.json`. Where a number must change, `--write` stores the new hashes, and
the commit says which changed and why. They hold for one kind of processor and one set of versions: others round differently.
"""

import argparse
import hashlib
import json
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
import xarray as xr

from alloc.onboard.controllers.registry import CONTROLLERS
from alloc.rules import RULES
from studies.core.collection import find_study
from studies.core.controllers import is_hosted
from studies.core.job import Job, simulate_job
from studies.core.statement import Statement
from studies.core.union import MEASURED
from studies.scenario.loading import load_scenario, shipped_scenarios
from studies.slides.ensemble_study import Effort
from tests.studies.brake_tables import brake_table
from tests.studies.ladder_tables import curve_table, ladder_table
from tests.studies.learning_tables import synthetic
from tests.studies.mismatch_tables import mismatch_table
from tests.studies.position_tables import position_table
from tests.studies.readhesion_tables import calibration_table, sweep_table
from tests.studies.resistance_tables import resistance_table
from tests.studies.slide_tables import slide_table
from tests.studies.sweep_tables import claim_table, difference_table

STORED = Path(__file__).with_name("results_hash.json")
HOSTED_DURATION = 8.0
"""Time [s] for which the slow hosted controllers run; every shipped event slips before."""
BOOKKEEPING = (*MEASURED, "code_hash", "scenario_hash", "messages", "reason", "status", "cell")
"""Columns, by their beginning, that depend on the machine's speed or on how rows are kept."""

SMALL: dict[str, tuple[int, dict[str, Any]]] = {
    "claims": (2, {"duration": 4.0}),
    "differences": (12, {"duration": 2.5}),
    "learning": (4, {"duration": 4.0}),
    "ladder": (2, {"duration": 4.0}),
    "curves": (1, {"duration": 4.0}),
    "published": (1, {"duration": 4.0}),
    "locomotive": (1, {"duration": 4.0}),
    "mismatch": (1, {"duration": 4.0}),
    "constant-rail": (2, {"duration": 4.0}),
    "joint": (1, {"duration": 4.0}),
    "blended": (1, {"duration": 6.0}),
    "readhesion": (1, {"margins": (0.4,), "widths": (0.2, 0.8), "step": 1e-3}),
    "calibration": (4, {"refinements": 3}),
    "brake-force": (1, {"beliefs": ("friction +20%", "gradient +10 per mille, by speeds")}),
    "resistance": (1, {}),
    "line-position": (1, {"arms": ("none", "all")}),
    "slide-protection": (1, {}),
    "log-accuracy": (3, {"logs": 6}),
    "slide-calibration": (1, {"effort": Effort(12, 1, 1, 1, 6)}),
}
"""Study -> events and settings of its small run."""

SYNTHETIC: dict[str, tuple[str, Callable[[], pd.DataFrame]]] = {
    "claims": ("claims", claim_table),
    "differences": ("differences", difference_table),
    "ladder": ("ladder", ladder_table),
    "curves": ("curves", curve_table),
    "mismatch": ("mismatch", mismatch_table),
    "readhesion": ("readhesion", sweep_table),
    "calibration": ("calibration", calibration_table),
    "brake-force": ("brake-force", brake_table),
    "resistance": ("resistance", resistance_table),
    "line-position": ("line-position", position_table),
    "slide-protection": ("slide-protection", slide_table),
    "learning": ("learning", lambda: synthetic(lambda arm, station: 0.01 / station)),
}
"""Table made for the tests of the statements -> study and table, with events enough for verdicts."""


def digest(*parts: bytes | str) -> str:
    """Short SHA-256 of parts in their order."""
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else part)
    return found.hexdigest()[:16]


def run_hash(run: xr.Dataset) -> str:
    """Hash of all recorded arrays."""
    parts: list[bytes | str] = []
    for name in sorted(map(str, run.variables)):
        values = np.ascontiguousarray(run[name].values)
        parts += [name, str(values.dtype), str(values.shape), values.tobytes()]
    return digest(*parts)


def table_hash(table: pd.DataFrame) -> str:
    """Hash of a study's table, whatever the order of its rows and columns."""
    names = sorted(str(name) for name in table if not str(name).startswith(BOOKKEEPING))
    plain = pd.DataFrame(
        {
            name: table[name].map(_plain)
            for name in names
            if table[name].notna().any()  # a column of nothing says nothing
        }
    )
    rows = sorted("|".join(row) for row in plain.itertuples(index=False, name=None))
    return digest(*plain.columns, *rows)


def _plain(value: Any) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    if isinstance(value, bool | np.bool_ | int | float | np.number):
        return float(value).hex()
    return str(value)


def statements_hash(statements: list[Statement]) -> str:
    """Hash of names, verdicts, numbers, conditions and methods; of a statement on computing time the name alone."""
    contents = [
        statement.content() if statement.name != "computing" else statement.name
        for statement in statements
    ]
    return digest(*(json.dumps(content, sort_keys=True) for content in contents))


def hash_run(scenario: str, rule: str, controller: str) -> str:
    """Hash of one run of a shipped scenario."""
    chosen = load_scenario(scenario)
    if is_hosted(controller):
        chosen = chosen.changed(duration_s=min(chosen.duration_s, HOSTED_DURATION))
    return run_hash(simulate_job(Job(chosen, rule, controller, 0)))


def hash_study(name: str) -> list[tuple[str, str]]:
    """Hashes of a study's small table and of its statements."""
    events, settings = SMALL[name]
    study = find_study(name)
    with tempfile.TemporaryDirectory() as folder:
        table = study.run(Path(folder), events, 0, 1, **settings)
    rows = len(table)
    return [
        (f"table/{name}", f"{table_hash(table)} {rows} rows"),
        (f"statements/{name}", statements_hash(study.statements(table))),
    ]


def tasks() -> Iterator[tuple[str, Callable[[], list[tuple[str, str]]]]]:
    """Everything that is hashed: a label by which it is chosen, and what gives its names and hashes; slow ones first."""
    for name in reversed(SMALL):
        yield f"study/{name}", lambda name=name: hash_study(name)
    for scenario in shipped_scenarios():
        cells = [("exact", controller) for controller in reversed(list(CONTROLLERS))]
        cells += [(rule, "cut-and-ramp") for rule in RULES if rule != "exact"]
        for rule, controller in cells:
            label = f"run/{scenario}/{rule}/{controller}"
            yield (
                label,
                lambda cell=(scenario, rule, controller), label=label: [(label, hash_run(*cell))],
            )
    for name, (study, table) in SYNTHETIC.items():
        yield (
            f"synthetic/{name}",
            lambda name=name, study=study, table=table: [
                (f"synthetic/{name}", statements_hash(find_study(study).statements(table())))
            ],
        )


def computed(label: str) -> list[tuple[str, str]]:
    """Names and hashes of the task of this label; what fails is said in place of the hash."""
    try:
        return dict(tasks())[label]()
    except Exception as error:
        return [(label, f"failed: {type(error).__name__}: {error}")]


def machine() -> dict[str, str]:
    """What hashes depend on beside the code."""
    model = next(
        (line for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line),
        platform.processor(),
    )
    packages = ("numpy", "scipy", "numba", "llvmlite", "casadi", "osqp", "daqp", "cvxpy", "pandas")
    return {
        "processor": model.partition(":")[2].strip(),
        **{name: version(name) for name in packages},
    }


def main() -> int:
    """Compare with the stored hashes, or store them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="store the hashes")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    parser.add_argument("parts", nargs="*", help="beginnings of labels, such as run/wet-patch")
    chosen = parser.parse_args()
    labels = [one for one, _ in tasks() if not chosen.parts or one.startswith(tuple(chosen.parts))]
    # the first alone: the others find what it compiled
    found = computed(labels[-1])
    parallel = joblib.Parallel(n_jobs=chosen.jobs, batch_size=1)
    for pairs in parallel(joblib.delayed(computed)(label) for label in labels[:-1]):
        found += pairs
    hashes = dict(sorted(found))
    stored = json.loads(STORED.read_text()) if STORED.exists() else {"machine": {}, "hashes": {}}
    if chosen.write:
        content = {
            "machine": machine(),
            "hashes": dict(sorted((stored["hashes"] | hashes).items())),
        }
        STORED.write_text(json.dumps(content, indent=1) + "\n")
        print(f"{len(hashes)} hashes stored")
        return 0
    other = [name for name, value in machine().items() if stored["machine"].get(name) != value]
    if other:
        print(
            f"stored on another machine ({', '.join(other)}): compare with hashes of the commit before instead"
        )
    changed = [name for name, value in hashes.items() if stored["hashes"].get(name) != value]
    for name in changed:
        print(f"changed: {name}: {stored['hashes'].get(name)} -> {hashes[name]}")
    whole = digest(json.dumps(hashes))
    print(f"{len(hashes) - len(changed)} of {len(hashes)} hashes as stored; of all: {whole}")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
