"""What the foremost unit does for the train: caps, when to ask the rule, and telegrams to the others."""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.onboard import memory as om


@inlined_jit
def prepare_allocation(eq, st, m, time, tick, commanded):
    """Caps by (5) from the coefficient held at detection; returns whether the rule must be called now.

    Without slip the limits are the plan and no rule is called; nor is it where there are no units to limit.
    """
    blended = eq.blended and commanded < 0.0
    expected = abs(commanded) * (eq.brake_share if blended else eq.planned_share)
    changed = expected != m.held[om.HELD_EXPECTED]
    m.held[om.HELD_EXPECTED] = expected
    if m.cap.size == 0:
        return False
    first = int(m.held[om.HELD_FIRST])
    periodic = st.when == om.ALLOCATE_PERIODICALLY
    since = m.held[om.HELD_ANY_TIME] if periodic else m.held[om.HELD_TIME]
    slip = time - since <= st.hold_time
    for j in range(m.cap.size):
        m.cap[j] = max(m.held[om.HELD_ESTIMATE] + eq.increment[j] - eq.increment[first], 0.0)
    if expected == 0.0 or not (slip or st.needs_truth):
        for j in range(m.cap.size):
            m.limit_wanted[j] = expected
        m.held[om.HELD_CASE] = 0.0
        m.held[om.HELD_LEVEL] = np.nan
        return False
    if periodic:
        return tick % st.telegram_ticks == 0 or changed
    return m.held[om.HELD_ALLOCATE] > 0.0 or changed


@inlined_jit
def distribute(eq, st, m, time, tick, arrival_draw, loss_draw, loss):
    """Send limits and states with the periodic telegrams; each unit takes what has arrived, or falls back."""
    units = eq.axles.size
    if units == 0:
        return
    first = int(m.held[om.HELD_FIRST])
    if tick % st.telegram_ticks == 0:
        for j in range(units):
            m.delivered[j] = m.estimate[j]
            if j == first:
                continue
            m.counter[om.TELEGRAMS] += 1
            if loss_draw[j] < loss:
                m.counter[om.LOST] += 1
                continue
            for k in range(om.SLOTS):
                if np.isinf(m.mail_time[j, k]):
                    m.mail_time[j, k] = time + st.telegram[0] + st.telegram[1] * arrival_draw[j]
                    m.mail_limit[j, k] = m.limit_wanted[j] if m.held[om.HELD_CASE] else np.inf
                    break
    m.received[first] = m.limit_wanted[first] if m.held[om.HELD_CASE] else np.inf
    m.last_heard[first] = time
    for j in range(units):
        if j == first:
            continue
        for _ in range(om.SLOTS):  # oldest first, so that the newest limit stands
            k = int(np.argmin(m.mail_time[j]))
            if m.mail_time[j, k] > time + 1e-9:
                break
            m.received[j] = m.mail_limit[j, k]
            m.last_heard[j] = time
            m.fallen_back[j] = False
            m.mail_time[j, k] = np.inf
        if time - m.last_heard[j] > st.telegram[2]:
            if not m.fallen_back[j]:
                m.counter[om.FALLBACKS] += 1
            m.fallen_back[j] = True
            m.received[j] = np.inf
    for j in range(units):  # who is told nothing keeps to the driver's command
        m.limit[j] = m.received[j] if np.isfinite(m.received[j]) else m.held[om.HELD_EXPECTED]
