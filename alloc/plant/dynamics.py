"""The plant: right side, Runge-Kutta steps, rail that wheels clean, cylinders behind their dead time; traction positive.

State: positions and speeds of the bodies (cars, or one rigid train), angular speeds of the axles, torques of the units,
pressures of the brake groups, friction work of the axles; then work of motors, of shoes, against resistance and gradient, of
couplers. Rows of the tables hold what is constant over a step, and note what is of the last instant asked for.

What few events have (patches, scatter, cleaning, load transfer, shoes, parallel motors) stands in loops of its own, and what
a loop reads of a single row it reads before: compiled code must otherwise read it again after every write.
"""

import math
from typing import Any

import numpy as np

from alloc import laws
from alloc.backends import compiled as law
from alloc.compilation import force_inline, jit, last_use
from alloc.plant.curves import BY_CREEP, PIECEWISE, coefficient, steepest
from alloc.schema.tables import Rows, look_up

FLOOR = 1e-3
"""Smallest adhesion coefficient: scatter and increments must not make it zero."""
STABLE = 2.5
"""Step times fastest rate; classical Runge-Kutta is stable below 2.78."""
STROKE = 0.1
"""Longest elongation of a coupler [m] for which a step is stable."""
SMALLEST = 1e-150
"""Size of a state below which it is zero."""


@jit
def state_places(wheelsets, cars, drives, cylinders, plant):
    """Number of bodies; where angular speeds, torques, pressures and friction work begin in the state; works follow."""
    bodies = 1 if plant.body_mass > 0.0 else cars.size
    omega = 2 * bodies
    torque = omega + wheelsets.size
    pressure = torque + drives.size
    return bodies, omega, torque, pressure, pressure + cylinders.size


@force_inline
def changes_rail(plant):
    """Whether wheels change the rail that they leave."""
    return plant.conditioning > 0.0 or plant.recovered_coefficient > 0.0


# The right side: what most events have in one function, since handing arrays to a part takes time; what few have in parts


@force_inline
def find_share(x, start, end, edge):
    """`law.window`; away from its edges it is 0 or 1 to the last bit, so that no division is needed."""
    half, behind, ahead = 0.5 * edge, x - start, end - x
    if behind <= -half or ahead <= -half:
        return 0.0
    return 1.0 if behind >= half and ahead >= half else law.window(x, start, end, edge)


@force_inline
def vary_rail(t, y, wheelsets, bodies, patches, scatter, plant):
    """Patches, scatter, and what wheels have cleaned, on the adhesion coefficient that the rail offers."""
    for k in range(patches.size):
        p = patches[k]
        change = find_share(t, p.begin, p.until, p.fade) * (p.factor - 1.0)
        if change != 0.0:
            start, end, edge = p.start, p.end, p.edge
            for i in range(wheelsets.size):
                a = wheelsets[i]
                inside = find_share(y[a.body] + a.offset, start, end, edge)
                if inside > 0.0:
                    a.offered += change * inside * (a.offered - a.increment)
    if plant.scatter_length > 0.0:
        for i in range(wheelsets.size):
            a = wheelsets[i]
            knot = (y[a.body] + a.offset) / plant.scatter_length
            k = math.floor(knot)
            behind, ahead = scatter[k % scatter.size], scatter[(k + 1) % scatter.size]
            a.offered += behind + law.smooth_step(knot - k) * (ahead - behind)
    for i in range(wheelsets.size):
        a = wheelsets[i]
        a.offered = max(a.offered * (1.0 + plant.conditioning * a.cleaned), FLOOR)
    if plant.recovered_coefficient > 0.0:
        for i in range(wheelsets.size):
            a = wheelsets[i]
            degree = law.both_cleaned(a.recovery, a.cleaned)
            a.offered = law.recovered(a.offered, degree, plant.recovered_coefficient)


@force_inline
def find_loads(y, wheelsets, cars, bodies, omega, curve, plant):
    """Coefficients, and axle loads as cars and bogies pitch: in closed form, without iteration between force and load."""
    for i in range(wheelsets.size):
        a = wheelsets[i]
        speed, rim = y[bodies + a.body], a.radius * y[omega + i]
        slip = rim - speed
        mu = coefficient(plant.curve_number, curve, slip, speed, rim, a.offered, a.contact)
        a.coefficient, a.axle_load = mu, a.static_load
    if plant.pitches:
        for k in range(cars.size):
            cars[k].force, cars[k].pitch = 0.0, 0.0
        for i in range(wheelsets.size):
            a, c = wheelsets[i], cars[wheelsets[i].car]
            c.force += a.coefficient * a.static_load
            c.pitch += a.coefficient * a.unloading
        for i in range(wheelsets.size):
            a, c = wheelsets[i], cars[wheelsets[i].car]
            force = law.car_force(c.force, c.pitch)
            a.axle_load = law.axle_load(a.static_load, a.unloading, force)


@force_inline
def divide_torque(t, y, dy, wheelsets, drives, omega, torque):
    """Motors in parallel on one frequency: what each gives beside the mean torque; the work of it [W]."""
    work = 0.0
    for i in range(wheelsets.size):
        a = wheelsets[i]
        if a.unit >= 0 and drives[a.unit].slip_torque > 0.0 and t < drives[a.unit].failure:
            u = drives[a.unit]
            mean, speed = a.gear * dy[torque + a.unit] / u.axles, a.gear * y[omega + i]
            more = a.gear * law.parallel_torque(0.0, u.slip_torque, mean, speed)
            dy[omega + i] += more / a.inertia
            work += more * y[omega + i]
    return work


@force_inline
def press_shoes(y, dy, wheelsets, cylinders, omega, pressure):
    """Shoes against the rotation of each wheelset; the work lost in them [W]."""
    work = 0.0
    for i in range(wheelsets.size):
        a = wheelsets[i]
        if a.brake >= 0:
            b, turning = cylinders[a.brake], y[omega + i]
            friction = law.speed_law(
                a.radius * turning, b.friction_numerator, b.friction_offset, b.friction_constant
            )
            bound = a.radius * a.shoe_gain * y[pressure + a.brake] * friction
            shoe = law.shoe_torque(dy[omega + i] * a.inertia, turning, bound, a.inertia)
            dy[omega + i] -= shoe / a.inertia
            a.brake_force = shoe / a.radius
            work += shoe * turning
    return work


@force_inline
def pull_couplers(y, dy, cars, bodies):
    """Accelerations of cars under the forces `dy` [N] and those of their couplers; power that these take in [W]."""
    power = 0.0
    for k in range(bodies - 1):
        c, rate = cars[k], y[bodies + k] - y[bodies + k + 1]
        tension = law.coupler_force(
            y[k] - y[k + 1], rate, c.stiffness, c.stiffening, c.damping, c.slack
        )
        c.coupler_force = tension
        power += tension * rate
        dy[bodies + k] -= tension
        dy[bodies + k + 1] += tension
    for k in range(bodies):
        dy[k] = y[bodies + k]
        dy[bodies + k] /= cars[k].mass
    return power


# Arrays go from function to function one by one: a NamedTuple of them counts a reference to each at every call, which took a
# sixth of a run. The lists are long for this alone; their order is that of `alloc.run.world.World`.


@jit
def derivative(
    t,
    y,
    dy,
    wheelsets,
    cars,
    drives,
    cylinders,
    patches,
    line,
    effort,
    retard,
    curve,
    scatter,
    plant,
):
    """Right side `dy` of the state `y` at the instant `t`; the rows note what is of this instant."""
    bodies, omega, torque, pressure, friction = state_places(
        wheelsets, cars, drives, cylinders, plant
    )
    motors, shoes, lost, coupled = 0.0, 0.0, 0.0, 0.0  # powers [W]

    # the rail
    offset = plant.law_offset
    decline = law.speed_law(y[bodies], 1.0, offset, 0.0)
    for i in range(wheelsets.size):
        a = wheelsets[i]
        if bodies > 1:
            decline = law.speed_law(y[bodies + a.body], 1.0, offset, 0.0)
        a.offered = max(a.law_numerator * decline + a.law_constant + a.increment, FLOOR)
    if changes_rail(plant) or patches.size > 0 or plant.scatter_length > 0.0:
        vary_rail(t, y, wheelsets, bodies, patches, scatter, plant)

    # the wheelsets; a unit's angular speeds are summed where the rate of its torque will stand
    q0, q1, q2, q3, q4 = 0.0, 0.0, 0.0, 0.0, 0.0
    # a call per axle and a choice of the curve would cost what the rest of the right side does
    usual = plant.curve_number == PIECEWISE and not plant.pitches
    if usual:  # what follows from these alone is found once
        q0, q1, q2, q3, q4 = curve[0], curve[1], curve[2], curve[3], curve[4]
    else:
        find_loads(y, wheelsets, cars, bodies, omega, curve, plant)
    for k in range(cars.size):
        cars[k].force = 0.0
    for j in range(drives.size):
        dy[torque + j] = 0.0
    for i in range(wheelsets.size):
        a, turning = wheelsets[i], y[omega + i]
        slip, mu, load = a.radius * turning - y[bodies + a.body], a.coefficient, a.axle_load
        if usual:
            load = a.static_load
            mu = law.piecewise_coefficient(slip, a.offered, q0, q1, q2, q3, q4)
        force = mu * load
        a.slip_velocity, a.coefficient, a.axle_load = slip, mu, load
        a.rail_force, a.brake_force = force, 0.0
        cars[a.car].force += force
        at_wheel = -a.radius * force
        if a.unit >= 0:
            driving = a.gear * y[torque + a.unit]
            at_wheel += driving
            motors += driving * turning
            dy[torque + a.unit] += turning
        dy[omega + i] = at_wheel / a.inertia
        dy[friction + i] = force * slip
    if plant.parallel:
        motors += divide_torque(t, y, dy, wheelsets, drives, omega, torque)

    # the cylinders
    pressed = 0.0
    for g in range(cylinders.size):
        b, p = cylinders[g], y[pressure + g]
        pressed += p
        dy[pressure + g] = law.pressure_rate(p, b.filling, b.acting, b.fill_time, b.release_time)
    if pressed > 0.0:
        shoes = press_shoes(y, dy, wheelsets, cylinders, omega, pressure)

    # the cars
    total, last = 0.0, line.size - 1.000001
    grade, air = line[0].grade, line[0].air
    for k in range(cars.size):
        c, body = cars[k], cars[k].body
        if line.size > 1:
            place = (y[body] + c.middle - plant.line_origin) / plant.line_spacing
            place = min(max(place, 0.0), last)
            point, ahead, part = line[int(place)], line[int(place) + 1], place - int(place)
            grade = point.grade + part * (ahead.grade - point.grade)
            air = point.air + part * (ahead.air - point.air)
        speed, quadratic = y[bodies + body], c.resistance_quadratic * air
        drag = law.resistance(speed, c.resistance, c.resistance_linear, quadratic)
        if grade != 0.0:  # most lines are level
            drag += law.gradient_force(c.mass, grade)
        lost += drag * speed
        total += c.force - drag
        dy[bodies + body] = c.force - drag
    if plant.body_mass > 0.0:
        dy[0], dy[1] = y[1], total / plant.body_mass
    else:
        coupled = pull_couplers(y, dy, cars, bodies)

    # the motors, behind commands within what they and the line allow at the units' rim speeds
    share = plant.receptivity_mean
    if plant.receptivity_amplitude > 0.0:
        share = law.power_taken(
            t, share, plant.receptivity_amplitude, plant.receptivity_period, plant.receptivity_phase
        )
    for j in range(drives.size):
        u = drives[j]
        kmh = 3.6 * abs(dy[torque + j]) * u.radius / u.axles
        drive, brake = look_up(effort, j, kmh), share * look_up(retard, j, kmh)
        if t >= u.failure:
            drive = brake = 0.0
        dy[torque + j] = law.torque_rate(y[torque + j], u.applied, drive, brake, u.lag)

    works = friction + wheelsets.size
    dy[works], dy[works + 1], dy[works + 2], dy[works + 3] = motors, shoes, lost, coupled
    last_use(y, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve, scatter)


@jit
def note_instant(y, dy, wheelsets, cars, drives, cylinders, plant):
    """Columns of the record that follow from the state and its `derivative`."""
    bodies, omega, _, pressure, friction = state_places(wheelsets, cars, drives, cylinders, plant)
    for i in range(wheelsets.size):
        wheelsets[i].rim_speed = wheelsets[i].radius * y[omega + i]
        wheelsets[i].friction_work = y[friction + i]
    mass, momentum, force = 0.0, 0.0, 0.0
    for k in range(cars.size):
        c = cars[k]
        c.car_speed, c.car_acceleration = y[bodies + c.body], dy[bodies + c.body]
        mass += c.mass
        momentum += c.mass * c.car_speed
        force += c.mass * c.car_acceleration
    for g in range(cylinders.size):
        cylinders[g].cylinder_pressure = y[pressure + g]
    works = friction + wheelsets.size
    plant.position, plant.speed, plant.acceleration = y[0], momentum / mass, force / mass
    plant.motor_work, plant.shoe_work = y[works], y[works + 1]
    plant.resistance_work, plant.coupler_work = y[works + 2], y[works + 3]


# Between the steps: cylinders behind their dead time, rail that wheels clean


@jit
def respond_cylinders(t, cylinders, commands, period):
    """Cylinders do what was commanded their dead time ago: `commands` (ticks, groups), rows recorded so far."""
    for g in range(cylinders.size):
        b = cylinders[g]
        tick = math.floor((t - b.dead_time) / period + 1e-6)
        b.filling, b.acting = 0.0, 0.0
        if tick >= 0:
            b.filling, b.acting = commands[tick, g].pressure_target, commands[tick, g].valve


@jit
def read_rail(y, wheelsets, rail, cell):
    """What wheels ahead have left under each axle; `rail` is a ring of cells."""
    for i in range(wheelsets.size):
        a = wheelsets[i]
        place = (y[a.body] + a.offset) / cell
        k = math.floor(place)
        degree = rail[k % rail.size]
        a.cleaned = degree + (place - k) * (rail[(k + 1) % rail.size] - degree)


@jit
def clean_rail(y, before, wheelsets, bodies, omega, friction, span, rail, plant):
    """Each axle cleans the cells that it has left behind in a step of `span` [s]; the foremost begins new ones.

    Slip cleans them (JP4209318 par. 0051), or what has recovered a contact stays in part. `before`: state at its begin.
    """
    for i in range(wheelsets.size):
        a, b = wheelsets[i], wheelsets[i].body
        speed, rim = y[bodies + b], a.radius * y[omega + i]
        if plant.recovered_coefficient > 0.0:
            power = (y[friction + i] - before[friction + i]) / span
            energy, lag = plant.recovery_energy, plant.recovery_time
            a.recovery = law.recovery(a.recovery, power, speed, energy, lag, span)
            degree = plant.recovery_left * law.both_cleaned(a.recovery, a.cleaned)
        else:
            ratio = (rim - speed) / max(abs(speed), abs(rim), 1e-3)
            degree = law.cleaned(ratio, plant.conditioning_slip)
        now = math.floor((y[b] + a.offset) / plant.cleaning_spacing)
        if a.cell < now - rail.size or a.cell > now:
            a.cell = now
        for k in range(a.cell, now + 1 if i == 0 else now):
            if i == 0:
                rail[(k + 2) % rail.size] = 0.0
            if k < now:
                rail[k % rail.size] = max(rail[k % rail.size], degree)
        a.cell = now


@jit
def advance_period(
    t, y, stages, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve, scatter, rail, plant, commands
):  # fmt: skip
    """One control period from `t` on by classical Runge-Kutta steps of equal length, `plant.step` at most.

    They are as short as contacts, shoes, motors and couplers need at this speed: where a curve goes by creep, which is slip
    over speed, contacts are the stiffer the slower the train.
    """
    stage, slope, end = stages[0], stages[1], stages[2]
    bodies, omega, _, _, friction = state_places(wheelsets, cars, drives, cylinders, plant)
    period, cleaning = plant.period, changes_rail(plant)
    speed = abs(y[bodies])
    for b in range(bodies + 1, 2 * bodies):
        speed = min(speed, abs(y[b]))
    by_creep = plant.curve_number in BY_CREEP
    contact = plant.contact_rate / (law.creep_speed(speed, speed) if by_creep else 1.0)
    rate = max(plant.rate, contact)
    steps = max(1, math.ceil(period / plant.step - 1e-9))
    steps *= max(1, math.ceil(period / steps * rate / STABLE))
    h = period / steps
    for s in range(steps):
        now = t + s * h
        respond_cylinders(now, cylinders, commands, period)
        if cleaning:
            read_rail(y, wheelsets, rail, plant.cleaning_spacing)
        for r in range(y.size):
            stage[r] = end[r] = y[r]
        for share, reach, at in (
            (1.0 / 6.0, 0.5, 0.0), (1.0 / 3.0, 0.5, 0.5), (1.0 / 3.0, 1.0, 0.5), (1.0 / 6.0, 0.0, 1.0)
        ):  # fmt: skip
            derivative(
                now + at * h, stage, slope, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve,
                scatter, plant,
            )  # fmt: skip
            for r in range(y.size):
                end[r] += share * h * slope[r]
                stage[r] = y[r] + reach * h * slope[r]
        if cleaning:
            clean_rail(end, y, wheelsets, bodies, omega, friction, h, rail, plant)
        for r in range(y.size):  # what is left of a standstill no processor computes fast
            y[r] = end[r] if abs(end[r]) > SMALLEST else 0.0


# What the integrator needs to know


def find_rates(
    wheelsets: Rows, cars: Rows, drives: Rows, cylinders: Rows, curve: Any, most: float, plant: Any
) -> float:
    """Write the rates that bound a step, `plant.rate` and `plant.contact_rate`; the shortest step that they ask for [s].

    `most`: the greatest coefficient that the rail offers anywhere.
    """
    slope = steepest(plant.curve_number, curve, most, wheelsets.contact.max())
    carried = slope * wheelsets.static_load
    rigid = plant.body_mass > 0.0
    mass = np.full(1, plant.body_mass) if rigid else cars.mass
    wheel, body = (
        wheelsets.radius**2 / wheelsets.inertia,
        np.bincount(wheelsets.body, carried, mass.size),
    )
    plant.contact_rate, rates = (carried * wheel).max() + (body / mass).max(), [0.0]
    if drives.size:
        on_shaft = np.where(
            wheelsets.unit >= 0, drives.slip_torque[wheelsets.unit] * wheelsets.gear**2, 0.0
        )
        rates += [1.0 / drives.lag.min(), (on_shaft / wheelsets.inertia).max()]
    if cylinders.size:
        quickest = min(cylinders.fill_time.min(), cylinders.release_time.min())
        rates += [1.0 / laws.LOCK_TIME, 1.0 / quickest]
    if not rigid and cars.size > 1:
        inverse = (1.0 / mass[:-1] + 1.0 / mass[1:]).max()
        stiffest = (cars.stiffness + 3.0 * cars.stiffening * STROKE**2).max()
        rates += [2.0 * cars.damping.max() * inverse, math.sqrt(2.0 * stiffest * inverse)]
    plant.rate = max(rates)
    return min(float(plant.step), STABLE / max(plant.rate, plant.contact_rate))
