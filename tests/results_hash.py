"""Hashes of what the project computes: runs, tables, statements, reports, figures. They tell what a change moved.

Each result has three: of all of it, of its numbers without names and words, and of its names and words without numbers. So a
better sentence is not a moved number. `make results-hash` compares them with `results_hash.json` and says which moved.
`--only runs` takes about a minute. Where a number must change, `--write` stores the new hashes, and the commit says which
changed and why.

Hashes are over raw bytes: they hold for one kind of processor and one set of versions, and others round differently. Each
run therefore has a `trace` of a few means too. On another machine these are compared instead, to `TOLERANCE`.
"""

import argparse
import contextlib
import hashlib
import io
import json
import re
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import joblib
import matplotlib as mpl
import numpy as np
import pandas as pd
import xarray as xr
from llvmlite.binding import get_host_cpu_name
from tests.paper_figs import small_figures
from tests.studies.brake_tables import brake_table
from tests.studies.headroom_tables import headroom_table
from tests.studies.ladder_tables import curve_table, ladder_table
from tests.studies.made_tables import (
    acceptance_table,
    calibration_table,
    comparison_table,
    sander_table,
    slide_table,
    sweep_table,
    synthetic,
)
from tests.studies.mismatch_tables import mismatch_table
from tests.studies.position_tables import position_table
from tests.studies.resistance_tables import resistance_table
from tests.studies.sweep_tables import claim_table, difference_table
from tests.studies.test_equal_effort_study import effort_table
from tests.studies.test_information_study import information_table
from tests.studies.test_patent_in_stops import braking_table, printed_table
from tests.studies.test_robustness_study import robustness_table

from alloc.onboard.host import CONTROLLERS
from alloc.plant.train import Coupler
from alloc.rules import RULES
from paper_figs.saving import data_of
from paper_figs.style import STYLE_FILE
from studies.command_line.main import run as run_command
from studies.comparison.summary import summarise, to_json
from studies.core.job import Job, is_hosted, simulate_job
from studies.core.statement import VERDICTS, Statement
from studies.core.store import MEASURED
from studies.core.study import find_study
from studies.logs.simulated import write_log
from studies.scenario.scenario import load_scenario, shipped_scenarios
from studies.slides.ensemble_study import Effort
from tests.simulation.slides import TRAIN, braked, readhering

PARTS = ("studies", "runs", "figures", "reports")
STORED = Path(__file__).with_name("results_hash.json")
HOSTED_DURATION = 8.0
"""Time [s] for which the slow hosted controllers run; every shipped event slips before."""
CONVERGING = ("mpc-opti",)
"""Controllers that are left out: minutes a run, and their last digits are those of libraries."""
BOOKKEEPING = (*MEASURED, "code_hash", "scenario_hash", "messages", "reason", "status", "cell")
"""Columns, by their beginning, that depend on the machine's speed or on how rows are kept."""

TRACED = ("speed", "slip_velocity", "motor_torque", "limit", "cylinder_pressure")
"""Variables of a run of which another machine compares the means."""
TOLERANCE = 1e-6
"""Largest relative difference of these means between machines. Compiled for a processor without AVX and FMA, 27 of the runs
had other bits and the same nine digits."""
Result = tuple[str, "Hashes | str", list[float]]
"""Name, hashes or what failed, and trace of a run (empty for others)."""

SMALL: dict[str, tuple[int, dict[str, Any]]] = {
    "claims": (2, {"duration": 4.0}),
    "differences": (12, {"duration": 2.5}),
    "learning": (4, {"duration": 4.0}),
    "braking": (2, {"duration": 6.0}),
    "printed": (1, {}),
    "effects": (1, {"duration": 4.0}),
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
    "headroom": (2, {"duration": 4.0}),
    "information": (1, {"duration": 4.0}),
    "robustness": (1, {"duration": 4.0, "controllers": ("cut-and-ramp", "perturb-observe")}),
    "equal-effort": (1, {"duration": 4.0}),
    "broad": (1, {"controllers": ("cut-and-ramp",)}),
    "sanders": (1, {}),
    "wsp-acceptance": (0, {"adhesion": (0.03,)}),
}
"""Study -> events and settings of its small run."""

SYNTHETIC: dict[str, tuple[str, Callable[[], pd.DataFrame]]] = {
    "claims": ("claims", claim_table),
    "differences": ("differences", difference_table),
    "braking": ("braking", braking_table),
    "printed": ("printed", printed_table),
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
    "headroom": ("headroom", headroom_table),
    "information": ("information", information_table),
    "robustness": ("robustness", robustness_table),
    "equal-effort": ("equal-effort", effort_table),
    "sanders": ("sanders", sander_table),
    "wsp-acceptance": ("wsp-acceptance", acceptance_table),
}
"""Table made for the tests of the statements -> study and table, with events enough for verdicts."""


def digest(*parts: bytes | str) -> str:
    """Short SHA-256 of parts in their order."""
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else part)
    return found.hexdigest()[:16]


@dataclass(frozen=True)
class Hashes:
    """What is stored of a result: hashes of all of it, of its numbers alone, and of its names and words alone."""

    whole: str
    numbers: str
    """Without names and words, whatever their order; a number in a sentence is a number."""
    words: str
    """Without numbers."""

    @classmethod
    def of_plain(cls, content: Any, whole: str | None = None) -> "Hashes":
        """Of plain values for JSON."""
        numbers, words = split(content)
        entire = json.dumps(content, sort_keys=True) if whole is None else whole
        return cls(digest(entire), digest(*sorted(numbers)), digest(*sorted(words)))

    def moved(self, before: "Hashes | None") -> str:
        """Which of the two has moved, in words; empty where neither has."""
        if before is None:
            return "new"
        if self.whole == before.whole:
            return ""
        which = [name for name in ("numbers", "words") if vars(self)[name] != vars(before)[name]]
        return " and ".join(which) or "order, or which name has which number"


NUMERAL = re.compile(r"\d+(?:\.\d+)?")


def split(content: Any) -> tuple[list[str], list[str]]:
    """Numbers and words of plain values, those in texts included."""
    if content is None or (isinstance(content, float) and np.isnan(content)):
        return [], []
    if isinstance(content, bool | np.bool_ | int | float | np.number):
        return [float(content).hex()], []
    if not isinstance(content, dict | list | tuple):
        text = str(content)
        return NUMERAL.findall(text), [NUMERAL.sub("#", text)]
    numbers: list[str] = []
    words = list(map(str, content)) if isinstance(content, dict) else []
    for one in content.values() if isinstance(content, dict) else content:
        more_numbers, more_words = split(one)
        numbers += more_numbers
        words += more_words
    return numbers, words


def trace(run: xr.Dataset) -> list[float]:
    """Mean size of each of `TRACED` over a run, to nine digits."""
    means = [float(np.nanmean(np.abs(run[name].values))) for name in TRACED]
    return [float(f"{one:.9g}") for one in means]


def run_hashes(run: xr.Dataset) -> Hashes:
    """Of all recorded arrays."""
    names = sorted(map(str, run.variables))
    arrays: list[tuple[bytes | str, ...]] = []
    for name in names:
        values = np.ascontiguousarray(run[name].values)
        arrays.append((str(values.dtype), str(values.shape), values.tobytes()))
    parts = [part for name, array in zip(names, arrays, strict=True) for part in (name, *array)]
    return Hashes(digest(*parts), digest(*sorted(digest(*one) for one in arrays)), digest(*names))


def table_hashes(table: pd.DataFrame) -> Hashes:
    """Of a study's table, whatever the order of its rows and columns."""
    names = sorted(str(name) for name in table if not str(name).startswith(BOOKKEEPING))
    names = [
        name for name in names if table[name].notna().any()
    ]  # a column of nothing says nothing
    columns = [table[name].tolist() for name in names]
    rows = list(zip(*columns, strict=True))
    plain = sorted("|".join(map(_plain, row)) for row in rows)
    # numbers by row and by column: one that changes its place changes one of them
    parts = [split(part) for part in (*rows, *columns)]
    numbers = sorted(digest(*sorted(numbers)) for numbers, _ in parts)
    words = sorted(digest(*sorted(words)) for _, words in parts)
    return Hashes(digest(*names, *plain), digest(*numbers), digest(*names, *words))


def _plain(value: Any) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    if isinstance(value, bool | np.bool_ | int | float | np.number):
        return float(value).hex()
    return str(value)


def statements_hashes(statements: list[Statement]) -> Hashes:
    """Of names, verdicts, numbers, conditions and methods; of a statement on computing time the name alone."""
    contents: list[Any] = [
        statement.content() if statement.name != "computing" else statement.name
        for statement in statements
    ]
    whole = "".join(json.dumps(content, sort_keys=True) for content in contents)
    for content in contents:
        if isinstance(content, dict):  # a verdict is a result
            content["verdict"] = VERDICTS.index(content["verdict"])
    return Hashes.of_plain(contents, whole)


def record(label: str) -> xr.Dataset:
    """The run of a shipped scenario that a label names."""
    _, scenario, rule, controller = label.split("/")
    chosen = load_scenario(scenario)
    if is_hosted(controller):
        chosen = chosen.changed(duration_s=min(chosen.duration_s, HOSTED_DURATION))
    return simulate_job(Job(chosen, rule, controller, 0))


def hash_study(name: str) -> list[Result]:
    """A study's small table and its statements."""
    events, settings = SMALL[name]
    study = find_study(name)
    with tempfile.TemporaryDirectory() as folder:
        table = study.run(Path(folder), events, 0, 1, **settings)
    statements = statements_hashes(study.statements(table))
    return [(f"table/{name}", table_hashes(table), []), (f"statements/{name}", statements, [])]


def printed(*arguments: str) -> Any:
    """What a command prints as JSON, beside a log and its train that it may name."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        train = TRAIN.coupled(Coupler())
        write_log(braked(readhering, train=train, duration=8.0), train, Path("slide.csv"))
        with contextlib.redirect_stdout(io.StringIO()) as text:
            code = run_command([*arguments, "--json"])
    assert code == 0, text.getvalue()
    return json.loads(text.getvalue())


def compared() -> Any:
    """The summary of a small comparison, without times of computing."""
    table = comparison_table()
    lines = summarise(table.drop(columns=[name for name in table if name.startswith(MEASURED)]))
    return json.loads(to_json(lines, {}))


REPORTS: dict[str, Callable[[], Any]] = {
    "compare": compared,
    "run-line": lambda: printed("run-line", "--effort", "0.8"),
    "analyse": lambda: printed(
        "analyse", "slide.csv", "--train", "slide.train.toml", "--brakes", "--resistance"
    ),
}
"""What commands print for machines."""


def hash_figure(name: str) -> Hashes:
    """Of the numbers that a figure of small inputs shows, as its CSV has them."""
    with mpl.rc_context(fname=STYLE_FILE):
        table = pd.read_csv(io.BytesIO(data_of(small_figures.DRAWN[name]())))
    return table_hashes(table)


def hash_run(label: str) -> list[Result]:
    """A run of a shipped scenario."""
    run = record(label)
    return [(label, run_hashes(run), trace(run))]


def tasks(among: Collection[str] = PARTS) -> Iterator[tuple[str, Callable[[], list[Result]]]]:
    """Everything that is hashed: a label by which it is chosen, and what gives its results; slow ones first."""
    if "studies" in among:
        for name in reversed(SMALL):
            yield f"study/{name}", lambda name=name: hash_study(name)
        for name, (study, made) in SYNTHETIC.items():
            label = f"synthetic/{name}"
            yield (
                label,
                lambda label=label, study=study, made=made: [
                    (label, statements_hashes(find_study(study).statements(made())), [])
                ],
            )
    if "reports" in among:
        for name, report in REPORTS.items():
            label = f"json/{name}"
            yield (
                label,
                lambda label=label, report=report: [(label, Hashes.of_plain(report()), [])],
            )
    if "figures" in among:
        for name in small_figures.DRAWN:
            label = f"figure/{name}.csv"
            yield label, lambda label=label, name=name: [(label, hash_figure(name), [])]
    if "runs" in among:
        for scenario in shipped_scenarios():
            cells = [f"exact/{one}" for one in reversed(list(CONTROLLERS)) if one not in CONVERGING]
            # the forms of wear by solvers answer as wear does, which their own tests see
            others = [one for one in RULES if one not in ("exact", "wear-qp", "wear-cvxpy")]
            cells += [f"{rule}/cut-and-ramp" for rule in others]
            for label in (f"run/{scenario}/{cell}" for cell in cells):
                yield label, lambda label=label: hash_run(label)


def computed(label: str) -> list[Result]:
    """Results of the task of this label; what fails is said in place of the hashes."""
    try:
        return dict(tasks())[label]()
    except Exception as error:
        return [(label, f"failed: {type(error).__name__}: {error}", [])]


def machine() -> dict[str, str]:
    """What hashes depend on beside the code: the kind of processor that is compiled for, and versions."""
    packages = ("numpy", "scipy", "numba", "llvmlite", "casadi", "osqp", "daqp", "cvxpy", "pandas")
    return {"processor": get_host_cpu_name(), **{name: version(name) for name in packages}}


def difference(found: Result, stored: dict[str, Any], same_machine: bool) -> str:
    """What differs from the stored result, in words; empty where nothing does, or another machine cannot say."""
    name, hashes, means = found
    if isinstance(hashes, str):
        return hashes
    before = stored["hashes"].get(name)
    moved = hashes.moved(None if before is None else Hashes(*before.split()))
    if same_machine or before is None:
        return moved
    if not means:
        return ""
    apart = np.subtract(means, stored["traces"][name]) / np.maximum(np.abs(means), 1e-9)
    k = int(np.argmax(np.abs(apart)))
    return f"mean of {TRACED[k]}, by {apart[k]:.1e}" if abs(apart[k]) > TOLERANCE else ""


def main() -> int:
    """Compare with the stored hashes, or store them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="store the hashes")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    parser.add_argument(
        "--only", default=",".join(PARTS), metavar="PARTS", help=f"some of {','.join(PARTS)}"
    )
    parser.add_argument("labels", nargs="*", help="beginnings of labels, such as run/wet-patch")
    chosen = parser.parse_args()
    among = chosen.only.split(",")
    if unknown := set(among) - set(PARTS):
        parser.error(f"--only {', '.join(sorted(unknown))}: give some of {','.join(PARTS)}")
    labels = [
        label
        for label, _ in tasks(among)
        if not chosen.labels or label.startswith(tuple(chosen.labels))
    ]
    if not labels:
        parser.error(f"nothing has a label that begins with {' or '.join(chosen.labels)}")
    # the first alone: the others find what it compiled
    found = computed(labels[-1])
    parallel = joblib.Parallel(n_jobs=chosen.jobs, batch_size=1)
    for results in parallel(joblib.delayed(computed)(label) for label in labels[:-1]):
        found += results
    found.sort(key=lambda result: result[0])
    stored = json.loads(STORED.read_text())
    if chosen.write:
        if failed := [f"{name}: {hashes}" for name, hashes, _ in found if isinstance(hashes, str)]:
            print("nothing is stored;", *failed, sep="\n")
            return 1
        for name, hashes, means in found:
            stored["hashes"][name] = " ".join(asdict(hashes).values())
            stored["traces"] |= {name: means} if means else {}
        content = {"machine": machine()} | {
            key: dict(sorted(stored[key].items())) for key in ("hashes", "traces")
        }
        STORED.write_text(in_lines(content))
        print(f"{len(found)} results stored")
        return 0
    other = [name for name, value in machine().items() if stored["machine"].get(name) != value]
    if other:
        print(f"stored on another machine ({', '.join(other)}): runs are compared to {TOLERANCE:g}")
    changed = {
        result[0]: words for result in found if (words := difference(result, stored, not other))
    }
    for name, words in changed.items():
        print(f"moved: {name}: {words}")
    numbers = sum(words != "words" for words in changed.values())
    print(
        f"{len(found)} results: numbers moved in {numbers}, words alone in {len(changed) - numbers}"
    )
    return 1 if changed else 0


def in_lines(content: dict[str, dict[str, Any]]) -> str:
    """JSON with one line for each entry."""
    parts = []
    for key, entries in content.items():
        lines = (f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in entries.items())
        parts.append(f" {json.dumps(key)}: {{\n" + ",\n".join(lines) + "\n }")
    return "{\n" + ",\n".join(parts) + "\n}\n"


if __name__ == "__main__":
    sys.exit(main())
