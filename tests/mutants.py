"""Mutation testing: small faults that Cosmic Ray puts into the code, one at a time, must make a test fail.

`python -m tests.mutants sample` draws faults, stores in `docs/mutants.csv` which test noticed each, and writes the page
about it; `again` draws from those stored and asks whether the same test still does; `page` writes the page alone. They work
on a copy of the project, in one process that forks for each run of pytest. What the compiled loop consists of runs as plain
Python, for compiling it takes a minute. A test is used if it passes without a fault, in `TEST_SECONDS`.
"""

import argparse
import ast
import csv
import hashlib
import importlib
import itertools
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

os.environ |= {"CI": "1", "OPENBLAS_NUM_THREADS": "1"}  # with CI Hypothesis always draws the same

ROOT = Path(__file__).parents[1]
FOLDERS = (
    "alloc/rules",
    "alloc/metrics",
    "alloc/onboard",
    "alloc/plant",
    "mpc",
    "studies",
    "paper_figs",
)
TESTS = [
    f"tests/{name}"
    for name in [
        "rules",
        "metrics",
        "onboard",
        "uncompiled",
        "mpc",
        "plant",
        "estimation",
        "studies",
        "paper_figs",
    ]
]
STORED, PAGE = ROOT / "docs/mutants.csv", ROOT / "docs/mutants.md"
MARK = "<!-- what follows is written by `python -m tests.mutants page` -->"
USABLE = ROOT / "build/mutants.json"
"""Times of the tests that can be used, by the content of their file."""
TEST_SECONDS, BEGIN_SECONDS, MUTANT_SECONDS = 3.0, 0.7, 60.0
"""Processor time that a test may take, that a file takes to begin with, and that the files of one fault may take."""
FIGURE_SECONDS = 150.0
"""What a test of figures may take, and faults in figures more than others: many figures are drawn."""
LIBRARIES = [
    "numba",
    "casadi",
    "scipy.optimize",
    "hypothesis",
    "pydantic",
    "daqp",
    "osqp",
    "cvxpy",
    "xarray",
    "matplotlib.figure",
    "cyclopts",
    "pandas",
]
"""Imported once, before the forks."""
BINARY = (
    "Add_Sub Sub_Add Mul_Div Mul_Add Div_Mul FloorDiv_Mul Mod_FloorDiv Pow_Mul "
    "BitAnd_BitOr BitOr_BitAnd BitXor_BitAnd"
)
COMPARISON = (
    "Eq_NotEq NotEq_Eq Lt_LtE Lt_GtE LtE_Lt LtE_Gt Gt_GtE Gt_LtE GtE_Gt GtE_Lt Is_IsNot IsNot_Is"
)
OPERATORS = [
    *(f"ReplaceBinaryOperator_{pair}" for pair in BINARY.split()),
    *(f"ReplaceComparisonOperator_{pair}" for pair in COMPARISON.split()),
    *(f"ReplaceUnaryOperator_Delete_{one}" for one in ("USub", "Not", "Invert")),
    *(f"Replace{pair}" for pair in ("TrueWithFalse", "FalseWithTrue", "AndWithOr", "OrWithAnd")),
    *("ReplaceBreakWithContinue", "ReplaceContinueWithBreak"),
    *("AddNot", "NumberReplacer", "ZeroIterationForLoop"),
]
"""Cosmic Ray's operators whose faults a person could make; its others (`<<` for `+`) mostly raise `TypeError`."""
ONE_ENTRY = {"train", "lead", "counter", "pressure", "valve"}
"""Records and arrays with one entry or column, where indices 0 and -1 are the same."""
NAMED = ("file", "operator", "before", "after")
"""What stays of a fault while other lines change."""

Row = dict[str, str]
Outcomes = dict[str, tuple[str, float]]
"""Outcome and processor time by test."""


class Site(NamedTuple):
    """Where a fault can be put: the manieth place of an operator in a file, and the text there."""

    file: str
    operator: str
    occurrence: int
    text: str


class Mutant(NamedTuple):
    """A fault in one line of a file; `source` is the whole file with it."""

    file: str
    operator: str
    line: int
    before: str
    after: str
    source: str


def key(row: Row) -> tuple[str, ...]:
    """A fault by what is `NAMED`."""
    return tuple(row[name] for name in NAMED)


def _left_out(tree: ast.AST) -> set[tuple[int, int]]:
    """Places (line, column) where a fault changes nothing: types, decorators, messages, `strict`, Numba's options."""
    found: list[ast.AST | None] = []
    for node in ast.walk(tree):
        found += getattr(node, "decorator_list", [])
        found += [getattr(node, "annotation", None), getattr(node, "returns", None)]
        if (
            isinstance(node, ast.Raise)
            or (
                isinstance(node, ast.Subscript)
                and ONE_ENTRY & set(ast.unparse(node.value).split("."))
            )
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
    return {
        (n.lineno, column)
        for n in inside
        if n.lineno == n.end_lineno
        for column in range(n.col_offset, n.end_col_offset + 1)
    }


@lru_cache
def sites(file: str) -> list[Site]:
    """Where faults can be put into a file."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    source = Path(file).read_text()
    left_out, nodes = _left_out(ast.parse(source)), list(ast_nodes(get_ast(source)))
    found, lines = [], source.splitlines()
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        places = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for k, (line, column) in enumerate(places):
            if (line, column) not in left_out:
                found.append(
                    Site(
                        file,
                        name,
                        k,
                        f"{lines[line - 1].strip()} {places[:k].count((line, column))} {column}",
                    )
                )
    return found


def mutant(file: str, name: str, occurrence: int, _: str = "") -> Mutant | None:
    """The fault at a `Site`; None where it changes no syntax, or breaks it (`*arguments` is no product)."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    source = Path(file).read_text()
    changed = mutate_code(source, get_operator(f"core/{name}")(), occurrence)
    try:
        if ast.dump(ast.parse(changed)) == ast.dump(ast.parse(source)):
            return None
    except SyntaxError:
        return None
    lines = enumerate(zip(source.splitlines(), changed.splitlines(), strict=False), 1)
    line, (old, new) = next(pair for pair in lines if pair[1][0] != pair[1][1])
    return Mutant(file, name, line, old.strip(), new.strip(), changed)


@lru_cache
def _imported(name: str) -> frozenset[str]:
    """Modules that a file, with the fixtures beside it, or a module imports in any number of steps."""
    from alloc.sources import closure

    files = [str(path.absolute()) for path in (Path(name), Path(name).with_name("conftest.py"))]
    return closure(
        *(filter(os.path.isfile, files) if "/" in name else [name]), "tests", "paper_figs"
    )


@lru_cache
def plain(file: str) -> bool:
    """Whether tests of a file run without Numba: where it is part of the compiled loop, or compiled itself."""
    text = Path(file).read_text()
    return _module(file) in _imported("alloc.loop") or "import jit" in text or "@sweep" in text


def _module(file: str) -> str:
    return file.removesuffix(".py").replace("/", ".")


class _TooLong(BaseException):
    """A test takes too long; no `except Exception` of the project catches it."""


def _ring(*_: object) -> None:
    raise _TooLong


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
            figures = item.nodeid.startswith("tests/paper_figs")
            signal.setitimer(signal.ITIMER_VIRTUAL, FIGURE_SECONDS if figures else TEST_SECONDS)
        self.started = os.times().user

    def pytest_runtest_logreport(self, report) -> None:
        if report.when == "call" or report.outcome == "failed":
            line = [report.nodeid, report.outcome, os.times().user - self.started]
            with self.results.open("a") as file:
                print(json.dumps(line), file=file)


def _pytest(file: str, wanted: dict[str, float] | None, seconds: float, uncompiled: bool) -> int:
    """Run pytest in a process that has imported the libraries."""
    import numba
    import pytest

    for name in [name for name in sys.modules if name.partition(".")[0] in ("alloc", "tests")]:
        del sys.modules[name]
    sys.dont_write_bytecode = wanted is not None
    os.environ["NUMBA_DISABLE_JIT"] = str(int(uncompiled))
    numba.config.DISABLE_JIT = int(uncompiled)
    signal.signal(signal.SIGVTALRM, _ring)
    signal.alarm(1200)  # for one that waits for ever, on a machine that others use too
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 1))
    with Path("pytest.log").open("w") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    options = ["--tb=line", "--assert=plain", "--override-ini=addopts=", "--import-mode=importlib"]
    options += [f"-pno:{name}" for name in ("cacheprovider", "xdist", "benchmark")]
    options += ["--maxfail=4" if wanted is None else "-x", "--mpl"]
    return pytest.main([*options, file], plugins=[_Watch(wanted, Path("results"))])


def run(file: str, wanted: dict[str, float] | None, seconds: float, uncompiled: bool) -> Outcomes:
    """Outcomes of a file's tests; of the `wanted` ones, up to the first that fails. A crash is a failure."""
    Path("results").write_text("")
    child = os.fork()
    if child == 0:
        try:
            os._exit(_pytest(file, wanted, seconds, uncompiled))
        except BaseException:
            traceback.print_exc()
            os._exit(70)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    lines = map(json.loads, Path("results").read_text().splitlines())
    found = {test: (outcome, spent) for test, outcome, spent in lines}
    return found if code in (0, 1) and found else {**found, file: ("failed", seconds)}


def passes(test: str, uncompiled: bool) -> bool:
    """Whether a test passes without a fault."""
    outcomes = run(test.partition("::")[0], {test: 0.0}, 60.0, uncompiled)
    return test.partition("::")[1] == "" or outcomes.get(test, ("failed", 0.0))[0] == "passed"


def notices(fault: Mutant, file: str, wanted: dict[str, float], seconds: float) -> str:
    """The first of the `wanted` tests of a file that fails with the fault; "" if none does."""
    path, uncompiled = Path(fault.file), plain(fault.file)
    before, times = path.read_text(), path.stat()
    path.write_text(fault.source)
    os.utime(path, (0, len(fault.after) + 10 * fault.line))  # no compiled file has this time
    outcomes = run(file, wanted, seconds, uncompiled)
    path.write_text(before)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return next((one for one, (outcome, _) in outcomes.items() if outcome == "failed"), "")


def _mark(file: str, uncompiled: bool) -> str:
    return f"{hashlib.sha256(Path(file).read_bytes()).hexdigest()} {uncompiled}"


def _known() -> dict[str, dict[str, float]]:
    return json.loads(USABLE.read_text()) if USABLE.exists() else {}


def usable_tests(file: str, uncompiled: bool) -> dict[str, float]:
    """Processor time [s] of those tests of a file that pass without a fault."""
    known, mark = _known(), _mark(file, uncompiled)
    if mark not in known:
        outcomes = run(file, None, 600.0, uncompiled)
        known[mark] = {
            one: spent for one, (outcome, spent) in outcomes.items() if outcome == "passed"
        }
        print(f"{file}: {len(known[mark])} tests, {sum(known[mark].values()):.1f} s", flush=True)
        USABLE.parent.mkdir(exist_ok=True)
        USABLE.write_text(json.dumps(known))
    return known[mark]


def noticed_by(fault: Mutant, first: str) -> str:
    """The test that notices a fault, "" if none does; asked are tests that import its file, those that name it first."""
    module, uncompiled, known, left = (
        _module(fault.file),
        plain(fault.file),
        _known(),
        MUTANT_SECONDS + FIGURE_SECONDS * fault.file.startswith("paper_figs"),
    )

    def order(file: str) -> tuple[bool, bool, float]:
        seconds = sum(known.get(_mark(file, uncompiled), {}).values())
        named = module in Path(file).read_text()
        return file != first, not named, len(_imported(file)) * (BEGIN_SECONDS + seconds)

    files = [str(path) for folder in TESTS for path in Path(folder).glob("test_*.py")]
    if not uncompiled:  # the whole loop as plain Python takes too long
        files += [str(path) for path in Path("tests/simulation").glob("test_*.py")]
    files = [file for file in files if "import subprocess" not in Path(file).read_text()]
    for file in sorted((file for file in files if module in _imported(file)), key=order):
        times = sorted((spent, test) for test, spent in usable_tests(file, uncompiled).items())
        left -= BEGIN_SECONDS
        total = list(itertools.accumulate(spent for spent, _ in times))
        wanted = {
            test: spent for (spent, test), until in zip(times, total, strict=True) if until <= left
        }
        left -= sum(wanted.values())
        found = notices(fault, file, wanted, 30.0 + 5.0 * sum(wanted.values())) if wanted else ""
        # what was known of the test may be of other sources: without the fault it must pass
        if found and passes(found, uncompiled):
            return found
    return ""


def read_stored() -> list[Row]:
    """Rows of the stored table."""
    if not STORED.exists():
        return []
    with STORED.open(newline="") as file:
        return list(csv.DictReader(file))


def store(rows: list[Row]) -> None:
    """Store the table, in the order of the code."""
    with STORED.open("w", newline="") as out:
        writer = csv.DictWriter(out, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            sorted(rows, key=lambda row: (row["file"], int(row["line"]), row["after"]))
        )


def possible(row: Row) -> bool:
    """Whether the code still has the line of a stored fault."""
    path = Path(row["file"])
    return path.exists() and row["before"] in map(str.strip, path.read_text().splitlines())


def sample(number: int, seed: int, keep: bool, only: list[str]) -> int:
    """Draw `number` faults and store what noticed them; `keep`: ask only where no test and no remark is.

    `only`: in these files and folders. What is stored of other draws stays as long as it can be made.
    """
    paths = [Path(one) for one in only or FOLDERS]
    files = [
        str(p) for one in paths for p in (sorted(one.rglob("*.py")) if one.is_dir() else [one])
    ]
    places = [site for file in files for site in sites(file)]
    # by hashes, so that an edit changes what is drawn of its own lines alone
    places.sort(
        key=lambda s: hashlib.sha256(f"{seed} {s.file} {s.operator} {s.text}".encode()).digest()
    )
    before, rows = {key(row): row for row in read_stored()}, {}
    for place in places:
        fault = mutant(*place)
        if fault is None or key(fault._asdict()) in rows:
            continue
        row = fault._asdict()
        known = before.get(key(row), {"noticed_by": "", "remark": ""})
        test = known["noticed_by"]
        if not (keep and (test or known["remark"])):
            test = noticed_by(fault, test.partition("::")[0])
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
        if len(rows) == number:
            break
        store([*rows.values(), *(row for key, row in before.items() if key not in rows)])
    store(
        [*rows.values(), *(row for key, row in before.items() if key not in rows and possible(row))]
    )
    return page()


def again(number: int, seed: int) -> int:
    """Draw `number` stored faults that were noticed and can still be made; 1 if their tests do not notice them any more."""
    rows = [row for row in read_stored() if row["noticed_by"] and Path(row["file"]).exists()]
    random.Random(seed).shuffle(rows)
    noticed: list[bool] = []
    for row in rows:
        made = (mutant(*place) for place in sites(row["file"]) if place.operator == row["operator"])
        same = [one for one in made if one and key(one._asdict()) == key(row)]
        # several lines may read alike
        fault = min(same, key=lambda one: abs(one.line - int(row["line"])), default=None)
        test = row["noticed_by"]
        file, wanted = test.partition("::")[0], {test: 0.0}
        if fault is None or not passes(test, plain(row["file"])):
            continue  # code or test has changed
        noticed.append(bool(notices(fault, file, wanted, 60.0)))
        if not noticed[-1]:
            print(
                f"{test} does not notice any more, in {row['file']}: {row['before']}  =>  {row['after']}"
            )
        if len(noticed) == number:
            break
    print(f"{sum(noticed)} of {len(noticed)} stored faults are noticed")
    return int(not noticed or not all(noticed))


def page() -> int:
    """Write what the table says into the page about it, after the mark there."""
    rows, kept = read_stored(), PAGE.read_text().partition(MARK)[0]
    text = "\n\n| folder | faults | noticed |\n|---|---|---|\n"
    for folder in (*FOLDERS, ""):
        inside = [bool(row["noticed_by"]) for row in rows if row["file"].startswith(folder)]
        text += f"| {folder or 'all'} | {len(inside)} | {sum(inside)} |\n"
    text += "\n| not noticed | before | after | why |\n|---|---|---|---|\n"
    for row in rows:
        if not row["noticed_by"]:
            line = (
                f"{row['file']}:{row['line']}",
                f"`{row['before']}`",
                f"`{row['after']}`",
                row["remark"],
            )
            text += "| " + " | ".join(one.replace("|", "\\|") for one in line) + " |\n"
    PAGE.write_text(kept + MARK + text)
    return 0


def main() -> int:
    """Run a command."""
    parser = argparse.ArgumentParser(
        description="Put faults into the code; tests must notice them."
    )
    parser.add_argument("command", choices=("sample", "again", "page"))
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="PATH", help="sample these files and folders"
    )
    parser.add_argument(
        "--keep",
        action="store_true",
        help="ask only about faults that no test noticed and no remark explains",
    )
    given = parser.parse_args()
    if given.command == "page":
        return page()
    for library in LIBRARIES:
        importlib.import_module(library)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("alloc", "mpc", "studies", "paper_figs", "tests", "docs"):
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, Path(folder) / name, ignore=ignored)
        shutil.copy2(ROOT / "pyproject.toml", folder)
        os.chdir(folder)
        sys.path[:] = [folder, *(path for path in sys.path if path not in ("", str(ROOT)))]
        if given.command == "sample":
            return sample(given.number, given.seed, given.keep, given.only)
        return again(given.number, given.seed)


if __name__ == "__main__":
    sys.exit(main())
