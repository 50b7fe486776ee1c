"""Elementary operations: the compiled polynomials agree with the C library to a few units in the last place."""

import math

import numba
import numpy as np
import pytest

from alloc.compilation import FASTMATH
from alloc.plant.operations import (
    absolute,
    atan,
    exp,
    interpolate,
    maximum,
    minimum,
    sine,
    sqrt,
    where,
)

allocating_jit = numba.njit(error_model="numpy", fastmath=FASTMATH)
"""As the project's own, but these functions make the arrays that they return."""


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


def test_transcendental_functions_agree_with_the_c_library():
    x = np.concatenate([np.linspace(-50.0, 50.0, 4001), np.geomspace(1e-12, 500.0, 500), [0.0]])
    value = _compiled(x)
    np.testing.assert_allclose(value[0], np.exp(x), rtol=1e-15)
    np.testing.assert_allclose(value[1], np.arctan(x), rtol=1e-15)
    np.testing.assert_allclose(value[2], np.sin(x), rtol=0.0, atol=2e-15)


def test_choices_agree_with_numpy():
    x, y = np.random.default_rng(1).normal(size=(2, 1000))
    expected = [where(x < y, x, 2.0 * y), minimum(x, y), maximum(x, y), absolute(x), sqrt(x * x)]
    np.testing.assert_array_equal(_compiled_choices(x, y), np.stack(expected))


@pytest.mark.parametrize("row", [0, 1, 2])
def test_not_a_number_surfaces(row):
    assert math.isnan(_compiled(np.array([math.nan]))[row, 0])


def test_exponential_saturates_instead_of_overflowing():
    value = _compiled(np.array([-1e4, 1e4]))[0]
    assert 0.0 <= value[0] < 1e-300
    assert value[1] > 1e300
