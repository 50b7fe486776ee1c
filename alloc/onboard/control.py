"""From a unit's torque target to its torque command, by the readhesion controller of the run.

A row of `Memory.control` is what the controller of a unit remembers; nan at the start. Everything counts positive in the
direction of the demand.
"""

import math

from alloc.compilation import inlined_jit, jit
from alloc.onboard import memory as om
from alloc.onboard import readhesion
from alloc.onboard.detector import differentiate
from alloc.onboard.readhesion.creep import gradient_step, hold_slip, perturbed_step
from alloc.onboard.readhesion.cut_and_ramp import FOLLOW, cut_and_ramp
from alloc.onboard.readhesion.torque_table import asymmetric_lag, torque_factor

LIMITING = 0.999
"""Share of its target below which a unit counts as limited by its readhesion controller, and a search goes on."""

ALLOWED, REFERENCE, STEP, CLOCK, COEFFICIENT_SUM, SLIP_SUM, COUNT, LAST_COEFFICIENT, LAST_SLIP = (
    range(9)
)
"""What creep controllers remember: integral, slip reference, its last step, and the means of the intervals."""


@jit
def cut_and_ramp_unit(eq, st, m, j, commanded):
    """Cut-and-ramp control of unit `j`: fills its torque command."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    to_torque = eq.axle_load[j] * eq.radius[j] / eq.gear[j]
    rate = m.held[om.HELD_EXPECTED] * to_torque / st.control[3]
    # what the air brake takes of the rail's force is not the motors' to have
    air = m.air[j] * eq.radius[j] / eq.gear[j]
    if math.isnan(m.control[j, 0]):
        m.control[j, 0], m.control[j, 1], m.control[j, 2] = FOLLOW, 0.0, 0.0
    phase, clock, base, torque = cut_and_ramp(
        int(m.control[j, 0]),
        m.control[j, 1],
        m.control[j, 2],
        sign * m.command[j],
        sign * m.target[j],
        m.slipping[j],
        m.estimate[j] * to_torque - air,
        st.control[0],
        st.control[1],
        st.control[2],
        rate,
        st.period,
    )
    m.control[j, 0], m.control[j, 1], m.control[j, 2] = phase, clock, base
    m.command[j] = sign * torque


@inlined_jit
def _table_unit(st, m, j, sign, commanded):
    if math.isnan(m.control[j, 0]):
        m.control[j, 0], m.control[j, 1] = m.speed[j], sign * m.command[j]
    m.control[j, 0], acceleration = differentiate(
        m.control[j, 0], m.speed[j], st.control[2], st.control[3]
    )
    deviation = sign * acceleration - abs(commanded)
    m.factor[j] = torque_factor(deviation, st.control[0], st.control[1])
    m.control[j, 1] = asymmetric_lag(
        m.control[j, 1], m.factor[j] * sign * m.target[j], st.control[4], st.control[5]
    )
    m.command[j] = sign * m.control[j, 1]


@inlined_jit
def _search(st, m, j):
    """Move the slip reference of unit `j` towards the peak; only while the controller limits the torque."""
    c = m.control[j]
    interval, lowest, highest = st.control[3], st.control[4], st.control[5]
    if m.factor[j] >= LIMITING:  # adhesion suffices: nothing to be learnt of the peak
        c[CLOCK] = c[COEFFICIENT_SUM] = c[SLIP_SUM] = c[COUNT] = 0.0
        c[LAST_COEFFICIENT] = math.nan
        return
    c[CLOCK] += st.period
    if c[CLOCK] > 0.5 * interval:  # the first half is for the slip to settle at its reference
        c[COEFFICIENT_SUM] += m.estimate[j]
        c[SLIP_SUM] += m.worst_slip[j]
        c[COUNT] += 1.0
    if c[CLOCK] < interval:
        return
    coefficient, slip = c[COEFFICIENT_SUM] / c[COUNT], c[SLIP_SUM] / c[COUNT]
    if math.isnan(c[LAST_COEFFICIENT]):
        if st.controller == readhesion.STEEPEST_GRADIENT:
            c[STEP] = math.copysign(st.control[7], c[STEP])
        else:
            c[STEP] = math.copysign(st.control[6], c[STEP])
    elif st.controller == readhesion.STEEPEST_GRADIENT:
        c[STEP] = gradient_step(
            c[STEP],
            coefficient - c[LAST_COEFFICIENT],
            slip - c[LAST_SLIP],
            st.control[6],
            st.control[7],
            st.control[8],
        )
    else:
        c[STEP] = perturbed_step(c[STEP], coefficient - c[LAST_COEFFICIENT], st.control[6])
    wanted = c[REFERENCE] + c[STEP]
    if wanted < lowest or wanted > highest:
        c[STEP] = -c[STEP]
    c[REFERENCE] = min(max(wanted, lowest), highest)
    c[LAST_COEFFICIENT], c[LAST_SLIP] = coefficient, slip
    c[CLOCK] = c[COEFFICIENT_SUM] = c[SLIP_SUM] = c[COUNT] = 0.0


@inlined_jit
def _creep_unit(eq, st, m, j, sign):
    to_torque = eq.axle_load[j] * eq.radius[j] / eq.gear[j]
    ceiling = sign * m.target[j] / to_torque
    c = m.control[j]
    if math.isnan(c[ALLOWED]):
        for k in range(c.size):
            c[k] = 0.0
        c[ALLOWED], c[REFERENCE], c[LAST_COEFFICIENT] = ceiling, st.control[2], math.nan
    if st.controller != readhesion.PI_CREEP:
        _search(st, m, j)
    c[ALLOWED], coefficient = hold_slip(
        c[ALLOWED], m.worst_slip[j], c[REFERENCE], ceiling, st.control[0], st.control[1], st.period
    )
    m.command[j] = sign * coefficient * to_torque


@inlined_jit
def control(eq, st, m, commanded):
    """Torque commands of all units by the built-in controller of the run, and the share of the target that they are."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    for j in range(eq.axles.size):
        if st.controller == readhesion.NONE:
            m.command[j] = m.target[j]
        elif st.controller == readhesion.TABLE:
            _table_unit(st, m, j, sign, commanded)
        elif st.controller == readhesion.CUT_AND_RAMP:
            cut_and_ramp_unit(eq, st, m, j, commanded)
        else:
            _creep_unit(eq, st, m, j, sign)
        if st.controller != readhesion.TABLE:  # its factor is that before its filter
            m.factor[j] = m.command[j] / m.target[j] if m.target[j] != 0.0 else 1.0
