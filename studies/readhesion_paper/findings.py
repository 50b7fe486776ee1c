"""Findings of the readhesion paper, each as a number from a run of its scenario and a bound that represents "as printed".

Calibration uses the misfits to find values that are not printed; the sweep states which findings hold. Where the paper has
words ("about", "order of"), the bounds are this project's; each is named here.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from alloc.estimation.series import spans
from alloc.metrics.search import limit_cycle, readhesion_possible, settled_at
from studies.core.claims import ABOUT, AT_MOST, Claim, meets
from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.paper import (
    CASE_A,
    DROP,
    LOW_END,
    PAPER_LIMITS,
    RECOVERY,
    signals_of,
    slip_spans,
)

SWITCHING = (0.01, 0.1)
"""Time [s] of the torque factor between 0 and 1: "of the order of 10 ms"."""
FACTOR_BAND = 0.02
"""A torque factor rests where it stays this close to its last value, and is between 0 and 1 where it is as far from both."""
NEVER_FROM = 0.6
"""a_w above which readhesion is never possible."""
HALF_SLIP_LIMIT, HALF_SLIP_WIDTHS = 0.16, (0.2, 0.3)
"""mu_lim and a_w of the half-slip, Figs. 22 and 23."""


def _about(name: str, value: float, band: float, reason: str) -> Claim:
    return Claim(
        name, mean=name, side=ABOUT, value=value, tolerance=band, exact=True, reason=reason
    )


BOUNDS: dict[str, Claim] = {
    one.name: one
    for one in (
        Claim("torque at the drop", mean="coefficient that the torque asks for", value=max(PAPER_LIMITS), exact=True,
              reason="section 3.2: it slips at every mu_lim"),
        _about("period", 0.65, 0.065, "section 3.1, a tenth is about"),
        _about("slips before", 2.0, 0.0, "section 3.1, Fig. 14"),
        Claim("switching", mean="time between 0 and 1", side=ABOUT, value=sum(SWITCHING) / 2.0,
              tolerance=(SWITCHING[1] - SWITCHING[0]) / 2.0, exact=True, reason="of the order of 10 ms: 0.01 to 0.1 s"),
        Claim("extremes", mean="share of time at 0 or 1", value=0.5, exact=True, reason="mostly 0 or 1"),
        _about("second slip", 7.0, 0.25, "about 7 s"),
        _about("settling", 3.0, 1.0, "about 3 s"),
        Claim("widths", mean="a_w that readhere, from 0.6 on", side=AT_MOST, exact=True, reason="never"),
        Claim("steeper", mean="slope per a_w less that per a_0", exact=True, reason="more"),
        Claim("used spread", mean="largest difference of mu_use over a_0", side=AT_MOST, value=0.005, exact=True,
              reason="of the order of 0.001"),
        Claim("growing", mean="share of mu_lim at which utilisation grows", value=0.5 + 1e-9, exact=True,
              reason="more than half"),
        Claim("half-slip time", mean="longest slip", value=1.0, exact=True,
              reason="a half-slip lasts long from more than a cycle of case A on (assumed)"),
    )
}  # fmt: skip
"""Bounds of the numbers that decide the findings, each with why; they are frozen, and decide when a run is made."""
WORST = 3.0
"""Largest misfit of a single finding, so that none hides the others."""

UNMET = 0.5
"""Addition to the objective for a finding that is not met, beside its misfit: a set should show what the paper says."""


@dataclass(frozen=True)
class Finding:
    """A finding of the paper in a set of runs."""

    met: bool
    misfit: float
    """0 where it is as printed, about 1 where it is clearly not, at most `WORST`."""
    numbers: dict[str, float]


CLAIMS: dict[str, str] = {
    "slips at the drop": "the torque of 6 s is enough to slip at every mu_lim of the grid, up to 0.16",
    "A readheres": "case A (a_w 0.2, a_0 0.4, mu_lim 0.12) readheres",
    "A period": f"the limit cycle of case A has a period of about {BOUNDS['period'].value:g} s",
    "A slips": f"case A is in its limit cycle after {BOUNDS['slips before'].value:g} slips",
    "A switching": "the torque factor of case A is between 0 and 1 for tens of ms, and mostly 0 or 1",
    "B first slip": "the first slip of case B (a_w 0.8) recovers",
    "B second slip": "the second slip of case B starts at about 7 s",
    "B diverges": "the second slip of case B does not recover and grows",
    "B factor rests": "about 3 s later the torque factor of case B rests between 0 and 1",
    "wide never": f"with a_w of {NEVER_FROM} and more readhesion is never possible",
    "narrow somewhere": "with every smaller a_w readhesion is possible somewhere",
    "margin lowers limit": "the smaller a_0, the lower the limit adhesion coefficient",
    "width raises limit": "the larger a_w, the higher the limit adhesion coefficient",
    "width is steeper": "the limit adhesion coefficient depends more on a_w than on a_0",
    "margin hardly used": "where readhesion is possible, mu_use differs over a_0 by the order of 0.001",
    "width uses more": "where readhesion is possible, utilisation grows with a_w",
    "half-slip lasts": "just below the plan (mu_lim 0.16) a half-slip lasts long for a_w 0.2 and 0.3",
    "half-slip costs": "with a_w 0.3, mu_use is lower at mu_lim 0.16 than at lower mu_lim",
}
"""Every finding in words, in the paper's order."""


def _near(name: str, value: float) -> tuple[bool, float]:
    """Whether a value is about as printed, and its distance in bands; without a band, itself."""
    bound = BOUNDS[name]
    if not np.isfinite(value):
        return False, WORST
    distance = abs(value - bound.value) / (bound.tolerance or 1.0)
    return meets(bound, value), min(distance, WORST)


def _yes(met: bool, short: float = 1.0, **numbers: float) -> Finding:
    """A finding that is met or falls `short`."""
    return Finding(bool(met), 0.0 if met else float(np.clip(short, 0.05, WORST)), numbers)


def case_findings(runs: TableRuns, lane_a: int = 0, lane_b: int = 1) -> dict[str, Finding]:
    """Findings of section 3.1, from runs of the cases A and B whose rail stays low."""
    return {**_drop(runs, lane_a), **_case_a(runs, lane_a), **_case_b(runs, lane_b)}


def _drop(runs: TableRuns, lane: int) -> dict[str, Finding]:
    """Section 2.4: the torque rises until 6 s, and the drop to any mu_lim makes the wheel slip then (3.2)."""
    before = int(np.searchsorted(runs.time, DROP)) - 1
    reached = float(runs.torque[before, lane] / runs.torque_per_coefficient)
    bound = BOUNDS["torque at the drop"]
    numbers = {"coefficient that the torque asks for at 6 s": reached}
    misfit = float(np.clip((bound.value - reached) / 0.01, 0.0, WORST))
    return {"slips at the drop": Finding(meets(bound, reached), misfit, numbers)}


def _case_a(runs: TableRuns, lane: int) -> dict[str, Finding]:
    signals = signals_of(runs)
    possible = bool(readhesion_possible(signals)[lane])
    cycle = limit_cycle(signals, lane, drop=DROP, until=RECOVERY)
    period_met, period_misfit = _near("period", cycle.period)
    before = float(cycle.slips_before) if cycle.exists else np.nan
    slips_met, slips_misfit = _near("slips before", before)
    inside = (runs.time >= DROP + 2.0) & (runs.time < RECOVERY)
    factor = runs.factor[inside, lane]
    between = (factor > 0.0) & (factor < 1.0)
    times = np.diff(spans(between), axis=1) * (runs.time[1] - runs.time[0])
    switching = float(np.median(times)) if times.size else np.nan
    extremes = float(1.0 - between.mean())
    low, high = SWITCHING
    outside = max(np.log2(low / switching), np.log2(switching / high), 0.0) if times.size else WORST
    short = max(BOUNDS["extremes"].value - extremes, 0.0) / 0.25
    switches = meets(BOUNDS["switching"], switching) and meets(BOUNDS["extremes"], extremes)
    return {
        "A readheres": _yes(possible, WORST),
        "A period": Finding(possible and period_met, period_misfit, {"period [s]": cycle.period}),
        "A slips": Finding(
            possible and slips_met, slips_misfit,
            {"slips before the limit cycle": float(cycle.slips_before)},
        ),
        "A switching": Finding(
            possible and switches, float(min(outside + short, WORST)),
            {"median time between 0 and 1 [s]": switching, "share of time at 0 or 1": extremes},
        ),
    }  # fmt: skip


def _case_b(runs: TableRuns, lane: int) -> dict[str, Finding]:
    slips = slip_spans(runs, lane, LOW_END)
    recovers = len(slips) >= 2
    second, ends = (float(v) for v in slips[1]) if recovers else (np.nan, np.nan)
    second_met, second_misfit = _near("second slip", second)
    diverges = recovers and len(slips) == 2 and ends >= runs.time[-1]
    inside = (runs.time >= (second if recovers else DROP)) & (runs.time < RECOVERY)
    time, factor = runs.time[inside], runs.factor[inside, lane]
    settling = settled_at(time, factor, FACTOR_BAND) - time[0] if diverges else np.nan
    last = float(factor[-1])
    settling_met, settling_misfit = _near("settling", settling)
    between = FACTOR_BAND < last < 1.0 - FACTOR_BAND
    return {
        "B first slip": _yes(recovers, WORST, slips=float(len(slips))),
        "B second slip": Finding(second_met, second_misfit, {"start [s]": second}),
        "B diverges": _yes(diverges, WORST, **{"slip at 14 s [m/s]": float(runs.slip[inside, lane][-1])}),
        "B factor rests": Finding(
            settling_met and between, settling_misfit if between else WORST,
            {"time until it rests [s]": settling, "factor": last},
        ),
    }  # fmt: skip


def limits_of(table: pd.DataFrame, over: str) -> "pd.Series[float]":
    """Limit adhesion coefficient for each value of `over` (margin or width), the other as in case A; nan where none."""
    other = "width" if over == "margin" else "margin"
    chosen = table[np.isclose(table[other], getattr(CASE_A, other))]
    return chosen["limit"].where(chosen["possible"]).groupby(chosen[over]).min()


def grid_findings(table: pd.DataFrame) -> dict[str, Finding]:
    """Findings of section 3.3, from indices (`studies.readhesion_paper.paper.assess`) over a_0, a_w and mu_lim."""
    by_width, by_margin = limits_of(table, "width"), limits_of(table, "margin")
    wide = by_width[by_width.index >= NEVER_FROM - 1e-9]
    narrow = by_width[by_width.index < NEVER_FROM - 1e-9]
    slope_width, slope_margin = _slope(narrow), _slope(by_margin)
    return {
        "wide never": _yes(
            meets(BOUNDS["widths"], wide.count()), 0.5 + wide.notna().mean(), **{"a_w that readhere": float(wide.count())}
        ),
        "narrow somewhere": _yes(
            bool(narrow.notna().all()), 3.0 * narrow.isna().mean(),
            **{"largest a_w that readheres": float(narrow.dropna().index.max())},
        ),
        "margin lowers limit": _grows(by_margin, "a_0"),
        "width raises limit": _grows(narrow, "a_w"),
        "width is steeper": _yes(
            meets(BOUNDS["steeper"], slope_width - slope_margin), **{"per a_w": slope_width, "per a_0": slope_margin}
        ),
        **_use_findings(table),
        **_half_slip_findings(table),
    }  # fmt: skip


def _slope(limits: "pd.Series[float]") -> float:
    known = limits.dropna()
    if len(known) < 2:
        return np.nan
    return float(np.polyfit(known.index, known.to_numpy(), 1)[0])


def _grows(limits: "pd.Series[float]", name: str) -> Finding:
    """Whether the limit nowhere falls and grows on the whole; none at all counts as above every other."""
    values = limits.fillna(limits.max() + 0.01).to_numpy() if limits.notna().any() else np.zeros(1)
    falls = float(np.maximum(-np.diff(values), 0.0).sum())
    rises = float(values[-1] - values[0])
    numbers = {
        f"at the smallest {name}": float(limits.iloc[0]),
        f"at the largest {name}": float(limits.iloc[-1]),
    }
    return _yes(falls < 1e-9 and rises > 1e-9, 0.5 + falls / 0.01, **numbers)


def _use_findings(table: pd.DataFrame) -> dict[str, Finding]:
    good = table[table["possible"]]
    at_width = good[np.isclose(good["width"], CASE_A.width)].groupby("limit")["used_coefficient"]
    spread = (at_width.max() - at_width.min())[at_width.count() > 1]
    widest = float(spread.max()) if len(spread) else np.nan
    at_margin = good[np.isclose(good["margin"], CASE_A.margin)]
    at_margin = at_margin[at_margin["limit"] < HALF_SLIP_LIMIT - 1e-9]
    groups = [one.set_index("width") for _, one in at_margin.groupby("limit") if len(one) > 1]
    slopes = np.array([_slope(one["utilisation"]) for one in groups])
    growing = float((slopes > 0.0).mean()) if slopes.size else np.nan
    excess = widest / BOUNDS["used spread"].value - 1.0 if np.isfinite(widest) else 1.0
    return {
        "margin hardly used": _yes(
            meets(BOUNDS["used spread"], widest),
            0.5 + excess,
            **{"largest difference of mu_use": widest},
        ),
        "width uses more": _yes(
            meets(BOUNDS["growing"], growing), **{"share of mu_lim at which it grows": growing}
        ),
    }


def _half_slip_findings(table: pd.DataFrame) -> dict[str, Finding]:
    case = table[np.isclose(table["margin"], CASE_A.margin)]
    at = case[np.isclose(case["limit"], HALF_SLIP_LIMIT)].set_index("width")
    longest = [float(at["longest_slip"].get(width, np.nan)) for width in HALF_SLIP_WIDTHS]
    width = HALF_SLIP_WIDTHS[-1]
    below = case[np.isclose(case["width"], width) & case["possible"]]
    below = below[below["limit"] < HALF_SLIP_LIMIT - 1e-9]
    best = float(below["used_coefficient"].max()) if len(below) else np.nan
    used = float(at["used_coefficient"].get(width, np.nan))
    lasted = zip(HALF_SLIP_WIDTHS, longest, strict=True)
    return {
        "half-slip lasts": _yes(
            meets(BOUNDS["half-slip time"], min(longest)), 1.0 - min(longest) / BOUNDS["half-slip time"].value,
            **{f"longest slip with a_w {w} [s]": v for w, v in lasted},
        ),
        "half-slip costs": _yes(
            used < best, (used - best) / 0.01 if np.isfinite(best) else 1.0,
            **{"mu_use at 0.16": used, "best mu_use at lower mu_lim": best},
        ),
    }  # fmt: skip


def objective(findings: dict[str, Finding]) -> float:
    """Sum of the misfits, and `UNMET` for each finding that is not met.

    What was not asked, since the cases already fail, counts as clearly not met.
    """
    misfits = sum(finding.misfit + UNMET * (not finding.met) for finding in findings.values())
    return float(misfits + (WORST + UNMET) * (len(CLAIMS) - len(findings)))
