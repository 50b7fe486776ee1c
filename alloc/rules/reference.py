"""The reference rule: JP5484215, steps S206 to S216 (Fig. 7 to 9), in plain Python."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

TIE = Fraction(1, 10**12)
"""Sums that differ by less of the plan are equal: a tie by hand is one in floating point. In fractions it counts as such."""


def reference_rule(
    caps: Sequence[Any], expected: Any, reading: str = "description", slip: bool = True
) -> list[Any]:
    """Limits of the units, foremost first, from their caps (5) and the coefficient that the plan needs; any kind of numbers.

    `reading`: "description" (par. 0041, 0049), where the candidate's cap bounds all units behind the front, or "claim"
    (claim 1), a running sum that stops at the candidate. `slip`: whether a detection counts still.
    """
    n = len(caps)
    if not slip:
        return [expected] * n  # S216: every unit at the plan
    mean = sum(caps) / n  # S206, (7)
    if mean <= expected * (1 + TIE):  # S207: case A, the plan is out of reach
        return list(caps)  # S208: every unit at its cap
    front = 0  # S207: case B
    while caps[front] < expected:
        front += 1  # S209: the units before the first that carries the plan
    small = sum(expected - cap for cap in caps[:front])  # S209, (8): what they lack
    for j in range(front, n):  # S210: the candidates, one after the other
        level = caps[j]
        if reading == "description":
            large = sum(min(cap, level) - expected for cap in caps[front:])  # S210, (9)
        else:
            large = sum(cap - expected for cap in caps[front : j + 1])  # claim 1
        if large >= small - n * expected * TIE:  # S211: the first that makes up for it
            break
    return [cap if cap < level else level for cap in caps]  # S212: S213 (10), S214 (11)
