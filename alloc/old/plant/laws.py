"""The physical laws of train and contact, each stated once, elementwise, for NumPy, Numba and CasADi alike.

In: states and parameters in SI units. Out: forces [N], accelerations, coefficients. Laws have no branch on states and take
every constant as an argument. `alloc.old.plant.engine` (compiled) and `alloc.old.plant.array_model` (NumPy, CasADi) put them
together, and say which axle belongs to which car.
"""

import math

from alloc.old.compilation import equation
from alloc.old.plant.operations import (
    absolute,
    atan,
    exp,
    interpolate,
    maximum,
    minimum,
    sqrt,
    where,
)

# Traction is positive, braking negative; SI units.


GRAVITY = 9.80665
"""Standard gravity [m/s2]; the readhesion paper's 9.0855 is a misprint."""

LOCK_TIME = 2e-3
"""Time constant [s] with which shoe friction stops the remaining rotation of a locking wheel."""

DAMPED_DEPTH = 2e-3
"""Compression [m] of a draft gear's structure at which all its damping acts; the onset is smooth, to avoid short steps at
impacts."""

STANDSTILL_SPEED = 0.05
"""Speed scale [m/s] on which running resistance changes sign at standstill."""


@equation
def slip_velocity(angular_speed, radius, speed):
    """Slip velocity [m/s], positive driving: r omega - v, readhesion paper (9)."""
    return radius * angular_speed - speed


@equation
def faster_speed(speed, rim_speed):
    """The larger of car and rim speed, a magnitude [m/s]: what slip is relative to."""
    return maximum(absolute(speed), absolute(rim_speed))


@equation
def slip_ratio(slip, speed, rim_speed, least):
    """Slip velocity over the larger of car and rim speed, or over `least` [m/s], since a ratio to zero is meaningless."""
    return slip / maximum(faster_speed(speed, rim_speed), least)


@equation
def shoe_torque(other_torque, angular_speed, limit, inertia):
    """Torque [N m] of the brake shoes on a wheelset, opposing its rotation.

    Coulomb friction with the bound `limit`. On a turning wheel all of it acts. On a wheel at rest just as much acts as holds
    it, so the wheel stays locked until the other torques exceed the bound. The ramp between the two brings omega to zero
    with the time constant `LOCK_TIME` instead of a jump.
    """
    holding = other_torque + inertia * angular_speed * (1.0 / LOCK_TIME)
    return minimum(limit, maximum(-limit, holding))  # in this order a nan passes through


@equation
def wheel_acceleration(motor_torque_at_wheel, rail_force, radius, shoe, inverse_inertia):
    """Angular acceleration of a wheelset [rad/s2]: readhesion paper (7), JP4209318 (2), (8)."""
    return (motor_torque_at_wheel - radius * rail_force - shoe) * inverse_inertia


@equation
def wheelset(
    motor_torque_at_wheel, rail_force, radius, angular_speed, shoe_limit, inertia, inverse_inertia
):
    """Shoe torque [N m] and angular acceleration [rad/s2] of a wheelset; passing the inverse saves a division per step."""
    other = motor_torque_at_wheel - radius * rail_force
    shoe = shoe_torque(other, angular_speed, shoe_limit, inertia)
    acceleration = wheel_acceleration(
        motor_torque_at_wheel, rail_force, radius, shoe, inverse_inertia
    )
    return shoe, acceleration


@equation
def motor_torque_rate(torque, command, drive_limit, brake_limit, health, inverse_lag):
    """Rate of the motor torque [N m/s]: first-order lag behind the bounded command.

    `brake_limit` already contains the receptivity of the line; `health` 0 is a failed motor; `inverse_lag` is 1 / time
    constant [1/s]. Inverses are used here and below because divisions dominate the cost of a step.
    """
    target = health * minimum(maximum(command, -brake_limit), drive_limit)
    return (target - torque) * inverse_lag


@equation
def induction_motor_torque(torque, breakdown, breakdown_slip, mean_speed, own_speed):
    """Torque of one of several induction motors on an inverter [N m]: Kloss's equation.

    The inverter feeds all of them with one frequency, at which a motor of their `mean_speed` gives `torque`; one that turns
    faster slips less in its field, and gives less. `breakdown` [N m]: the largest torque, at a slip of `breakdown_slip`
    [rad/s] between field and rotor. At `mean_speed` the result is `torque`, whose size is at most `breakdown`.
    """
    share = minimum(maximum(torque / breakdown, -1.0), 1.0)
    slip = share / (1.0 + sqrt(1.0 - share * share)) + (mean_speed - own_speed) / breakdown_slip
    return breakdown * 2.0 * slip / (1.0 + slip * slip)


@equation
def series_motor_torque(torque, base_speed, mean_speed, own_speed):
    """Torque of one of several direct-current series motors on one voltage [N m].

    Current is voltage over (resistance + constant x speed), and torque goes with its square (unsaturated field).
    `base_speed` [rad/s]: speed at which the resistance takes half of the voltage.
    """
    ratio = (absolute(mean_speed) + base_speed) / (absolute(own_speed) + base_speed)
    return torque * ratio * ratio


INDUCTION, SERIES = 1.0, 2.0
"""Kinds of motors that share an inverter or a voltage; 0: each motor has a torque control of its own."""


@equation
def parallel_motor_torque(kind, torque, breakdown, slip, mean_speed, own_speed):
    """Torque of one of the motors of a unit [N m], at `own_speed` [rad/s] of its shaft, where their mean is `mean_speed`.

    `breakdown` and `slip`: as `breakdown_slip`, or as `base_speed`.
    """
    induction = induction_motor_torque(torque, breakdown, slip, mean_speed, own_speed)
    series = series_motor_torque(torque, slip, mean_speed, own_speed)
    return where(kind > 1.5, series, where(kind > 0.5, induction, torque))


@equation
def shaft_torque(twist, rate, stiffness, damping):
    """Torque [N m] at the wheel that a drive hands on from rotor to wheelset: spring and damper between two inertias."""
    return stiffness * twist + damping * rate


@equation
def swing_torque(torque, settled, rate, stiffness, reduced_inertia):
    """Largest torque [N m] that a drive's oscillation reaches about the `settled` one, from its present torque and rate."""
    away = torque - settled
    return absolute(settled) + sqrt(away * away + stiffness * reduced_inertia * rate * rate)


@equation
def limit_place(speed, per_speed, size):
    """Where a table of torque limits of `size` points, 1 / `per_speed` [m/s] apart, is read at `speed` [m/s], for `look_up`.

    The greatest place lies a little before the last point.
    """
    return minimum(absolute(speed) * per_speed, size - 1.000001)


@equation
def cylinder_pressure_rate(pressure, target, valve, inverse_fill, inverse_release):
    """Rate of a brake cylinder's pressure [Pa/s].

    `valve` 0: supply valve open, the pressure follows `target`; 1: both shut, held; 2: release valve open.
    """
    filling = (target - pressure) * inverse_fill
    releasing = -pressure * inverse_release
    return where(valve < 0.5, filling, where(valve < 1.5, 0.0 * pressure, releasing))


@equation
def speed_decline(speed, offset):
    """1 / (V + b) with V in km/h: the decrease of a hyperbolic speed law."""
    return 1.0 / (3.6 * absolute(speed) + offset)


@equation
def hyperbolic_speed_law(speed, numerator, offset, constant):
    """a / (V + b) + c with V in km/h: planned adhesion JP5484215 (12), Curtius-Kniffler, shoe friction."""
    return numerator * speed_decline(speed, offset) + constant


@equation
def running_resistance(speed, constant, linear, quadratic, air_factor):
    """Running resistance [N] against the motion: A + B v + C v^2, its air part increased in tunnels."""
    magnitude = constant + linear * absolute(speed) + quadratic * air_factor * speed * speed
    return magnitude * speed / sqrt(speed * speed + STANDSTILL_SPEED * STANDSTILL_SPEED)


@equation
def curving_resistance(mass, specific):
    """Resistance of a curve [N], part of the running resistance that does not depend on speed; `specific` per weight."""
    return mass * GRAVITY * specific


@equation
def gradient_force(mass, grade):
    """Downhill component of the weight [N] against the motion; `grade` is the rise per run, JP H07-322414."""
    return mass * GRAVITY * (grade / sqrt(1.0 + grade * grade))


@equation
def car_drag(speed, constant, linear, quadratic, air_factor, downhill):
    """Running resistance and gradient force `downhill` of a car [N] against the motion."""
    return running_resistance(speed, constant, linear, quadratic, air_factor) + downhill


@equation
def coupler_stretch(elongation, slack):
    """Elongation [m] beyond the slack (half of it on either side)."""
    return elongation - minimum(maximum(elongation, -0.5 * slack), 0.5 * slack)


@equation
def coupler_spring_force(stretch, stiffness, stiffening):
    """Elastic tension of a draft gear [N]: k s + k3 s^3, stiffening as in the RTRI report."""
    return stretch * (stiffness + stiffening * stretch * stretch)


@equation
def coupler_damper_force(stretch, rate, damping):
    """Damping tension of a draft gear [N]: none inside the slack, full at 1 mm beyond it."""
    return damping * rate * minimum(absolute(stretch) * 1e3, 1.0)


@equation
def coupler_forces(elongation, rate, stiffness, stiffening, damping, slack):
    """Tension of a draft gear and the part of it that damps [N], at this elongation [m] and its rate [m/s]."""
    stretch = coupler_stretch(elongation, slack)
    damper = coupler_damper_force(stretch, rate, damping)
    return coupler_spring_force(stretch, stiffness, stiffening) + damper, damper


@equation
def wedge_creep(force, travel, gear, fluidity):
    """Rate at which the wedges of a draft gear slide [m/s] under `force` [N], at `travel` >= 0 [m].

    In loading they slide above T0 + k1 p, in unloading below t0 + k2 p. At either end of the travel they stop.
    """
    structure, loading, unloading, preload, restoring, longest = gear
    excess = maximum(0.0, force - (preload + loading * travel))
    lack = maximum(0.0, restoring + unloading * travel - force)
    loaded = minimum(structure * maximum(0.0, longest - travel), excess)
    return fluidity * (loaded - minimum(structure * travel, lack))


@equation
def structure_forces(compression, rate, structure, damping):
    """Elastic force of a structure [N], damping where it is in contact [N s/m], and both together; it does not pull."""
    depth = maximum(0.0, compression)
    elastic, share = structure * depth, minimum(depth * (1.0 / DAMPED_DEPTH), 1.0)
    damper = damping * share * share * (3.0 - 2.0 * share)
    return elastic, damper, maximum(0.0, elastic + damper * rate)


@equation
def friction_draft_gear(stretch, rate, travel, gear, fluidity, damping):
    """Tension of a friction draft gear [N], rate of its wedges' travel [m/s], and power lost in it [W].

    A damped structure of stiffness ck is in series with wedges, which stick between their two lines, see `wedge_creep`.
    `travel` p [m] is positive in draft, negative in buff. Beyond a line the wedges slide at `fluidity` [m/N s] times the
    excess. The structure and the mean of the two lines are elastic. All other power of the tension is lost; the loss is
    never negative.
    """
    structure, loading, unloading, preload, restoring, _ = gear
    drawn, pressed = maximum(0.0, travel), maximum(0.0, -travel)
    pull, pull_damper, drawing = structure_forces(stretch - drawn, rate, structure, damping)
    push, push_damper, pressing = structure_forces(-stretch - pressed, -rate, structure, damping)
    # wedges that slide relieve the damper: its force at rest would overstate what drives them
    drawn_rate = wedge_creep(drawing, drawn, gear, fluidity / (1.0 + pull_damper * fluidity))
    pressed_rate = wedge_creep(pressing, pressed, gear, fluidity / (1.0 + push_damper * fluidity))
    creep = drawn_rate - pressed_rate
    # and do not where they still come back from the other side
    tension = maximum(0.0, drawing - where(travel < 0.0, 0.0, pull_damper * drawn_rate))
    tension = tension - maximum(
        0.0, pressing - where(travel > 0.0, 0.0, push_damper * pressed_rate)
    )
    mean = 0.5 * (preload + restoring + (loading + unloading) * absolute(travel))
    draft, buff = (pull - mean) * creep, (mean - push) * creep
    wedges = where(travel > 0.0, draft, where(travel < 0.0, buff, where(creep > 0.0, draft, buff)))
    return tension, creep, (tension - pull + push) * rate + wedges


@equation
def car_rail_force(static_force, unloading):
    """Rail force of a car whose axles are unloaded by that same force.

    F = sum mu_i (N0_i - k_i F), so F = sum mu_i N0_i / (1 + sum mu_i k_i).
    """
    return static_force / (1.0 + unloading)


@equation
def axle_load(static_load, unloading, car_force):
    """Axle load [N] under the pitch of car and bogies: N0 - k F, with sum k = 0 over the car."""
    return static_load - unloading * car_force


SLOWEST_SANDING = 0.5
"""Speed [m/s] below which a sander lays no more on a metre: at rest all sand would lie on one spot."""


@equation
def sand_laid(rate, speed):
    """Sand on a metre of rail [kg/m] behind a sander that discharges `rate` [kg/s] at `speed` [m/s]."""
    return rate / maximum(absolute(speed), SLOWEST_SANDING)


@equation
def conditioning_deposit(slip_ratio, scale):
    """Degree 0..1 to which a wheel with this slip ratio cleans the rail under it (JP4209318 par. 0053)."""
    return 1.0 - exp(-absolute(slip_ratio) / scale)


@equation
def cleaned_degree(own, under):
    """Degree 0..1 to which a contact is clean: by the wheel's own slip, and by the wheels ahead."""
    return 1.0 - (1.0 - own) * (1.0 - under)


@equation
def recovered_peak(peak, degree, recovered):
    """Peak coefficient of a contact that is clean to a `degree`, on a rail where clean wheels find `recovered`."""
    return peak + degree * maximum(recovered - peak, 0.0)


@equation
def recovery_rate(degree, power, speed, energy, time):
    """Rate [1/s] of a contact's degree of cleaning, whose slip dissipates `power` [W].

    After Allotta, Meli, Ridolfi, Rindi (2014), of whom only the abstract could be read: the form is assumed. It follows
    tanh(W / `energy`) with the time constant `time` [s], where W [J/m] is the energy dissipated on a metre of rail, at least
    on one metre a second.
    """
    share = absolute(power) / (maximum(absolute(speed), CREEPAGE_SPEED_FLOOR) * energy)
    rest = exp(-2.0 * share)
    return ((1.0 - rest) / (1.0 + rest) - degree) / time


# Laws of the adhesion curves: the tangential force coefficient over the slip velocity, and its maximum.
#
# Every law is odd in the slip velocity and takes the local `peak` from the adhesion field. For Polach's curve the peak
# is the friction coefficient, and the maximum over the slip velocity is below it. For the others it is the adhesion
# coefficient, which is that maximum.


PIECEWISE, POLACH, SLIP_RATIO, TABULATED, POLACH_BY_FRICTION, RATIONAL = 0, 1, 2, 3, 4, 5

CREEPAGE_SPEED_FLOOR = 1.0
"""Smallest speed [m/s] that creepage is divided by: it applies at standstill and is reached smoothly from twice this speed.

Creepage is singular at standstill; the floor bounds the stiffness, and with it the number of substeps. It is a numerical
device, not a property of the rail.
"""

GROWTH_END = 3.0
"""Slip velocity times Polach's decay B at which the creepage of `polach_coefficient` stops growing."""


@equation
def parabola_curvature(peak, micro_slope, top_curvature, macro_slope, residual_ratio):
    """Curvature C of the parabola, raised where the source's value would not give a curve.

    The source needs C >= g1^2 / (4 peak), else its first break point is negative and the curve jumps at the origin. It also
    needs B > 0, that is C > g2^2 / (4 (peak - mu_inf)), else its tail grows without bound. The law takes the smallest C that
    satisfies the first condition and leaves half of the fall from the peak to the tail. The initial slope is kept, and the
    curve keeps its first derivative.
    """
    return maximum(
        top_curvature, narrowest_parabola(micro_slope, macro_slope, residual_ratio) / peak
    )


@equation
def narrowest_parabola(micro_slope, macro_slope, residual_ratio):
    """Smallest curvature of the parabola, times the peak."""
    for_line = 0.25 * micro_slope * micro_slope
    for_tail = 0.5 * macro_slope * macro_slope / (1.0 - residual_ratio)
    return maximum(for_line, for_tail)


@equation
def piecewise_coefficient(
    slip, peak, micro_slope, top_curvature, macro_slope, residual_ratio, most_residual
):
    """Line, parabola, exponential: readhesion paper (1)-(6).

    mu_inf is `most_residual`, and `residual_ratio` of the peak where that is less: the source prints neither. On a rail
    too slippery for the source's `top_curvature` the parabola is narrowed, see `parabola_curvature`.
    """
    narrowest = narrowest_parabola(micro_slope, macro_slope, residual_ratio)
    # divisions are what this law costs: but for one, below, they are by constants
    breadth = minimum(1.0 / top_curvature, peak * (1.0 / narrowest))
    magnitude = absolute(slip)
    middle, half_width = peak * (1.0 / micro_slope), 0.25 * micro_slope * breadth
    line_end = maximum(0.0, middle - half_width)  # (3)
    top = middle + half_width  # (4)
    tail_start = top + 0.5 * macro_slope * breadth  # (5)
    residual = minimum(residual_ratio * peak, most_residual)
    drop = peak - 0.25 * macro_slope * macro_slope * breadth - residual  # (6), B of the source
    inverse = 1.0 / (peak * drop)
    curvature = maximum(top_curvature, narrowest * drop * inverse)  # as `parabola_curvature`
    # the parabola with its top at (top, peak), seen from the line that it leaves: at the origin nothing is to cancel
    off_line = maximum(0.0, magnitude - line_end)  # in this order a nan passes through
    rise = micro_slope * magnitude - curvature * off_line * off_line
    beyond = maximum(0.0, magnitude - tail_start)
    tail = residual + drop * exp(-beyond * macro_slope * peak * inverse)
    value = where(magnitude < tail_start, rise, tail)
    return where(slip < 0.0, -value, value)


@equation
def reference_speed(speed, rim_speed):
    """Speed that slip is divided by: the larger of car and rim speed, kept away from zero.

    Above twice the floor it is that speed itself; below, a parabola leads to the floor without a kink.
    """
    larger = faster_speed(speed, rim_speed)
    slow = maximum(0.0, 1.0 - larger * (0.5 / CREEPAGE_SPEED_FLOOR))
    return larger + CREEPAGE_SPEED_FLOOR * slow * slow


@equation
def polach_set(kind, q, peak):
    """B [s/m], kA and kS of Polach's law, and the slip velocity [m/s] at which its creepage stops growing.

    They are given, or follow from Open Rails' interpolation over the friction coefficient at rest (`Axle.cs`,
    `PolachCalculator`). The interpolation meets Polach's dry set at 0.55 and his wet one at 0.30, and keeps the wet set
    below that.
    """
    if kind == POLACH:
        none = 0.0 * peak
        return q[1] + none, q[2] + none, q[3] + none, q[5] + none
    else:
        decay = maximum(1.6 * peak - 0.28, 0.2)
        adhesion_factor = maximum(2.8 * peak - 0.54, 0.3)
        return decay, adhesion_factor, maximum(1.2 * peak - 0.26, 0.1), GROWTH_END / decay


@equation
def growing_slip(slip, decay, end):
    """Slip velocity [m/s] from which creepage is computed: `slip` at first, constant from `end` = `GROWTH_END` / `decay` on.

    There friction has fallen to nearly its final value. If creepage continued to grow, the coefficient would rise again, by
    up to 4 % of the peak at high speed and load. The transition is of fifth order, so the maximum is unchanged.
    """
    bounded = minimum(end, maximum(-end, slip))  # in this order a nan passes through
    share = bounded * decay * (1.0 / GROWTH_END)
    square = share * share
    return bounded * (1.0 - 0.2 * square * square)


@equation
def polach_coefficient(slip, speed, rim_speed, peak, ratio_at_infinity, shape, creep_stiffness):
    """Polach's creep force law in pure longitudinal creep (Wear 258 (2005) 992-1000, eqs. 1-9).

    Friction falls with the slip velocity as ((1 - A) exp(-B w) + A) from its value `peak` at rest. Creepage stops growing
    once friction has fallen, see `growing_slip`. `shape`: the result of `polach_set`.
    """
    decay, adhesion_factor, slip_factor, end = shape
    friction = peak * ((1.0 - ratio_at_infinity) * exp(-decay * absolute(slip)) + ratio_at_infinity)
    grown = growing_slip(slip, decay, end)
    reference = reference_speed(speed, rim_speed + (grown - slip))
    gradient = creep_stiffness * absolute(grown) / (reference * friction)
    adhesion = adhesion_factor * gradient
    value = (
        (2.0 / math.pi)
        * friction
        * (adhesion / (1.0 + adhesion * adhesion) + atan(slip_factor * gradient))
    )
    return where(slip < 0.0, -value, value)


@equation
def slip_ratio_coefficient(slip, reference, peak, peak_slip_ratio, residual_ratio):
    """Rise 2x/(1 + x^2) to the peak at x = slip ratio / `peak_slip_ratio` = 1, then towards a residual.

    With `residual_ratio` = 1 it is flat beyond the peak, as in publications on wheel slide protection.
    """
    x = absolute(slip) / (reference * peak_slip_ratio)
    rise = 2.0 * x / (1.0 + x * x)
    beyond = residual_ratio + (1.0 - residual_ratio) * rise
    value = peak * where(x <= 1.0, rise, beyond)
    return where(slip < 0.0, -value, value)


@equation
def rational_coefficient(slip, peak, peak_slip, steepness):
    """Peak times n x / (1 + (n - 2) x + x^2) with x = slip / `peak_slip` and n = `steepness`, after Kiencke and Daiss.

    Its slope at the origin is n peak / `peak_slip`; the top is at x = 1 for every n > 0.
    """
    x = absolute(slip) / peak_slip
    value = peak * (steepness * x / (1.0 + x * (x + (steepness - 2.0))))
    return where(slip < 0.0, -value, value)


@equation
def tabulated_coefficient(slip, peak, table):
    """Shape of the curve from `table`: slip velocity of the peak, then values over slip / (slip + that of the peak)."""
    magnitude = absolute(slip)
    value = peak * interpolate(table, magnitude / (magnitude + table[0]))
    return where(slip < 0.0, -value, value)


@equation
def tangential_coefficient(kind, q, slip, speed, rim_speed, peak, contact=1.0):
    """Coefficient of the curve `kind` with its parameters `q`; elementwise in the other arguments.

    `contact`: creep stiffness of the axle over that in `q`.
    """
    if kind == PIECEWISE:
        return piecewise_coefficient(slip, peak, q[0], q[1], q[2], q[3], q[4])
    elif kind in (POLACH, POLACH_BY_FRICTION):
        shape = polach_set(kind, q, peak)
        return polach_coefficient(slip, speed, rim_speed, peak, q[0], shape, q[4] * contact)
    elif kind == SLIP_RATIO:
        reference = reference_speed(speed, rim_speed)
        return slip_ratio_coefficient(slip, reference, peak, q[0], q[1])
    elif kind == RATIONAL:
        return rational_coefficient(slip, peak, q[0], q[1])
    else:
        return tabulated_coefficient(slip, peak, q)


@equation
def polach_peak(kind, q, peak, speed, contact):
    """Largest Polach coefficient of a driving axle over the slip velocity, and its place (golden section search).

    The curve rises from zero to its maximum and does not rise again. The bracket (0, one tenth of the speed plus 2 m/s)
    contains the maximum of every published set.
    """
    shape = polach_set(kind, q, peak)
    ratio, stiffness = q[0], q[4] * contact
    golden = 0.6180339887498949
    low = 0.0 * (peak + speed)
    high = low + 0.1 * absolute(speed) + 2.0
    inner_low, inner_high = high - golden * (high - low), low + golden * (high - low)
    for _ in range(60):
        left = polach_coefficient(
            inner_low, speed, speed + inner_low, peak, ratio, shape, stiffness
        ) > polach_coefficient(inner_high, speed, speed + inner_high, peak, ratio, shape, stiffness)
        low = where(left, low, inner_low)
        high = where(left, inner_high, high)
        inner_low = high - golden * (high - low)
        inner_high = low + golden * (high - low)
    top = 0.5 * (low + high)
    return polach_coefficient(top, speed, speed + top, peak, ratio, shape, stiffness), top


@equation
def slip_ratio_peak(speed, ratio):
    """Slip velocity [m/s] of a driving axle at which slip / `reference_speed` is `ratio`."""
    v = absolute(speed) * (0.5 / CREEPAGE_SPEED_FLOOR)
    # slip = ratio * (1 + (v + slip)^2 / 4) on the parabola, in floors
    linear = 1.0 - ratio * v
    root = sqrt(maximum(0.0, linear * linear - ratio * ratio * (1.0 + v * v)))
    below = maximum(linear + root, 1.0 - ratio)  # as it is wherever the parabola counts
    slow = CREEPAGE_SPEED_FLOOR * 2.0 * ratio * (1.0 + v * v) / below
    return where(v < 1.0 - ratio, slow, absolute(speed) * ratio / (1.0 - ratio))


@equation
def adhesion_limit(kind, q, peak, speed, contact=1.0):
    """Adhesion coefficient of a driving axle (maximum over the slip velocity), and the slip velocity [m/s] there.

    `contact`: creep stiffness of the axle over that in `q`.
    """
    if kind == PIECEWISE:
        curvature = parabola_curvature(peak, q[0], q[1], q[2], q[3])
        return peak * 1.0, peak / q[0] + q[0] / (4.0 * curvature)
    elif kind in (POLACH, POLACH_BY_FRICTION):
        return polach_peak(kind, q, peak, speed, contact)
    elif kind in (TABULATED, RATIONAL):
        return peak * 1.0, q[0] + 0.0 * peak
    else:
        return peak * 1.0, slip_ratio_peak(speed, q[0]) + 0.0 * peak


# Adhesion at standstill: an elastic contact that holds a force without slip.
#
# Creepage needs motion, so a curve alone lets a braked train creep downhill. Below `STICK_SPEED` the contact of a
# braked wheel is also a spring. Its deflection z [m] follows the slip and carries peak z / d, with the presliding
# displacement d at which it yields (Dahl, A solid friction model, 1968). With the slip w, the curve's coefficient f and
# the share s of `stuck_share`,
#
#     mu = f + c peak z / d,    dz/dt = c (w - |w| z / d) - (1 - s) z / T,    c = s (1 - |f| / peak).
#
# The spring takes in c w times what it carries and loses the rest, so it never gives back more than it took; |z| stays
# within d and |mu| within the peak. At rest c = 1 and z is constant. Above `STICK_SPEED` c = 0 and the curve acts
# alone. It also acts alone under a wheel without brake, which rolls on to rail that is not strained.


STICK_SPEED = 0.2
"""Speed [m/s] of train or rim above which no contact sticks."""

RELEASE_TIME = 0.05
"""Time constant T [s] with which a moving contact loses its deflection."""


HOLDING_BRAKE = 0.005
"""Brake force over axle load, at constant shoe friction, above which a wheel counts as fully braked."""


@equation
def stuck_share(speed, rim_speed, brake):
    """Share of a contact that sticks: 1 at rest, 0 above `STICK_SPEED`; `brake` is the brake force over `HOLDING_BRAKE`."""
    pace = faster_speed(speed, rim_speed) * (1.0 / STICK_SPEED)
    rest = maximum(0.0, 1.0 - pace * pace)
    return rest * rest * minimum(brake, 1.0)


@equation
def sticking_contact(coefficient, peak, slip, deflection, presliding, share):
    """Coefficient with the spring's part beside the curve's `coefficient`, and rate of the deflection [m/s]."""
    strain = deflection / presliding
    coupling = share * maximum(0.0, 1.0 - absolute(coefficient) / peak)
    release = (1.0 - share) * deflection * (1.0 / RELEASE_TIME)
    rate = coupling * (slip - absolute(slip) * strain) - release
    return coefficient + coupling * peak * strain, rate


@equation
def elastic_energy(deflection, presliding, peak, axle_load):
    """Energy [J] that a contact stores and `friction_work` contains."""
    return 0.5 * axle_load * peak * deflection * deflection / presliding
