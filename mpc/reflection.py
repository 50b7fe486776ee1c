"""A symmetric matrix made positive definite by reflection, compiled and without allocation.

Its eigenvalues are found by Householder's reduction to three diagonals (Martin, Reinsch, Wilkinson: Householder's
tridiagonalization of a symmetric matrix, Numerische Mathematik 11 (1968) 181-195) and the implicit QL method (Bowdler,
Martin, Reinsch, Wilkinson: The QR and QL algorithms for symmetric matrices, ibid. 293-306). NumPy's function allocates.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, void

from alloc.by_reference import ByReference
from alloc.plant.structure import Floats
from mpc.arrays import MATRIX, sweep

ROUNDS = 60
"""Most QL steps for one eigenvalue; two or three are usual."""


class EigenWorkspace(NamedTuple):
    """What `reflect` works in; of n rows."""

    vectors: Floats
    """Eigenvectors, a row each, (n, n)."""
    values: Floats
    """Eigenvalues, (n,); in between, the diagonal."""
    beside: Floats
    """What stands beside the diagonal, (n,)."""
    product: Floats
    """(n,)"""


def eigen_workspace(size: int) -> EigenWorkspace:
    """Workspace for `size` rows."""
    return EigenWorkspace(np.zeros((size, size)), *(np.zeros(size) for _ in range(3)))


WORKSPACE = ByReference(eigen_workspace(0)).kind


@sweep(void(MATRIX, WORKSPACE))
def to_three_diagonals(matrix, work):
    """Householder's reduction: fill `values` and `beside` with the diagonals, and `vectors` with the transformation.

    matrix = vectors^T T vectors; beside[i] stands beside values[i] and values[i + 1].
    """
    vectors, values, beside, product = work.vectors, work.values, work.beside, work.product
    n = values.size
    # the lower triangle of `vectors` holds the part that is still to be reduced, above it the mirrors' normals
    for i in range(n):
        for j in range(n):
            vectors[i, j] = matrix[i, j]
    for k in range(n - 1, 0, -1):
        row = vectors[k]
        length = 0.0
        for j in range(k):
            length += row[j] * row[j]
        length = np.sqrt(length)
        values[k] = row[k]
        row[k] = 0.0  # in the end: twice over the squared normal, or no mirror
        beside[k - 1] = row[k - 1]
        if k == 1 or length == 0.0 or length == abs(row[k - 1]):
            beside[k - 1] = row[k - 1]
            continue
        image = -length if row[k - 1] > 0.0 else length
        beside[k - 1] = image
        row[k - 1] -= image
        squared = 0.0
        for j in range(k):
            squared += row[j] * row[j]
        share = 2.0 / squared
        row[k] = share
        along = 0.0
        for i in range(k):
            product[i] = 0.0
        for i in range(k):
            value = vectors[i, i] * row[i]
            for j in range(i):
                value += vectors[i, j] * row[j]
                product[j] += vectors[i, j] * row[i]
            product[i] += value
        for i in range(k):
            product[i] *= share
            along += product[i] * row[i]
        for i in range(k):
            product[i] -= 0.5 * share * along * row[i]
        for i in range(k):
            for j in range(i + 1):
                vectors[i, j] -= row[i] * product[j] + product[i] * row[j]
    values[0] = vectors[0, 0]
    # the mirrors one after the other, from the smallest on
    vectors[0, 0] = 1.0
    for k in range(1, n):
        share = vectors[k, k]
        if share != 0.0:
            for i in range(k):  # row i of what is there already
                along = 0.0
                for j in range(k):
                    along += vectors[i, j] * vectors[k, j]
                product[i] = share * along
            for i in range(k):
                for j in range(k):
                    vectors[i, j] -= product[i] * vectors[k, j]
        for j in range(k):
            vectors[k, j] = 0.0
            vectors[j, k] = 0.0
        vectors[k, k] = 1.0


@sweep(boolean(WORKSPACE))
def to_one_diagonal(work):
    """Implicit QL: turn `values` into the eigenvalues and the rows of `vectors` into eigenvectors; False if it fails."""
    vectors, values, beside = work.vectors, work.values, work.beside
    n = values.size
    beside[n - 1] = 0.0
    for first in range(n):
        for round_ in range(ROUNDS + 1):
            last = first
            while last < n - 1:
                size = abs(values[last]) + abs(values[last + 1])
                if abs(beside[last]) <= 2.3e-16 * size:
                    break
                last += 1
            if last == first:
                break
            if round_ == ROUNDS or not abs(values[first]) < np.inf:
                return False
            g = (values[first + 1] - values[first]) / (2.0 * beside[first])
            root = np.sqrt(g * g + 1.0)
            g = values[last] - values[first] + beside[first] / (g + (root if g >= 0.0 else -root))
            sine, cosine, p = 1.0, 1.0, 0.0
            ended = False
            for i in range(last - 1, first - 1, -1):
                f, b = sine * beside[i], cosine * beside[i]
                root = np.sqrt(f * f + g * g)
                beside[i + 1] = root
                if root == 0.0:
                    values[i + 1] -= p
                    beside[last] = 0.0
                    ended = True
                    break
                sine, cosine = f / root, g / root
                g = values[i + 1] - p
                root = (values[i] - g) * sine + 2.0 * cosine * b
                p = sine * root
                values[i + 1] = g + p
                g = cosine * root - b
                for j in range(n):
                    upper, lower = vectors[i + 1, j], vectors[i, j]
                    vectors[i + 1, j] = sine * lower + cosine * upper
                    vectors[i, j] = cosine * lower - sine * upper
            if not ended:
                values[first] -= p
                beside[first] = g
                beside[last] = 0.0
    return True


@sweep(boolean(MATRIX, float64, WORKSPACE))
def reflect(matrix, least, work):
    """Turn eigenvalues below zero into their magnitude, and raise what is then below `least`; False if none are found.

    Only the parts of `matrix` that belong to such eigenvalues change.
    """
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[0]):
            if not abs(matrix[i, j]) < np.inf:
                return False
    to_three_diagonals(matrix, work)
    if not to_one_diagonal(work):
        return False
    for k in range(work.values.size):
        value, vector = work.values[k], work.vectors[k]
        if value < least:
            raised = max(abs(value), least) - value
            for i in range(vector.size):
                part = raised * vector[i]
                for j in range(vector.size):
                    matrix[i, j] += part * vector[j]
    return True
