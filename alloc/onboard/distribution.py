"""What the foremost unit does for the train: caps, when to ask the rule, and telegrams to the others."""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.onboard.memory import SLOTS


@inlined_jit
def prepare_allocation(eq, st, m, time, tick, commanded):
    """Caps by (5) from the coefficient held at detection; returns whether the rule must be called now.

    Without slip the limits are the plan and no rule is called; nor is it where there are no units to limit.
    """
    blended = eq.blended and commanded < 0.0
    expected = abs(commanded) * (eq.brake_share if blended else eq.planned_share)
    changed = expected != m.train.expected[0]
    m.train.expected[0] = expected
    if m.cap.size == 0:
        return False
    first = m.lead.unit[0]
    since = m.lead.slipped[0] if st.rule.periodic else m.lead.detected[0]
    slip = time - since <= st.hold_time
    for j in range(m.cap.size):
        m.cap[j] = max(m.lead.estimate[0] + eq.increment[j] - eq.increment[first], 0.0)
    if expected == 0.0 or not (slip or st.rule.needs_truth):
        for j in range(m.cap.size):
            m.limit_wanted[j] = expected
        m.train.case[0] = 0.0
        m.train.level[0] = np.nan
        return False
    if st.rule.periodic:
        return tick % st.telegrams.ticks == 0 or changed
    return m.lead.allocate[0] or changed


@inlined_jit
def distribute(eq, st, m, time, tick, delay, fate):
    """Send limits and states with the periodic telegrams; each unit takes what has arrived, or falls back.

    `delay`, `fate` (units,): draws of the telegrams' jitter and loss.
    """
    units = eq.axles.size
    if units == 0:
        return
    first = m.lead.unit[0]
    wanted, limited = m.limit_wanted, m.train.case[0] != 0.0
    if tick % st.telegrams.ticks == 0:
        for j in range(units):
            m.delivered[j] = m.unit.coefficient_estimate[j]
            if j == first:
                continue
            m.counter.telegrams_sent[0] += 1
            if fate[j] < st.telegrams.loss:
                m.counter.telegrams_lost[0] += 1
                continue
            for k in range(SLOTS):
                if np.isinf(m.mail_time[j, k]):
                    m.mail_time[j, k] = time + st.telegrams.latency + st.telegrams.jitter * delay[j]
                    m.mail_limit[j, k] = wanted[j] if limited else np.inf
                    break
    m.received[first] = wanted[first] if limited else np.inf
    m.last_heard[first] = time
    for j in range(units):
        if j == first:
            continue
        for _ in range(SLOTS):  # oldest first, so that the newest limit stands
            k = int(np.argmin(m.mail_time[j]))
            if m.mail_time[j, k] > time + 1e-9:
                break
            m.received[j] = m.mail_limit[j, k]
            m.last_heard[j] = time
            m.unit.fallen_back[j] = 0.0
            m.mail_time[j, k] = np.inf
        if time - m.last_heard[j] > st.telegrams.silence:
            if m.unit.fallen_back[j] == 0.0:
                m.counter.fallbacks[0] += 1
            m.unit.fallen_back[j] = 1.0
            m.received[j] = np.inf
    for j in range(units):  # who is told nothing keeps to the driver's command
        m.unit.limit[j] = m.received[j] if np.isfinite(m.received[j]) else m.train.expected[0]
