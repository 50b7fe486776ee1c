"""The physical laws of contact, wheelset and train, each stated once and elementwise, in SI units.

Traction counts positive, braking negative. No law branches on a state or changes an argument, so the same text serves NumPy
(this module), compiled code and CasADi (`alloc.backends`). What a law needs is an argument of it; who calls it says
which axle stands on which car.
"""

from numpy import abs as absolute
from numpy import arctan as atan
from numpy import copysign, exp, maximum, minimum, sqrt, where
from numpy import sin as sine

GRAVITY = 9.80665
"""Standard gravity [m/s2]; the readhesion paper's 9.0855 is a misprint."""
PI = 3.141592653589793
LOCK_TIME = 2e-3
"""Time constant [s] with which shoes stop the last rotation of a wheel that locks: a ramp in the place of a jump."""
SLOWEST = 1.0
"""Smallest speed [m/s] that creepage is divided by. It bounds the stiffness of the contact at standstill, and with it the
number of integration steps; it is no property of the rail."""
GROWTH_END = 3.0
"""Slip velocity times Polach's decay B at which creepage stops growing, see `polach_coefficient`."""
REST = 0.05
"""Speed [m/s] about which running resistance changes its sign."""


# Adhesion curves: tangential force coefficient [1] over slip velocity [m/s], odd in it. `peak` is what the rail offers: the
# greatest coefficient of the curve; for Polach's curves the friction coefficient, which is a little above that.


def narrowest_parabola(micro_slope, macro_slope, residual_ratio):
    """Smallest curvature [(s/m)2] times peak at which the parabola of the piecewise curve meets line and tail.

    (3) of the readhesion paper asks for C >= g1^2 / (4 peak), else the curve does not pass through the origin; its (6) for
    C > g2^2 / (4 (peak - mu_inf)), else the tail grows. Of the second, half of the fall from peak to mu_inf is left.
    """
    for_tail = 0.5 * macro_slope * macro_slope / (1.0 - residual_ratio)
    return maximum(0.25 * micro_slope * micro_slope, for_tail)


def parabola_breadth(peak, micro_slope, top_curvature, macro_slope, residual_ratio):
    """1 / C [(m/s)2] of the piecewise curve's parabola, narrowed on slippery rail, see `narrowest_parabola`."""
    inverse_least = 1.0 / narrowest_parabola(micro_slope, macro_slope, residual_ratio)
    return minimum(1.0 / top_curvature, peak * inverse_least)


def piecewise_rise(size, peak, micro_slope, breadth):
    """Line and parabola of the piecewise curve, at a slip of this `size` [m/s] up to the tail: readhesion paper (1)-(3)."""
    line_end = maximum(0.0, peak * (1.0 / micro_slope) - 0.25 * micro_slope * breadth)  # (3)
    # the parabola seen from the line that it leaves: at the origin nothing is to cancel
    off = maximum(0.0, size - line_end)
    return micro_slope * size - off * off / breadth


def piecewise_coefficient(
    slip, peak, micro_slope, top_curvature, macro_slope, residual_ratio, most_residual
):
    """Line, parabola, exponential: readhesion paper (1)-(6), with the slopes g1, g2 [s/m] and the curvature C [(s/m)2].

    mu_inf, which is not printed, is `residual_ratio` of the peak, at most `most_residual`. On rail too slippery for C the
    parabola is narrowed, see `narrowest_parabola`.
    """
    # but for two, divisions are by constants: they are what this law costs
    breadth = parabola_breadth(peak, micro_slope, top_curvature, macro_slope, residual_ratio)
    s, top = absolute(slip), peak * (1.0 / micro_slope) + 0.25 * micro_slope * breadth
    tail = top + 0.5 * macro_slope * breadth  # (4), (5)
    residual = minimum(residual_ratio * peak, most_residual)
    drop = peak - residual - 0.25 * macro_slope * macro_slope * breadth  # (6), B of the source
    beyond, rise = minimum(0.0, tail - s), piecewise_rise(s, peak, micro_slope, breadth)
    return copysign(where(s < tail, rise, residual + drop * exp(beyond * macro_slope / drop)), slip)


def piecewise_top(peak, micro_slope, top_curvature, macro_slope, residual_ratio):
    """Slip velocity [m/s] of the peak of `piecewise_coefficient`: readhesion paper (4)."""
    breadth = parabola_breadth(peak, micro_slope, top_curvature, macro_slope, residual_ratio)
    return peak / micro_slope + 0.25 * micro_slope * breadth


def creep_speed(speed, rim):
    """Speed [m/s] that slip is divided by: the larger of car and rim speed; below twice `SLOWEST` a parabola towards it."""
    larger = maximum(absolute(speed), absolute(rim))
    slow = maximum(0.0, 1.0 - larger * (0.5 / SLOWEST))
    return larger + SLOWEST * slow * slow


def polach_coefficient(
    slip, speed, rim, friction, at_infinity, decay, adhesion, sliding, stiffness
):
    """Polach, Wear 258 (2005) 992-1000, (1)-(9), in pure longitudinal creep.

    `friction`: coefficient at rest; A = `at_infinity`, B = `decay` [s/m], kA = `adhesion`, kS = `sliding` of his Table 3;
    `stiffness`: G pi a b C11 / (4 Q). Creepage stops growing at the slip `GROWTH_END` / B, where friction has fallen: else
    the coefficient would rise again, by up to 4 % of the peak. The transition is of fifth order, so the peak is unchanged.
    """
    at_slip = friction * ((1.0 - at_infinity) * exp(-decay * absolute(slip)) + at_infinity)
    end = GROWTH_END / decay
    bounded = minimum(end, maximum(-end, slip))
    square = (bounded / end) * (bounded / end)
    grown = bounded * (1.0 - 0.2 * square * square)
    reference = creep_speed(speed, rim + (grown - slip))
    gradient = stiffness * absolute(grown) / (reference * at_slip)
    x = adhesion * gradient
    return copysign((2.0 / PI) * at_slip * (x / (1.0 + x * x) + atan(sliding * gradient)), slip)


def polach_by_friction(slip, speed, rim, friction, at_infinity, stiffness):
    """`polach_coefficient` with B, kA, kS over the friction coefficient: Open Rails, `Axle.cs`, `PolachCalculator`.

    They meet Polach's dry set at 0.55 and his wet one at 0.30, and keep the wet one below that.
    """
    return polach_coefficient(
        slip, speed, rim, friction, at_infinity, maximum(1.6 * friction - 0.28, 0.2),
        maximum(2.8 * friction - 0.54, 0.3), maximum(1.2 * friction - 0.26, 0.1), stiffness,
    )  # fmt: skip


def slip_ratio_coefficient(slip, speed, rim, peak, peak_ratio, residual_ratio):
    """Rise 2 x / (1 + x^2) to the peak at a slip ratio, then towards a residual.

    Flat where that is 1, as in publications on slide protection.
    """
    x = absolute(slip) / (creep_speed(speed, rim) * peak_ratio)
    rise = 2.0 * x / (1.0 + x * x)
    beyond = residual_ratio + (1.0 - residual_ratio) * rise
    return copysign(peak * where(x <= 1.0, rise, beyond), slip)


def slip_ratio_top(speed, ratio):
    """Slip velocity [m/s] at which a driving axle's slip over `creep_speed` is `ratio`."""
    v = absolute(speed) * (0.5 / SLOWEST)
    # on the parabola slip = ratio (1 + (v + slip)^2 / 4), in units of SLOWEST
    linear = 1.0 - ratio * v
    root = sqrt(maximum(0.0, linear * linear - ratio * ratio * (1.0 + v * v)))
    below = maximum(linear + root, 1.0 - ratio)
    slow = 2.0 * SLOWEST * ratio * (1.0 + v * v) / below
    return where(v < 1.0 - ratio, slow, absolute(speed) * ratio / (1.0 - ratio))


def rational_coefficient(slip, peak, peak_slip, steepness):
    """Peak times n x / (1 + (n - 2) x + x^2), x = slip / `peak_slip`, n = `steepness`: Kiencke and Daiss (1994)."""
    x = absolute(slip) / peak_slip
    return copysign(peak * (steepness * x / (1.0 + x * (x + (steepness - 2.0)))), slip)


# What the rail offers


def speed_law(speed, numerator, offset, constant):
    """a / (V + b) + c, V in km/h: planned adhesion JP5484215 (12), Curtius and Kniffler; also friction of brake shoes."""
    return numerator / (3.6 * absolute(speed) + offset) + constant


def smooth_step(x):
    """0 below 0, 1 above 1, between them a polynomial, twice continuously differentiable."""
    a = minimum(1.0, maximum(0.0, x))
    return a * a * a * (10.0 + a * (6.0 * a - 15.0))


def window(x, start, end, edge):
    """1 between `start` and `end`, 0 outside, smooth over `edge` at either."""
    return smooth_step((x - start) / edge + 0.5) * smooth_step((end - x) / edge + 0.5)


def cleaned(ratio, scale):
    """Degree 0..1 to which a wheel with this slip ratio cleans the rail, 63 % at `scale`: JP4209318 par. 0053."""
    return 1.0 - exp(-absolute(ratio) / scale)


def both_cleaned(recovery_degree, under):
    """Degree 0..1 to which a contact is clean: by the wheel's own slip, and by the wheels ahead."""
    return 1.0 - (1.0 - recovery_degree) * (1.0 - under)


def recovered(offered, degree, clean):
    """Coefficient of a contact that is clean to a `degree`, on rail where clean wheels find `clean`."""
    return offered + degree * maximum(clean - offered, 0.0)


def recovery(degree, power, speed, energy, time, span):
    """Degree of recovery 0..1 after a `span` [s] of dissipating `power` [W] at `speed` [m/s].

    After Allotta, Meli, Ridolfi, Rindi (2014), of whom only the abstract could be read; the form is assumed. With the time
    constant `time` [s] it follows tanh(W / `energy`), W [J/m]: energy dissipated on a metre of rail.
    """
    rest = exp(-2.0 * absolute(power) / (maximum(absolute(speed), SLOWEST) * energy))
    wanted = (1.0 - rest) / (1.0 + rest)  # tanh
    return wanted + (degree - wanted) * exp(-span / time)


# Wheelset, motors, brakes


def shoe_torque(torque, angular_speed, bound, inertia):
    """Torque of brake shoes [N m] against the rotation of a wheelset under another `torque` [N m].

    Coulomb friction with a `bound`. At rest as much acts as holds the wheel, so a locked wheel stays locked until the other
    torque exceeds the bound.
    """
    return minimum(bound, maximum(-bound, torque + inertia * angular_speed / LOCK_TIME))


def torque_rate(torque, command, drive, brake, lag):
    """Rate of a motor's torque [N m/s]: a lag behind the command, bounded by -`brake` and `drive`; readhesion paper, 2.2."""
    return (minimum(maximum(command, -brake), drive) - torque) / lag


def parallel_torque(mean_torque, slip_torque, mean_speed, own_speed):
    """Torque of one of several induction motors on one inverter [N m].

    All have its frequency, at which a motor of their mean shaft speed [rad/s] gives `mean_torque`. One that turns faster
    slips less in the field, by the straight part of its characteristic: `slip_torque` [N m s].
    """
    return mean_torque + slip_torque * (mean_speed - own_speed)


def power_taken(time, mean, swing, period, phase):
    """Share 0..1 of the electric brake that the line takes at `time` [s]."""
    return minimum(maximum(mean + swing * sine(2.0 * PI * time / period + phase), 0.0), 1.0)


def pressure_rate(pressure, target, valve, fill, release):
    """Rate of a brake cylinder's pressure [Pa/s]. Valve 0: it fills towards `target`, 1: is held, 2: is released."""
    emptying = where(valve < 1.5, 0.0 * pressure, -pressure / release)
    return where(valve < 0.5, (target - pressure) / fill, emptying)


# Cars


def axle_load(static_load, unloading, force):
    """Axle load [N] as car and bogies pitch under the car's rail `force` [N]; `unloading` sums to 0 over the car."""
    return static_load - unloading * force


def car_force(static_force, pitch):
    """Rail force [N] of a car that unloads its own axles: F = sum mu (N - k F) = sum mu N / (1 + sum mu k)."""
    return static_force / (1.0 + pitch)


def resistance(speed, constant, linear, quadratic):
    """Running resistance [N] against the motion: A + B v + C v^2, smooth at standstill."""
    size = constant + linear * absolute(speed) + quadratic * speed * speed
    return size * speed / sqrt(speed * speed + REST * REST)


def gradient_force(mass, grade):
    """Downhill part of the weight [N] against the motion; `grade` is the rise per run: JP H07-322414."""
    return mass * GRAVITY * grade / sqrt(1.0 + grade * grade)


def coupler_force(elongation, rate, stiffness, stiffening, damping, slack):
    """Tension of a coupler [N]: beyond half the slack on either side a spring that stiffens, and a damper; RTRI report.

    The damper is full at 1 mm beyond the slack.
    """
    stretch = elongation - minimum(maximum(elongation, -0.5 * slack), 0.5 * slack)
    spring = stretch * (stiffness + stiffening * stretch * stretch)
    return spring + damping * rate * minimum(absolute(stretch) * 1e3, 1.0)


# On board


def fuzzy_valve(ratio, rate, small, medium, large, falling, steady, growing):
    """Valve 0 supply .. 2 release by slip ratio and slip acceleration [m/s2]: nine rules, triangles that overlap in pairs.

    JP4209318 controls its valves by fuzzy inference and prints no rules. These are this project's own, for falling, steady,
    growing slip: small (supply, supply, hold), medium (supply, hold, release), large (hold, release, release).
    """
    low = minimum(maximum((medium - ratio) / (medium - small), 0.0), 1.0)
    high = minimum(maximum((ratio - medium) / (large - medium), 0.0), 1.0)
    down = minimum(maximum((steady - rate) / (steady - falling), 0.0), 1.0)
    up = minimum(maximum((rate - steady) / (growing - steady), 0.0), 1.0)
    even = 1.0 - down - up
    middle = 1.0 - low - high
    return low * up + middle * (even + 2.0 * up) + high * (down + 2.0 * (even + up))
