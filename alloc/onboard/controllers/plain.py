"""Controllers without a search: none, cut and ramp, the readhesion paper's table."""

import math

from alloc.compilation import jit
from alloc.onboard.columns import NAN, ONE
from alloc.onboard.controllers.controller import register
from alloc.onboard.controllers.creep import ASSUMED, TUNED, has_lasted, lag_share, per_coefficient
from alloc.onboard.signatures import control
from alloc.schema.tables import Column, Table

NO_LESS_THAN_0 = (0.0, math.inf)


@control
def follow_target(unit, axles, memory, run):
    """The torque follows its target whatever the wheels do."""
    unit.torque_command = unit.torque_target


FOLLOW, CUT, HOLD, RAMP = range(4)
GIVEN_UP = 3.0
"""Time after which a cut that does not end the slip goes to no torque: the estimate was too high [s]."""

CUT_AND_RAMP = Table(
    "cut-and-ramp",
    cut=Column(0.33, ONE, "torque at a detection over what the rail carried", source=TUNED),
    recover=Column(1.0, ONE, "torque held after slip over what the rail carried", source=TUNED),
    hold=Column(0.048, "s", "time for which it is held", source=TUNED),
    ramp=Column(3.0, "s", "time in which the torque rises by the plan's", source=ASSUMED),
    phase=Column(FOLLOW, ONE, "0 follows, 1 cut, 2 holds, 3 ramps"),
    ticks=Column(0, ONE, "control periods in it"),
    carried=Column(0.0, "N m", "torque that the rail carried at the detection"),
)
CUT_AND_RAMP_ROW = CUT_AND_RAMP.dtype


@control
def cut_and_ramp(unit, axles, memory, run):
    """On slip the torque is cut to a part of what the observer says the rail carries, held, and raised again.

    After Kadowaki and Ohishi, who print no values. Slip in a later phase begins again with the new estimate.
    """
    m = memory.view(CUT_AND_RAMP_ROW)[0]
    scale, target = per_coefficient(unit), unit.torque_target
    m.ticks += 1
    if unit.slipping and m.phase != CUT:
        m.phase, m.ticks = CUT, 0
        # what the air brake takes of the rail's force is not the motors' to have
        rail = (unit.coefficient_estimate - unit.air / unit.load) * scale
        m.carried = min(max(rail, 0.0), target)
    elif m.phase == CUT and not unit.slipping:
        m.phase, m.ticks = HOLD, 0
    elif m.phase == HOLD and has_lasted(m.ticks, m.hold, run.period):
        m.phase = RAMP
    elif m.phase == RAMP and unit.torque_command >= target:
        m.phase = FOLLOW
    torque = target
    if m.phase == CUT:
        torque = 0.0 if has_lasted(m.ticks, GIVEN_UP, run.period) else m.cut * m.carried
    elif m.phase == HOLD:
        torque = m.recover * m.carried
    elif m.phase == RAMP:
        torque = unit.torque_command + run.plan * scale / m.ramp * run.period
    unit.torque_command = min(torque, target)


CALIBRATED = "calibrated in `studies.readhesion_paper`; the paper does not print it"
CASE_A = "readhesion paper, case A, read as km/h/s"

TORQUE_TABLE = Table(
    "table",
    margin=Column(0.4 / 3.6, "m s-2", "deviation a_0 up to which the factor is 1", source=CASE_A),
    width=Column(0.2 / 3.6, "m s-2", "deviation a_w over which it falls to 0", source=CASE_A),
    rise=Column(1.8, "s", "time constant T_u of a rising torque", source=CALIBRATED),
    fall=Column(0.25, "s", "time constant T_d of a falling torque", source=CALIBRATED),
    time_constant=Column(0.18, "s", "tau of the pseudo-differentiator", source=CALIBRATED),
    filtered=Column(NAN, "m s-1", "rim speed behind its filter"),
)
TORQUE_TABLE_ROW = TORQUE_TABLE.dtype


@jit
def torque_factor(deviation, margin, width):
    """Factor Adl of the readhesion paper's Fig. 5: 1 up to `margin`, 0 from `margin` + `width` on; all [m/s2]."""
    return min(max(1.0 - (deviation - margin) / width, 0.0), 1.0)


@jit
def asymmetric_lag(value, wanted, rise_share, fall_share):
    """A period of the filter behind the factor; the shares are `lag_share` of its time constants rising and falling."""
    return value + (rise_share if wanted > value else fall_share) * (wanted - value)


@control
def torque_table(unit, axles, memory, run):
    """A static table: torque factor over the deviation from the acceleration commanded (readhesion paper, section 2.3)."""
    m = memory.view(TORQUE_TABLE_ROW)[0]
    if math.isnan(m.filtered):
        m.filtered = unit.rim
    acceleration = (unit.rim - m.filtered) / m.time_constant
    m.filtered += lag_share(m.time_constant, run.period) * (unit.rim - m.filtered)
    deviation = run.sign * acceleration - abs(run.driver_command)
    wanted = torque_factor(deviation, m.margin, m.width) * unit.torque_target
    shares = lag_share(m.rise, run.period), lag_share(m.fall, run.period)
    filtered = asymmetric_lag(unit.torque_command, wanted, shares[0], shares[1])
    unit.torque_command = min(filtered, unit.torque_target)


register(
    "none",
    follow_target,
    "torque follows the limit whatever the wheels do",
    colour="#aa8e55",
    marker="o",
)
register(
    "table",
    torque_table,
    "torque factor by the deviation of acceleration (readhesion paper, section 2.3)",
    memory=TORQUE_TABLE,
    colour="#c60055",
    marker="v",
    bounds={"margin": NO_LESS_THAN_0},
)
register(
    "cut-and-ramp",
    cut_and_ramp,
    "cut on slip to what the observer says the rail carries, hold, ramp back",
    memory=CUT_AND_RAMP,
    colour="#00aaaa",
    marker="s",
    bounds={"cut": (0.0, 1.0), "recover": (0.0, 1.0), "hold": NO_LESS_THAN_0},
)
