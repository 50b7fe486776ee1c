"""Covariance matrix adaptation, the evolution strategy of Hansen's tutorial (arXiv 1604.00772), in the unit cube.

For misfits that switching valves roughen, where least squares and the simplex method stop on the first ripple.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def minimise(
    misfit: Callable[[Floats], float],
    start: Floats,
    spread: float,
    generations: int,
    seed: int,
    enough: float = 0.0,
) -> tuple[Floats, float]:
    """Best point found and its misfit, from `start` (n,) with a standard deviation of `spread`.

    Points outside the cube are judged at its nearest point, with the squared way there added. Ends after so many
    `generations`, or once the misfit is `enough`.
    """
    n = start.size
    generator = np.random.default_rng(seed)
    size = 4 + int(3 * np.log(n))
    parents = size // 2
    weights = np.log(parents + 0.5) - np.log(np.arange(1, parents + 1))
    weights /= weights.sum()
    effective = 1.0 / (weights**2).sum()
    # the tutorial's default rates, Table 1
    path_rate = (4 + effective / n) / (n + 4 + 2 * effective / n)
    step_rate = (effective + 2) / (n + effective + 5)
    rank_one = 2 / ((n + 1.3) ** 2 + effective)
    rank_mu = min(1 - rank_one, 2 * (effective - 2 + 1 / effective) / ((n + 2) ** 2 + effective))
    damping = 1 + 2 * max(0.0, np.sqrt((effective - 1) / (n + 1)) - 1) + step_rate
    expected = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))
    mean, step = start.copy(), spread
    covariance, path, step_path = np.eye(n), np.zeros(n), np.zeros(n)
    best, least = start.copy(), np.inf
    for generation in range(generations):
        values, vectors = np.linalg.eigh(covariance)
        root = np.sqrt(np.maximum(values, 1e-20))
        moves = (generator.standard_normal((size, n)) * root) @ vectors.T
        points = mean + step * moves
        inside = np.clip(points, 0.0, 1.0)
        found = np.array([misfit(point) for point in inside])
        if found.min() < least:
            best, least = inside[found.argmin()].copy(), float(found.min())
        if least <= enough:
            break
        found = found + 1e2 * ((points - inside) ** 2).sum(axis=1)
        chosen = moves[np.argsort(found, kind="stable")[:parents]]
        move = weights @ chosen
        mean = mean + step * move
        whitened = vectors @ ((vectors.T @ move) / root)
        step_path = (1 - step_rate) * step_path + np.sqrt(
            step_rate * (2 - step_rate) * effective
        ) * whitened
        length = np.linalg.norm(step_path)
        stalled = length / np.sqrt(1 - (1 - step_rate) ** (2 * generation + 2)) > expected * (
            1.4 + 2 / (n + 1)
        )
        path = (1 - path_rate) * path + (not stalled) * np.sqrt(
            path_rate * (2 - path_rate) * effective
        ) * move
        covariance = (
            (1 - rank_one - rank_mu) * covariance
            + rank_one * np.outer(path, path)
            + rank_mu * np.einsum("k,ki,kj->ij", weights, chosen, chosen)
        )
        step *= float(np.exp(step_rate / damping * (length / expected - 1)))
    return best, least
