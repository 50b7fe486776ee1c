"""Walkers that sample a posterior, and the packages that calibrations need (the extra `calibration`).

The moves are those of differential evolution Monte Carlo (ter Braak and Vrugt, Stat. Comput. 18, 2008), by the package
emcee: a step is a difference of other walkers, so that narrow curved valleys are followed without being told their shape.
"""

from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.files.study_error import StudyError

Floats = NDArray[np.float64]

SNOOKER = 0.2
"""Share of the moves that are snooker moves, along the line to another walker."""


class Walked(NamedTuple):
    """Where walkers are after some steps."""

    points: Floats
    """(walkers, n)"""
    accepted: Floats
    """Share of the steps that each took, (walkers,)."""


def needed(package: str) -> ModuleType:
    """A package of the extra `calibration`; raises `StudyError` where it is not installed."""
    try:
        return import_module(package)
    except ImportError:
        raise StudyError(
            f"calibrations need the package {package}; install it with `pip install 'readhesion[calibration]'`"
        ) from None


def walk(
    points: Floats,
    log_values: Floats,
    log_posterior: Callable[[Floats], float],
    seed: int,
    steps: int,
) -> Walked:
    """Where walkers get to from `points`, (walkers, n), with these logarithms of the posterior, (walkers,).

    There must be at least 2 n walkers, not all in one plane.
    """
    emcee = needed("emcee")
    moves = [(emcee.moves.DEMove(), 1.0 - SNOOKER), (emcee.moves.DESnookerMove(), SNOOKER)]
    sampler = emcee.EnsembleSampler(*points.shape, log_posterior, moves=moves)
    start = emcee.State(
        points, log_prob=log_values, random_state=np.random.RandomState(seed).get_state()
    )
    return Walked(sampler.run_mcmc(start, steps).coords, sampler.acceptance_fraction)
