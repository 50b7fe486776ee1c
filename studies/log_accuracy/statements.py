"""Statements of the sweep `log-accuracy`; a log is an event."""

import pandas as pd

from studies.core.statement import Statement
from studies.core.verdict import LEAST_EVENTS, Bound, Numbers, decided
from studies.log_accuracy.drawn_logs import CLEAN, LITTLE, PLAIN, SLIPS, TOLERANCE

MOST_RIGHT, MOST_SILENT = 0.75, 0.03
"""Share of spoiled logs that should be right, and of those that may be wrong without a word."""
RIGHT = (
    f"right: Q within {TOLERANCE:.0%} or {LITTLE:g} kJ of the simulator's, and the slips of the clean log but for {SLIPS} "
    "or a twelfth; logs that are refused count in none"
)


def log_accuracy_statements(table: pd.DataFrame) -> list[Statement]:
    """Of clean logs, of spoiled ones, of wrong figures that nothing is said of, and of what is refused."""
    read = table[~table["refused"].astype(bool)]
    clean, spoiled = (read[(read["defect"] == CLEAN) == own] for own in (True, False))
    coupled = clean["coupled"].astype(bool)
    return [
        _clean(clean[~coupled], "clean", "a log without a defect"),
        _clean(
            clean[coupled],
            "clean-coupled",
            "a log without a defect, of a train whose couplers give way,",
        ),
        _right(spoiled),
        _silent(spoiled),
        _refused(table),
    ]


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
        {f"{int(wrong.sum())} of {len(rows)} logs": not wrong.any()},
        {"share right": ~wrong, "error of Q, share": rows["error"], "share with a fault found": _is(rows, "remarked")},
        f"{RIGHT}; holds if it does in every log", enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _right(rows: pd.DataFrame) -> Statement:
    right = _is(rows, "right")
    plain = rows["form"] == PLAIN
    numbers = {
        **_by(rows, "defect", "right"),
        "right, rigid trains": right[~rows["coupled"].astype(bool)],
        "right, trains whose couplers give way": right[rows["coupled"].astype(bool)],
        "right, in the project's own form": right[plain],
        "right, in another form": right[~plain],
        "share within twice the stated error": _is(rows, "covered"),
    }
    return decided(
        "right", f"of logs with a usual defect {MOST_RIGHT:.0%} or more are right",
        {"": Bound("", right, least=MOST_RIGHT)}, numbers, RIGHT, enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _silent(rows: pd.DataFrame) -> Statement:
    silent = _is(rows, "silent")
    wrong = ~_is(rows, "right")
    return decided(
        "silent", f"of logs with a usual defect {MOST_SILENT:.0%} or less are wrong and nothing is said of it",
        {"": Bound("", silent, most=MOST_SILENT)},
        {**_by(rows, "defect", "silent"), "wrong ones within twice the stated error": _is(rows, "covered")[wrong]},
        "silent: wrong, beyond twice the stated error, and no remark names the defect or finds another fault",
        enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _refused(table: pd.DataFrame) -> Statement:
    refused = table["refused"].astype(bool)
    units = table["defect"].str.contains(" called ")
    other = refused & ~units
    return decided(
        "refused", "no log is refused but for units that cannot be",
        {f"{int(other.sum())} of {len(table)} logs": not other.any()},
        {"share refused": refused, "share refused, wrong units": refused[units]},
        "holds if no other is refused", enough=len(table) >= LEAST_EVENTS,
    )  # fmt: skip
