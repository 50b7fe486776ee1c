"""The force that a motion needs, linear in its weights: JP H07-322414 (2), (3), (6), (7) without the factor K_i.

F = (W1 or W2) V^2 + W3 (a + g sin(theta)), W1 in the open, W2 in tunnels. Beyond the source: + A + B V, the rest of a
running resistance, where five weights are used instead of three.

W3 represents two masses of a train that are not equal: gravity pulls its mass M, while acceleration moves M and the
equivalent mass of its turning wheelsets, M_r. Where M_r is known (it does not change with the load) M_r a is computed
separately and W3 is M.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from alloc.errors import OnboardError
from alloc.plant.model import Floats

WEIGHTS = ("W1", "W2", "W3")
"""Air resistance in the open and in tunnels [kg/m], mass [kg]: the source's weights, K1, K2 and K3/g of its claim 2."""
EXTENDED_WEIGHTS = (*WEIGHTS, "A", "B")
"""Also constant [N] and linear [N s/m] running resistance; not in the source."""


class Motion(NamedTuple):
    """A motion, measured or commanded; numbers or arrays of one shape."""

    speed: ArrayLike
    """V or V_c [m/s]."""
    acceleration: ArrayLike
    """a or a_c [m/s2]."""
    slope: ArrayLike
    """g sin(theta) [m/s2], positive uphill."""
    tunnel: ArrayLike
    """0 open, 1 tunnel; the train's share in tunnels where the memory is read at several points."""


def regressor(motion: Motion, weights: int = 3) -> Floats:
    """Regressors Z (..., weights) of `motion`; 3 or 5 weights, in the order of `EXTENDED_WEIGHTS`.

    Z1 = V^2 in the open, Z2 = V^2 in tunnels, Z3 = a + g sin(theta), and 1 and V. The source prints Z3 = a below its
    (5); (2), (3), (6) and (7) make it a + g sin(theta).
    """
    if weights not in (len(WEIGHTS), len(EXTENDED_WEIGHTS)):
        raise OnboardError(f"running resistance: weights = {weights!r} must be 3 or 5")
    speed, acceleration, slope, tunnel = (np.asarray(value, dtype=float) for value in motion)
    square = speed * speed
    pull = acceleration + slope + 0.0 * speed
    found = np.empty((*np.broadcast_shapes(square.shape, tunnel.shape, pull.shape), weights))
    found[..., 0], found[..., 1], found[..., 2] = square * (1.0 - tunnel), square * tunnel, pull
    if weights == len(EXTENDED_WEIGHTS):
        found[..., 3], found[..., 4] = 1.0, speed
    return found


def compensation_force(weights: ArrayLike, motion: Motion) -> Floats:
    """Running resistance F_d = F_V + F_g [N] of claims 1 and 2: `weights` (K1, K2, K3/g, ...), measured `motion`.

    The acceleration does not enter: the feedback makes the force for it.
    """
    weights = np.asarray(weights, dtype=float)
    return regressor(motion._replace(acceleration=0.0), weights.size) @ weights


def feedforward_force(weights: ArrayLike, motion: Motion, rotating_mass: float = 0.0) -> Floats:
    """Force [N] of (2) and (3) for the commanded `motion`, claims 3 to 5; `rotating_mass` M_r [kg]."""
    weights = np.asarray(weights, dtype=float)
    own = rotating_mass * np.asarray(motion.acceleration, dtype=float)
    return regressor(motion, weights.size) @ weights + own
