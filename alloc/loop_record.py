"""What the loop writes down of an instant, compiled."""

from alloc.compilation import equation, inlined_jit
from alloc.onboard.increment_learning import NO_LEARNING


@inlined_jit
def _copy(values, k, record):
    # element by element: an assignment of arrays compiles its check of shapes too, for seconds
    for f in range(values.shape[0]):
        for j in range(values.shape[1]):
            record[k, f, j] = values[f, j]


@inlined_jit
def record_computers(plant, eq, st, m, commanded, k, record):
    """Write to row `k` what the computers know and decide, `commanded` [m/s2] included."""
    m.train.driver_command[0] = commanded
    body = eq.unit_body[m.lead.unit[0]] if eq.axles.size > 0 else 0
    m.train.reference_speed[0] = m.reference[body]
    _copy(m.unit_block, k, record.unit)
    _copy(m.train_block, k, record.train)
    if st.learning.learner != NO_LEARNING:
        _copy(m.learning.block, k, record.learning)
    for g in range(plant.rows.groups):
        record.valve[k, g] = plant.inputs.valve[g]
    for s in range(plant.rows.sanders):
        record.sand_rate[k, s] = plant.inputs.sand_rate[s]
    for c in range(plant.rows.cars):
        record.slide_reference[k, c] = m.reference[min(c, m.reference.size - 1)]


@equation
def record_plant(plant, time, k, record):
    """Write the state at `time` [s] to row `k`."""
    record.time[k] = time
    for i in range(plant.state.size):
        record.state[k, i] = plant.state[i]


@equation
def record_noted(plant, k, record):
    """Write to row `k` what the plant noted in the step that began there."""
    noted = plant.workspace.noted
    for i in range(noted.peak.size):
        record.peak[k, i] = noted.peak[i]
    for i in range(noted.acceleration.size):
        record.body_acceleration[k, i] = noted.acceleration[i]
