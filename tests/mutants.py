"""Mutation testing: small faults that Cosmic Ray puts into the code, one at a time, must make a test fail.

`python -m tests.mutants sample` draws faults and stores in `docs/mutants.csv` which test noticed each; `again` draws from
those stored and asks whether the same test still does. Both work on a copy of the project, in one process that forks for
each run of pytest. What the compiled loop consists of runs as plain Python, for compiling it takes a minute. A test is used
if it passes without a fault in `TEST_SECONDS`.
"""

import argparse
import ast
import csv
import hashlib
import importlib
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

os.environ |= {
    "CI": "1",
    "OPENBLAS_NUM_THREADS": "1",
}  # with CI Hypothesis draws the same every time

ROOT = Path(__file__).parents[1]
FOLDERS = ("alloc/rules", "alloc/metrics", "alloc/onboard", "mpc")
TESTS = ("tests/rules", "tests/metrics", "tests/onboard", "tests/uncompiled", "tests/mpc")
STORED = ROOT / "docs/mutants.csv"
USABLE = ROOT / "build/mutants.json"
"""Times of the tests that can be used, by the content of their file."""
TEST_SECONDS, MUTANT_SECONDS = 2.0, 25.0
"""Longest processor time of a test that is used, and of all tests of one fault."""
LIBRARIES = (
    "numba",
    "casadi",
    "scipy.optimize",
    "hypothesis",
    "pydantic",
    "daqp",
    "osqp",
    "cvxpy",
    "xarray",
    "pandas",
)
"""Imported once, before the forks."""

BINARY = "Add_Sub Sub_Add Mul_Div Mul_Add Div_Mul FloorDiv_Mul Mod_FloorDiv Pow_Mul BitAnd_BitOr BitOr_BitAnd BitXor_BitAnd"
COMPARISON = (
    "Eq_NotEq NotEq_Eq Lt_LtE Lt_GtE LtE_Lt LtE_Gt Gt_GtE Gt_LtE GtE_Gt GtE_Lt Is_IsNot IsNot_Is"
)
OPERATORS = [
    *(f"ReplaceBinaryOperator_{pair}" for pair in BINARY.split()),
    *(f"ReplaceComparisonOperator_{pair}" for pair in COMPARISON.split()),
    *(f"ReplaceUnaryOperator_Delete_{one}" for one in ("USub", "Not", "Invert")),
    "AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "NumberReplacer", "ZeroIterationForLoop",
]  # fmt: skip
"""Cosmic Ray's operators whose faults a person could make; its others (`<<` for `+`) mostly raise `TypeError`."""


Outcomes = dict[str, tuple[str, float]]
"""By test."""


class Mutant(NamedTuple):
    """A fault in one line of a file."""

    file: str
    operator: str
    line: int
    before: str
    after: str
    source: str
    """The whole file with it."""


def key(row: dict[str, str]) -> tuple[str, ...]:
    """What stays of a fault while other lines change."""
    return tuple(row[name] for name in ("file", "operator", "before", "after"))


def _left_out(tree: ast.AST) -> set[tuple[int, int]]:
    """Places (line, column) where a fault changes nothing: annotations, decorators, messages, `strict`, Numba's options."""
    found: list[ast.AST | None] = []
    for node in ast.walk(tree):
        found += getattr(node, "decorator_list", [])
        found += [getattr(node, "annotation", None), getattr(node, "returns", None)]
        if (
            isinstance(node, ast.Raise)
            or (isinstance(node, ast.keyword) and node.arg == "strict")
            or (isinstance(node, ast.FunctionDef) and node.name == "__repr__")
            or (isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING")
            or (
                isinstance(node, ast.Call)
                and getattr(node.func, "id", "") in ("compiled", "record")
            )
        ):
            found.append(node)
    inside = [n for part in filter(None, found) for n in ast.walk(part) if hasattr(n, "lineno")]
    spans = [
        (n.lineno, range(n.col_offset, n.end_col_offset + 1))
        for n in inside
        if n.lineno == n.end_lineno
    ]
    return {(line, column) for line, columns in spans for column in columns}


@lru_cache
def sites(file: str) -> list[tuple[str, str, int]]:
    """Where faults can be put into a file: file, operator, how manieth place."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    source = (ROOT / file).read_text()
    left_out, nodes = _left_out(ast.parse(source)), list(ast_nodes(get_ast(source)))
    found = []
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        places = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        found += [(file, name, k) for k, place in enumerate(places) if place not in left_out]
    return found


def mutant(file: str, name: str, occurrence: int) -> Mutant | None:
    """The fault at a site; None where it leaves the syntax tree as it is, or breaks it (`*arguments` is no product)."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    source = (ROOT / file).read_text()
    changed = mutate_code(source, get_operator(f"core/{name}")(), occurrence)
    try:
        if ast.dump(ast.parse(changed)) == ast.dump(ast.parse(source)):
            return None
    except SyntaxError:
        return None
    lines = enumerate(zip(source.splitlines(), changed.splitlines(), strict=False), 1)
    line, (old, new) = next(pair for pair in lines if pair[1][0] != pair[1][1])
    return Mutant(file, name, line, old.strip(), new.strip(), changed)


def _imported(module: str) -> frozenset[str]:
    from alloc.sources import closure

    return closure(module.removesuffix(".py").replace("/", "."))


def plain(file: str) -> bool:
    """Whether tests of a file run without Numba: where it is part of the compiled loop, or compiled itself."""
    name = file.removesuffix(".py").replace("/", ".")
    return (
        name in _imported("alloc.loop")
        or "import jit" in (text := (ROOT / file).read_text())
        or "@sweep" in text
    )


class _TooLong(BaseException):
    """A test takes too long; no `except Exception` of the project catches it."""


class _Watch:
    """Plug-in of pytest: notes outcome and processor time of each test, of the `wanted` ones alone if these are given."""

    def __init__(self, wanted: dict[str, float] | None, results: Path) -> None:
        self.wanted, self.results = wanted, results

    def pytest_collection_modifyitems(self, items: list) -> None:
        if self.wanted is not None:
            items[:] = [item for item in items if item.nodeid in self.wanted]
            items.sort(key=lambda item: self.wanted[item.nodeid])

    def pytest_runtest_setup(self, item) -> None:
        if self.wanted is None:  # rings in processor time, so other processes do not matter
            signal.setitimer(signal.ITIMER_VIRTUAL, TEST_SECONDS)
        self.started = os.times().user

    def pytest_runtest_logreport(self, report) -> None:
        if report.when == "call" or report.outcome == "failed":
            with self.results.open("a") as file:
                print(
                    json.dumps([report.nodeid, report.outcome, os.times().user - self.started]),
                    file=file,
                )


class Copy:
    """A copy of the project, and runs of pytest there in forks of this process."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.results, self._applied = folder, folder / "results", 0
        for name in ("alloc", "mpc", "studies", "paper_figs", "tests", "docs"):
            shutil.copytree(
                ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__")
            )
        shutil.copy2(ROOT / "pyproject.toml", folder)

    def run(
        self, file: str, wanted: dict[str, float] | None, seconds: float, uncompiled: bool
    ) -> Outcomes:
        """Outcome and time of a file's tests; of the `wanted` ones up to the first that fails. A crash is a failure."""
        self.results.write_text("")
        child = os.fork()
        if child == 0:
            try:
                os._exit(self._pytest(file, wanted, seconds, uncompiled))
            except BaseException:
                traceback.print_exc()
                os._exit(70)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        found = {
            test: (outcome, spent)
            for test, outcome, spent in map(json.loads, self.results.read_text().splitlines())
        }
        return found if code in (0, 1) and found else {**found, file: ("failed", seconds)}

    def _pytest(
        self, file: str, wanted: dict[str, float] | None, seconds: float, uncompiled: bool
    ) -> int:
        import numba
        import pytest

        def ring(*_: object) -> None:
            raise _TooLong

        for name in [name for name in sys.modules if name.partition(".")[0] in ("alloc", "tests")]:
            del sys.modules[name]
        os.chdir(self.folder)
        sys.path[:] = [
            str(self.folder),
            *(path for path in sys.path if path not in ("", str(ROOT))),
        ]
        sys.dont_write_bytecode = wanted is not None
        os.environ["NUMBA_DISABLE_JIT"] = str(int(uncompiled))
        numba.config.DISABLE_JIT = int(uncompiled)
        signal.signal(signal.SIGVTALRM, ring)
        signal.alarm(1200)
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 1))
        with (self.folder / "pytest.log").open("w") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        options = [
            "-q",
            "--tb=line",
            "--assert=plain",
            "--override-ini=addopts=",
            "--import-mode=importlib",
        ]
        options += [f"-pno:{name}" for name in ("cacheprovider", "xdist", "benchmark")]
        options += ["--maxfail=3" if wanted is None else "-x"]
        return pytest.main([*options, file], plugins=[_Watch(wanted, self.results)])

    def noticed(self, fault: Mutant, test: str, wanted: dict[str, float], seconds: float) -> str:
        """The first of the `wanted` tests of the file `test` that fails with the fault; "" if none does."""
        path = self.folder / fault.file
        path.write_text(fault.source)
        self._applied += 10
        os.utime(path, (1e9 + self._applied,) * 2)  # no compiled file has this time
        outcomes = self.run(test, wanted, seconds, plain(fault.file))
        shutil.copy2(ROOT / fault.file, path)
        return next((one for one, (outcome, _) in outcomes.items() if outcome == "failed"), "")


def usable_tests(copy: Copy, uncompiled: bool) -> dict[str, dict[str, float]]:
    """File -> test -> processor time [s], of the tests that pass without a fault."""
    known = json.loads(USABLE.read_text()) if USABLE.exists() else {}
    found = {}
    for path in sorted(path for folder in TESTS for path in (ROOT / folder).glob("test_*.py")):
        file = path.relative_to(ROOT).as_posix()
        mark = f"{hashlib.sha256(path.read_bytes()).hexdigest()} {uncompiled}"
        if mark not in known:
            outcomes = copy.run(file, None, 600.0, uncompiled)
            known[mark] = {
                test: spent for test, (outcome, spent) in outcomes.items() if outcome == "passed"
            }
            print(
                f"{file}: {len(known[mark])} tests, {sum(known[mark].values()):.1f} s", flush=True
            )
            USABLE.parent.mkdir(exist_ok=True)
            USABLE.write_text(json.dumps(known))
        found[file] = known[mark]
    return found


def noticed_by(copy: Copy, fault: Mutant, first: str, usable: dict[str, dict[str, float]]) -> str:
    """The test that notices a fault, "" if none does; asked are tests that import its file, the most special first."""
    name, spent = fault.file.removesuffix(".py").replace("/", "."), 0.0
    near = [test for test, times in usable.items() if times and name in _imported(test)]
    for test in sorted(near, key=lambda test: (not first.startswith(test), len(_imported(test)))):
        seconds = sum(usable[test].values())
        if spent + seconds <= MUTANT_SECONDS:
            spent += seconds
            if found := copy.noticed(fault, test, usable[test], 30.0 + 5.0 * seconds):
                return found
    return ""


def read_stored() -> list[dict[str, str]]:
    """Rows of the stored table."""
    if not STORED.exists():
        return []
    with STORED.open(newline="") as file:
        return list(csv.DictReader(file))


def sample(copy: Copy, number: int, seed: int, keep: bool) -> int:
    """Draw `number` faults and store what noticed them."""
    files = [
        path.relative_to(ROOT).as_posix()
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
    ]
    places = [place for file in files for place in sites(file)]
    random.Random(seed).shuffle(places)
    before = {key(row): row for row in read_stored()}
    usable = {uncompiled: usable_tests(copy, uncompiled) for uncompiled in (True, False)}
    rows: dict[tuple[str, ...], dict[str, str]] = {}
    for place in places:
        fault = mutant(*place)
        if fault is None or key(fault._asdict()) in rows:
            continue
        row = fault._asdict()
        known = before.get(key(row), {"noticed_by": "", "remark": ""})
        test = known["noticed_by"]
        if not (keep and test):
            test = noticed_by(copy, fault, test, usable[plain(fault.file)])
        del row["source"]
        rows[key(row)] = row | {"noticed_by": test, "remark": "" if test else known["remark"]}
        print(
            len(rows),
            fault.file,
            fault.line,
            f"{fault.before}  =>  {fault.after} |",
            test or "SURVIVED",
            flush=True,
        )
        with STORED.with_suffix(".part").open("w", newline="") as out:
            writer = csv.DictWriter(out, [*row, "noticed_by", "remark"], lineterminator="\n")
            writer.writeheader()
            writer.writerows(
                sorted(rows.values(), key=lambda row: (row["file"], row["line"], row["after"]))
            )
        if len(rows) == number:
            break
    STORED.with_suffix(".part").replace(STORED)
    for folder in FOLDERS:
        noticed = [
            bool(row["noticed_by"]) for row in rows.values() if row["file"].startswith(folder)
        ]
        print(f"{folder}: {sum(noticed)} of {len(noticed)} noticed")
    return 0


def again(copy: Copy, number: int, seed: int) -> int:
    """Draw `number` stored faults that were noticed and can still be made; 1 if their tests do not notice them any more."""
    rows = [row for row in read_stored() if row["noticed_by"]]
    random.Random(seed).shuffle(rows)
    noticed: list[bool] = []
    for row in rows:
        made = (mutant(*place) for place in sites(row["file"]) if place[1] == row["operator"])
        fault = next((one for one in made if one and key(one._asdict()) == key(row)), None)
        test = row["noticed_by"]
        file, wanted = test.partition("::")[0], {test: 0.0}
        if (
            fault is None
            or copy.run(file, wanted, 60.0, plain(row["file"])).keys() != wanted.keys()
        ):
            continue  # code or test has changed
        noticed.append(bool(copy.noticed(fault, file, wanted, 60.0)))
        if not noticed[-1]:
            print(
                f"{test} does not notice any more, in {row['file']}: {row['before']}  =>  {row['after']}"
            )
        if len(noticed) == number:
            break
    print(f"{sum(noticed)} of {len(noticed)} stored faults are noticed")
    return int(not noticed or not all(noticed))


def main() -> int:
    """Run a command."""
    parser = argparse.ArgumentParser(
        description="Put faults into the code; tests must notice them."
    )
    parser.add_argument("command", choices=("sample", "again"))
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--keep",
        action="store_true",
        help="sample: ask only about faults that nothing noticed before",
    )
    given = parser.parse_args()
    for library in LIBRARIES:
        importlib.import_module(library)
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        if given.command == "sample":
            return sample(copy, given.number, given.seed, given.keep)
        return again(copy, given.number, given.seed)


if __name__ == "__main__":
    sys.exit(main())
