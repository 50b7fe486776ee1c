"""The model compiled from C is the one that Numba compiles, and a machine that cannot have it is told why."""

import os
import shutil
import stat
import sys
import threading

import casadi as cs
import numpy as np
import pytest

from alloc.private_folder import cache_folder
from alloc.whole_file import sealed
from mpc.code_cache import create
from mpc.compiled_model import compiled_model, symbolic_functions
from mpc.generated_c import COMPILERS, NATIVE, CompilerError, compile_c_functions
from mpc.settings import MpcError, MpcSettings
from mpc.unit_controller import MpcController
from mpc.unit_model import substeps, unit_model
from tests.benchmarks.unit_step import step_function
from tests.test_compilation import start_afresh, survives_damage

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, COMPILERS)), reason="no C compiler on this machine"
)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache."""
    with monkeypatch.context() as patch:
        patch.setenv("READHESION_CACHE", str(tmp_path / "cache"))
        start_afresh()
        yield cache_folder()
    start_afresh()


@pytest.fixture
def twice():
    x = cs.SX.sym("x", 2)
    return cs.Function("twice", [x], [2 * cs.fmax(x, 0)], ["x"], ["y"])


def _script(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@needs_compiler
@pytest.mark.parametrize("curve", ["piecewise", "polach", "slip-ratio"])
@pytest.mark.parametrize("axles", [1, 4])
def test_c_equals_numba(make_context, random_problem, curve, axles):
    context = make_context(curve, axles=axles)
    model = unit_model(context)
    ways = [compiled_model(model, code) for code in ("numba", "c")]
    for name, function in symbolic_functions(model).items():
        for seed in range(50):
            problem = random_problem(context, seed)
            inputs = [problem.state, np.array([500.0]), problem.parameters]
            answers = []
            for way in ways:
                outputs = [np.full(function.nnz_out(k), np.nan) for k in range(function.n_out())]
                inputs[2] = way.prepared(problem.parameters)
                getattr(way, name)(*inputs, *outputs)
                answers.append(outputs)
            for value, expected in zip(answers[1], answers[0], strict=True):
                scale = np.abs(expected).max()
                np.testing.assert_allclose(value, expected, rtol=0.0, atol=1e-12 * scale)


@needs_compiler
def test_closed_loops_agree(context, make_sense):
    # the unit of the model itself, with more torque wanted than its rail carries
    step = step_function(unit_model(context), 0.01, substeps(context, 0.01))
    commands = {}
    for code in ("numba", "c"):
        controller = MpcController(context, MpcSettings(code=code))
        constants = controller._unit.solver.now.parameters.copy()
        constants[:4] = [0.118, 0.12, 0.122, 0.125]
        state, commands[code] = np.array([10.0, *[10.3 / 0.43] * 4, 600.0]), []
        for _ in range(100):
            sense = make_sense(speed=state[0], torque=state[5])._replace(omega=state[1:5])
            decision = controller.decide(sense)
            assert decision.ok
            commands[code].append(decision.torque)
            state = np.asarray(step(state, decision.torque, constants)).ravel()
    np.testing.assert_allclose(commands["c"], commands["numba"], rtol=1e-9, atol=1e-9)
    assert np.ptp(commands["c"]) > 100.0  # the wheels did slip


@needs_compiler
def test_nan_surfaces_where_it_does_with_numba(context, random_problem):
    problem = random_problem(context, 1)
    for index in range(6):
        state, found = problem.state.copy(), []
        state[index] = np.nan
        for code in ("numba", "c"):
            model = compiled_model(unit_model(context), code)
            slopes, nonzeros = np.zeros(6), np.zeros(model.nonzeros.row.size)
            model.rate(
                state, np.array([500.0]), model.prepared(problem.parameters), slopes, nonzeros
            )
            found.append(np.isnan(np.concatenate([slopes, nonzeros])))
        assert found[1].any()
        np.testing.assert_array_equal(*found)


def test_a_missing_compiler_is_named(context, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("mpc.compiled_model._compiled", {})
    with pytest.raises(CompilerError, match="install gcc or clang") as caught:
        MpcController(context, MpcSettings(code="c"))
    assert isinstance(caught.value, MpcError)
    assert "\n" not in str(caught.value)


def test_a_compiler_that_fails_is_quoted(cache, twice, tmp_path, monkeypatch):
    text = "echo 'fatal: no space left' >&2; echo 'more' >&2; exit 3"
    monkeypatch.setenv("CC", _script(tmp_path / "broken", text))
    with pytest.raises(CompilerError, match=r"exit code 3: fatal: no space left;") as caught:
        compile_c_functions([twice])
    assert "broken" in str(caught.value)
    assert "more" not in str(caught.value)
    assert not any((cache / "generated").iterdir()), "nothing may pass for a library"


@needs_compiler
def test_a_compiler_that_refuses_the_machines_own_instructions_will_do(
    cache, twice, tmp_path, monkeypatch
):
    text = f'for word; do test "$word" = {NATIVE} && exit 1; done; exec cc "$@"'
    monkeypatch.setenv("CC", _script(tmp_path / "plain", text))
    y = np.zeros(2)
    compile_c_functions([twice])["twice"](np.array([3.0, -3.0]), y)
    np.testing.assert_array_equal(y, [6.0, 0.0])


@needs_compiler
def test_models_with_functions_of_one_name_do_not_mix(cache):
    # a shared library's symbols are global: both have a `same` and CasADi's own functions
    x, answers = cs.SX.sym("x"), []
    made = [
        compile_c_functions([cs.Function("same", [x], [k * x**2], ["x"], ["y"])])["same"]
        for k in (2.0, 3.0)
    ]
    for function in made:
        y = np.zeros(1)
        function(np.array([5.0]), y)
        answers.append(y[0])
    assert answers == [50.0, 75.0]


@needs_compiler
def test_the_library_is_compiled_once(cache, twice, tmp_path, monkeypatch):
    log = tmp_path / "calls"
    monkeypatch.setenv("CC", _script(tmp_path / "logging", f'echo "$@" >> {log}; exec cc "$@"'))
    for _ in range(2):
        compile_c_functions([twice])
    assert sum("-shared" in line for line in log.read_text().splitlines()) == 1


@needs_compiler
def test_what_is_damaged_is_set_aside_and_made_again(cache, twice):
    def work():
        y = np.zeros(2)
        compile_c_functions([twice])["twice"](np.array([3.0, -3.0]), y)
        return y.tolist()

    generated = ["*.so", "*.py", f"*.{sys.implementation.cache_tag}"]
    survives_damage(cache, [*generated, "*.nbi", "*.nbc"], work, 5)


def test_writers_at_once_leave_one_whole_file(tmp_path):
    target, barrier = tmp_path / "file.txt", threading.Barrier(2)

    def write(aside):
        with aside.open("w") as file:
            file.write("first half, ")
            barrier.wait(10.0)  # both are in the middle of it
            assert not target.exists() or target.read_bytes() == sealed(b"first half, second half")
            file.write("second half")

    threads = [threading.Thread(target=create, args=(target, write)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert target.read_bytes() == sealed(b"first half, second half")
    assert os.listdir(tmp_path) == ["file.txt"]


def test_a_writer_that_fails_leaves_nothing(tmp_path):
    def write(aside):
        aside.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        create(tmp_path / "file.txt", write)
    assert os.listdir(tmp_path) == []
