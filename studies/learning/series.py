"""The table of the sweep `learning` series by series: one train in one running direction, all its stations."""

import pandas as pd

from studies.learning.starts import KINDS, Kind

TOLERANCE = 0.002
"""Largest error of any unit's increment with which it counts as learnt: a tenth of what the increments reach."""
COARSE = 0.005
"""A second, coarser tolerance, reported beside it."""
SERIES = [*Kind._fields, "train", "direction"]


PARTS = {
    kind.words: f"rail == {kind.rail} and stored == '{kind.stored}' and case == '{kind.case}'"
    for kind in KINDS
}
"""The kinds of series."""


def per_series(table: pd.DataFrame) -> pd.DataFrame:
    """One row per series; columns "<quantity>, <arm>".

    Means over the second half of the stations of effort, slip time, damage and detections. After the last station: `error`
    (largest of a unit), `bias` (mean) and `deviation`. `stations`: station after which the error stays within `TOLERANCE`
    (nan: never), `coarse` the same for `COARSE`; `data`: number of data, `excess`: their mean excess over the truth.
    """
    wide: dict[str, pd.Series] = {}
    for arm, rows in table.groupby("arm", sort=False):
        ordered = rows.sort_values("station")
        late = ordered[ordered["station"] > ordered["station"].max() // 2].groupby(SERIES)
        for name in ("effort_ratio", "slip_time", "damage", "unit_detections", "rear_detections"):
            wide[f"{name}, {arm}"] = late[name].mean()
        groups = ordered.groupby(SERIES)
        for name in ("error", "bias", "deviation"):
            wide[f"{name}, {arm}"] = groups[name].last()
        wide[f"covered, {arm}"] = groups["covered"].mean()
        total = groups["data"].sum()
        summed = ordered.assign(excess=ordered["data"] * ordered["excess"]).groupby(SERIES)
        wide[f"data, {arm}"] = total
        wide[f"excess, {arm}"] = summed["excess"].sum() / total.where(total > 0.0)
        for name, tolerance in (("stations", TOLERANCE), ("coarse", COARSE)):
            wide[f"{name}, {arm}"] = groups[["station", "error"]].apply(_stations_until, tolerance)
    return pd.DataFrame(wide).reset_index()


def _stations_until(rows: pd.DataFrame, tolerance: float) -> float:
    """First station from which on the error stays within the tolerance; nan for never."""
    outside = rows["station"][rows["error"] > tolerance]
    if outside.empty:
        return float(rows["station"].iloc[0])
    later = rows["station"][rows["station"] > outside.iloc[-1]]
    return float(later.iloc[0]) if len(later) else float("nan")
