"""Which weights of the running resistance a run can teach: persistence of excitation, weight by weight."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.estimation.finite_series import finite_series

Floats = NDArray[np.float64]

LEARNED, NOT_LEARNABLE = "learned", "not learnable from this run"
LEAST_PART = 1e-3
"""Independent part of a regressor's square below which the regressor cannot be distinguished from the others."""
LARGEST_DEVIATION = 0.05
"""Standard deviation of a learnt weight, relative to the weight, above which it is not called learnt."""
LEAST_SAMPLES = 20
"""Samples in which a regressor is not zero, below which nothing is said."""


@dataclass(frozen=True)
class WeightStatus:
    """Information of a run on one weight."""

    name: str
    status: str
    """`LEARNED` or `NOT_LEARNABLE`."""
    reason: str
    """Why it is not learnable; empty if it is."""
    value: float
    """Least-squares weight, of the least norm where it is not determined."""
    part: float
    """Part of the regressor's square that is apart from the other regressors, 0 to 1; nan without samples."""
    deviation: float
    """Standard deviation of the weight, by the residuals and their correlation from sample to sample."""


@dataclass(frozen=True)
class Excitation:
    """Excitation of all weights by one run."""

    weights: tuple[WeightStatus, ...]
    condition: float
    """Condition number of the normalised information matrix of the weights that occur at all; 1 is best."""
    smallest_eigenvalue: float
    """Of that matrix, whose diagonal is 1."""
    residual: float
    """Root mean square [N] of what the weights leave."""

    def learned(self, name: str) -> bool:
        """Whether the weight called `name` was learnt."""
        return next(one for one in self.weights if one.name == name).status == LEARNED


def judge_excitation(regressors: ArrayLike, force: ArrayLike, names: tuple[str, ...]) -> Excitation:
    """Judge samples F = W Z: `regressors` (samples, weights), `force` (samples,) [N].

    A weight is learned under three conditions: it is excited (`LEAST_SAMPLES`), distinguished from the others
    (`LEAST_PART`), and accurate compared with the residuals of the force (`LARGEST_DEVIATION`). Residuals are correlated: if
    neighbouring ones of n samples correlate by r, n (1 - r)/(1 + r) samples count. Raises `EstimationError` for impossible
    data.
    """
    z = finite_series("excitation: regressors", regressors, (None, len(names)))
    f = finite_series("excitation: force", force, z.shape[:1])
    count = (z != 0.0).sum(axis=0)
    present = count > 0
    size = np.where(present, np.sqrt((z * z).sum(axis=0)), 1.0)
    unit = z / size
    solved, *_ = np.linalg.lstsq(unit, f, rcond=1e-9)
    value = np.where(present, solved / size, np.nan)
    left = f - unit @ solved
    freedom = max(f.size - int(present.sum()), 1)
    variance = float(left @ left) / freedom
    if f.size > 2 and float(left @ left) > 0.0:
        r = float(np.clip(left[1:] @ left[:-1] / (left @ left), 0.0, 0.999))
        variance *= (1.0 + r) / (1.0 - r)
    information = unit[:, present].T @ unit[:, present]
    eigenvalues = np.linalg.eigvalsh(information) if present.any() else np.array([np.nan])
    statuses = []
    for k, name in enumerate(names):
        part, partner = _part_apart(unit, k, present)
        deviation = float(np.sqrt(variance / part) / size[k]) if part > 0.0 else np.inf
        reason = _reason(int(count[k]), part, names[partner], deviation, float(value[k]))
        status = NOT_LEARNABLE if reason else LEARNED
        statuses.append(WeightStatus(name, status, reason, float(value[k]), part, deviation))
    least = float(eigenvalues[0])
    condition = float(eigenvalues[-1] / least) if least > 1e-15 else np.inf
    return Excitation(tuple(statuses), condition, least, float(np.sqrt((left**2).mean())))


def _part_apart(unit: Floats, k: int, present: NDArray[np.bool_]) -> tuple[float, int]:
    """Part of column `k`'s square apart from the other columns, and the column that it resembles most."""
    if not present[k]:
        return float("nan"), k
    others = np.flatnonzero(present & (np.arange(present.size) != k))
    if others.size == 0:
        return 1.0, k
    solved, *_ = np.linalg.lstsq(unit[:, others], unit[:, k], rcond=1e-9)
    apart = unit[:, k] - unit[:, others] @ solved
    return float(np.clip(apart @ apart, 0.0, 1.0)), int(others[np.argmax(np.abs(solved))])


def _reason(count: int, part: float, partner: str, deviation: float, value: float) -> str:
    if count == 0:
        return "its regressor is zero throughout"
    if count < LEAST_SAMPLES:
        return f"{count} samples only"
    if part < LEAST_PART:
        return f"cannot be told apart from {partner}"
    if not deviation <= LARGEST_DEVIATION * abs(value):
        share = deviation / abs(value) if value else np.inf
        return (
            f"excited too little against what the weights leave: uncertain by {100 * share:.3g} %"
        )
    return ""
