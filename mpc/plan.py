"""The fast twin of `mpc.problem.solve` for one unit whose curve is believed to be a line: a few microseconds a period.

Wheelset and lag are linear then, so the slip after step k is s_k = free_k + sum over j <= k of answer_(k-j) u_j, and the
problem is one of the torques alone. `b` is a row of `mpc.problem.BELIEVED`, `m` one of `mpc.unit.MPC`, which has weights and
room for all work. Torques and slips count over their scales.

Loops over numbers stand in the place of matrices: an expression of arrays would make new ones in every period of every unit.
"""

import math

from alloc.compilation import jit
from mpc import problem
from mpc.problem import SLIP

NEAR = 1e-3
"""How near its bound a torque that is pushed against it counts as at it, at most [1] (Bertsekas 1982)."""
ROUNDING = 1e-13
"""Relative rise of the cost that rounding explains."""

torque_scale = jit(problem.torque_scale)


@jit
def line_dynamics(b, period):
    """Numbers of `advance_slip`, exact for a line: what a period keeps of slip and torque, and what it adds to the slip."""
    slope = b.elasticity * b.coefficient / b.pair_slip
    stiff = b.radius * b.radius * b.load / b.inertia
    keep, left = math.exp(-stiff * slope * period), math.exp(-period / b.lag)
    reach = (1.0 - keep) / (stiff * slope)
    share = b.lag / period * (1.0 - left)  # weight of the torque in its mean over a step
    push = stiff * (b.air / b.load - b.coefficient + slope * b.pair_slip) - b.acceleration
    return keep, left, share, reach * b.radius * b.gear / b.inertia, reach * push


@jit
def advance_slip(slip, torque, command, push, numbers):
    """Slip [m/s] and torque [N m] a period on; `push`: 1, or 0 for the answer to torque alone."""
    keep, left, share, reach, offset = numbers
    slip = keep * slip + reach * (share * torque + (1.0 - share) * command) + push * offset
    return slip, left * torque + (1.0 - left) * command


@jit
def plan_torques(m, b, period):
    """Put the torques that solve the problem into `m.torques`, from those in it on; whether they do.

    Newton's method on the torques that are off their bounds; a step is projected, and halved until the cost falls.
    """
    n, scale, numbers = m.horizon, torque_scale(b), line_dynamics(b, period)
    slip, torque, answer, answer_torque = b.slip, b.torque, 0.0, 0.0
    for k in range(n):
        slip, torque = advance_slip(slip, torque, 0.0, 1.0, numbers)
        command = scale if k == 0 else 0.0
        answer, answer_torque = advance_slip(answer, answer_torque, command, 0.0, numbers)
        m.free[k], m.answer[k] = slip / SLIP, answer / SLIP
    upper, cost = b.upper / scale, evaluate_cost(m, b, m.torques, scale)
    if not (cost < math.inf and upper >= 0.0):
        return False
    steepest = math.inf
    for _ in range(20):
        steepest = 0.0
        for k in range(n):
            u, m.step[k] = m.torques[k], m.slope[k]
            steepest = max(steepest, abs(u - min(max(u - m.slope[k], 0.0), upper)))
        if steepest < 1e-10:
            break
        near = min(NEAR, steepest)
        for k in range(n):
            u, slope = m.torques[k], m.slope[k]
            if (u <= near and slope > 0.0) or (u >= upper - near and slope < 0.0):
                for j in range(n):  # pushed against its bound, it goes there apart from the others
                    m.hessian[k, j] = m.hessian[j, k] = m.hessian[k, k] if j == k else 0.0
        solve_cholesky(m.step, m.hessian, n)
        share, trial_cost, enough = 1.0, math.inf, cost * (1.0 + ROUNDING)
        while not trial_cost <= enough and share > 1e-4:
            for k in range(n):
                m.trial[k] = min(max(m.torques[k] - share * m.step[k], 0.0), upper)
            trial_cost, share = evaluate_cost(m, b, m.trial, scale), 0.5 * share
        if not trial_cost <= enough:
            break
        # number by number: past versions of Numba refused to assign a whole column of a row, or did it wrong
        for k in range(n):
            m.torques[k] = m.trial[k]
        cost = trial_cost
    return steepest < 1e-6  # rounding hides the rest


@jit
def evaluate_cost(m, b, u, scale):
    """The cost of torques `u`; half of its first and second derivatives go into `m.slope` and `m.hessian`."""
    n, total, last = m.horizon, 0.0, b.before / scale
    for k in range(n):
        m.slope[k] = 0.0
        # the lower half alone: the factor reads no other
        for j in range(k + 1):
            m.hessian[k, j] = 0.0
        short, change, over = u[k] - b.target / scale, u[k] - last, m.free[k] - b.limit / SLIP
        for j in range(k + 1):
            over += m.answer[k - j] * u[j]
        total += short * short + m.change_weight * change * change
        m.slope[k] += short + m.change_weight * change
        m.hessian[k, k] += 1.0 + m.change_weight
        if k > 0:
            m.slope[k - 1] -= m.change_weight * change
            m.hessian[k - 1, k - 1] += m.change_weight
            m.hessian[k, k - 1] -= m.change_weight
        if not over <= 0.0:  # what is no number must reach the cost
            total += m.slip_weight * over * over
            for i in range(k + 1):
                m.slope[i] += m.slip_weight * m.answer[k - i] * over
                for j in range(i + 1):
                    m.hessian[i, j] += m.slip_weight * m.answer[k - i] * m.answer[k - j]
        last = u[k]
    return total


@jit
def solve_cholesky(x, a, n):
    """Put the solution of a y = x into `x`, by Cholesky's factor, which replaces the lower half of `a`: no other is read."""
    for i in range(n):
        for j in range(i + 1):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] = math.sqrt(a[i, i]) if i == j else a[i, j] / a[j, j]
        for k in range(i):
            x[i] -= a[i, k] * x[k]
        x[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= a[k, i] * x[k]
        x[i] /= a[i, i]
