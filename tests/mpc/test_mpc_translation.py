"""Python's constructs in C: each means what it means in Python, and what is not known is refused by its place."""

import ctypes
import math
import re

import numpy as np
import pytest

from alloc.plant.simd import load, spread, store, total
from mpc.export.c_kinds import DOUBLE, INTEGER, Array, TranslationError, Value
from mpc.export.c_known import HELPERS
from mpc.export.c_program import Program
from tests.mpc.exported import STRICT, needs_compiler, run_compiler

LIMIT = 0.75


def remainders(a, b):
    return (a % b) + 10.0 * ((int(a) - 7) // 3) + 100.0 * ((int(a) - 7) % 3)


def extremes(a, b):
    return min(a, b) + 2.0 * max(a, b, 0.5) - abs(min(a, 0.0))


def loops(a, b):
    total_, i, count = 0.0, 0, 0
    for i in range(5):
        if i == 3:
            break
        total_ += a * i
    for k in range(6, 0, -2):
        count += k + i
    while count > 3 and not (b < 0.0):
        count -= 2
        if count == 9:
            continue
    return total_ + count + i


def nested(a, b):
    result = 0.0
    for i in range(3):
        for i in range(5):
            result += a * i
        result += b * i
    return result


def swapped(a, b):
    a, b = b, a - b
    low = 0.0 if a < b <= 3.0 else a
    return pair(a, low)[0] if False else _sum(a, low)


def pair(a, b):
    return a, b**2


def _sum(a, b):
    first, second = pair(a, b)
    return first + second * LIMIT


def logic(a, b):
    known = (a > 0.0 and b > 0.0) or not a < b
    return (1 if known else 0.5) + (2 if math.isnan(a) else 0) + math.sqrt(abs(b)) / 2


FUNCTIONS = (remainders, extremes, loops, nested, swapped, logic)
VALUES = (-7.25, -3.0, -0.0, 0.4, 2.0, 9.5)


def _program(function, arguments):
    program = Program({})
    first = program.first(function, arguments)
    functions, uses = program.reached(first)
    text = "#include <math.h>\n#include <stdbool.h>\n#include <stdint.h>\n"
    for kind in uses.get("tuple", ()):
        fields = "".join(f"{item.name} item{k};" for k, item in enumerate(kind.items))
        text += f"typedef struct {{ {fields} }} {kind.name};\n"
    text += "".join(
        f"static const double {one} = {program.constants[one]!r};\n"
        for one in uses.get("constant", ())
    )
    text += "".join(f"static {HELPERS[one]}\n" for one in HELPERS if one in uses.get("helper", ()))
    *parts, last = ["\n".join(one.lines) for one in functions]
    return "\n".join(
        [text, *parts, re.sub(r"^static ", "", last, flags=re.MULTILINE)]
    ) + "\n", first


def _compile(text, folder, name):
    declared = re.search(rf"^\w+ {name}\(.*\)$", text, re.MULTILINE).group(0)
    (folder / "one.c").write_text(text.replace(declared, f"{declared};\n{declared}"))
    run_compiler(folder, *STRICT, "-shared", "-fPIC", "one.c", "-o", "one.so", "-lm")
    return getattr(ctypes.CDLL(str(folder / "one.so")), name)


@needs_compiler
@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_construct_means_what_it_means_in_python(tmp_path, function):
    text, first = _program(function, [Value(DOUBLE, "a"), Value(DOUBLE, "b")])
    in_c = _compile(text, tmp_path, first.name)
    in_c.restype, in_c.argtypes = ctypes.c_double, [ctypes.c_double] * 2
    for a in VALUES:
        for b in VALUES:
            if b != 0.0:
                assert in_c(a, b) == pytest.approx(function(a, b), rel=1e-15), (a, b)


@needs_compiler
def test_what_is_no_number_passes_as_it_does_in_python(tmp_path):
    text, first = _program(extremes, [Value(DOUBLE, "a"), Value(DOUBLE, "b")])
    in_c = _compile(text, tmp_path, first.name)
    in_c.restype, in_c.argtypes = ctypes.c_double, [ctypes.c_double] * 2
    for a, b in ((math.nan, 1.0), (1.0, math.nan), (-1.0, math.nan), (math.nan, math.nan)):
        assert in_c(a, b) == pytest.approx(extremes(a, b), nan_ok=True), (a, b)


def plain(cube, n):
    row, result = cube[1, 2], 0.0
    for m in range(0, 16, 8):
        sums = spread(0.5)
        sums = sums + 2.0 * load(row, m) - load(cube[0, n], m)
        store(row, m, sums)
        result += total(sums)
    part = cube[n : n + 1]
    return result + part[0, 0, 3] + cube[0].size + row[:n].size


@needs_compiler
def test_arrays_lanes_and_slices_are_those_of_numpy(tmp_path):
    whole = Value(Array(DOUBLE, (2, 3, 16)), "cube", ("2", "3", "16"))
    text, first = _program(plain, [whole, Value(INTEGER, "n")])
    in_c = _compile(text, tmp_path, first.name)
    in_c.restype, in_c.argtypes = ctypes.c_double, [ctypes.c_void_p, ctypes.c_int64]
    cube = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 3, 16))
    row = 0.5 + 2.0 * cube[1, 2] - cube[0, 1]
    wanted = row.sum() + cube[1, 0, 3] + 48 + 1
    assert in_c(cube.ctypes.data, 1) == pytest.approx(wanted, rel=1e-13)
    np.testing.assert_allclose(cube[1, 2], row, rtol=1e-13)


def cubed(a, b):
    return a + b**3


def listed(a, b):
    return sum([a, b])


def looped(a, b):
    for one in (a, b):
        b += one
    return b


def tried(a, b):
    try:
        return a
    finally:
        _sum(a, b)


def backwards(a, b):
    return a[-1] + b


def two_kinds(a, b):
    if b > 0.0:
        x = a
    else:
        x = b
    return x[0]


def valued(a, b):
    return a or b


def called_twice(a, b):
    return 1.0 if a < _sum(a, b) < b else 0.0


def by_name(a, b):
    return _sum(a, b=b)


def annotated(a, b):
    c: float = a
    return c + b


def lanes(a, b):
    return _sum(spread(a), b)


@pytest.mark.parametrize(
    ("function", "line", "construct"),
    [
        (cubed, 1, r"the power b \*\* 3"),
        (listed, 1, r"a call of sum|List"),
        (looped, 1, r"the loop over \(a, b\)"),
        (tried, 1, "the statement try:"),
        (valued, 1, "no truth value: a"),
        (called_twice, 1, "a call within a < _sum"),
        (by_name, 1, "arguments by name"),
        (annotated, 1, "the statement c: float = a"),
        (lanes, 1, "lanes or a tuple handed over"),
        (backwards, 1, "the index -1"),
        (two_kinds, 4, "x, which stands for things of two kinds"),
    ],
)
def test_what_is_not_known_is_named_with_its_place(function, line, construct):
    array = function in (backwards, two_kinds)
    a = Value(Array(DOUBLE, (3,)), "a", ("3",)) if array else Value(DOUBLE, "a")
    first = function.__code__.co_firstlineno
    with pytest.raises(
        TranslationError, match=rf"test_mpc_translation\.py, line {first + line}: .*({construct})"
    ):
        _program(function, [a, Value(DOUBLE, "b")])
