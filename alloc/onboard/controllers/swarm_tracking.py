"""Adhesion tracking by a particle swarm after Abouzeid et al. (arXiv 2406.13650): the particles are slips that are tried.

From the source (only the abstract could be read): it has two strategies that overcome the limitations of perturb-observe and
steepest gradient. One of them finds the slip of the largest adhesion by particle swarm optimisation.

The algorithm is assumed, as the abstract prints none. One particle after the other is held as the creep reference for an
interval, as is usual in tracking the power of solar cells. The coefficient is its fitness. Best values fade, because the
rail changes. A swarm that has gathered rests at its best place until the coefficient changes.
"""

import math
from dataclasses import dataclass

from alloc.compilation import called
from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import BuiltInController, Remembered
from alloc.onboard.controllers.peak_search import (
    interval_is_over,
    interval_means,
    move_reference,
)
from alloc.onboard.controllers.pi_creep import hold_slip_of_unit
from alloc.onboard.controllers.swarm import between, drawn, seeded, swarm_speed
from alloc.onboard.quantity import quantity

PARTICLES = 3
"""As few as make a swarm: each particle costs an interval of driving at its slip."""

_EACH = (0.0,) * PARTICLES
_SWARM: Remembered = {
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
class SwarmTracking(BuiltInController, remembered=_SWARM):
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
    keep: float = quantity(0.98, "1")
    """Factor by which the best value that a particle found decreases after every round."""
    gathered: float = quantity(0.015, "km/h")
    """Once all particles are within this distance of the best place, that slip is held [m/s]."""
    change: float = quantity(0.05, "1")
    """The search begins again once the coefficient changes by this share from one interval to the next."""
    seed: float = quantity(1.0, "1")
    """Seed of the draws."""

    def __post_init__(self) -> None:
        names = ("spread", "keep", "gathered", "change")
        OnboardError.check("swarm-tracking", self, names, ("seed",))
