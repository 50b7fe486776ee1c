"""Slide protection of the air brakes: what the valves of each bogie do while its wheels slide (JP4209318).

The worst axle of a bogie decides for it. Two laws: `THRESHOLD`, switching points of the slip ratio, is this project's;
`FUZZY` infers from slip ratio and slip acceleration, as JP4209318 does, by rules that it does not print
(`alloc.laws.fuzzy_valve`). An axle without a sensor asks for nothing.
"""

import math

from alloc.backends import compiled as law
from alloc.compilation import jit

NONE, THRESHOLD, FUZZY = range(3)
"""Laws, `slide.protection`."""
SUPPLY, HOLD, RELEASE = 0.0, 1.0, 2.0
"""Actions of the valves, `brake.valve`."""
LEAST_SPEED = 1.0
"""Smallest speed that slip ratios are relative to [m/s]."""
STANDING = 0.1
"""Rim speed below which an axle counts as standing [m/s]; sensors see no less."""


@jit
def protect_wheels(k, axles, brakes, slide, run):
    """`brake.valve` of every bogie at instant `k`: decided every so many, until the next; at rest while the brakes are."""
    if not run.braking:
        for a in axles:
            a.slide = 0.0
        for b in brakes:
            b.valve = SUPPLY
        return
    if k % slide.every != 0 or slide.protection == NONE:
        return
    for b in brakes:
        b.severity = SUPPLY
    for a in axles:
        if a.brake >= 0:
            b = brakes[a.brake]
            b.severity = max(b.severity, severity_at_axle(a, slide, run))
    for b in brakes:
        b.valve = SUPPLY if b.severity < 0.5 else HOLD if b.severity < 1.5 else RELEASE
        if run.reference_speed < slide.cut_out_speed:
            b.valve = SUPPLY


@jit
def severity_at_axle(a, slide, run):
    """What an axle asks of its bogie's valves, `SUPPLY` to `RELEASE`: release if it stands while the train runs."""
    speed, period = run.reference_speed, run.period * slide.every
    behind = max(speed - a.reading, 0.0)
    advance = (1.0 - math.exp(-slide.fuzzy_pole * period)) * (behind - a.slide)
    # JP4209318's sets are calibrated with the slide ahead of its filter, times the pole, for its acceleration
    rate = slide.fuzzy_pole * (behind - a.slide)
    a.slide += advance
    if a.reading < STANDING and speed > slide.cut_out_speed:
        return RELEASE
    ratio = behind / max(abs(speed), abs(a.reading), LEAST_SPEED)
    if slide.protection == THRESHOLD:
        if ratio > slide.threshold_release:
            return RELEASE
        return HOLD if ratio > slide.threshold_hold else SUPPLY
    s, slip, rates = slide.fuzzy_sensitivity, slide.fuzzy_slip, slide.fuzzy_rate
    return law.fuzzy_valve(
        s * ratio, s * rate, slip[0], slip[1], slip[2], rates[0], rates[1], rates[2]
    )
