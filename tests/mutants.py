"""Mutation testing: small faults that Cosmic Ray puts into the code, one at a time, must make a test fail.

`python -m tests.mutants sample` draws faults, stores in `docs/mutants.csv` which test noticed each, and writes the page
about it; `again` draws from those stored and asks whether the same test still does; `page` writes the page alone. They work
on a copy of the project, in one process that forks for each run of pytest. A fault is shown to the tests that execute its
line, the quickest first, then to others: each file of tests runs once under coverage, and what it says of lines is kept.
"""

import argparse
import ast
import csv
import hashlib
import importlib
import io
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
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

# with CI Hypothesis always draws the same; other tracers than `ctrace` tell no tests apart
os.environ |= {"CI": "1", "OPENBLAS_NUM_THREADS": "1", "COVERAGE_CORE": "ctrace"}

ROOT = Path(__file__).parents[1]
PACKAGES = ["alloc", "mpc", "studies", "paper_figs"]
FOLDERS = [*(f"alloc/{one}" for one in ("rules", "metrics", "onboard", "plant")), *PACKAGES[1:]]
TESTS = ["rules", "metrics", "onboard", "uncompiled", "mpc", "plant", "estimation"]
LOOP_TESTS = ["simulation", "studies", "paper_figs"]
"""Folders of tests that are used; the second in compiled mode alone, for the loop as plain Python takes too long."""
STORED, PAGE = ROOT / "docs/mutants.csv", ROOT / "docs/results/mutants.md"
MARK = "<!-- what follows is written by `python -m tests.mutants page` -->"
MAPS = ROOT / "build/mutants"
"""What was measured of each file of tests, by its content."""
TEST_SECONDS, PLAIN_SECONDS, MUTANT_SECONDS, COMPILE_SECONDS = 60.0, 5.0, 150.0, 200.0
"""Processor time that a test may take, compiled and as plain Python, all tests of one fault, and compiling a faulty loop."""
TOGETHER, QUICK = 6, 1.0
"""Files of tests that are run in one process, and the time [s] of a test that comes before the slow ones."""
LIBRARIES = "numba casadi scipy.optimize hypothesis pydantic daqp osqp cvxpy xarray matplotlib.figure cyclopts pandas"
"""Imported once, before the forks."""
BINARY = "Add_Sub Sub_Add Mul_Div Mul_Add Div_Mul FloorDiv_Mul Mod_FloorDiv Pow_Mul BitAnd_BitOr BitOr_BitAnd BitXor_BitAnd"
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

Site = tuple[str, str, int, str]
"""Where a fault can be put: the manieth place of an operator in a file, and the text there."""
Row = dict[str, str]
Outcomes = dict[str, tuple[str, float]]  # with processor time [s], by test
Map = tuple[dict[str, float], dict[str, dict[str, list[int]]]]
"""Processor time [s] of each test that passes, the shortest first; by file and text of a line, which of them execute it."""


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
        match node:
            case (
                ast.Raise()
                | ast.keyword(arg="strict")
                | ast.FunctionDef(name="__repr__")
                | ast.If(test=ast.Name("TYPE_CHECKING"))
                | ast.Call(func=ast.Name("compiled" | "record"))
            ):
                found.append(node)
            case ast.Subscript() if ONE_ENTRY & set(ast.unparse(node.value).split(".")):
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
    source = Path(file).read_text()
    left_out, nodes = _left_out(ast.parse(source)), list(ast_nodes(get_ast(source)))
    found, lines = [], source.splitlines()
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        places = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for k, (line, column) in enumerate(places):
            if (line, column) not in left_out:
                text = f"{lines[line - 1].strip()} {places[:k].count((line, column))} {column}"
                found.append((file, name, k, text))
    return found


def mutant(file: str, name: str, occurrence: int, _: str = "") -> Mutant | None:
    """The fault at a `Site`; None where it changes no syntax, or breaks it (`*arguments` is no product)."""
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
    names = filter(os.path.isfile, files) if "/" in name else [name]
    return closure(*names, "tests", "paper_figs")


def _module(file: str) -> str:
    return file.removesuffix(".py").replace("/", ".")


@lru_cache
def modes(file: str) -> tuple[bool, ...]:
    """Whether tests of a file run uncompiled: at first where it is compiled or in the loop, for compiling takes a minute."""
    text = Path(file).read_text()
    compiles = "alloc.compilation import" in text or "mpc.arrays import" in text
    return (True, False) if compiles or _module(file) in _imported("alloc.loop") else (False,)


class _TooLong(BaseException):
    """A test takes too long; no `except Exception` of the project catches it."""


def _ring(*_: object) -> None:
    raise _TooLong


class _Watch:
    """Plug-in of pytest: notes outcome and time of each test; runs those `wanted` in their order, or measures all."""

    def __init__(self, wanted: list[str] | None, coverage: Any, most: float) -> None:
        self.wanted, self.coverage, self.most = wanted, coverage, most

    def pytest_collection_modifyitems(self, items: list) -> None:
        if self.wanted is not None:
            place = {test: k for k, test in enumerate(self.wanted)}
            items[:] = [item for item in items if item.nodeid in place]
            items.sort(key=lambda item: place[item.nodeid])

    def pytest_runtest_protocol(self, item) -> None:
        if self.wanted is None:
            # rings in processor time, so other processes do not matter
            signal.setitimer(signal.ITIMER_VIRTUAL, self.most)
            self.coverage.switch_context(item.nodeid)
        self.started = sum(os.times()[:3:2])  # of processes that it waited for too
        self.note(item.nodeid, "started")

    def pytest_runtest_logreport(self, report) -> None:
        if report.when == "call" or report.outcome == "failed":
            self.note(report.nodeid, report.outcome, sum(os.times()[:3:2]) - self.started)
        if report.when == "teardown":
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)

    def pytest_collectreport(self, report) -> None:
        if report.failed:
            self.note(report.nodeid, "failed")

    def note(self, test: str, outcome: str, seconds: float = 0.0) -> None:
        with Path("outcomes").open("a") as file:
            print(json.dumps([test, outcome, seconds]), file=file)


def _pytest(files: list[str], wanted: list[str] | None, seconds: float, uncompiled: bool) -> int:
    """Run pytest in a process that has imported the libraries; without `wanted` write `executed`, tests by line."""
    import numba
    import pytest
    from coverage import Coverage

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
    options += ["--mpl", *(f"-pno:{name}" for name in ("cacheprovider", "xdist", "benchmark"))]
    if wanted is not None:
        return pytest.main([*options, "-x", *files], plugins=[_Watch(wanted, None, 0.0)])
    options += ["--maxfail=4"] if uncompiled else []
    most = PLAIN_SECONDS if uncompiled else TEST_SECONDS
    measured = Coverage(data_file=None, config_file=False, source=PACKAGES)
    with measured.collect():
        code = pytest.main([*options, *files], plugins=[_Watch(None, measured, most)])
    data, executed = measured.get_data(), {}
    for path in data.measured_files():
        text = Path(path).read_text().splitlines()
        here = executed.setdefault(str(Path(path).relative_to(Path.cwd())), {})
        for line, tests in data.contexts_by_lineno(path).items():
            here.setdefault(text[line - 1].strip(), []).extend(tests)
    Path("executed").write_text(json.dumps(executed))
    return code


def run(files: list[str], wanted: list[str] | None, seconds: float, uncompiled: bool) -> Outcomes:
    """Outcomes of the tests in files; of the `wanted` ones in their order, up to the first that fails, as a crash does."""
    Path("outcomes").write_text("")
    child = os.fork()
    if child == 0:
        try:
            os._exit(_pytest(files, wanted, seconds, uncompiled))
        except BaseException:
            traceback.print_exc()
            os._exit(70)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    lines = map(json.loads, Path("outcomes").read_text().splitlines())
    found = {test: (outcome, spent) for test, outcome, spent in lines}
    last = next(reversed(found), files[0])
    return {**found, last: ("failed", seconds)} if code not in (0, 1, 5) else found


def passes(test: str, uncompiled: bool) -> bool:
    """Whether a test passes without a fault."""
    outcomes = run([test.partition("::")[0]], [test], COMPILE_SECONDS, uncompiled)
    return outcomes.get(test, ["failed" if "::" in test else "passed"])[0] == "passed"


def notices(fault: Mutant, wanted: list[str], seconds: float, uncompiled: bool) -> str:
    """The first of the `wanted` tests that fails with the fault; "" if none does."""
    path, files = Path(fault.file), list(dict.fromkeys(one.partition("::")[0] for one in wanted))
    before, times = path.read_text(), path.stat()
    path.write_text(fault.source)
    os.utime(path, (0, len(fault.after) + 10 * fault.line))  # no compiled file has this time
    outcomes = run(files, wanted, seconds, uncompiled)
    path.write_text(before)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return next((one for one, (outcome, _) in outcomes.items() if outcome == "failed"), "")


@lru_cache(maxsize=32)
def measured(file: str, uncompiled: bool) -> Map:
    """The map of a file of tests, made once, in a process of its own."""
    mark = hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]
    path = MAPS / f"{mark}-{'plain' if uncompiled else 'compiled'}.json"
    if not path.exists():
        Path("executed").write_text("{}")
        outcomes = run([file], None, 1000.0, uncompiled)
        spent = {one: s for one, (outcome, s) in outcomes.items() if outcome == "passed"}
        tests = sorted(spent, key=spent.__getitem__)
        place = {one: k for k, one in enumerate(tests)}
        lines = {
            source: {
                text: sorted({place[one] for one in by if one in place})
                for text, by in here.items()
            }
            for source, here in json.loads(Path("executed").read_text()).items()
        }
        print(f"{file}: {len(tests)} tests, {sum(spent.values()):.1f} s", flush=True)
        MAPS.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps([{one: spent[one] for one in tests}, lines]))
    return tuple(json.loads(path.read_text()))


def statement(fault: Mutant) -> set[str]:
    """Lines of the statement that a fault is in, for not all of them count as executed; of a compound one its header."""
    source = Path(fault.file).read_text()
    every = (one for one in ast.walk(ast.parse(source)) if isinstance(one, ast.stmt))
    inner = max(every, key=lambda one: (one.lineno <= fault.line <= one.end_lineno, one.lineno))
    body = getattr(inner, "body", None)
    last = max(inner.lineno, body[0].lineno - 1) if body else inner.end_lineno
    return {line.strip() for line in source.splitlines()[inner.lineno - 1 : last]}


def candidates(fault: Mutant, files: list[str], uncompiled: bool) -> list[tuple]:
    """Rank, whether it is slow, place of the file, distance, time [s] and name of tests, the likeliest first.

    Rank 0 executes the fault, 1 is of a file of such tests, for what tests share the first alone executes; 2 is of others.
    """
    text, found = statement(fault), []
    for file in random.sample(files, len(files)):  # commands that run at once share the measuring
        seconds, lines = measured(file, uncompiled)
        here = lines.get(fault.file, {})
        executing = {k for line in text for k in here.get(line, [])}
        near = set().union(*here.values())
        for k, (test, spent) in enumerate(seconds.items()):
            rank = 0 if k in executing else 1 if executing else 2
            found.append((rank, spent > QUICK, files.index(file), k not in near, spent, test))
    return sorted(found)


def noticed_by(fault: Mutant) -> str:
    """The test that notices a fault, "" if none does. Files that name its module, or import little else, come first."""
    module, ways = _module(fault.file), modes(fault.file)
    for uncompiled in ways:
        recompiled = len(ways) == 2 and not uncompiled
        folders = TESTS + LOOP_TESTS * (not uncompiled)
        files = [str(path) for one in folders for path in Path("tests", one).glob("test_*.py")]
        files = [file for file in files if module in _imported(file)]
        files.sort(key=lambda file: (module not in Path(file).read_text(), len(_imported(file))))
        left, asked = MUTANT_SECONDS, set()
        ranks = (0, 1) if uncompiled else (2,) if recompiled else (0, 2)  # compiled: unseen
        for most, k in itertools.product(ranks, range(0, len(files), TOGETHER)):
            if left < 1.0:
                break
            batch, seconds = [], 60.0 + COMPILE_SECONDS * recompiled
            for rank, *_, spent, test in candidates(fault, files[k : k + TOGETHER], uncompiled):
                if rank <= most and spent <= left and test not in asked:
                    batch.append(test)
                    left, seconds = left - spent, seconds + 2.0 * spent
            asked.update(batch)
            while batch and (test := notices(fault, batch, seconds, uncompiled)):
                # by itself it must pass without the fault, and fail with it
                if passes(test, uncompiled) and notices(fault, [test], seconds, uncompiled):
                    return test
                after = batch.index(test) + 1 if test in batch else 0
                batch = [one for one in batch[after:] if not one.startswith(f"{test}::")]
    return ""


def read_stored() -> list[Row]:
    """Rows of the stored table."""
    with STORED.open(newline="") as file:
        return list(csv.DictReader(file))


def possible(row: Row) -> bool:
    """Whether the line of a stored fault is still there, and the test that noticed it."""
    file, _, test = row["noticed_by"].partition("[")[0].partition("::")
    text = [Path(one).read_text() if Path(one).is_file() else "" for one in (row["file"], file)]
    return row["before"] in map(str.strip, text[0].splitlines()) and test in text[1]


def store(rows: dict[tuple[str, ...], Row]) -> None:
    """Put rows into the table, which is in the order of the code; another command may have added to it."""
    kept = {key(row): row for row in read_stored() if possible(row)} | rows
    text = io.StringIO()
    order = sorted(kept.values(), key=lambda row: (row["file"], int(row["line"]), row["after"]))
    writer = csv.DictWriter(text, order[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(order)
    aside = STORED.with_suffix(f".{os.getpid()}")
    aside.write_text(text.getvalue())
    aside.replace(STORED)  # another command may read it now


def sample(number: int, seed: int, only: list[str]) -> int:
    """Draw `number` faults in files and folders, `only` in some, and store what noticed them.

    Asked is where neither a test nor a remark is stored. What is stored of other draws stays as long as it can be made.
    """
    paths = [path for one in only or FOLDERS for path in (sorted(Path(one).rglob("*.py")) or [one])]
    places = [site for path in paths for site in sites(str(path))]
    # by hashes, so that an edit changes what is drawn of its own lines alone
    places.sort(key=lambda s: hashlib.sha256(f"{seed} {s[0]} {s[1]} {s[3]}".encode()).digest())
    drawn: dict[tuple[str, ...], Mutant] = {}
    for fault in filter(None, (mutant(*place) for place in places)):
        drawn.setdefault(key(fault._asdict()), fault)
        if len(drawn) == number:
            break
    known = {key(row): row for row in read_stored() if row["noticed_by"] or row["remark"]}
    for k, (one, fault) in enumerate(drawn.items(), 1):
        if one in known and possible(known[one]):
            continue
        test = noticed_by(fault)
        print(f"{k} {fault.file}:{fault.line} {fault.before}  =>  {fault.after}", flush=True)
        print("   ", test or "SURVIVED", flush=True)
        row = {name: str(value) for name, value in fault._asdict().items() if name != "source"}
        store({one: row | {"noticed_by": test, "remark": ""}})
    return page()


def again(number: int, seed: int) -> int:
    """Draw `number` stored faults that were noticed and can still be made; 1 if their tests do not notice them any more."""
    rows = [row for row in read_stored() if row["noticed_by"] and possible(row)]
    random.Random(seed).shuffle(rows)
    noticed: list[bool] = []
    for row in rows:
        test = row["noticed_by"]
        made = (mutant(*place) for place in sites(row["file"]) if place[1] == row["operator"])
        same = [one for one in made if one and key(one._asdict()) == key(row)]
        fault = min(same, key=lambda one: abs(one.line - int(row["line"])), default=None)
        ways = [one for one in modes(row["file"]) if passes(test, one)] if fault else []
        if not ways:
            continue  # code or test has changed
        noticed.append(any(notices(fault, [test], COMPILE_SECONDS, one) for one in ways))
        if not noticed[-1]:
            print(f"{test} does not notice any more:", *(row[name] for name in NAMED), sep="  ")
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
            what = f"`{row['before']}`", f"`{row['after']}`", row["remark"]
            line = " | ".join(one.replace("|", "\\|") for one in what)
            text += f"| {row['file']}:{row['line']} | {line} |\n"
    PAGE.write_text(kept + MARK + text)
    return 0


def main() -> int:
    """Run a command."""
    parser = argparse.ArgumentParser(description="Faults in the code, which tests must notice.")
    parser.add_argument("command", choices=("sample", "again", "page"))
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", default=[], metavar="PATH", help="sample in these")
    given = parser.parse_args()
    if given.command == "page":
        return page()
    for library in LIBRARIES.split():
        importlib.import_module(library)
    with tempfile.TemporaryDirectory() as folder:
        ignored = shutil.ignore_patterns(".*", "build", "*.egg-info", "__pycache__")
        shutil.copytree(ROOT, folder, dirs_exist_ok=True, ignore=ignored)
        os.chdir(folder)
        os.environ["PYTHONPATH"] = folder  # for processes that tests start
        sys.path[:] = [folder, *(path for path in sys.path if path not in ("", str(ROOT)))]
        drawn = given.number, given.seed
        return sample(*drawn, given.only) if given.command == "sample" else again(*drawn)


if __name__ == "__main__":
    sys.exit(main())
