"""The two phases of the real-time iteration, apart: what can be done before the readings, and what has to wait for them.

*Preparation*, once a command is out: predict the state of the next readings and the slip limit then, improve the guess from
there, and leave its trajectory and the derivatives. *Feedback*, on the readings: move that trajectory to the measured
state, to first order, and solve the quadratic program. So no evaluation of the model stands between the readings and the
command. Belief, slip limits and bounds are those of the readings; only the model's parameters are a control period old.

Diehl, Bock, Schloeder: A real-time iteration scheme for nonlinear optimization in optimal feedback control, SIAM J. Control
and Optimization 43 (2005) 1714-1736, section 3. The slip penalty is kept as it is, not linearised: the feedback phase
condenses anew, so a slip that passes its limit between the phases is seen with its curvature.
"""

from numba import float64, int64, types, void

from mpc.arrays import sweep
from mpc.sqp import ENDED, ahead, iterate, linearise_at, quadratic_model, quadratic_step
from mpc.sqp_period import PERIOD


@sweep(types.UniTuple(int64, 2)(int64, float64, PERIOD))
def preparation(most, time, p):
    """Make ready for readings `time` [s] ahead with at most `most` steps; returns steps done, and how it ended."""
    ahead(time, p)
    linearise_at(p.guess.torques, p)
    _, residual, end = quadratic_model(p)
    if most == 0 or end > ENDED or residual <= p.rules.tolerance:
        return 0, end
    _, _, done, end = iterate(most, p)
    linearise_at(p.guess.torques, p)
    return done, end


@sweep(void(PERIOD))
def move(p):
    """Move the prepared trajectory to the measured state, and the guess within its bounds, to first order."""
    guess, nodes, sensitivity = p.guess, p.around.nodes, p.around.sensitivity
    change, states = guess.nodes, nodes.shape[1]
    units = guess.torques.size // sensitivity.shape[0]
    for m in range(guess.torques.size):
        torque = min(max(guess.torques[m], 0.0), p.now.upper[m])
        guess.step[m] = torque - guess.torques[m]
        guess.torques[m] = torque
    for i in range(states):
        change[0, i] = p.now.state[i] - nodes[0, i]
        nodes[0, i] = p.now.state[i]
    for k in range(sensitivity.shape[0]):
        for i in range(states):
            moved = 0.0
            for j in range(states):
                moved += sensitivity[k, i, j] * change[k, j]
            for j in range(units):
                moved += sensitivity[k, i, states + j] * guess.step[k * units + j]
            change[k + 1, i] = moved
            nodes[k + 1, i] += moved


@sweep(types.Tuple((float64, float64, int64, int64))(PERIOD))
def feedback(p):
    """Answer the readings with one whole step from what `preparation` left; returns as `mpc.sqp.iterate`."""
    move(p)
    cost, residual, end = quadratic_model(p)
    if end == ENDED:
        end = quadratic_step(p)
    if end > ENDED:
        return cost, residual, 0, end
    for m in range(p.guess.torques.size):
        p.guess.torques[m] = p.guess.trial[m]
    return cost, residual, 1, ENDED
