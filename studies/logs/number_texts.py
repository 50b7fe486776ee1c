"""Numbers as loggers write them in text: digits in groups, decimal commas, Fortran's exponents, words for no value."""

import re
from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]

GROUPS = "'’\u00a0\u202f\u2009 "
"""Signs between groups of three digits that are nothing else; a comma or a point may be the decimal sign."""
PLAIN = re.compile(r"[+-]?\d+")
GROUPED = {sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:{re.escape(sign)}\d{{3}})+") for sign in ",."}
DECIMAL = {
    sign: re.compile(
        rf"[+-]?(?:\d*|[1-9]\d{{0,2}}(?:{re.escape(other)}\d{{3}})+){re.escape(sign)}\d+(?:[eEdD][+-]?\d+)?"
    )
    for sign, other in ((",", "."), (".", ","))
}


class Numbers(NamedTuple):
    """What a column of texts says."""

    values: Floats
    """nan where there is no number. (rows,)"""
    words: Counter[str]
    """Words in place of a number, and how often."""
    wrong: int | None
    """First row whose text has digits and is no number; None if there is none."""


def decimal_of(columns: Iterable[list[str]]) -> str:
    """The decimal sign of a file, by the cells of some rows, column by column.

    "12,345" is 12.345 or 12 345. Cells that can be read in one way alone decide. Without any, it is the latter if a column
    has it beside whole numbers below a thousand, or has two groups.
    """
    sure, group, unsure = (dict.fromkeys(",.", 0) for _ in range(3))
    for cells in columns:
        told = [cell.strip() for cell in cells if cell.strip()]
        plain = [abs(int(cell)) for cell in told if PLAIN.fullmatch(cell)]
        for sign in ",.":
            grouped = [cell for cell in told if GROUPED[sign].fullmatch(cell)]
            sure[sign] += sum(bool(DECIMAL[sign].fullmatch(cell)) for cell in told) - sum(
                cell.count(sign) == 1 for cell in grouped
            )
            twice = any(cell.count(sign) > 1 for cell in grouped)
            beside = bool(plain) and max(plain) < 1000
            (group if twice or beside else unsure)[sign] += len(grouped)
    if any(sure.values()):
        return "," if sure[","] > sure["."] else "."
    if any(group.values()):
        return "." if group[","] > group["."] else ","
    return "," if unsure[","] > unsure["."] else "."


def numbers_of(texts: NDArray[Any], decimal: str = ".") -> Numbers:
    """Numbers of a column of texts, (rows,); `decimal` is the file's sign."""
    column = pd.Series(texts, dtype=object)
    # where the decimal sign is a comma, a point stands between groups: the library would take it for the sign
    plain = (
        column
        if decimal == "."
        else column.where(~column.astype(str).str.contains(".", regex=False))
    )
    values = pd.to_numeric(plain, errors="coerce").to_numpy(float).copy()
    left = np.flatnonzero(np.isnan(values) & column.notna().to_numpy())
    words: Counter[str] = Counter()
    wrong = None
    for row in left.tolist():
        text = str(texts[row]).strip()
        number = _number(text, decimal)
        if number is not None:
            values[row] = number
        elif is_word(text):
            words[text] += 1
        elif wrong is None:
            wrong = row
    return Numbers(values, words, wrong)


def is_word(text: str) -> bool:
    """Whether a text stands for no value: a word, a heading, or what a computer prints for none such as 1.#QNAN."""
    return not any(c.isdigit() for c in text) or "#" in text or text[:1].isalpha()


def _number(text: str, decimal: str) -> float | None:
    """The number that a text is, None if it is none."""
    other = "," if decimal == "." else "."
    plain = text
    for sign in GROUPS:
        # only between groups: "12 5" is none
        plain = re.sub(rf"(?<=\d){re.escape(sign)}(?=\d{{3}}(?!\d))", "", plain)
    whole, point, rest = plain.partition(decimal)
    if other in whole:
        if not GROUPED[other].fullmatch(whole):
            return None
        whole = whole.replace(other, "")
    plain = re.sub(r"(?<=[\d.])[dD](?=[+-]?\d+$)", "e", whole + ("." if point else "") + rest)
    if "_" in plain or any(c.isalpha() and c not in "eE" for c in plain):
        return None  # Python's own spellings: 1_000, inf
    try:
        return float(plain)
    except ValueError:
        return None
