"""From a unit's limit to its torque target: limits (6) and (6'), load compensation, the motor's limit."""

from alloc.compilation import inlined_jit
from alloc.onboard.observer import empty_torque_limit, load_compensated
from alloc.plant.equations import GRAVITY


@inlined_jit
def set_targets(eq, st, m, commanded):
    """Torque target of each unit: (6) and (6') plus its wheelsets' inertia, within the motor's limit, with bounded rise."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    for j in range(eq.axles.size):
        limit = m.unit.limit[j] if commanded != 0.0 else 0.0
        empty = empty_torque_limit(limit, eq.empty_axle_mass[j], eq.radius[j], eq.gear[j])
        share = 1.0 + eq.own_inertia[j]
        wanted = share * load_compensated(empty, eq.empty_axle_mass[j], eq.load_per_axle[j])
        planned = m.train.expected[0] * (eq.empty_axle_mass[j] + eq.load_per_axle[j])
        step = share * planned * GRAVITY * eq.radius[j] / eq.gear[j] * st.period / st.rise_time
        bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
        m.rise[j] = min(min(wanted, bound), m.rise[j] + step) if commanded != 0.0 else 0.0
        m.unit.torque_target[j] = sign * m.rise[j]
        m.unit.air_brake_force[j] = 0.0
    m.lead.brake_rise[0] = 0.0


@inlined_jit
def restrain_blind_units(st, m):
    """A unit that knows the speed of none of its axles could not notice slip: it gets a part of its target."""
    for j in range(m.unit.torque_target.size):
        if m.unit.axles_seen[j] == 0.0:
            m.unit.torque_target[j] *= st.sensors.blind_share
