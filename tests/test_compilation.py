"""Compiled code is never stale, is not compiled again for a comment, and is loaded from no folder of somebody else."""

import contextlib
import importlib
import io
import multiprocessing
import os
import pickle
import pkgutil
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import warnings
from collections import namedtuple
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import alloc.loop
import mpc
import studies.readhesion_paper
from alloc import compilation, sources
from alloc.onboard import distribution, host, sensing
from alloc.onboard.controllers.collection import BUILT_IN, control
from alloc.onboard.parameters import Onboard
from alloc.onboard.state import RuleSettings, settings
from alloc.plant import engine as compiled
from alloc.sources import VARIABLES, cache_folder, closure, keep, path_of, private, write_whole
from tests.test_sources import forget

ROOT = Path(__file__).parents[1]
MPC = [importlib.import_module(f"mpc.{m.name}") for m in pkgutil.iter_modules(mpc.__path__)]
SWEPT = [m for m in MPC if any(isinstance(part, Dispatcher) for part in vars(m).values())]
KERNELS = [
    alloc.loop,
    sensing,
    distribution,
    host,
    compiled,
    studies.readhesion_paper,
    *SWEPT,
]


def called(function, seen):
    """Python functions that a compiled one calls, however indirectly, by the names that it uses."""
    function = getattr(function, "py_func", function)
    code = getattr(function, "__code__", None)
    if code is None or id(code) in seen:
        return
    seen[id(code)] = function
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    values = [function.__globals__.get(name) for name in code.co_names]
    modules = [value for value in values if isinstance(value, type(os))]
    values += [vars(module).get(name) for module in modules for name in code.co_names]
    for value in (*cells, *values):
        if callable(value) and not isinstance(value, type):
            called(value, seen)


@pytest.mark.parametrize("module", KERNELS, ids=lambda module: module.__name__)
def test_every_function_of_a_kernel_lies_in_a_file_that_counts(module):
    seen: dict[int, object] = {}
    for value in vars(module).values():
        if isinstance(value, Dispatcher):
            called(value, seen)
    files = {Path(function.__code__.co_filename) for function in seen.values()}
    own = {file for file in files if ROOT in file.parents and ".venv" not in file.parts}
    assert own
    assert own <= {path_of(name) for name in closure(module.__name__, later=False)}


def test_the_mpc_calls_no_part_that_is_compiled_with_its_caller():
    """Such a part has two texts of one name; which of them runs would depend on what this process compiled."""
    parts = [getattr(module, name) for module in MPC for name in vars(module)]
    compiled_parts = [part for part in parts if isinstance(part, Dispatcher)]
    assert len(compiled_parts) > 40
    own = [part for part in compiled_parts if part.py_func.__module__.startswith("mpc.")]
    loose = [
        part.py_func.__qualname__
        for part in own
        if part._can_compile and not part.targetoptions.get("forceinline")
    ]
    assert not loose


def test_an_edit_of_a_part_of_a_period_leaves_the_loop_as_it_is():
    """And one of a controller those that do not use it."""
    of_loop = closure("alloc.loop", later=False)
    parts = {f"alloc.onboard.{one}" for one in ("sensing", "distribution", "telegrams", "host")}
    controllers = {kind.__module__ for kind in BUILT_IN.values()}
    assert not (parts | controllers) & of_loop
    for name, kind in BUILT_IN.items():
        seen: dict[int, object] = {}
        called(control(name), seen)
        own = {Path(function.__code__.co_filename) for function in seen.values()}
        counts = closure(kind.__module__, later=False)
        assert {file for file in own if ROOT in file.parents} <= set(map(path_of, counts))
        assert controllers & counts <= {kind.__module__, "alloc.onboard.controllers.creep"}


PACKAGE = {
    "__init__.py": "",
    "kernel.py": """
        from alloc.compilation import jit
        from pack.law import law


        @jit
        def kernel(x):
            return law(x) + 1.0
    """,
    "law.py": """
        from alloc.compilation import equation
        from pack.factor import FACTOR


        @equation
        def law(x):
            return FACTOR * x
    """,
    "factor.py": "FACTOR = 2.0\n",
}


@pytest.fixture
def kernel(tmp_path, monkeypatch):
    """Write the small package with edits and import it afresh; gives its answer and whether it compiled."""
    (tmp_path / "pack").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def run(variable="READHESION_CACHE", **edits):
        for name, text in PACKAGE.items():
            text = textwrap.dedent(text).strip() + "\n"
            for old, new in edits.get(name.removesuffix(".py"), ()):
                assert old in text
                text = text.replace(old, new)
            file = tmp_path / "pack" / name
            if not file.exists() or file.read_text() != text:  # several processes may be here
                file.write_text(text)
        with monkeypatch.context() as patch:
            for name in VARIABLES:
                patch.delenv(name, raising=False)
            patch.setenv(variable, str(tmp_path / "cache"))
            start_afresh()
            kernel = importlib.import_module("pack.kernel").kernel
            answer = kernel(3.0)
        return answer, sum(kernel.stats.cache_misses.values()) > 0

    yield run
    start_afresh()


def start_afresh():
    """Forget what a process remembers of the package, of sources and of folders."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "pack"]:
        del sys.modules[name]
    importlib.invalidate_caches()
    for module in (sources, compilation):
        forget(module)


@pytest.mark.parametrize("variable", VARIABLES)
def test_an_edit_elsewhere_compiles_again_and_a_comment_does_not(kernel, variable):
    assert kernel(variable) == (7.0, True)
    assert kernel(variable) == (7.0, False)
    commented = [("from", '"""A docstring."""\n# a comment\n\nfrom')]
    assert kernel(variable, kernel=commented, law=commented) == (7.0, False)
    assert kernel(variable, factor=[("2.0", "5.0")]) == (16.0, True)
    assert kernel(variable) == (7.0, False)


def difference(pair):
    return pair.a - pair.b


def test_a_kernel_is_not_taken_for_that_of_another_record_of_equal_look(tmp_path, monkeypatch):
    monkeypatch.setenv("READHESION_CACHE", str(tmp_path))
    for fields, expected in (("a b", 2.0), ("b a", -2.0)):  # Numba writes both as Pair(float64 x 2)
        start_afresh()
        pair = namedtuple("Pair", fields)(3.0, 1.0)
        assert compilation.compiled(difference)(pair) == expected
    start_afresh()


def test_what_was_compiled_for_settings_by_value_is_found_again():
    st = settings(Onboard(), RuleSettings(0), "pi-creep")
    for name, value in st._asdict().items():
        assert type(pickle.loads(pickle.dumps(value))) is type(value), name
    assert pickle.loads(pickle.dumps(type(st.brakes.slide_protection))) is type(
        st.brakes.slide_protection
    )


def test_who_waits_at_a_terminal_is_told_once_and_only_where_something_is_compiled(
    kernel, monkeypatch
):
    terminal, log = io.StringIO(), io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True, raising=False)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    monkeypatch.delattr(sys, "ps1", raising=False)
    kernel()
    monkeypatch.setattr(sys, "stderr", log)
    kernel(law=[("*", "+")])
    monkeypatch.setattr(sys, "stderr", terminal)
    assert kernel() == (7.0, False)
    assert log.getvalue() == terminal.getvalue() == "", "a log is not told, nor who loads"
    kernel(law=[("*", "-")])
    compilation._say_compiling()
    assert terminal.getvalue() == f"{compilation.COMPILING}\n"


def test_a_library_of_another_version_compiles_again(kernel, monkeypatch):
    kernel()
    found = sources.library_versions() | {"llvmlite": "0.0.0"}
    monkeypatch.setattr(sources, "library_versions", lambda: found)
    assert kernel() == (7.0, True)


class Exploit:
    """What a crafted cache file holds: it runs a command when it is loaded."""

    def __init__(self, witness):
        self.witness = witness

    def __reduce__(self):
        return os.system, (f"touch {self.witness}",)


def poison(witness):
    """Replace all compiled code by what runs a command."""
    kernels = list(cache_folder().glob("kernel-*"))
    for path in kernels:
        keep(path.name, pickle.dumps(Exploit(witness)))
    return kernels


OTHER = 65534
"""A user that is not this one (nobody)."""


@pytest.mark.parametrize("how", ["owner", "file", "mode", "link"])
def test_compiled_code_that_another_user_could_have_put_there_is_not_loaded(
    kernel, tmp_path, monkeypatch, how
):
    kernel()
    folder = cache_folder()
    (file,) = poison(tmp_path / "witness")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    if how == "mode":
        folder.chmod(0o777)
    elif how == "link":
        folder.rename(tmp_path / "elsewhere")
        folder.symlink_to(tmp_path / "elsewhere")
    elif os.getuid() != 0:
        pytest.skip("only root can give files away")
    else:
        os.chown(folder if how == "owner" else file, OTHER, OTHER)
    for compiles in (True, False):
        with pytest.warns(RuntimeWarning, match="not this user's alone: it is not used, delete it"):
            assert kernel() == (7.0, compiles)
    assert not (tmp_path / "witness").exists()
    assert list((tmp_path / "temporary").rglob("kernel-*"))
    folder.chmod(0o700)


def test_the_exploit_works_where_the_files_are_ones_own(kernel, tmp_path):
    """So that the test above can fail."""
    kernel()
    assert poison(tmp_path / "witness")
    with warnings.catch_warnings(action="ignore"):
        assert kernel() == (7.0, True)
    assert (tmp_path / "witness").exists()


def damage(path, rng):
    """Flip one bit of a file, or lose its end."""
    content = bytearray(path.read_bytes())
    place = rng.integers(len(content))
    content[place] ^= 1 << rng.integers(8)
    path.write_bytes(content if rng.random() < 0.8 else content[:place])


def forked(work):
    """What `work` answers in a process of its own, with the warnings that it gave; a crash has no answer."""
    ours, theirs = multiprocessing.Pipe(duplex=False)

    def send():
        with warnings.catch_warnings(record=True) as given:
            warnings.simplefilter("always")
            theirs.send((work(), [str(one.message) for one in given]))

    process = multiprocessing.get_context("fork").Process(target=send)
    process.start()
    theirs.close()
    with contextlib.suppress(EOFError):
        return ours.recv()
    process.join()
    return process.exitcode


def test_of_processes_that_need_a_kernel_one_compiles_and_the_others_load(kernel, tmp_path):
    """Also where the one that compiled is killed: its lock ends with it."""
    kernel()
    shutil.rmtree(tmp_path / "cache")
    with ThreadPoolExecutor(3) as at_once:
        answers = [answer for answer, _ in at_once.map(lambda _: forked(kernel), range(3))]
    assert sorted(answers) == [(7.0, False), (7.0, False), (7.0, True)]
    assert forked(lambda: (killed_while_compiling(), kernel(law=[("*", "-")]))) == -signal.SIGKILL
    assert forked(lambda: kernel(law=[("*", "-")]))[0] == (0.0, True)


def killed_while_compiling():
    compilation.keep = lambda *_: os.kill(os.getpid(), signal.SIGKILL)


def survives_damage(folder, patterns, work, times):
    """`work` answers as before where a file in `folder` is damaged, with one warning, and none the next time."""
    rng, (expected, _) = np.random.default_rng(37), forked(work)
    for pattern in patterns * times:
        paths = sorted(path for path in folder.rglob(pattern) if "damaged" not in path.name)
        path = paths[rng.integers(len(paths))]
        damage(path, rng)
        aside = path.with_name(f"damaged-{path.name}")
        said = f"{str(path)!r} is damaged and made again; what it was is now {aside.name!r}"
        assert forked(work) == (expected, [said])
        assert forked(work) == (expected, [])
        aside.unlink()


def test_what_is_damaged_is_set_aside_and_made_again(kernel, tmp_path):
    def work():
        return kernel()[0]

    work()
    survives_damage(cache_folder(), ["kernel-*", "source-*"], work, 12)


def test_a_part_of_compiled_code_says_that_python_cannot_call_it():
    part = compilation.inlined_jit(lambda x: x + 1.0)
    for _ in ("never compiled", "compiled with its caller"):
        with pytest.raises(TypeError, match="is a part of compiled code: call it from"):
            part(1.0)
        assert compilation.jit(lambda x: part(x))(1.0) == 2.0


def test_without_compiling_commands_and_runs_say_what_to_unset():
    program = (
        "import sys; from studies.cli import run; from alloc.errors import SimulationError\n"
        "from alloc.simulation import simulate\n"
        "try: simulate(None)\n"
        "except SimulationError as error: print(error, file=sys.stderr)\n"
        "sys.exit(run(['simulate', 'wet-patch']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    line = "simulations need compiled code: unset NUMBA_DISABLE_JIT"
    assert (done.returncode, done.stderr) == (2, f"{line}\nreadhesion: {line}\n")


def test_where_the_cache_is_another_users_the_temporary_folder_serves(tmp_path, monkeypatch):
    if os.getuid() != 0:
        pytest.skip("only root can give files away")
    taken, temporary = tmp_path / "cache" / "readhesion" / "code", tmp_path / "tmp"
    temporary.mkdir()
    private(taken)
    os.chown(taken, OTHER, OTHER)
    monkeypatch.setenv("READHESION_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    with pytest.warns(RuntimeWarning, match="not this user's alone"):
        found = cache_folder.__wrapped__()
    assert found == temporary / f"readhesion-{os.getuid()}" / "code"
    os.chown(found, OTHER, OTHER)
    with pytest.warns(RuntimeWarning, match="not this user's alone"):
        other = cache_folder.__wrapped__()
    assert other.parent.parent == temporary
    assert other != found
    assert other.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_everybody_may_replace_is_refused(tmp_path):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    with pytest.raises(PermissionError, match="everybody may replace what is in"):
        private(tmp_path / "open" / "code")
    (tmp_path / "open").chmod(0o1777)
    assert private(tmp_path / "open" / "code").stat().st_mode & 0o777 == 0o700


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    def half(path):
        path.write_text("half")
        raise KeyboardInterrupt

    write_whole(tmp_path / "file", lambda path: path.write_text("whole"))
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "file", half)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "whole"


def test_writers_at_once_leave_one_whole_file(tmp_path):
    target, barrier = tmp_path / "file.txt", threading.Barrier(2)

    def write(aside):
        with aside.open("w") as file:
            file.write("first half, ")
            barrier.wait(10.0)  # both are in the middle of it
            assert not target.exists() or target.read_text() == "first half, second half"
            file.write("second half")

    threads = [threading.Thread(target=write_whole, args=(target, write)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]
    assert target.read_text() == "first half, second half"


def test_what_was_not_used_for_long_is_deleted(kernel):
    kernel()
    paths = list(cache_folder().iterdir())
    for used, compiles in ((True, False), (False, True)):
        for path in paths:
            os.utime(path, (0.0, 0.0))
        if used:
            assert kernel() == (7.0, False)
        kernel(factor=[("2.0", "5.0" if used else "7.0")])
        assert kernel() == (7.0, compiles)
