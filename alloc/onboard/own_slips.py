"""Slips of all units, for a rule that is called on slip: JP5484215 with embodiment 2's reports at their best.

There every unit estimates its coefficient at its own detection and sends it to the foremost one (par. 0063), which learns
increments from it after some stations. If it is used at once, as if one datum were enough, it is the unit's cap (5) itself.
"""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.onboard.reports import DETECTED, ESTIMATE


@inlined_jit
def count_slips(st, m, time):
    """Note which detections are within the hold time; returns whether there are any, and whether they changed."""
    some, changed = False, False
    for j in range(m.cap.size):
        detected = m.report.line.read[j, DETECTED]
        counted = detected if time - detected <= st.hold_time else -np.inf
        changed = changed or counted != m.report.counted[j]
        some = some or counted > -np.inf
        m.report.counted[j] = counted
    return some, changed


@inlined_jit
def caps_by_own_slips(st, m, time):
    """Set the cap of each unit that slipped within the hold time to its own slip's coefficient, without an increment."""
    told = m.report.line.read
    for j in range(m.cap.size):
        if time - told[j, DETECTED] <= st.hold_time:
            m.cap[j] = told[j, ESTIMATE]


@inlined_jit
def caps_by_slips(st, m, time):
    """(5) from the foremost unit whose slip counts, of which there must be one; others that slipped have what they found.

    Units ahead have not slipped: the plan is their cap, as it is without slip (step S216).
    """
    caps_by_own_slips(st, m, time)
    increment, front = m.learnt.increment, 0
    while m.report.counted[front] == -np.inf:
        front += 1
    found = m.report.line.read[front, ESTIMATE]
    for j in range(m.cap.size):
        if j < front:
            m.cap[j] = m.train.expected[0]
        elif (
            j == front or m.report.counted[j] == -np.inf
        ):  # (5) rounds as it does in the rule as printed
            m.cap[j] = max(found + increment[j] - increment[front], 0.0)
