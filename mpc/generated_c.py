"""From CasADi expressions to C: CasADi writes, the system's compiler compiles, Numba calls.

An alternative to `mpc.generated` with the same functions, for machines that have a C compiler. CasADi's C functions take
tables of pointers. A few lines of C around each of them take the plain vectors instead, so that a call does not allocate. A
Numba function of one line passes the vectors on by the symbol's name, which Numba can cache.
"""

import hashlib
import os
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi as cs
import llvmlite.binding as llvm

from mpc.code_cache import create, folder
from mpc.generated import compile_source, function_source
from mpc.settings import MpcError

COMPILERS = ("cc", "gcc", "clang")
"""Tried in this order; the environment variable CC goes before them."""

# C90: there CasADi writes minimum and maximum as comparisons, which compile to one instruction and treat nan as the
# plant's operations in Numba do; C99's fmin and fmax are calls. No option that lets nan or infinity go unnoticed.
# Hidden symbols: another model's library must not answer.
FLAGS = (
    "-std=gnu90", "-O3", "-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros",
    "-shared", "-fPIC", "-fvisibility=hidden", "-w",
)  # fmt: skip
NATIVE = "-march=native"
"""Left out where the compiler refuses it."""

TIME_LIMIT = 300.0
"""Longest compilation [s]."""


class CompilerError(MpcError):
    """C code was asked for, but there is no compiler or it fails; the message says which and what to do."""


def find_compiler() -> list[str]:
    """Command of the C compiler. Raises `CompilerError` if there is none."""
    chosen = shlex.split(os.environ.get("CC", ""))
    for command in ([chosen] if chosen else []) + [[name] for name in COMPILERS]:
        path = shutil.which(command[0])
        if path:
            return [path, *command[1:]]
    raise CompilerError(
        f'mpc: code = "c" needs a C compiler, and none of {", ".join(COMPILERS)} is on the PATH: install gcc or clang '
        '(Debian, Ubuntu: apt install gcc; macOS: xcode-select --install), or use code = "numba"'
    )


def _plain_function(function: cs.Function, suffix: str) -> str:
    """C function of the plain vectors around CasADi's; its work vectors lie on the stack."""
    inputs, outputs = function.name_in(), function.name_out()
    arguments = [f"const double *__restrict__ {name}" for name in inputs]
    arguments += [f"double *__restrict__ {name}" for name in outputs]
    # CasADi's tables have room for its own use behind the arguments
    sources = ", ".join(inputs + ["0"] * (function.sz_arg() - len(inputs)))
    targets = ", ".join(outputs + ["0"] * (function.sz_res() - len(outputs)))
    return f"""
__attribute__((visibility("default"), nonnull))
void {function.name()}_{suffix}({", ".join(arguments)})
{{
  const casadi_real *arg[] = {{{sources}}};
  casadi_real *res[] = {{{targets}}};
  casadi_int iw[{max(function.sz_iw(), 1)}];
  casadi_real w[{max(function.sz_w(), 1)}];
  {function.name()}(arg, res, iw, w, 0);
}}
"""


def c_source(functions: list[cs.Function], suffix: str) -> str:
    """C code of the SX `functions`; each is exported as its name with `_suffix`.

    Every input and output is a vector of double of its nonzeros (columnwise); outputs are written in place.
    """
    generator = cs.CodeGenerator("model")
    for function in functions:
        generator.add(function)
    return str(generator.dump()) + "".join(_plain_function(f, suffix) for f in functions)


def _run(command: list[str]) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=TIME_LIMIT)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CompilerError(f'mpc: code = "c": {command[0]} does not run: {error}') from error


def _compile(compiler: list[str], text: str, library: Path) -> None:
    code = library.with_suffix(".c")
    code.write_text(text, encoding="utf-8")
    try:
        for native in ([NATIVE], []):
            done = _run([*compiler, *FLAGS, *native, str(code), "-o", str(library), "-lm"])
            if done.returncode == 0:
                return
    finally:
        code.unlink(missing_ok=True)
    said = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[0]
    raise CompilerError(
        f'mpc: code = "c": {shlex.join(compiler)} fails with exit code {done.returncode}: {said}; repair it, set CC to '
        'another compiler, or use code = "numba"'
    )


def _machine() -> str:
    """What `NATIVE` stands for: a cache may lie in a home that machines share."""
    features = llvm.get_host_cpu_features().flatten()
    return f"{llvm.get_process_triple()} {llvm.get_host_cpu_name()} {features}"


def _caller(function: cs.Function, suffix: str) -> str:
    """Python source of the Numba function that calls the C function."""
    names = function.name_in() + function.name_out()
    pointers = ", ".join(["types.CPointer(float64)"] * len(names))
    symbol = f"{function.name()}_{suffix}"
    call = f"    {symbol}({', '.join(f'{name}.ctypes' for name in names)})\n"
    declared = f'\n{symbol} = types.ExternalFunction("{symbol}", types.void({pointers}))\n'
    return declared + function_source(function.name(), names, call)


def compile_c_functions(functions: list[cs.Function]) -> dict[str, Any]:
    """Numba functions by name that run the SX `functions` as C; compiled once per machine, compiler and expression.

    Inputs and outputs as in `mpc.generated.source`. Raises `CompilerError`.
    """
    compiler = find_compiler()
    version = _run([*compiler, "--version"]).stdout
    parts = (c_source(functions, ""), *compiler, version, *FLAGS, NATIVE, _machine())
    key = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
    library = folder() / f"c_{key}.so"
    create(library, lambda aside: _compile(compiler, c_source(functions, key), aside))
    llvm.load_library_permanently(str(library))
    return compile_source("".join(_caller(function, key) for function in functions))
