"""The decisions of the cars' slide protection: the law on every axle, safeguards, the valves."""

from alloc.compilation import inlined_jit
from alloc.onboard import slide_protection
from alloc.onboard.detector import differentiate
from alloc.onboard.slide_protection.fuzzy import HOLD, RELEASE, SUPPLY, infer, valve_action

LOWEST_SPEED = 1.0
"""Speed [m/s] below which slip ratios are relative to this speed, since a ratio to zero is meaningless."""

STANDING_SPEED = 0.1
"""Rim speed [m/s] below which an axle counts as standing; sensors see no less."""


@inlined_jit
def _severity(p, ratio, rate):
    """What the law asks for at one axle: `SUPPLY` to `RELEASE`."""
    if p.law == slide_protection.FUZZY:
        return infer(ratio, rate, p.fuzzy.sensitivity, p.fuzzy.slip, p.fuzzy.rate)
    if p.law == slide_protection.THRESHOLD:
        if ratio > p.threshold.release:
            return RELEASE
        return HOLD if ratio > p.threshold.hold else SUPPLY
    return SUPPLY


@inlined_jit
def _ask_axles(eq, p, m):
    """The worst axle of each bogie asks for its valves' action; a standing one asks for release."""
    k = m.slide
    for g in range(k.severity.size):
        k.severity[g] = SUPPLY
    for i in range(m.axle_omega.size):
        g = eq.axle_group[i]
        if g < 0:
            continue
        reference = m.reference[eq.axle_body[i]]
        rim = eq.axle_radius[i] * m.axle_omega[i]
        slip = max(reference - rim, 0.0)
        k.filtered[i], rate = differentiate(k.filtered[i], slip, p.fuzzy.pole, p.fuzzy.gain)
        asked = _severity(p, slip / max(reference, LOWEST_SPEED), rate)
        stands = rim < STANDING_SPEED and reference > p.cut_out_speed
        if stands and not k.locked[i]:
            m.counter.locks[0] += 1
        k.locked[i] = stands
        if stands and p.law != slide_protection.NONE:
            asked = RELEASE
        k.severity[g] = max(k.severity[g], asked)


@inlined_jit
def _decide(eq, p, m, g):
    """Action of the valves of group `g` until the next decision."""
    k = m.slide
    action = valve_action(k.severity[g])
    if m.estimate.sounding.group[0] == g and p.law != slide_protection.NONE:
        action = RELEASE
    if m.reference[eq.group.body[g]] < p.cut_out_speed:
        action = SUPPLY
    k.away[g] = 0.0 if action == SUPPLY else k.away[g] + p.period
    if k.away[g] > p.time_out:
        m.counter.time_outs[0] += 1
        k.refill[g], k.away[g] = p.refill, 0.0
    if k.refill[g] > 0.0:
        k.refill[g] -= p.period
        k.away[g] = 0.0
        action = SUPPLY
    k.action[g] = action


@inlined_jit
def protect(eq, st, m, tick, braking, valve):
    """Fill `valve` (groups,) with the actions of all bogies; everything rests while the air brakes do."""
    p, k = st.slide, m.slide
    if not braking:
        for i in range(k.filtered.size):
            k.filtered[i], k.locked[i] = 0.0, False
        for g in range(k.action.size):
            k.action[g] = k.away[g] = k.refill[g] = 0.0
    elif tick % p.every == 0:
        _ask_axles(eq, p, m)
        for g in range(k.action.size):
            _decide(eq, p, m, g)
    for g in range(k.action.size):
        valve[g] = k.action[g]
