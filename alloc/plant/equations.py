"""The train's physical laws, each stated once, elementwise, for NumPy, Numba and CasADi alike.

Traction is positive, braking negative; SI units. The assembly (which axle belongs to which car) is in
`array_model` and `compiled`; neither states a law of its own.
"""

from alloc.compilation import equation
from alloc.plant.operations import absolute, exp, maximum, minimum, sqrt, where

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
