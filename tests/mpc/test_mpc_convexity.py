"""The quadratic model of a step is made convex by reflection: curvature keeps its size and loses its sign."""

import numpy as np
import pytest

from alloc.by_reference import ByReference
from mpc.real_time import LEAST_CURVATURE, RealTimeIteration
from mpc.reflection import eigen_workspace, reflect
from mpc.settings import MpcSettings, Weights

LEAST = 0.4


def reflected(matrix, least=LEAST):
    """What is left of `matrix`, and the workspace."""
    work, after = eigen_workspace(len(matrix)), matrix.copy()
    for part in work:
        part[:] = np.nan
    assert reflect(after, least, ByReference(work))
    return after, work


def turned(values, seed=0):
    """A symmetric matrix of these eigenvalues, and their axes."""
    n = len(values)
    axes = np.linalg.qr(np.random.default_rng(seed).standard_normal((n, n)))[0]
    matrix = axes @ np.diag(values) @ axes.T
    return 0.5 * (matrix + matrix.T), axes


@pytest.mark.parametrize(
    ("curvature", "convex"),
    [
        ([-3.0, -0.05, 0.02, 5.0], [3.0, 0.4, 0.4, 5.0]),
        ([-3.0, 0.1, 0.5, 2.0], [3.0, 0.4, 0.5, 2.0]),
        ([0.39, 0.5, 1.0, 2.0], [0.4, 0.5, 1.0, 2.0]),
        ([0.41, 0.5, 1.0, 2.0], [0.41, 0.5, 1.0, 2.0]),
        ([-1.0, -1.0, -1.0, 1.0], [1.0, 1.0, 1.0, 1.0]),
        ([0.0, 0.0, 0.0, 0.0], [0.4, 0.4, 0.4, 0.4]),
    ],
)
def test_negative_curvature_is_reflected_and_little_is_raised(curvature, convex):
    for seed in range(5):
        matrix, axes = turned(curvature, seed)
        wanted = axes @ np.diag(convex) @ axes.T
        np.testing.assert_allclose(reflected(matrix)[0], wanted, atol=1e-12)


@pytest.mark.parametrize("size", [1, 2, 3, 20, 80])
def test_eigenvalues_are_lapacks(size):
    for seed in range(4):
        matrix, _ = turned(np.random.default_rng(seed).standard_normal(size) * 10.0, seed)
        after, work = reflected(matrix)
        values, vectors = np.linalg.eigh(matrix)
        np.testing.assert_allclose(np.sort(work.values), values, atol=1e-12 * size)
        np.testing.assert_allclose(work.vectors @ work.vectors.T, np.eye(size), atol=1e-12)
        wanted = vectors * np.maximum(np.abs(values), LEAST) @ vectors.T
        np.testing.assert_allclose(after, wanted, atol=1e-11)


def test_matrices_with_nothing_beside_the_diagonal_and_in_blocks():
    for matrix in (np.diag([2.0, -1.0, 3.0]), np.kron(np.eye(2), [[0.0, 1.0], [1.0, 0.0]])):
        values, vectors = np.linalg.eigh(matrix)
        wanted = vectors * np.maximum(np.abs(values), LEAST) @ vectors.T
        np.testing.assert_allclose(reflected(matrix)[0], wanted, atol=1e-12)


def test_what_is_convex_enough_stays_as_it_is():
    matrix, _ = turned([0.5, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(reflected(matrix)[0], matrix)


def test_what_is_no_number_has_no_eigenvalues():
    matrix, _ = turned([0.5, 1.0, 2.0, 3.0])
    matrix[1, 2] = np.nan
    assert not reflect(matrix, LEAST, ByReference(eigen_workspace(4)))


def test_the_least_curvature_is_a_share_of_that_of_tracking(context):
    settings = MpcSettings(exact_hessian=True, weights=Weights(tracking=2.0))
    assert RealTimeIteration(context, settings).period.rules.least_curvature == 0.4
    assert LEAST_CURVATURE == 0.1
