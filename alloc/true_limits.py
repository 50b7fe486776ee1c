"""What the rail truly carries: the oracle's knowledge, which nobody on board has."""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.plant import compiled
from alloc.plant.adhesion_laws import adhesion_limit
from alloc.plant.right_side import peak_field

USED = 0.995
"""Share of the true adhesion that the oracle's units use. At the very peak a torque is not held."""

AHEAD = 0.02
"""Time [s] by which the oracle looks ahead: its torque is kept for a control period and lags behind its command."""


@inlined_jit
def _least_adhesion(w, eq, time, truth, trailing):
    """Lower `truth` (units,) and `trailing` (groups,) to the force per axle [N] that the weakest axle of each can carry.

    It is that of the state in the workspace's scratch.
    """
    y, axle = w.scratch.state, w.axle
    peak_field(w, time, y)
    for i in range(w.size.axles):
        j, g = eq.axle_unit[i], eq.axle_group[i]
        if j >= 0 or g >= 0:
            v = y[axle.speed_row[i]]
            limit, _ = adhesion_limit(
                w.rail.curve_kind, w.rail.curve, w.scratch.peak[i], v, axle.contact[i]
            )
            load = axle.static_load[i] - axle.unloading[i] * w.scratch.car_force[axle.car[i]]
            if j >= 0:
                truth[j] = min(truth[j], USED * limit * load)
            else:
                trailing[g] = min(trailing[g], USED * limit * load)


@inlined_jit
def true_limits(plant, eq, time, sign, braking, truth, trailing):
    """Coefficient of each unit whose torque the rail just carries: that of its weakest axle, whose wheels slip first.

    Part of the torque turns the wheelsets as the train goes, not as the plan has it.
    """
    w = plant.workspace
    for j in range(truth.size):
        truth[j] = np.inf
    for g in range(trailing.size):
        trailing[g] = np.inf
    compiled.pack(w, plant.state, w.scratch.state)
    _least_adhesion(w, eq, time, truth, trailing)
    for b in range(w.size.bodies):
        w.scratch.state[w.row.position + b] += AHEAD * w.scratch.state[w.row.speed + b]
    _least_adhesion(w, eq, time + AHEAD, truth, trailing)
    for j in range(truth.size):
        turning = eq.inertia[j] / eq.radius[j] ** 2 * sign * w.noted.acceleration[eq.unit_body[j]]
        share = 1.0 + (eq.brake_inertia[j] if braking else eq.own_inertia[j])
        truth[j] = max(truth[j] + turning, 0.0) / (share * eq.axle_load[j])
