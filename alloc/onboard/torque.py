"""From a unit's limit to its torque command: limits (6) and (6'), load compensation, readhesion control."""

from alloc.compilation import inlined_jit
from alloc.onboard import memory as om
from alloc.onboard.cut_and_ramp import cut_and_ramp
from alloc.onboard.observer import empty_torque_limit, load_compensated
from alloc.plant.equations import GRAVITY


@inlined_jit
def set_targets(eq, st, m, commanded):
    """Torque target of each unit: (6) and (6') plus its wheelsets' inertia, within the motor's limit, with bounded rise."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    for j in range(eq.axles.size):
        limit = m.limit[j] if commanded != 0.0 else 0.0
        empty = empty_torque_limit(limit, eq.empty_axle_mass[j], eq.radius[j], eq.gear[j])
        share = 1.0 + eq.own_inertia[j]
        wanted = share * load_compensated(empty, eq.empty_axle_mass[j], eq.load_per_axle[j])
        planned = m.held[om.HELD_EXPECTED] * (eq.empty_axle_mass[j] + eq.load_per_axle[j])
        step = share * planned * GRAVITY * eq.radius[j] / eq.gear[j] * st.period / st.rise_time
        bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
        m.rise[j] = min(min(wanted, bound), m.rise[j] + step) if commanded != 0.0 else 0.0
        m.target[j] = sign * m.rise[j]
        m.air[j] = 0.0
    m.brake_rise[0] = 0.0


@inlined_jit
def cut_and_ramp_unit(eq, st, m, j, commanded):
    """Built-in readhesion control of unit `j`: fills its torque command."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    to_torque = eq.axle_load[j] * eq.radius[j] / eq.gear[j]
    cut, recover, hold, ramp = st.readhesion
    rate = m.held[om.HELD_EXPECTED] * to_torque / ramp
    # what the air brake takes of the rail's force is not the motors' to have
    air = m.air[j] * eq.radius[j] / eq.gear[j]
    m.phase[j], m.clock[j], m.base[j], torque = cut_and_ramp(
        m.phase[j],
        m.clock[j],
        m.base[j],
        sign * m.command[j],
        sign * m.target[j],
        m.slipping[j],
        m.estimate[j] * to_torque - air,
        cut,
        recover,
        hold,
        rate,
        st.period,
    )
    m.command[j] = sign * torque


@inlined_jit
def control(eq, st, m, commanded):
    """Torque commands of all units by the built-in controller of the run."""
    for j in range(eq.axles.size):
        if st.controller == om.CONTROLLER_NONE:
            m.command[j] = m.target[j]
        else:
            cut_and_ramp_unit(eq, st, m, j, commanded)
