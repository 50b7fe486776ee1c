"""The cost of a trajectory and its condensed quadratic model in the torques, compiled.

Of one unit or a group. With U_j the torque scale of unit j, w_j its share of the group's mass, and sums over the units:

cost = sum over the horizon of tracking (sum w_j (u_j - target_j) / U_j)^2 + rate sum w_j ((u_j - u_j before) / U_j)^2
     + evenness sum w_j ((u_j - reference_j) / U_j)^2
     + slip sum over the axles of share (max(0, slip - limit) / slip scale)^2 at the step's end.

So the group's total effort is tracked, whoever gives it; evenness alone says who. An axle's share is that of its unit,
divided by the unit's axles. The penalty of slip is a soft constraint with its slack eliminated. Unknowns are u_j / U_j.
"""

from numba import float64, void

from mpc.shooting import CUBE, MATRIX, VECTOR, sweep

TRACKING, SLIP, RATE, EVENNESS, SLIP_SCALE, WEIGHTS = range(6)
"""Entries of the vector of weights, and its size."""
TARGET, BEFORE, REFERENCE, TORQUE_SCALE, UNIT_SHARE, UNIT_ROWS = range(6)
"""Rows of the matrix of units (UNIT_ROWS, units): torques [N m], share of the group's mass."""
SLIP_LIMIT, AXLE_SHARE, AXLE_ROWS = range(3)
"""Rows of the matrix of axles (AXLE_ROWS, axles): slip velocity [m/s], share of the penalty."""


@sweep(float64(MATRIX, VECTOR, MATRIX, MATRIX, MATRIX, VECTOR))
def trajectory_cost(nodes, torques, slip_matrix, axle, unit, weights):
    """Cost of `nodes` (horizon + 1, states) under `torques` (horizon * units,).

    `slip_matrix` (axles, states); `axle` (AXLE_ROWS, axles), `unit` (UNIT_ROWS, units), `weights` (WEIGHTS,).
    """
    axles, states = slip_matrix.shape
    units = unit.shape[1]
    cost = 0.0
    for k in range(nodes.shape[0] - 1):
        missed = 0.0
        for j in range(units):
            u, scale, share = torques[k * units + j], unit[TORQUE_SCALE, j], unit[UNIT_SHARE, j]
            last = unit[BEFORE, j] if k == 0 else torques[(k - 1) * units + j]
            missed += share * (u - unit[TARGET, j]) / scale
            change, uneven = (u - last) / scale, (u - unit[REFERENCE, j]) / scale
            cost += share * (weights[RATE] * change * change + weights[EVENNESS] * uneven * uneven)
        cost += weights[TRACKING] * missed * missed
        for i in range(axles):
            slip = -axle[SLIP_LIMIT, i]
            for j in range(states):
                slip += slip_matrix[i, j] * nodes[k + 1, j]
            excess = max(slip, 0.0) / weights[SLIP_SCALE]
            cost += weights[SLIP] * axle[AXLE_SHARE, i] * excess * excess
    return cost


@sweep(void(VECTOR, MATRIX, VECTOR, MATRIX, VECTOR))
def _torque_terms(torques, unit, weights, hessian, gradient):
    """Fill the upper half of `hessian` and `gradient` with what the torques cost themselves."""
    units = unit.shape[1]
    horizon = torques.size // units
    hessian[:] = 0.0
    for k in range(horizon):
        missed = 0.0
        for j in range(units):
            here = k * units + j
            missed += (
                unit[UNIT_SHARE, j] * (torques[here] - unit[TARGET, j]) / unit[TORQUE_SCALE, j]
            )
        for j in range(units):
            here = k * units + j
            scale, share = unit[TORQUE_SCALE, j], unit[UNIT_SHARE, j]
            rate, even = 2.0 * weights[RATE] * share, 2.0 * weights[EVENNESS] * share
            track = 2.0 * weights[TRACKING] * share
            last = unit[BEFORE, j] if k == 0 else torques[here - units]
            change = rate * (torques[here] - last) / scale
            gradient[here] = track * missed + change
            gradient[here] += even * (torques[here] - unit[REFERENCE, j]) / scale
            hessian[here, here] += rate + even
            for i in range(j, units):
                hessian[here, here - j + i] += track * unit[UNIT_SHARE, i]
            if k > 0:
                gradient[here - units] -= change
                hessian[here - units, here - units] += rate
                hessian[here - units, here] -= rate


@sweep(
    void(
        MATRIX, CUBE, VECTOR, MATRIX, MATRIX, MATRIX, VECTOR, MATRIX, MATRIX, MATRIX, VECTOR, CUBE,
    )
)  # fmt: skip
def condense(
    nodes, sensitivity, torques, slip_matrix, axle, unit, weights,
    hessian, adjoint, row, gradient, influence,
):  # fmt: skip
    """Fill the Gauss-Newton `hessian` (horizon * units, horizon * units) and `gradient` of the cost by u / U.

    Also fills `influence` (horizon + 1, states, horizon * units), the nodes' derivative by u / U, and `adjoint`
    (horizon + 1, states), the derivative of the cost to go by the node. `row` (axles, horizon * units) is scratch.
    """
    axles, states = slip_matrix.shape
    units, size = unit.shape[1], torques.size
    horizon = size // units
    _torque_terms(torques, unit, weights, hessian, gradient)
    adjoint[:] = 0.0
    influence[0] = 0.0
    for k in range(horizon):
        before, known = k * units, (k + 1) * units
        for i in range(states):
            for m in range(size):
                influence[k + 1, i, m] = 0.0
            for j in range(units):
                moved = sensitivity[k, i, states + j] * unit[TORQUE_SCALE, j]
                influence[k + 1, i, before + j] = moved
            for j in range(states):
                value = sensitivity[k, i, j]
                if value != 0.0:
                    for m in range(before):
                        influence[k + 1, i, m] += value * influence[k, j, m]
        for i in range(axles):
            slip = -axle[SLIP_LIMIT, i]
            for j in range(states):
                slip += slip_matrix[i, j] * nodes[k + 1, j]
            if slip <= 0.0:
                continue
            w_slip = 2.0 * weights[SLIP] * axle[AXLE_SHARE, i] / weights[SLIP_SCALE] ** 2
            for m in range(known):
                row[i, m] = 0.0
            for j in range(states):
                value = slip_matrix[i, j]
                if value != 0.0:
                    adjoint[k + 1, j] += w_slip * slip * value
                    for m in range(known):
                        row[i, m] += value * influence[k + 1, j, m]
            for m in range(known):
                part = w_slip * row[i, m]
                for n in range(m, known):
                    hessian[m, n] += part * row[i, n]
    for k in range(horizon - 1, -1, -1):
        for j in range(states):
            for i in range(units):
                own = adjoint[k + 1, j] * sensitivity[k, j, states + i]
                gradient[k * units + i] += own * unit[TORQUE_SCALE, i]
        for j in range(states):
            for i in range(states):
                adjoint[k, i] += sensitivity[k, j, i] * adjoint[k + 1, j]
    for m in range(size):
        for n in range(m):
            hessian[m, n] = hessian[n, m]


@sweep(void(CUBE, CUBE, MATRIX, MATRIX, MATRIX))
def add_second_order(hessians, influence, unit, hessian, scratch):
    """Add to `hessian` the model's second-order terms `hessians` (horizon, states + units, states + units).

    `scratch` (2 (states + units), horizon * units).
    """
    horizon, width = hessians.shape[0], hessians.shape[1]
    units = unit.shape[1]
    states = width - units
    for k in range(horizon):
        before, known = k * units, (k + 1) * units
        for i in range(states):
            for m in range(known):
                scratch[i, m] = influence[k, i, m] if m < before else 0.0
        for j in range(units):
            for m in range(known):
                scratch[states + j, m] = unit[TORQUE_SCALE, j] if m == before + j else 0.0
        for i in range(width):
            for m in range(known):
                scratch[width + i, m] = 0.0
            for j in range(width):
                value = hessians[k, i, j]
                if value != 0.0:
                    for m in range(known):
                        scratch[width + i, m] += value * scratch[j, m]
        for i in range(width):
            for m in range(known):
                left = scratch[i, m]
                for n in range(m, known):
                    hessian[m, n] += left * scratch[width + i, n]
    for m in range(hessian.shape[0]):
        for n in range(m):
            hessian[m, n] = hessian[n, m]
