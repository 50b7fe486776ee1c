"""Statements of the sweep `log-accuracy`; a log is an event."""

import pandas as pd

from studies.core.statement import Statement
from studies.core.verdict import LEAST_EVENTS, Bound, Numbers, decided
from studies.log_accuracy.drawn_logs import CLEAN, LITTLE, PLAIN, SLIPS, TOLERANCE

ENOUGH_RIGHT, MOST_SILENT = 0.90, 0.01
"""Share of spoiled logs that should be answered rightly, and of those that may be wrong without a word."""
COVERED = 0.86, 0.94
"""Share of the logs with a Q that should lie within twice the stated error."""
RIGHT = (
    f"right: Q within {TOLERANCE:.0%} or {LITTLE:g} kJ of the simulator's; all shares are of all logs, "
    "those that are refused too"
)


def log_accuracy_statements(table: pd.DataFrame) -> list[Statement]:
    """Of clean logs, of spoiled ones, of wrong figures that nothing is said of, of stated errors and of what is refused."""
    clean, spoiled = (table[(table["defect"] == CLEAN) == own] for own in (True, False))
    coupled = clean["coupled"].astype(bool)
    return [
        _clean(clean[~coupled], "clean", "a log without a defect"),
        _clean(clean[coupled], "clean-coupled", "a log without a defect, of a train whose couplers give way,"),
        _right(spoiled),
        _slips(spoiled),
        _silent(spoiled),
        _stated(table[~table["refused"].astype(bool)]),
        _refused(table),
    ]  # fmt: skip


def _is(rows: pd.DataFrame, column: str) -> "pd.Series[bool]":
    return rows[column].astype(float) > 0.0


def _by(rows: pd.DataFrame, column: str, what: str) -> Numbers:
    """A share over all rows, and over those of each value of a column."""
    return {f"share {what}": _is(rows, what)} | {
        f"{what}, {value}": _is(own, what) for value, own in rows.groupby(column, sort=False)
    }


def _clean(rows: pd.DataFrame, name: str, what: str) -> Statement:
    wrong = ~_is(rows, "right")
    return decided(
        name, f"{what} gives the simulator's Q within {TOLERANCE:.0%}",
        {f"in {int(wrong.sum())} of {len(rows)} logs": not wrong.any()},
        {"share right": ~wrong, "error of Q, share": rows["error"], "share with a fault found": _is(rows, "remarked")},
        f"{RIGHT}; holds if it does in every log", enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _right(rows: pd.DataFrame) -> Statement:
    right, proper, plain = _is(rows, "right"), _is(rows, "proper"), rows["form"] == PLAIN
    coupled = rows["coupled"].astype(bool)
    numbers = {
        **_by(rows, "defect", "right"), "share properly refused": proper,
        "right, rigid trains": right[~coupled], "right, trains whose couplers give way": right[coupled],
        "right, in the project's own form": right[plain], "right, in another form": right[~plain],
    }  # fmt: skip
    return decided(
        "right", f"of logs with a usual defect {ENOUGH_RIGHT:.0%} or more are right or properly refused",
        {"": Bound("", right | proper, least=ENOUGH_RIGHT)}, numbers,
        f"{RIGHT}; properly refused: mistaken units, and worn wheels that never roll", enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _slips(rows: pd.DataFrame) -> Statement:
    counted = _is(rows, "slips_right") | _is(rows, "proper")
    return decided(
        "slips",
        f"of logs with a usual defect {ENOUGH_RIGHT:.0%} or more have the slips of the clean log or are properly refused",
        {"": Bound("", counted, least=ENOUGH_RIGHT)}, _by(rows, "defect", "slips_right"),
        f"as many but for {SLIPS}, or a twelfth", enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _silent(rows: pd.DataFrame) -> Statement:
    return decided(
        "silent", f"of logs with a usual defect {MOST_SILENT:.0%} or less are wrong and nothing is said of it",
        {"": Bound("", _is(rows, "silent"), most=MOST_SILENT)}, _by(rows, "defect", "silent"),
        "silent: wrong, beyond twice the stated error, and no remark names the defect or finds another fault",
        enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _stated(rows: pd.DataFrame) -> Statement:
    covered, (least, most) = _is(rows, "covered"), COVERED
    return decided(
        "stated", f"{least:.0%} to {most:.0%} of the logs with a Q lie within twice the error that is stated",
        {f"with {covered.mean():.1%}": bool(least <= covered.mean() <= most)},
        {"share within twice the stated error": covered, "of the wrong ones": covered[~_is(rows, "right")]},
        "holds if the share lies there", enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _refused(table: pd.DataFrame) -> Statement:
    refused = table["refused"].astype(bool)
    other, units = refused & ~_is(table, "proper"), table["defect"].str.contains(" called ")
    return decided(
        "refused", "no log is refused but for mistaken units and worn wheels",
        {f"in {int(other.sum())} of {len(table)} logs": not other.any()},
        {"share refused": refused, "share refused, mistaken units": refused[units]},
        "holds if no other is refused", enough=len(table) >= LEAST_EVENTS,
    )  # fmt: skip
