"""Synthetic tables of the readhesion paper's sweep and of its calibration, on which it is known what holds."""

import numpy as np
import pandas as pd

from studies.readhesion_paper import study as readhesion
from studies.readhesion_paper.calibration import NOT_ASKED_OF_ALL, RANGES, draw, grid_tables
from studies.readhesion_paper.findings import CLAIMS
from studies.readhesion_paper.paper import PAPER_LIMITS, PAPER_MARGINS, PAPER_WIDTHS, UNITS


def limit_of(margin: float, width: float) -> float:
    """Limit adhesion coefficient of the synthetic controller, off the grid; none from a_w = 0.6 on."""
    return 0.0903 + 0.02 * margin + 0.1 * width if width < 0.59 else np.inf


def index_rows(limit=limit_of, limits=PAPER_LIMITS) -> pd.DataFrame:
    """Indices as the paper found them: a half-slip at 0.16, more adhesion used with a larger a_w."""
    rows = []
    for margin, width in grid_tables(PAPER_MARGINS, PAPER_WIDTHS):
        for mu in limits:
            possible = mu >= limit(margin, width)
            used = mu * (0.95 + 0.02 * width) + 0.001 * margin if possible else 0.8 * mu
            half = abs(mu - 0.16) < 1e-9 and 0.15 < width < 0.35
            rows.append(
                {
                    "margin": margin,
                    "width": width,
                    "limit": mu,
                    "possible": possible,
                    "used_coefficient": 0.13 if half else used,
                    "utilisation": (0.13 if half else used) / mu,
                    "longest_slip": 2.0 if half else 0.3 if possible else 8.0,
                }
            )
    return pd.DataFrame(rows)


def sweep_table(narrow_limit=limit_of, monotone: bool = True) -> pd.DataFrame:
    """A whole table of the sweep `readhesion`; the narrow parabola may have limits of its own.

    Two members in each unit do as the set in use does.
    """
    parts: list[pd.DataFrame] = []
    for name, limit in ((readhesion.PRINTED, limit_of), (readhesion.NARROW, narrow_limit)):
        limits = pd.DataFrame(grid_tables(), columns=["margin", "width"])
        values = [limit(m, w) for m, w in zip(limits["margin"], limits["width"], strict=True)]
        limits["limit_coefficient"] = np.where(np.isfinite(values), values, np.nan)
        limits["monotone"] = monotone | (np.arange(len(limits)) > 0)
        both = pd.concat([index_rows(limit).assign(part="indices"), limits.assign(part="limit")])
        parts.append(both.assign(parabola=name))
    cases = [name for name in CLAIMS if name[:2] in ("A ", "B ") or name == "slips at the drop"]
    parts.append(
        pd.DataFrame(
            {"part": "case", "finding": cases, "met": True, "quantity": "number", "value": 1.0}
        )
    )
    printed = [
        part
        for part in parts
        if "parabola" not in part or (part["parabola"] == readhesion.PRINTED).all()
    ]
    parts += [
        part.drop(columns="parabola", errors="ignore").assign(unit=unit, member=k)
        for unit in UNITS
        for k in range(2)
        for part in printed
    ]
    return pd.concat(parts, ignore_index=True)


def calibration_table(samples: int = 40) -> pd.DataFrame:
    """Sets drawn as ever; those with T_u < 2 s in km/h/s meet all findings but the half-slip's."""
    rows = []
    for unprinted in draw(samples, 0):
        row = {name: getattr(unprinted, name) for name in (*RANGES, "unit")}
        good = unprinted.rise < 2.0 and unprinted.unit == "km/h/s"
        met = {name: good and name not in NOT_ASKED_OF_ALL for name in CLAIMS}
        rows.append(
            {
                **row,
                "objective": (2.0 if good else 10.0) + abs(unprinted.rise - 1.0),
                "met": sum(met.values()),
                **{f"met: {name}": value for name, value in met.items()},
                "stage": "wide",
            }
        )
    rows[0]["stage"] = "assumed"
    return pd.DataFrame(rows).assign(seed=0, samples=samples)
