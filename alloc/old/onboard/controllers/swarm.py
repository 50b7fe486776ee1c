"""Particle swarm optimisation in memory that is there already: one particle's move, and a generator that runs repeat.

Kennedy and Eberhart (1995), with the inertia of Shi and Eberhart (1998). The draws are those of the minimal standard
generator of Park and Miller (1988) with the multiplier 48271; its state is a part of the controller's memory.
"""

from alloc.old.compilation import equation

MULTIPLIER, MODULUS = 48271, 2147483647
UNIT_STRIDE = 1000003
"""Distance between the seeds of two units' generators."""

INERTIA, OWN, COMMON = 0.6, 1.2, 1.2
"""Weights of a particle's speed, of its own best place and of the swarm's: below Trelea's (2003) bound of divergence."""


@equation
def seeded(seed, j):
    """First state of unit `j`'s generator; 1 to MODULUS - 1."""
    state = 1 + (int(seed) * UNIT_STRIDE + (j + 1) * MULTIPLIER) % (MODULUS - 1)
    return state * MULTIPLIER % MODULUS * MULTIPLIER % MODULUS  # nearby seeds are far apart then


@equation
def drawn(generator, j):
    """Next number of unit `j`'s `generator` (units,), uniform between 0 and 1."""
    generator[j] = generator[j] * MULTIPLIER % MODULUS
    return generator[j] / MODULUS


@equation
def swarm_speed(place, speed, own_best, swarm_best, own_draw, common_draw):
    """Next speed of a particle in one direction: what it keeps, and the pull of both bests."""
    pull = OWN * own_draw * (own_best - place) + COMMON * common_draw * (swarm_best - place)
    return INERTIA * speed + pull


@equation
def between(value, low, high):
    """`value` within its bounds."""
    return min(max(value, low), high)
