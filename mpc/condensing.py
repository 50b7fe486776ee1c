"""The cost of a trajectory and its condensed quadratic model in the torques, compiled.

cost = sum over the horizon of tracking ((u - target) / U)^2 + rate ((u - u_before) / U)^2
     + slip / axles * sum over the axles of (max(0, slip - limit) / slip scale)^2 at the step's end.

The penalty of slip is a soft constraint with its slack eliminated. Unknown is u / U, U the torque scale.
"""

from numba import float64, void

from mpc.shooting import CUBE, MATRIX, VECTOR, sweep

TRACKING, SLIP, RATE, TORQUE_SCALE, SLIP_SCALE, WEIGHTS = range(6)
"""Entries of the vector of weights, and its size."""


@sweep(float64(MATRIX, VECTOR, MATRIX, VECTOR, float64, float64, VECTOR))
def trajectory_cost(nodes, torques, slip_matrix, slip_limit, target, before, weights):
    """Cost of `nodes` (horizon + 1, states) under `torques` (horizon,).

    `slip_matrix` (axles, states) and `slip_limit` (axles,) [m/s]; `target` and the torque `before` the horizon [N m].
    """
    axles, states = slip_matrix.shape
    scale = 1.0 / weights[TORQUE_SCALE]
    cost = 0.0
    last = before
    for k in range(torques.size):
        deviation, change = (torques[k] - target) * scale, (torques[k] - last) * scale
        cost += weights[TRACKING] * deviation * deviation + weights[RATE] * change * change
        last = torques[k]
        for i in range(axles):
            slip = -slip_limit[i]
            for j in range(states):
                slip += slip_matrix[i, j] * nodes[k + 1, j]
            excess = max(slip, 0.0) / weights[SLIP_SCALE]
            cost += weights[SLIP] / axles * excess * excess
    return cost


@sweep(
    void(
        MATRIX, CUBE, VECTOR, MATRIX, VECTOR, float64, float64, VECTOR,
        MATRIX, MATRIX, MATRIX, VECTOR, CUBE,
    )
)  # fmt: skip
def condense(
    nodes, sensitivity, torques, slip_matrix, slip_limit, target, before, weights,
    hessian, adjoint, row, gradient, influence,
):  # fmt: skip
    """Fill the Gauss-Newton `hessian` (horizon, horizon) and `gradient` (horizon,) of the cost by u / U.

    Also fills `influence` (horizon + 1, states, horizon), the nodes' derivative by u / U, and `adjoint` (horizon + 1,
    states), the derivative of the cost to go by the node. `row` (axles, horizon) is scratch.
    """
    axles, states = slip_matrix.shape
    horizon = torques.size
    scale = 1.0 / weights[TORQUE_SCALE]
    w_track, w_rate = 2.0 * weights[TRACKING], 2.0 * weights[RATE]
    w_slip = 2.0 * weights[SLIP] / (axles * weights[SLIP_SCALE] * weights[SLIP_SCALE])
    hessian[:] = 0.0
    adjoint[:] = 0.0
    last = before
    for k in range(horizon):
        gradient[k] = w_track * (torques[k] - target) * scale
        change = w_rate * (torques[k] - last) * scale
        gradient[k] += change
        hessian[k, k] += w_track + w_rate
        if k > 0:
            gradient[k - 1] -= change
            hessian[k - 1, k - 1] += w_rate
            hessian[k - 1, k] -= w_rate
        last = torques[k]
    influence[0] = 0.0
    for k in range(horizon):
        for i in range(states):
            for m in range(horizon):
                influence[k + 1, i, m] = 0.0
            influence[k + 1, i, k] = sensitivity[k, i, states] * weights[TORQUE_SCALE]
            for j in range(states):
                value = sensitivity[k, i, j]
                if value != 0.0:
                    for m in range(k):
                        influence[k + 1, i, m] += value * influence[k, j, m]
        for i in range(axles):
            slip = -slip_limit[i]
            for j in range(states):
                slip += slip_matrix[i, j] * nodes[k + 1, j]
            if slip <= 0.0:
                continue
            for j in range(states):
                adjoint[k + 1, j] += w_slip * slip * slip_matrix[i, j]
            for m in range(k + 1):
                row[i, m] = 0.0
                for j in range(states):
                    row[i, m] += slip_matrix[i, j] * influence[k + 1, j, m]
            for m in range(k + 1):
                part = w_slip * row[i, m]
                for n in range(m, k + 1):
                    hessian[m, n] += part * row[i, n]
    for k in range(horizon - 1, -1, -1):
        for j in range(states):
            gradient[k] += adjoint[k + 1, j] * sensitivity[k, j, states] * weights[TORQUE_SCALE]
        for i in range(states):
            for j in range(states):
                adjoint[k, i] += sensitivity[k, j, i] * adjoint[k + 1, j]
    for m in range(horizon):
        for n in range(m):
            hessian[m, n] = hessian[n, m]


@sweep(void(CUBE, CUBE, float64, MATRIX, MATRIX))
def add_second_order(hessians, influence, torque_scale, hessian, scratch):
    """Add to `hessian` the model's second-order terms `hessians` (horizon, states + 1, states + 1).

    `scratch` (2 (states + 1), horizon).
    """
    horizon, size = hessians.shape[0], hessians.shape[1]
    for k in range(horizon):
        for i in range(size - 1):
            for m in range(k + 1):
                scratch[i, m] = influence[k, i, m] if m < k else 0.0
        for m in range(k + 1):
            scratch[size - 1, m] = torque_scale if m == k else 0.0
        for i in range(size):
            for m in range(k + 1):
                scratch[size + i, m] = 0.0
            for j in range(size):
                value = hessians[k, i, j]
                if value != 0.0:
                    for m in range(k + 1):
                        scratch[size + i, m] += value * scratch[j, m]
        for i in range(size):
            for m in range(k + 1):
                left = scratch[i, m]
                for n in range(m, k + 1):
                    hessian[m, n] += left * scratch[size + i, n]
    for m in range(horizon):
        for n in range(m):
            hessian[m, n] = hessian[n, m]
