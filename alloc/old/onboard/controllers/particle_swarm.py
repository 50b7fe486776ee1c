"""Controllers with a particle swarm: one that fits curves and holds their best slip, one whose particles are slips.

In: coefficient and slip of a unit. Out: the slip that is held.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from alloc.old.compilation import called
from alloc.old.errors import OnboardError
from alloc.old.onboard.controllers.base import BuiltInController, Remembered
from alloc.old.onboard.controllers.creep import (
    hold_slip_of_unit,
    interval_is_over,
    interval_means,
    move_reference,
)
from alloc.old.onboard.controllers.swarm import between, drawn, seeded, swarm_speed
from alloc.old.records import quantity

# PI control at an optimum slip that a swarm of adhesion curves estimates, after Zirek and Onat (2020).
#
# From the source (Railway Engineering Science 28, s40534-020-00223-w, abstract and list of symbols): a PI controller of
# slip operates together with a swarm of models, each with an estimate of the greatest friction coefficient. The optimum
# of the best model's adhesion-slip curve is the controller's reference. It is better than a fixed slip on a tram wheel
# test stand.
#
# Assumed: models are compared with the observer's coefficient at the slips of the last intervals, not by their own
# simulated speeds. A model is the curve peak * 2 x / (1 + x^2), x = slip / optimum slip. The number of models and the
# bounds are assumed too.


MODELS = 8
"""Curves in the swarm."""
POINTS = 12
"""Intervals to whose slip and coefficient a curve is fitted."""
HIGHEST_PEAK = 0.6
"""Greatest coefficient that a curve may have at its peak."""

_MODEL, _POINT = (0.0,) * MODELS, (0.0,) * POINTS
_SWARM: Remembered = {
    "peak": _MODEL,  # greatest coefficient of every curve
    "optimum": _MODEL,  # slip velocity at which it has it [m/s]
    "peak_speed": _MODEL,
    "optimum_speed": _MODEL,
    "best_peak": _MODEL,
    "best_optimum": _MODEL,
    "point_slip": _POINT,  # means of the last intervals, in a ring
    "point_coefficient": _POINT,
    "points": 0,  # so many since the unit was limited
    "generator": 0,
}


@called
def curve(slip, peak, optimum):
    """Coefficient at this slip velocity [m/s] of a curve with its `peak` at `optimum` [m/s]."""
    x = slip / optimum
    return peak * 2.0 * x / (1.0 + x * x)


@called
def misfit(k, j, peak, optimum):
    """Sum of the squared distances between unit `j`'s points and a curve."""
    total = 0.0
    for n in range(min(k.points[j], POINTS)):
        error = k.point_coefficient[j, n] - curve(k.point_slip[j, n], peak, optimum)
        total += error * error
    return total


@called
def scatter_models(k, j, p, bounds, coefficient):
    """Place unit `j`'s curves over all optima between the bounds, with their peaks at the coefficient found just now."""
    if k.generator[j] == 0:
        k.generator[j] = seeded(p.seed, j)
    for i in range(MODELS):
        share = (i + drawn(k.generator, j)) / MODELS
        k.optimum[j, i] = k.best_optimum[j, i] = (
            bounds.lowest * (bounds.highest / bounds.lowest) ** share
        )
        k.peak[j, i] = k.best_peak[j, i] = between(coefficient, 0.0, HIGHEST_PEAK)
        k.peak_speed[j, i] = k.optimum_speed[j, i] = 0.0


@called
def best_model(k, j):
    """Number of unit `j`'s curve whose best place fits the points best."""
    found, least = 0, math.inf
    for i in range(MODELS):
        error = misfit(k, j, k.best_peak[j, i], k.best_optimum[j, i])
        if error < least:
            found, least = i, error
    return found


@called
def fit_models(k, j, p, bounds, coefficient, slip):
    """Add a point of unit `j` [1, m/s], move its curves once, and return the optimum of the best one [m/s]."""
    if k.points[j] == 0:
        scatter_models(k, j, p, bounds, coefficient)
    place = k.points[j] % POINTS
    k.point_slip[j, place], k.point_coefficient[j, place] = slip, coefficient
    k.points[j] += 1
    lead = best_model(k, j)
    peak, optimum = k.best_peak[j, lead], k.best_optimum[j, lead]
    for i in range(MODELS):
        own, common = drawn(k.generator, j), drawn(k.generator, j)
        speed = swarm_speed(k.peak[j, i], k.peak_speed[j, i], k.best_peak[j, i], peak, own, common)
        k.peak_speed[j, i] = speed
        k.peak[j, i] = between(k.peak[j, i] + speed, 0.0, HIGHEST_PEAK)
        speed = swarm_speed(
            k.optimum[j, i], k.optimum_speed[j, i], k.best_optimum[j, i], optimum, own, common
        )
        k.optimum_speed[j, i] = speed
        k.optimum[j, i] = between(k.optimum[j, i] + speed, bounds.lowest, bounds.highest)
        moved = misfit(k, j, k.peak[j, i], k.optimum[j, i])
        if moved < misfit(k, j, k.best_peak[j, i], k.best_optimum[j, i]):
            k.best_peak[j, i], k.best_optimum[j, i] = k.peak[j, i], k.optimum[j, i]
    return k.best_optimum[j, best_model(k, j)]


@called
def swarm_slip_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    bounds, search = st.law.perturb_observe, m.law.perturb_observe
    if interval_is_over(st, m, bounds, search, j):
        coefficient, slip = interval_means(search, j)
        if math.isnan(search.last_coefficient[j]):
            k.points[j] = 0
        way = fit_models(k, j, p, bounds, coefficient, slip) - search.reference[j]
        step = between(way, -p.largest, p.largest)
        move_reference(bounds, search, j, step, coefficient, slip)
    return hold_slip_of_unit(
        eq, st, m, st.law.creep, search.allowed, search.reference[j], m.worst_slip[j], j, commanded
    )


@dataclass(frozen=True)
class SwarmSlip(BuiltInController, remembered=_SWARM):
    """PI creep control at the optimum of the curve that a swarm of `MODELS` fits to the last `POINTS` intervals.

    Every interval the curves move once, and the reference moves towards the best curve's optimum. Interval, bounds of the
    optima and the memory of the search are those of `PerturbObserve`.

    Source: Zirek, Onat (2020); the values are assumed.
    """

    name = "swarm-slip"
    meaning = "PI control at the optimum slip of a swarm of curves (Zirek, Onat 2020)"
    colour = "#390071"
    marker = "8"
    law = swarm_slip_unit

    largest: float = quantity(0.02, "km/h")
    """Largest move of the reference per interval [m/s]."""
    seed: float = quantity(1.0, "1")
    """Seed of the draws."""

    def __post_init__(self) -> None:
        OnboardError.check("swarm-slip", self, ("largest",), ("seed",))


# Adhesion tracking by a particle swarm after Abouzeid et al. (arXiv 2406.13650): the particles are slips that are
# tried.
#
# From the source (only the abstract could be read): it has two strategies that overcome the limitations of perturb-
# observe and steepest gradient. One of them finds the slip of the largest adhesion by particle swarm optimisation.
#
# The algorithm is assumed, as the abstract prints none. One particle after the other is held as the creep reference for
# an interval, as is usual in tracking the power of solar cells. The coefficient is its fitness. Best values fade,
# because the rail changes. A swarm that has gathered rests at its best place until the coefficient changes.


PARTICLES = 3
"""As few as make a swarm: each particle costs an interval of driving at its slip."""

_EACH = (0.0,) * PARTICLES
_SWARM_swarm_tracking: Remembered = {
    "place": _EACH,  # slip velocity of every particle [m/s]
    "speed": _EACH,  # by which it moved last [m/s]
    "best": _EACH,  # place where it found most [m/s]
    "most": _EACH,  # coefficient it found there, faded
    "turn": -1,  # particle that is tried; -1: none yet, PARTICLES: all rest at the swarm's best place
    "generator": 0,
}


@called
def best_particle(most):
    """Number of the particle whose best place gave the largest coefficient; `most` (particles,)."""
    found = 0
    for i in range(most.size):
        if most[i] > most[found]:
            found = i
    return found


@called
def scatter_swarm(k, j, centre, p, bounds):
    """Place the particles of unit `j` about `centre` [m/s], the first one on it; no place has been tried yet."""
    for i in range(PARTICLES):
        side = 1.0 if i % 2 == 1 else -1.0
        away = side * p.spread * float((i + 1) // 2)
        k.place[j, i] = k.best[j, i] = between(centre + away, bounds.lowest, bounds.highest)
        k.speed[j, i] = 0.0
        k.most[j, i] = -math.inf
    k.turn[j] = 0


@called
def move_swarm(k, j, p, bounds):
    """A step of all particles of unit `j`; returns how far the farthest one lies from the swarm's best place [m/s]."""
    leader = k.best[j, best_particle(k.most[j])]
    farthest = 0.0
    for i in range(PARTICLES):
        own, common = drawn(k.generator, j), drawn(k.generator, j)
        speed = swarm_speed(k.place[j, i], k.speed[j, i], k.best[j, i], leader, own, common)
        place = between(k.place[j, i] + speed, bounds.lowest, bounds.highest)
        k.speed[j, i], k.place[j, i] = place - k.place[j, i], place
        k.most[j, i] *= p.keep
        farthest = max(farthest, abs(place - leader))
    return farthest


@called
def try_particles(k, j, p, bounds, held, coefficient, last):
    """Note the `coefficient` of an interval in which unit `j` `held` a slip; returns the slip to hold next [m/s].

    `last`: coefficient of the interval before; nan if there is none, and the search begins.
    """
    if k.generator[j] == 0:
        k.generator[j] = seeded(p.seed, j)
    turn = k.turn[j]
    if turn < 0 or math.isnan(last):
        scatter_swarm(k, j, held, p, bounds)
    elif turn == PARTICLES:
        if abs(coefficient - last) > p.change * abs(last):
            scatter_swarm(k, j, held, p, bounds)
    else:
        if coefficient > k.most[j, turn]:
            k.most[j, turn], k.best[j, turn] = coefficient, k.place[j, turn]
        k.turn[j] = turn + 1
        if k.turn[j] == PARTICLES and move_swarm(k, j, p, bounds) > p.gathered:
            k.turn[j] = 0
    if k.turn[j] == PARTICLES:
        return k.best[j, best_particle(k.most[j])]
    return k.place[j, k.turn[j]]


@called
def swarm_tracking_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    bounds, search = st.law.perturb_observe, m.law.perturb_observe
    if interval_is_over(st, m, bounds, search, j):
        coefficient, slip = interval_means(search, j)
        held, last = search.reference[j], search.last_coefficient[j]
        wanted = try_particles(k, j, p, bounds, held, coefficient, last)
        move_reference(bounds, search, j, wanted - held, coefficient, slip)
    return hold_slip_of_unit(
        eq, st, m, st.law.creep, search.allowed, search.reference[j], m.worst_slip[j], j, commanded
    )


@dataclass(frozen=True)
class SwarmTracking(BuiltInController, remembered=_SWARM_swarm_tracking):
    """Particle swarm tracking: `PARTICLES` slip velocities are held in turn, then the swarm moves.

    Interval, bounds and the search's memory are those of `PerturbObserve`. The spread is a compromise: over 24 events of
    `studies.ladder.events` (seed 1000) 0.02 m/s used 97.6 % where short on the narrow peak and 93.7 % on the wide one, 0.07
    m/s 93.3 and 98.4 %, this one 96.1 and 97.2 % (multiple units).

    Source: arXiv 2406.13650; the values are assumed.
    """

    name = "swarm-tracking"
    meaning = "creep control whose reference is searched by a particle swarm (arXiv 2406.13650)"
    colour = "#550039"
    marker = "d"
    law = swarm_tracking_unit

    spread: float = quantity(0.04, "km/h")
    """Distance of the swarm's particles at the start, about the reference [m/s]. Source: tuned on 24 events of
    `studies.ladder.events` (seed 1000)."""
    keep: ClassVar[float] = 0.98
    """Factor by which the best value that a particle found decreases after every round."""
    gathered: ClassVar[float] = 0.015
    """Once all particles are within this distance of the best place, that slip is held [m/s]."""
    change: ClassVar[float] = 0.05
    """The search begins again once the coefficient changes by this share from one interval to the next."""
    seed: float = quantity(1.0, "1")
    """Seed of the draws."""

    def __post_init__(self) -> None:
        OnboardError.check("swarm-tracking", self, ("spread",), ("seed",))
