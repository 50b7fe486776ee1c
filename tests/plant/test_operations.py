"""Elementary operations, one number at a time and eight at once, are those of NumPy and of the C library."""

import math

import numba
import numpy as np
import pytest

from alloc.compilation import FASTMATH
from alloc.plant import operations
from alloc.plant import operations as simd
from alloc.plant.operations import (
    WIDTH,
    absolute,
    atan,
    exp,
    gather,
    interpolate,
    load,
    look_up,
    maximum,
    minimum,
    padded,
    sine,
    spread,
    sqrt,
    store,
    total,
    where,
)
from tests.cases import looped

allocating_jit = numba.njit(error_model="numpy", fastmath=FASTMATH)


"""As the project's own, but these functions make the arrays that they return."""


EXACT = {
    "a + b": lambda a, b: a + b,
    "a - b": lambda a, b: a - b,
    "a * b": lambda a, b: a * b,
    "a / b": lambda a, b: a / b,
    "-a": lambda a, b: -a,
    "2 - a": lambda a, b: 2 - a,
    "b / 3.0": lambda a, b: b / 3.0,
    "a < b": lambda a, b: np.where(a < b, 1.0, 0.0),
    "a <= b": lambda a, b: np.where(a <= b, 1.0, 0.0),
    "a > b": lambda a, b: np.where(a > b, 1.0, 0.0),
    "a >= b": lambda a, b: np.where(a >= b, 1.0, 0.0),
    "a < 0.5": lambda a, b: np.where(a < 0.5, b, a),
    "absolute": lambda a, b: np.abs(a),
    "sqrt": lambda a, b: np.sqrt(a),
    "floor": lambda a, b: np.floor(a),
    # of two numbers, one of which is none, the second: so a bound that stands first lets a nan pass through
    "minimum": lambda a, b: np.where(a < b, a, b),
    "maximum": lambda a, b: np.where(a > b, a, b),
    "minimum(1, a)": lambda a, b: np.minimum(1.0, a),
    "maximum(1, a)": lambda a, b: np.maximum(1.0, a),
}


"""What NumPy makes of two arrays, in the order of the rows of `_exact`."""


@allocating_jit
def _exact(x, y):
    out = np.empty((19, x.size))
    zero = spread(0.0)
    for i in range(0, x.size, WIDTH):
        a, b = load(x, i), load(y, i)
        store(out[0], i, a + b)
        store(out[1], i, a - b)
        store(out[2], i, a * b)
        store(out[3], i, a / b)
        store(out[4], i, -a)
        store(out[5], i, 2 - a)
        store(out[6], i, b / 3.0)
        store(out[7], i, operations.where(a < b, 1.0, zero))
        store(out[8], i, operations.where(a <= b, 1.0, zero))
        store(out[9], i, operations.where(a > b, 1.0, zero))
        store(out[10], i, operations.where(a >= b, 1.0, zero))
        store(out[11], i, operations.where(a < 0.5, b, a))
        store(out[12], i, operations.absolute(a))
        store(out[13], i, operations.sqrt(a))
        store(out[14], i, operations.floor(a))
        store(out[15], i, operations.minimum(a, b))
        store(out[16], i, operations.maximum(a, b))
        store(out[17], i, operations.minimum(1.0, a))
        store(out[18], i, operations.maximum(1.0, a))
    return out


@pytest.fixture(scope="module")
def pairs():
    """Every pair of numbers of all sizes and signs, infinite ones and those that are none; and random ones."""
    edges = [0.0, 1.0, 0.5, 1.5, 5e-324, 1e-300, 1e300, 2.0**53, math.pi, math.inf]
    edges = np.array([*edges, *(-x for x in edges), math.nan, 2.5, -3.0, 7.0])
    drawn = np.random.default_rng(3).normal(size=(2, 4096)) * 10.0
    assert edges.size % WIDTH == 0
    return np.concatenate([np.array(np.meshgrid(edges, edges)).reshape(2, -1), drawn], axis=1)


def test_arithmetic_and_choices_are_those_of_numpy(pairs):
    with np.errstate(all="ignore"):
        expected = {name: of(*pairs) for name, of in EXACT.items()}
        found = _exact(*pairs)
    assert len(found) == len(EXACT)
    for (name, values), row in zip(expected.items(), found, strict=True):
        np.testing.assert_array_equal(row, values, err_msg=name)


@allocating_jit
def _laws(x):
    out = np.empty((3, x.size))
    for i in range(0, x.size, WIDTH):
        a = load(x, i)
        store(out[0], i, operations.exp(a))
        store(out[1], i, operations.atan(a))
        store(out[2], i, operations.sine(a))
    return out


def _blocks(values):
    """A block of `values` and all blocks that are made of it by turning it, one behind the other."""
    return np.concatenate([np.roll(values, k) for k in range(WIDTH)])


def test_transcendental_functions_agree_with_the_c_library():
    x = np.concatenate([np.linspace(-50.0, 50.0, 3999), np.geomspace(1e-12, 500.0, 504), [0.0]])
    exp, atan, sine = _laws(x)
    np.testing.assert_allclose(exp, np.exp(x), rtol=1e-15)
    np.testing.assert_allclose(atan, np.arctan(x), rtol=1e-15)
    np.testing.assert_allclose(sine, np.sin(x), rtol=0.0, atol=2e-15)
    np.testing.assert_array_equal(_laws(-x)[1], -atan)
    wide = np.linspace(-700.0, 700.0, 2800)
    np.testing.assert_allclose(_laws(wide)[0], np.exp(wide), rtol=1e-15)


def test_exponential_of_zeros_alone_is_one():
    """Where nothing slips it is not computed; a single number that differs must not be missed."""
    np.testing.assert_array_equal(_laws(np.zeros(WIDTH))[0], 1.0)
    x = _blocks(np.array([*np.zeros(WIDTH - 1), 1e-9]))
    np.testing.assert_allclose(_laws(x)[0] - 1.0, x, rtol=1e-6)


def test_exponential_saturates_instead_of_overflowing():
    exp = _laws(_blocks(np.array([-1e4, 1e4, -math.inf, math.inf, -700.0, 700.0, 0.0, 1.0])))[0]
    x = _blocks(np.array([-1e4, 1e4, -1e4, 1e4, -700.0, 700.0, 0.0, 1.0]))
    assert np.all((exp[x <= -700.0] >= 0.0) & (exp[x <= -700.0] < 1e-300))
    assert np.all(exp[x >= 700.0] > 1e300)
    np.testing.assert_allclose(exp[np.abs(x) < 2.0], np.exp(x[np.abs(x) < 2.0]), rtol=1e-15)


def test_not_a_number_surfaces_in_its_own_place():
    for others in (0.0, 1.0):
        x = _blocks(np.array([math.nan, *[others] * (WIDTH - 1)]))
        for row in _laws(x):
            np.testing.assert_array_equal(np.isnan(row), np.isnan(x))


@allocating_jit
def _moved(source, index, first):
    out = np.full(source.size, -1.0)
    store(out, first, load(source, first))
    picked = np.empty(WIDTH)
    store(picked, 0, gather(source, index, first))
    return out, picked


@looped("first", range(WIDTH + 1))
def test_blocks_begin_anywhere_and_touch_no_neighbour(first):
    rng = np.random.default_rng(first)
    source, index = rng.normal(size=2 * WIDTH + 1), rng.integers(0, 2 * WIDTH + 1, 2 * WIDTH + 1)
    out, picked = _moved(source, index, first)
    block = slice(first, first + WIDTH)
    np.testing.assert_array_equal(picked, source[index[block]])
    np.testing.assert_array_equal(out[block], source[block])
    assert np.all(np.delete(out, block) == -1.0)


@allocating_jit
def _reduced(x, table):
    sums, nonzero = np.empty(x.size // WIDTH), np.empty(x.size // WIDTH)
    found = np.empty(x.size)
    for i in range(0, x.size, WIDTH):
        values = load(x, i)
        sums[i // WIDTH] = total(values)
        nonzero[i // WIDTH] = simd.is_nonzero(values)
        inside = operations.minimum(operations.maximum(values, 0.0), table.size - 1.000001)
        store(found, i, look_up(table, inside))
    return sums, nonzero, found


def test_total_is_the_sum():
    x = np.random.default_rng(5).normal(size=(400, WIDTH)) * 10.0 ** np.arange(-4.0, WIDTH - 4)
    sums, _, _ = _reduced(x.ravel(), np.zeros(2))
    exact = np.array([math.fsum(row) for row in x])
    assert np.all(np.abs(sums - exact) <= 4.0 * np.spacing(np.abs(x).sum(axis=1)))
    for k in range(WIDTH):
        row = np.where(np.arange(WIDTH) == k, math.nan, 1.0)
        assert math.isnan(_reduced(row, np.zeros(2))[0][0])


def test_tables_are_read_by_linear_interpolation():
    table = np.random.default_rng(6).normal(size=50)
    x = np.concatenate([np.linspace(0.0, 49.0 - 1e-6, 343), np.arange(49.0)])
    expected = np.interp(x, np.arange(50.0), table)
    np.testing.assert_allclose(_reduced(x, table)[2], expected, rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(_reduced(np.arange(48.0), table)[2], table[:48])
    # NumPy, single numbers and eight at once read alike, and what is no number stays none
    np.testing.assert_allclose(look_up(table, x), expected, rtol=1e-14, atol=1e-15)
    assert np.isnan(look_up(table, np.array([math.nan, 1.0]))).tolist() == [True, False]


def test_a_single_number_that_is_not_zero_is_seen():
    for value, seen in ((0.0, 0.0), (-0.0, 0.0), (5e-324, 1.0), (-1.0, 1.0), (math.nan, 1.0)):
        x = _blocks(np.array([value, *np.zeros(WIDTH - 1)]))
        np.testing.assert_array_equal(_reduced(x, np.zeros(2))[1], seen)


def test_padding_is_the_least_number_of_whole_blocks():
    for size in range(4 * WIDTH):
        assert padded(size) % WIDTH == 0, size
        assert max(size, 1) <= padded(size) < max(size, 1) + WIDTH, size


@allocating_jit
def _compiled(x):
    out = np.empty((3, x.size))
    for i in range(x.size):
        out[0, i] = exp(x[i])
        out[1, i] = atan(x[i])
        out[2, i] = sine(x[i])
    return out


@allocating_jit
def _compiled_choices(x, y):
    out = np.empty((5, x.size))
    for i in range(x.size):
        out[0, i] = where(x[i] < y[i], x[i], 2.0 * y[i])
        out[1, i] = minimum(x[i], y[i])
        out[2, i] = maximum(x[i], y[i])
        out[3, i] = absolute(x[i])
        out[4, i] = sqrt(x[i] * x[i])
    return out


@allocating_jit
def _compiled_interpolation(table, share):
    out = np.empty(share.size)
    for i in range(share.size):
        out[i] = interpolate(table, share[i])
    return out


def test_interpolation_is_numpys():
    table, share = np.random.default_rng(2).normal(size=12), np.linspace(0.0, 1.0, 301)
    expected = np.interp(share, np.linspace(0.0, 1.0, 11), table[1:])
    for found in (interpolate, _compiled_interpolation):
        np.testing.assert_allclose(found(table, share), expected, atol=1e-8)


def test_single_transcendental_functions_agree_with_the_c_library():
    x = np.concatenate([np.linspace(-50.0, 50.0, 4001), np.geomspace(1e-12, 500.0, 500), [0.0]])
    value = _compiled(x)
    np.testing.assert_allclose(value[0], np.exp(x), rtol=1e-15)
    np.testing.assert_allclose(value[1], np.arctan(x), rtol=1e-15)
    np.testing.assert_allclose(value[2], np.sin(x), rtol=0.0, atol=2e-15)


def test_choices_agree_with_numpy():
    x, y = np.random.default_rng(1).normal(size=(2, 1000))
    expected = [where(x < y, x, 2.0 * y), minimum(x, y), maximum(x, y), absolute(x), sqrt(x * x)]
    np.testing.assert_array_equal(_compiled_choices(x, y), np.stack(expected))
