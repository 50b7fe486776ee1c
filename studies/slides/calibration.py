"""What a set of the undisclosed parameters of JP4209318 is to a search: a point of the unit cube, drawn, tried, disturbed.

Unknown are the adhesion of Fig. 2, the conditioning, the fuzzy sets and the sensitivities (`studies.slides.jp4209318`);
`studies.slides.ensemble` seeks the sets that bring out Tables 3 and 4.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import qmc

from studies.slides.jp4209318 import BOUNDS, Undisclosed
from studies.slides.targets import HOLD_OUT, implausible, misfit, outcomes, unreached

JITTER = 1e-4
"""Relative noise on every parameter (standard deviation)."""
LOGARITHMIC = ("conditioning_slip", "rate_growing", "sensitivity_high")
"""Parameters that are drawn on a logarithmic scale."""


def from_unit_cube(point: NDArray[np.float64]) -> Undisclosed:
    """The set at a point of the unit cube, (parameters,)."""
    values = {}
    for x, (name, (low, high)) in zip(point, BOUNDS.items(), strict=True):
        share = float(np.clip(x, 0.0, 1.0))
        straight = low + share * (high - low)
        values[name] = low * (high / low) ** share if name in LOGARITHMIC else straight
    return Undisclosed(**values)


def to_unit_cube(undisclosed: Undisclosed) -> NDArray[np.float64]:
    """Where in the unit cube a set lies, (parameters,)."""
    point = []
    for name, value in asdict(undisclosed).items():
        low, high = BOUNDS[name]
        logarithmic = math.log(value / low) / math.log(high / low)
        point.append(logarithmic if name in LOGARITHMIC else (value - low) / (high - low))
    return np.array(point)


def row_of(undisclosed: Undisclosed, found: Mapping[str, float]) -> dict[str, Any]:
    """A row of a table: the set, its outcomes, misfit, and what it does not reach."""
    return {
        **asdict(undisclosed),
        **found,
        "misfit": misfit(undisclosed, found),
        "misfit without 2": misfit(undisclosed, found, HOLD_OUT),
        "unreached": ", ".join(unreached(found)),
    }


def reaches(row: Mapping[Any, Any], leave_out: str | None = None) -> bool:
    """Whether the set of a row reaches every target but `leave_out`, and is plausible."""
    missed = {name for name in str(row["unreached"]).split(", ") if name}
    return missed <= {leave_out} and implausible(undisclosed_of(row)) == 0.0


def undisclosed_of(row: "Mapping[Any, Any] | pd.Series[Any]") -> Undisclosed:
    """The set of a row."""
    return Undisclosed(**{name: float(row[name]) for name in BOUNDS})


def draw(sets: int, seed: int) -> list[Undisclosed]:
    """`sets` plausible sets, drawn uniformly over the ranges (Sobol's sequence, scrambled); more of them extend fewer."""
    engine = qmc.Sobol(len(BOUNDS), rng=seed)
    found: list[Undisclosed] = []
    while len(found) < sets:
        drawn = [from_unit_cube(point) for point in engine.random(64)]
        found += [one for one in drawn if implausible(one) == 0.0]
    return found[:sets]


def jittered(
    undisclosed: Undisclosed, seed: int, k: int, deviation: float = JITTER
) -> dict[str, Any]:
    """Outcomes of the set with the draw `k` of normal noise of this relative deviation on every parameter."""
    noise = np.random.default_rng(seed).standard_normal((k + 1, len(BOUNDS)))[k]
    values = zip(asdict(undisclosed).values(), noise, strict=True)
    return outcomes(Undisclosed(*(value * (1.0 + deviation * float(x)) for value, x in values)))
