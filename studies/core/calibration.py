"""What an ensemble of parameter sets does to a statement: its numbers get the ensemble's range, its verdict the members'."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib import import_module
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from studies.core.statement import VERDICTS, Interval, Statement, share_interval
from studies.files.study_error import StudyError

PERCENTILES = (5.0, 95.0)
"""Of the ensemble, between which its range lies."""
MOST = 0.95
"""Share of the members that must have the verdict of the set in use, or it is a condition that they have others."""
RANGE = "limits: 5 and 95 % of the ensemble's members"


def range_of(value: float, members: Iterable[float]) -> Interval:
    """A number of the set in use, with the range of the members that have it."""
    known = np.array([one for one in members if math.isfinite(one)], dtype=float)
    if known.size == 0:
        return Interval(float(value), math.nan, math.nan, 0)
    low, high = np.percentile(known, PERCENTILES)
    return Interval(float(value), float(low), float(high), known.size)


def median_of(members: Iterable[float]) -> Interval:
    """Median of the members with their range."""
    known = [one for one in members if math.isfinite(one)]
    return range_of(float(np.median(known)) if known else math.nan, known)


def over_members(own: Statement, others: Sequence[Statement]) -> Statement:
    """The statement of the set in use, with the verdicts of its members on the same claim.

    Its numbers get the members' range. If the claim holds for the set in use, but for fewer than `MOST` of them, it holds
    with conditions.
    """
    if not others:
        return own
    ranges = {
        quantity: range_of(
            interval.value, [one.numbers[quantity].value for one in others if quantity in one.numbers]
        )
        for quantity, interval in own.numbers.items()
    }  # fmt: skip
    counts = {verdict: sum(one.verdict == verdict for one in others) for verdict in VERDICTS}
    said_by_all = own
    if counts[own.verdict] < MOST * len(others):
        said = ", ".join(f"{word} of {count}" for word, count in counts.items() if count)
        said_by_all = own.conditioned(f"of the ensemble's {len(others)} members it {said}")
    same = pd.Series([one.verdict == own.verdict for one in others], dtype=bool)
    ranges["share of the members with the same verdict"] = share_interval(same)
    method = "; ".join(part for part in (own.method, RANGE) if part)
    return replace(said_by_all, numbers=ranges, method=method)


# Walkers that sample a posterior, and the packages that calibrations need (the extra `calibration`).
#
# The moves are those of differential evolution Monte Carlo (ter Braak and Vrugt, Stat. Comput. 18, 2008), by the
# package emcee: a step is a difference of other walkers, so that narrow curved valleys are followed without being told
# their shape.

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
            f"calibrations need the package {package}; install it with `pip install -e '.[calibration]'`"
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
