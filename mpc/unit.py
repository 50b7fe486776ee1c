"""The readhesion MPC of one traction unit: it holds the best slip that the rail offers, and finds it without a known curve.

A control period: readings become a belief (`mpc.belief.observe_axles`), the target slip moves (`seek_slip`), the problem of
the period is posed (`pose_problem`) and solved, its first torque is commanded (`command_torque`). CasADi solves it in
"mpc-casadi" (`mpc.problem.plan_row`), its compiled twin in "mpc" (`mpc.plan.plan_torques`); both command the same.
"""

import math
from typing import Any

from numba import objmode

from alloc.compilation import jit
from alloc.onboard.columns import NAN, ONE
from alloc.onboard.controllers import CONTROLLERS, register
from alloc.onboard.controllers.creep import clip
from alloc.onboard.controllers.plain import cut_and_ramp
from alloc.onboard.reference_speed import LIMITING
from alloc.onboard.signatures import control
from alloc.run.serving import CONTROLS, call_python
from alloc.schema.tables import Column, Table
from mpc.belief import AXLES, LEAST_SLIP, observe_axles, seek_slip
from mpc.plan import advance_slip, line_dynamics, plan_torques, torque_scale
from mpc.problem import BELIEVED, plan_row

STEPS, LATEST = 30, 10
"""Room for the longest horizon, and for the longest delay of computing, in control periods."""
ASSUMED, TUNED = "assumed", "tuned on 24 events of another seed than those that judge it"
OF_EACH, OF_STEPS = (0.0,) * AXLES, (0.0,) * STEPS
SQUARE: Any = (OF_STEPS,) * STEPS


def memory_of(name: str) -> tuple[float, ...]:
    """Memory of a unit's controller at the start of a run, as the default of a column."""
    return tuple(CONTROLLERS[name].rows(1)[0].tolist())


OF_DELAY, FALLBACK = (0.0,) * LATEST, memory_of("cut-and-ramp")
# The memory of a unit is one row, room for work included: nothing is allocated in a period, and one argument is handed on,
# where compiled code would count references of every array.

MPC = Table(
    "mpc",
    horizon=Column(15, ONE, "steps of the prediction, of a control period", source=TUNED),
    late=Column(0, ONE, "control periods that computing takes", source="the simulation: none"),
    change_weight=Column(0.758, ONE, "weight w_u of changes of torque", source=TUNED),
    slip_weight=Column(0.949, ONE, "weight w_s of slip beyond its limit", source=TUNED),
    pole=Column(25.0, "s-1", "pole of the filter of the pairs", source="the observer's"),
    first=Column(0.152, "m s-1", "target slip at first", source=TUNED),
    lowest=Column(0.0118, "m s-1", "least target slip", source=TUNED),
    highest=Column(1.6, "m s-1", "greatest target slip", source=ASSUMED),
    margin=Column(4.0, ONE, "least target slip over the noise of slip", source=ASSUMED),
    price=Column(0.098, "s m-1", "relative loss of force accepted per slip", source=TUNED),
    swing=Column(0.0456, ONE, "relative swing a of the slip limit", source=TUNED),
    loud=Column(1.5, ONE, "swing over the relative noise of slip, if more", source=TUNED),
    most=Column(0.3, ONE, "greatest swing", source=TUNED),
    turn=Column(31.4, "rad s-1", "angular frequency of the swing", source=ASSUMED),
    memory=Column(0.3, "s", "memory of the search", source=TUNED),
    gain=Column(15.0, "s-1", "relative speed of the target slip per elasticity", source=TUNED),
    fastest=Column(3.0, "s-1", "greatest relative speed of the target slip", source=TUNED),
    doubt=Column(0.1, ONE, "D over the square of a full answer", source=TUNED),
    least=Column(0.131, ONE, "least elasticity that is predicted with", source=TUNED),
    direction=Column(0.0, ONE, "direction of the demand a period ago; 0: begins anew"),
    torque=Column(NAN, "N m", "torque of a motor a period ago"),
    speed=Column(NAN, "m s-1", "train speed a period ago"),
    acceleration=Column(0.0, "m s-2", "acceleration of the train, filtered"),
    noise=Column(0.005, "m s-1", "deviation of a slip's noise"),
    sought=Column(NAN, "m s-1", "target slip, s*"),
    phase=Column(NAN, "rad", "phase p of the swing"),
    elasticity=Column(0.5, ONE, "elasticity e of the curve at the axle with most slip"),
    certainty=Column(0.0, ONE, "certainty c of it"),
    ticks=Column(0, ONE, "control periods for which the unit has been limited"),
    rim=Column(OF_EACH, "m s-1", "rim speed a period ago; nan: unknown"),
    reading=Column(OF_EACH, "m s-1", "slip as read"),
    last_reading=Column(OF_EACH, "m s-1", "slip as read a period ago"),
    slip=Column(OF_EACH, "m s-1", "slip, filtered"),
    coefficient=Column(OF_EACH, ONE, "coefficient, filtered, less the air brake's part"),
    mean_slip=Column(OF_EACH, ONE, "mean of the logarithm of the slip [m s-1]; nan: none"),
    mean_coefficient=Column(OF_EACH, ONE, "mean of the logarithm of the coefficient"),
    slip_answer=Column(OF_EACH, "s", "z_s, correlation of the slip with the answer expected"),
    coefficient_answer=Column(OF_EACH, "s", "z_mu, that of the coefficient"),
    problem=Column((0.0,) * len(BELIEVED.columns), ONE, "row of `BELIEVED`, the problem posed"),
    torques=Column(OF_STEPS, ONE, "torques of the last plan, over their scale"),
    pending=Column(OF_DELAY, "N m", "commands that are still being computed, the oldest first"),
    fallback=Column(FALLBACK, ONE, "memory of cut-and-ramp, for periods without a plan"),
    **{
        name: Column(room, ONE, f"room for work: {meaning}")
        for name, room, meaning in (
            ("free", OF_STEPS, "slip without torque"),
            ("answer", OF_STEPS, "answer of the slip to a torque"),
            ("slope", OF_STEPS, "first derivatives of the cost"),
            ("step", OF_STEPS, "Newton's step"),
            ("trial", OF_STEPS, "torques after a step"),
            ("hessian", SQUARE, "second derivatives of the cost"),
        )
    },
)
ROW, PROBLEM_ROW = MPC.dtype, BELIEVED.dtype


@control
def mpc(unit, axles, memory, run):
    """A control period."""
    # controllers have one signature, so the memory of each comes as plain numbers
    m = memory.view(ROW)[0]
    posed = pose_problem(unit, axles, m, run)
    solved = posed and plan_torques(m, m.problem.view(PROBLEM_ROW)[0], run.period)
    command_torque(unit, axles, m, solved, run)


@control
def mpc_casadi(unit, axles, memory, run):
    """A control period; CasADi's DAQP solves `mpc.problem` in the place of its compiled twin."""
    m = memory.view(ROW)[0]
    solved = pose_problem(unit, axles, m, run)
    if solved:
        row, torques, period = m.problem, m.torques[: m.horizon], run.period
        change, slip = m.change_weight, m.slip_weight
        # the solve alone is in Python: to box rows takes longer than it
        with objmode(solved="boolean"):
            solved = bool(call_python(CONTROLS, plan_row, row, torques, period, change, slip))
    command_torque(unit, axles, m, solved, run)


@jit
def torque_bound(unit, run):
    """Most torque [N m] that may be commanded; 0 where the readings are no numbers."""
    # a comparison with nan is false, so the last line needs no test of its own for it
    most = min(unit.torque_target, unit.drive_limit if run.sign > 0.0 else unit.brake_limit)
    return most if most > 0.0 else 0.0


@jit
def pose_problem(unit, axles, m, run):
    """Believe and search by the readings, and put the problem into `m.problem`; False where nothing is known of slip."""
    # the problem is a row of another table: memory keeps its numbers, and the view has its names
    upper, b, n = torque_bound(unit, run), m.problem.view(PROBLEM_ROW)[0], m.horizon
    if not math.isfinite(unit.motor_torque + unit.torque_target + run.reference_speed):
        return False
    b.radius, b.gear, b.load, b.inertia = unit.radius, unit.gear, unit.load, unit.inertia
    scale = torque_scale(b)
    if m.direction != run.sign:
        reset_memory(m, axles[0].unit, max(unit.motor_torque, 0.0), scale)
        m.direction, b.target = run.sign, unit.torque_target
    i = observe_axles(unit, axles, m, run)
    if i < 0:
        return False
    b.limit = seek_slip(unit, m, unit.motor_torque < LIMITING * upper, run.period)
    b.coefficient = max(m.coefficient[i] + unit.air / unit.load, 1e-3)
    b.pair_slip = max(m.slip[i], LEAST_SLIP, m.noise)
    b.elasticity = clip(m.elasticity, m.least, 1.0)
    b.air, b.acceleration, b.lag = unit.air, m.acceleration, unit.lag
    b.before = m.torques[0] * scale
    # changes have a price, but not to follow the target: behind a rising one the unit would look as if it held back
    if b.before >= LIMITING * b.target:
        b.before += unit.torque_target - b.target
    b.target, b.upper, b.share = unit.torque_target, upper, 1.0
    b.slip, b.torque, numbers = m.reading[i], m.torque, line_dynamics(b, run.period)
    for k in range(m.late):  # the plan begins when computing ends
        b.slip, b.torque = advance_slip(b.slip, b.torque, m.pending[k], 1.0, numbers)
    # Newton's method begins at the last plan, a period on: most of its torques stay
    for k in range(n):
        m.torques[k] = clip(m.torques[min(k + 1, n - 1)], 0.0, upper / scale)
    return True


@jit
def reset_memory(m, unit, torque, scale):
    """Nothing is known of the period before; `torque` [N m] of a motor has been commanded."""
    # nan stands for what is not known: a flag would be one more column that has to agree
    m.torque = m.speed = NAN
    for i in range(AXLES):
        m.rim[i] = NAN
    for k in range(STEPS):
        m.torques[k] = torque / scale
    for k in range(LATEST):
        m.pending[k] = torque
    if math.isnan(m.sought):
        m.sought, m.phase = m.first, 2.4 * unit  # units swing apart from each other


@jit
def command_torque(unit, axles, m, solved, run):
    """Command the plan's first torque; without a plan that of cut-and-ramp, which is a fault if any axle is seen."""
    torque = m.torques[0] * torque_scale(m.problem.view(PROBLEM_ROW)[0])
    if not solved:
        cut_and_ramp(unit, axles, m.fallback, run)
        torque, m.direction = unit.torque_command, 0.0
        unit.faults += 1 if unit.seen > 0 else 0
    due = m.pending[0] if m.late > 0 else torque
    for k in range(m.late):
        m.pending[k] = m.pending[k + 1] if k + 1 < m.late else torque
    unit.torque_command = min(due, torque_bound(unit, run)) if due > 0.0 else 0.0


BOUNDS: dict[str, tuple[float, float]] = {"horizon": (1, STEPS), "late": (0, LATEST)}
BOUNDS |= dict.fromkeys(
    ("change_weight", "slip_weight", "margin", "price", "loud"), (0.0, math.inf)
)
register(
    "mpc",
    mpc,
    "model predictive control of each unit",
    memory=MPC,
    colour="#aa39ff",
    marker="P",
    bounds=BOUNDS,
)
register(
    "mpc-casadi",
    mpc_casadi,
    "the same, solved by CasADi's DAQP",
    memory=MPC,
    colour="#d4a0ff",
    marker="*",
    bounds=BOUNDS,
)
