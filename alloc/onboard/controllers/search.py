"""Creep control, which holds a slip, and searches for the slip that the rail answers best.

In: the unit's coefficient estimate and the slip of its worst axle, as sensed. Out: its torque command. All searches share
the inner loop (`hold_slip`), and all but one the interval over which they compare (`interval_is_over`).
"""

import math
from dataclasses import replace

from alloc.backends import compiled as law
from alloc.compilation import jit
from alloc.onboard.columns import NAN, ONE
from alloc.onboard.sensing import LIMITING
from alloc.onboard.signatures import control
from alloc.schema.tables import Column, Table

ASSUMED = "assumed"
TUNED = "tuned by the procedure of `studies.tuning`"


@jit
def per_coefficient(unit):
    """Torque of each motor [N m] for a coefficient of 1 at the unit's axles."""
    return unit.load * unit.radius / unit.gear


@jit
def lasted(ticks, time, period):
    """Whether `ticks` control periods are at least `time` [s]; ticks are counted, so rounding adds none."""
    return (ticks + 1e-6) * period >= time


@jit
def lag_share(time_constant, period):
    """Share of the difference to its input by which a first-order lag moves in one `period` [s]."""
    return -math.expm1(-period / time_constant)


@jit
def clip(value, low, high):
    """`value` within its bounds."""
    return min(max(value, low), high)


# Creep control


def tuned(columns: dict[str, Column], **values: float) -> dict[str, Column]:
    """The same columns with other values."""
    return columns | {key: replace(columns[key], default=one) for key, one in values.items()}


GAINS = {
    "proportional": Column(0.35, "s m-1", "coefficient over the error of slip", source=TUNED),
    "integral": Column(4.0, "m-1", "rate of the coefficient over that error", source=TUNED),
    "margin": Column(3.0, ONE, "least slip held over the noise of a speed reading", source=TUNED),
}
HELD = {
    "allowed": Column(NAN, ONE, "integral: coefficient that is allowed; nan: nothing yet"),
    "share": Column(1.0, ONE, "share of the target that was commanded last"),
}

CREEP = Table(
    "pi-creep",
    reference=Column(0.24, "m s-1", "slip of the worst axle that is held", source=TUNED),
    **GAINS,
    **HELD,
)
CREEP_ROW = CREEP.dtype


@jit
def hold_slip(unit, m, reference, slip, run):
    """PI control of `slip` to `reference` [m/s]; the integral stays within what can be commanded, so it does not wind up.

    The worst of several noisy slips is more than the slip: a reference within the noise would be none.
    """
    scale = per_coefficient(unit)
    ceiling = unit.torque_target / scale
    if math.isnan(m.allowed):
        m.allowed = ceiling
    error = max(reference, m.margin * run.noise) - slip
    m.allowed = clip(m.allowed + m.integral * error * run.period, 0.0, ceiling)
    coefficient = clip(m.allowed + m.proportional * error, 0.0, ceiling)
    # a ceiling times the scale need not be the target to the last bit
    unit.torque_command = min(coefficient * scale, unit.torque_target)
    m.share = unit.torque_command / unit.torque_target if unit.torque_target > 0.0 else 1.0


@control
def pi_creep(unit, axles, memory, run):
    """A fixed slip is held."""
    m = memory.view(CREEP_ROW)[0]
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


FUZZY_CREEP = Table(
    "fuzzy-creep",
    reference=Column(0.24, "m s-1", "slip held, where its middle set peaks", source=TUNED),
    large=Column(0.3, "m s-1", "slip at which its highest set peaks", source=ASSUMED),
    rate=Column(1.5, "m s-2", "slip rates at which the outer sets peak, either way", source=TUNED),
    change=Column(0.7, "s-1", "greatest rate of `allowed`", source="as pi-creep"),
    pole=Column(48.0, "s-1", "pole of the differentiator of slip", source=TUNED),
    allowed=HELD["allowed"],
    filtered=Column(NAN, "m s-1", "slip behind the differentiator's filter"),
)
FUZZY_CREEP_ROW = FUZZY_CREEP.dtype


@control
def fuzzy_creep(unit, axles, memory, run):
    """The coefficient that is allowed grows or falls by fuzzy inference of slip and slip rate.

    After Tian, Daniel, Meehan (2014), whose abstract prints no rules. These are those of the slide protection's valves:
    supply, hold and release become more, the same and less torque. Near the reference it is pi-creep with the gains
    change / reference and change / rate.
    """
    m = memory.view(FUZZY_CREEP_ROW)[0]
    scale, slip = per_coefficient(unit), unit.worst_slip
    ceiling = unit.torque_target / scale
    if math.isnan(m.allowed):
        m.allowed, m.filtered = ceiling, slip
    rate = m.pole * (slip - m.filtered)
    m.filtered += lag_share(1.0 / m.pole, run.period) * (slip - m.filtered)
    valve = law.fuzzy_valve(slip, rate, 0.0, m.reference, m.large, -m.rate, 0.0, m.rate)
    m.allowed = clip(m.allowed + run.period * m.change * (1.0 - valve), 0.0, ceiling)
    unit.torque_command = min(m.allowed * scale, unit.torque_target)


# What searches share: means over intervals, and a reference that moves between bounds


FIRST = {"first": Column(0.085, "m s-1", "slip that is held at first", source=TUNED), **GAINS}
BOUNDS = {
    "lowest": Column(0.03, "m s-1", "least slip that is held", source=TUNED),
    "highest": Column(0.5, "m s-1", "greatest slip that is held", source=ASSUMED),
}
INTERVAL = {"interval": Column(0.2, "s", "time from move to move of the slip held", source=TUNED)}
SEARCH = FIRST | BOUNDS | INTERVAL
SEARCHED = HELD | {
    "reference": Column(NAN, "m s-1", "slip that is held"),
    "moved": Column(0.0, "m s-1", "its last move"),
    "ticks": Column(0, ONE, "control periods of this interval"),
    "samples": Column(0, ONE, "number of them in its second half"),
    "coefficient_sum": Column(0.0, ONE, "sum of coefficients in them"),
    "slip_sum": Column(0.0, "m s-1", "sum of slips in them"),
    "last_coefficient": Column(NAN, ONE, "mean coefficient of the last interval; nan: none"),
    "last_slip": Column(0.0, "m s-1", "mean slip of the last interval"),
}


@jit
def start_interval(m):
    """An interval begins."""
    m.ticks = m.samples = 0
    m.coefficient_sum = m.slip_sum = 0.0


@jit
def interval_is_over(unit, m, run):
    """Add what the unit senses to its means; whether an interval is over. Only while the controller limits the torque."""
    if math.isnan(m.reference):
        m.reference = m.first
    if m.share >= LIMITING:  # adhesion suffices: nothing to be learnt of the peak
        start_interval(m)
        m.last_coefficient = NAN
        return False
    m.ticks += 1
    if m.ticks * run.period > (0.5 + 1e-6) * m.interval:  # slip settles in the first half
        m.coefficient_sum += unit.coefficient_estimate
        m.slip_sum += unit.worst_slip
        m.samples += 1
    return lasted(m.ticks, m.interval, run.period)


@jit
def move(m, step):
    """Move the reference by `step` [m/s] within its bounds, turn round there, and start an interval."""
    wanted = m.reference + step
    m.moved = -step if wanted < m.lowest or wanted > m.highest else step
    m.reference = clip(wanted, m.lowest, m.highest)
    m.last_coefficient, m.last_slip = m.coefficient_sum / m.samples, m.slip_sum / m.samples
    start_interval(m)


PERTURB = Table(
    "perturb-observe",
    **SEARCH,
    step=Column(0.012, "m s-1", "size of a move", source=TUNED),
    **SEARCHED,
)
PERTURB_ROW = PERTURB.dtype


@control
def perturb_observe(unit, axles, memory, run):
    """The slip held climbs by fixed steps, and turns back where the coefficient fell (arXiv 2406.13650).

    As the source says, the step is a compromise between the time of the search and the loss about the peak, and a change of
    the rail is mistaken for an answer to the step.
    """
    m = memory.view(PERTURB_ROW)[0]
    if interval_is_over(unit, m, run):
        worse = m.coefficient_sum / m.samples < m.last_coefficient
        move(m, math.copysign(m.step, -m.moved if worse else m.moved))
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


STEEPEST = Table(
    "steepest-gradient",
    **SEARCH | {"interval": replace(INTERVAL["interval"], default=0.3, source=ASSUMED)},
    gain=Column(0.15, "m2 s-2", "move over the slope of the curve", source=TUNED),
    least=Column(0.017, "m s-1", "least move", source=TUNED),
    largest=Column(0.06, "m s-1", "largest move", source=TUNED),
    **SEARCHED,
)
STEEPEST_ROW = STEEPEST.dtype


@control
def steepest_gradient(unit, axles, memory, run):
    """As perturb-observe, but a move is a gain times the slope between the last two intervals (arXiv 2406.13650).

    Where the slip has hardly changed, the slope is noise, and the least move goes on. As the source says, the slope is
    noisy, and small where the curve falls slowly.
    """
    m = memory.view(STEEPEST_ROW)[0]
    if interval_is_over(unit, m, run):
        rise = m.coefficient_sum / m.samples - m.last_coefficient
        way = m.slip_sum / m.samples - m.last_slip
        step = math.copysign(m.least, m.moved)
        if not math.isnan(rise) and abs(way) >= 0.3 * m.least:
            wanted = m.gain * rise / way
            step = math.copysign(clip(abs(wanted), m.least, m.largest), wanted)
        move(m, step)
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


FUZZY_TRACKING = Table(
    "fuzzy-tracking",
    **SEARCH,
    rise=Column(0.005, ONE, "changes of the coefficient where the outer sets peak", source=ASSUMED),
    way=Column(0.01, "m s-1", "changes of the slip at which the outer sets peak", source=ASSUMED),
    least=Column(0.01, "m s-1", "least move", source=TUNED),
    largest=Column(0.04, "m s-1", "largest move", source=TUNED),
    **SEARCHED,
)
FUZZY_TRACKING_ROW = FUZZY_TRACKING.dtype


@control
def fuzzy_tracking(unit, axles, memory, run):
    """As perturb-observe, but a move is inferred from the changes of coefficient and slip, after Abouzeid et al.

    Their abstract (arXiv 2406.13650) prints no rules. Here nine say, over three sets each: onward where both rose or both
    fell, back where one fell, nothing where either stayed. Such rules are a product of two clipped lines.
    """
    m = memory.view(FUZZY_TRACKING_ROW)[0]
    if interval_is_over(unit, m, run):
        rise = m.coefficient_sum / m.samples - m.last_coefficient
        way = m.slip_sum / m.samples - m.last_slip
        step = math.copysign(m.least, m.moved)
        if not math.isnan(rise):
            wanted = m.largest * (clip(rise / m.rise, -1.0, 1.0) * clip(way / m.way, -1.0, 1.0))
            # where no rule applies, back and forth by the least move: nothing would be learnt without
            step = math.copysign(max(abs(wanted), m.least), wanted) if wanted != 0.0 else -step
        move(m, step)
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


# Extremum seeking on the estimates of a Kalman filter


CUBATURE = Table(
    "cubature-seeking",
    **tuned(FIRST | BOUNDS, first=0.1, proportional=0.83, margin=6.3),
    cycle=Column(0.3, "s", "period of the sine", source=TUNED),
    amplitude=Column(0.015, "m s-1", "amplitude of the sine", source=TUNED),
    gain=Column(0.57, "m2 s-2", "move of its centre over the slope of the curve", source=TUNED),
    largest=Column(0.03, "m s-1", "largest move of its centre", source=TUNED),
    lag=Column(0.3, "rad", "lag of the coefficient behind the reference", source=TUNED),
    noise=Column(0.014, "m s-1", "least deviation of the rim speed measured", source=TUNED),
    train_noise=Column(0.01, "m s-1", "deviation of the train's speed", source=ASSUMED),
    rim_walk=Column(0.35, "m s-2", "walk of the rim speed", source=TUNED),
    train_walk=Column(0.3, "m s-2", "walk of the train's speed", source=ASSUMED),
    height_walk=Column(0.2, ONE, "walk of the curve's height in a second", source=ASSUMED),
    adapt=Column(0.02, ONE, "share of an innovation in the rim speed's variance", source=ASSUMED),
    scale=Column(0.14, "m s-1", "slip at the peak of the filter's curve", source=TUNED),
    **HELD,
    estimate=Column((NAN, 0.0, 0.1), ONE, "rim speed, train speed [m s-1], height of the curve"),
    covariance=Column((1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-2), ONE, "of their errors"),
    rim_variance=Column(0.0, "m2 s-2", "variance of the rim speed measured"),
    centre=Column(NAN, "m s-1", "slip about which is sought"),
    ticks=Column(0, ONE, "control periods of this cycle"),
    product=Column(0.0, ONE, "mean so far of coefficient times sine"),
)
CUBATURE_ROW = CUBATURE.dtype


@jit
def predict(m, torque, pull, period):
    """Carry the estimate one period on: the rim by `torque` (as a coefficient), `pull` [m/s] of speed per coefficient."""
    x, p = m.estimate, m.covariance
    s = (x[0] - x[1]) / m.scale
    bottom = 1.0 + s * s
    value, slope = 2.0 * s / bottom, 2.0 * (1.0 - s * s) / (bottom * bottom * m.scale)
    # implicit where the curve rises, as a wheel settles there within a period
    step = pull / (1.0 + pull * max(x[2] * slope, 0.0))
    a, b = step * x[2] * slope, step * value
    x[0] += step * (torque - x[2] * value)
    for j in range(3):  # the rim's row of the Jacobian is (1 - a, a, -b), others the identity's
        p[j] += a * (p[3 + j] - p[j]) - b * p[6 + j]
    for i in range(3):
        p[3 * i] += a * (p[3 * i + 1] - p[3 * i]) - b * p[3 * i + 2]
    p[0] += m.rim_walk * period * (m.rim_walk * period)
    p[4] += m.train_walk * period * (m.train_walk * period)
    p[8] += m.height_walk * m.height_walk * period


@jit
def correct(m, a, measured, variance):
    """Correct by a measurement of element `a`; returns the innovation."""
    x, p = m.estimate, m.covariance
    innovation, total = measured - x[a], p[4 * a] + variance
    column = (p[a], p[3 + a], p[6 + a])
    for i in range(3):
        x[i] += column[i] / total * innovation
        for j in range(3):
            p[3 * i + j] -= column[i] * column[j] / total
    return innovation


@control
def cubature_seeking(unit, axles, memory, run):
    """Extremum seeking: the slip held swings as a sine, whose product with the coefficient shows the slope of the curve.

    After Applied Sciences 15, 10524, which has an adaptive cubature Kalman filter of the train's speed. Here an extended one
    estimates rim speed, train speed and the height of a curve 2 x / (1 + x^2), which only has to be right where the wheels
    are. It uses as much adhesion as a cubature filter of these states; without a filter it is 8 points less.
    """
    m = memory.view(CUBATURE_ROW)[0]
    x = m.estimate
    speed, rim = run.reference_speed, run.reference_speed + run.sign * unit.worst_slip
    if math.isnan(x[0]):
        x[0], x[1], m.centre, m.rim_variance = rim, speed, m.first, m.noise * m.noise
    torque = run.sign * (unit.motor_torque / per_coefficient(unit) + unit.air / unit.load)
    pull = unit.load * unit.radius * unit.radius / unit.inertia * run.period
    predict(m, torque, pull, run.period)
    own = m.covariance[0]
    innovation = correct(m, 0, rim, m.rim_variance)
    unexplained = innovation * innovation - own - m.rim_variance
    m.rim_variance = max(m.rim_variance + m.adapt * unexplained, m.noise * m.noise)
    correct(m, 1, speed, m.train_noise * m.train_noise)
    x[2] = clip(x[2], 0.0, 1.0)
    slip, reference = run.sign * (x[0] - x[1]), m.centre
    if m.share >= LIMITING:  # nothing to be learnt of the peak
        m.ticks, m.product = 0, 0.0
    else:
        m.ticks += 1
        turn, s = 2.0 * math.pi * m.ticks * run.period / m.cycle, slip / m.scale
        coefficient = x[2] * 2.0 * s / (1.0 + s * s)
        m.product += coefficient * math.sin(turn - m.lag) * run.period / m.cycle
        if lasted(m.ticks, m.cycle, run.period):
            # a mean of the product is slope times amplitude / 2
            change = clip(m.gain * 2.0 * m.product / m.amplitude, -m.largest, m.largest)
            m.centre = clip(m.centre + change, m.lowest, m.highest)
            m.ticks, m.product = 0, 0.0
            turn = 0.0
        reference = m.centre + m.amplitude * math.sin(turn)
    hold_slip(unit, m, reference, slip, run)
