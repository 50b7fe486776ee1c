"""Searches by a swarm of particles: slips that are tried in turn, or curves that are fitted.

In and out as in `alloc.onboard.controllers.search`. A swarm is that of Kennedy and Eberhart (1995), with the inertia of Shi
and Eberhart (1998).
"""

import math

import numpy as np

from alloc.compilation import jit
from alloc.onboard.columns import ONE
from alloc.onboard.controllers.search import (
    ASSUMED,
    SEARCH,
    SEARCHED,
    TUNED,
    clip,
    hold_slip,
    interval_is_over,
    move,
    tuned,
)
from alloc.onboard.signatures import control
from alloc.schema.tables import Column, Table

INERTIA, PULL = 0.6, 1.2
"""Weights of a particle's speed, and of its own best place and the swarm's: below Trelea's (2003) bound of divergence."""
MULTIPLIER, MODULUS, STRIDE = 48271, 2147483647, 1000003
"""Minimal standard generator of Park and Miller (1988), and the distance between the seeds of two units."""
SEED = {"seed": Column(1, ONE, "seed of the draws", source="any")}
GENERATOR = {"generator": Column(0, ONE, "state of the generator of draws; 0: not seeded")}


@jit
def draw(m):
    """Next number between 0 and 1."""
    m.generator = m.generator * MULTIPLIER % MODULUS
    return m.generator / MODULUS


@jit
def seeded(m, axles):
    """Seed the generator, differently for each unit."""
    if m.generator == 0:
        state = 1 + (m.seed * STRIDE + (axles[0].unit + 1) * MULTIPLIER) % (MODULUS - 1)
        m.generator = state * MULTIPLIER % MODULUS * MULTIPLIER % MODULUS  # nearby seeds part


@jit
def next_speed(place, speed, own_best, common_best, own, common):
    """Next speed of a particle in one direction: what it keeps, and the pull of both bests; `own`, `common`: draws."""
    return INERTIA * speed + (
        PULL * own * (own_best - place) + PULL * common * (common_best - place)
    )


PARTICLES = 3
"""As few as make a swarm: each costs an interval of driving at its slip."""
EACH = (0.0,) * PARTICLES

SWARM_TRACKING = Table(
    "swarm-tracking",
    **SEARCH,
    spread=Column(0.04, "m s-1", "distance of the particles at the start", source=TUNED),
    keep=Column(0.98, ONE, "factor on the best values after a round", source=ASSUMED),
    gathered=Column(0.015, "m s-1", "distance within which the swarm rests", source=ASSUMED),
    renewal=Column(0.05, ONE, "relative change of the coefficient that wakes it", source=ASSUMED),
    **SEED,
    **SEARCHED,
    **GENERATOR,
    turn=Column(-1, ONE, "particle that is tried; -1: none yet, 3: the swarm rests"),
    place=Column(EACH, "m s-1", "slip of each particle"),
    speed=Column(EACH, "m s-1", "its last move"),
    best=Column(EACH, "m s-1", "slip at which it found most"),
    most=Column(EACH, ONE, "coefficient found there, faded"),
)
SWARM_TRACKING_ROW = SWARM_TRACKING.dtype


@jit
def scatter(m):
    """Particles about the reference, the first one on it; no place has been tried yet."""
    for i in range(PARTICLES):
        away = (1.0 if i % 2 == 1 else -1.0) * m.spread * float((i + 1) // 2)
        m.place[i] = m.best[i] = clip(m.reference + away, m.lowest, m.highest)
        m.speed[i], m.most[i] = 0.0, -math.inf
    m.turn = 0


@jit
def try_particle(m, coefficient):
    """Note what the particle of this interval has found; after a round all move, or rest once they have gathered."""
    if coefficient > m.most[m.turn]:
        m.most[m.turn], m.best[m.turn] = coefficient, m.place[m.turn]
    m.turn += 1
    if m.turn < PARTICLES:
        return
    leader, farthest = m.best[np.argmax(m.most)], 0.0
    for i in range(PARTICLES):
        own, common = draw(m), draw(m)
        speed = next_speed(m.place[i], m.speed[i], m.best[i], leader, own, common)
        place = clip(m.place[i] + speed, m.lowest, m.highest)
        m.speed[i], m.place[i] = place - m.place[i], place
        m.most[i] *= m.keep  # the rail changes
        farthest = max(farthest, abs(place - leader))
    if farthest > m.gathered:
        m.turn = 0


@control
def swarm_tracking(unit, axles, memory, run):
    """Three slips are held in turn, then the swarm of them moves, after Abouzeid et al.

    Their abstract (arXiv 2406.13650) prints no algorithm. This is the one usual in tracking the power of solar cells.
    """
    m = memory.view(SWARM_TRACKING_ROW)[0]
    seeded(m, axles)
    if interval_is_over(unit, m, run):
        coefficient = m.coefficient_sum / m.samples
        if m.turn < 0 or math.isnan(m.last_coefficient):
            scatter(m)
        elif m.turn < PARTICLES:
            try_particle(m, coefficient)
        elif abs(coefficient - m.last_coefficient) > m.renewal * abs(m.last_coefficient):
            scatter(m)
        rests = m.turn == PARTICLES
        move(m, (m.best[np.argmax(m.most)] if rests else m.place[m.turn]) - m.reference)
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


CURVES, POINTS, STEEPEST_PEAK = 8, 12, 0.6
"""Curves in the swarm, intervals to which they are fitted, and the greatest coefficient of a curve."""
CURVE, POINT = (0.0,) * CURVES, (0.0,) * POINTS

SWARM_SLIP = Table(
    "swarm-slip",
    **tuned(SEARCH, first=0.18, proportional=0.4, integral=8.0),
    largest=Column(0.02, "m s-1", "largest move", source=ASSUMED),
    **SEED,
    **SEARCHED,
    **GENERATOR,
    peak=Column(CURVE, ONE, "greatest coefficient of each curve"),
    optimum=Column(CURVE, "m s-1", "slip at which the curve has it"),
    peak_speed=Column(CURVE, ONE, "last move of the peak"),
    optimum_speed=Column(CURVE, "m s-1", "last move of the optimum"),
    best_peak=Column(CURVE, ONE, "peak with which the curve fitted best"),
    best_optimum=Column(CURVE, "m s-1", "optimum with which it did"),
    point_slip=Column(POINT, "m s-1", "slip of the last intervals, a ring"),
    point_coefficient=Column(POINT, ONE, "coefficient of the last intervals, a ring"),
    points=Column(0, ONE, "intervals since the unit became limited"),
)
SWARM_SLIP_ROW = SWARM_SLIP.dtype


@jit
def misfit(m, peak, optimum):
    """Sum of the squared distances of the points from the curve peak 2 x / (1 + x^2), x = slip / optimum."""
    total = 0.0
    for n in range(min(m.points, POINTS)):
        x = m.point_slip[n] / optimum
        error = m.point_coefficient[n] - peak * 2.0 * x / (1.0 + x * x)
        total += error * error
    return total


@jit
def best_curve(m):
    """Number of the curve whose best place fits the points best."""
    found, least = 0, math.inf
    for i in range(CURVES):
        error = misfit(m, m.best_peak[i], m.best_optimum[i])
        if error < least:
            found, least = i, error
    return found


@jit
def fit_curves(m, coefficient, slip):
    """Add a point, move the curves once, and return the optimum of the best one [m/s]."""
    if m.points == 0:  # over all optima, their peaks at what was found just now
        for i in range(CURVES):
            share = (i + draw(m)) / CURVES
            m.optimum[i] = m.best_optimum[i] = m.lowest * (m.highest / m.lowest) ** share
            m.peak[i] = m.best_peak[i] = clip(coefficient, 0.0, STEEPEST_PEAK)
            m.peak_speed[i] = m.optimum_speed[i] = 0.0
    n = m.points % POINTS
    m.point_slip[n], m.point_coefficient[n] = slip, coefficient
    m.points += 1
    lead = best_curve(m)
    peak, optimum = m.best_peak[lead], m.best_optimum[lead]
    for i in range(CURVES):
        own, common = draw(m), draw(m)
        speed = next_speed(m.peak[i], m.peak_speed[i], m.best_peak[i], peak, own, common)
        m.peak_speed[i], m.peak[i] = speed, clip(m.peak[i] + speed, 0.0, STEEPEST_PEAK)
        speed = next_speed(
            m.optimum[i], m.optimum_speed[i], m.best_optimum[i], optimum, own, common
        )
        m.optimum_speed[i], m.optimum[i] = speed, clip(m.optimum[i] + speed, m.lowest, m.highest)
        if misfit(m, m.peak[i], m.optimum[i]) < misfit(m, m.best_peak[i], m.best_optimum[i]):
            m.best_peak[i], m.best_optimum[i] = m.peak[i], m.optimum[i]
    return m.best_optimum[best_curve(m)]


@control
def swarm_slip(unit, axles, memory, run):
    """The slip held moves to the optimum of the best of a swarm of curves, after Zirek and Onat (2020).

    Their abstract has PI control of slip and a swarm of models, each with an estimate of the greatest coefficient. Assumed:
    models are curves, and are compared with the last intervals' coefficients, not by simulated speeds.
    """
    m = memory.view(SWARM_SLIP_ROW)[0]
    seeded(m, axles)
    if interval_is_over(unit, m, run):
        if math.isnan(m.last_coefficient):
            m.points = 0
        way = fit_curves(m, m.coefficient_sum / m.samples, m.slip_sum / m.samples) - m.reference
        move(m, clip(way, -m.largest, m.largest))
    hold_slip(unit, m, m.reference, unit.worst_slip, run)
