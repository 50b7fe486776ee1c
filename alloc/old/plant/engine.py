"""The compiled plant: the laws put together over blocks of axles, cars and units, and the integrators that step them.

In: a `Workspace`. Out: its state after a step; nothing is allocated. What acts between steps
(locks, sand, cleaning) is here.
"""

from alloc.old.compilation import inlined_jit, jit
from alloc.old.plant.laws import (
    STICK_SPEED,
    adhesion_limit,
    axle_load,
    car_drag,
    car_rail_force,
    cleaned_degree,
    coupler_forces,
    coupler_stretch,
    curving_resistance,
    cylinder_pressure_rate,
    friction_draft_gear,
    gradient_force,
    hyperbolic_speed_law,
    limit_place,
    motor_torque_rate,
    parallel_motor_torque,
    recovered_peak,
    recovery_rate,
    shaft_torque,
    slip_velocity,
    speed_decline,
    sticking_contact,
    stuck_share,
    tangential_coefficient,
    wheelset,
)
from alloc.old.plant.operations import (
    WIDTH,
    absolute,
    gather,
    is_nonzero,
    load,
    look_up,
    maximum,
    minimum,
    spread,
    store,
    total,
    where,
)
from alloc.old.plant.rail import (
    leave_rail,
    patch_factor,
    peak_coefficient,
    power_taken,
    read_rail,
    sanded_peak,
    scatter_knot,
    window,
)
from alloc.old.plant.train import EFFORT_SPEED_STEP
from alloc.old.plant.workspace import workspace

# Right side of the compiled plant: assembly of the laws over blocks of axles, cars and units.
#
# Everything that varies is a vector (`alloc.old.plant.operations`) or a number that is common to all. Nothing allocates.


@inlined_jit
def _of_bodies(w, y, part, rows, i):
    """Position or speed of the bodies to which eight axles or cars belong."""
    return spread(y[part]) if w.rigid else gather(y, rows, i)


@inlined_jit
def _find_patches(w, time, y):
    """Patches that touch the train at `time`; returns their number."""
    axle, patch, touching = w.axle, w.rail.patch, w.scratch.touching
    front = y[axle.position_row[0]] + axle.offset[0]
    last = w.size.axles - 1
    rear = y[axle.position_row[last]] + axle.offset[last]
    count = 0
    for p in range(patch.factor.size):
        edge, weight = patch.edge[p], window(time, patch.begin[p], patch.until[p], patch.fade[p])
        if weight > 0.0 and front > patch.start[p] - edge and rear < patch.end[p] + edge:
            touching[count], w.scratch.acting[count] = p, weight
            count += 1
    return count


@inlined_jit
def _find_declines(w, y):
    """Fall of the speed laws with the speed of every body: divided once for all its axles."""
    for k in range(0, w.car.inverse_body_mass.size, WIDTH):
        store(w.scratch.decline, k, speed_decline(load(y, w.row.speed + k), w.rail.law_offset))


@inlined_jit
def _peaks(w, y, i, patches):
    """Peak coefficient of eight axles; the patches and the fall with the speed are known."""
    axle, patch = w.axle, w.rail.patch
    x = _of_bodies(w, y, w.row.position, axle.position_row, i) + load(axle.offset, i)
    product = spread(1.0)
    for k in range(patches):
        p = w.scratch.touching[k]
        inside = window(x, patch.start[p], patch.end[p], patch.edge[p])
        product = product * patch_factor(inside, w.scratch.acting[k], patch.factor[p])
    scatter = spread(0.0)
    if w.rail.noisy:
        scatter = look_up(w.rail.noise, scatter_knot(x, w.rail.noise_length))
    peak = peak_coefficient(
        spread(w.scratch.decline[0]) if w.rigid else gather(w.scratch.decline, axle.body, i),
        load(axle.law[0], i), load(axle.law[1], i), product,
        load(axle.increment, i), scatter, w.rail.conditioning * load(w.scratch.cleaning.under, i),
    )  # fmt: skip
    if w.rail.sandy:
        amount = load(w.scratch.sand.under, i)
        peak = sanded_peak(peak, amount, w.rail.sanded, w.rail.sand_saturation)
    if w.rail.recovers:
        degree = cleaned_degree(load(y, w.row.recovery + i), load(w.scratch.cleaning.under, i))
        peak = recovered_peak(peak, degree, w.rail.recovered)
    return peak


@inlined_jit
def peak_field(w, time, y):
    """Peak coefficient of every axle in the padded state `y`, into `w.scratch.peak`."""
    patches = _find_patches(w, time, y)
    _find_declines(w, y)
    for i in range(0, w.axle.radius.size, WIDTH):
        store(w.scratch.peak, i, _peaks(w, y, i, patches))


@inlined_jit
def near_rest(w, y):
    """Whether a contact of the train may stick."""
    slowest = STICK_SPEED
    if w.size.groups > 0:
        for k in range(w.size.bodies):
            slowest = min(slowest, abs(y[w.row.speed + k]))
    return slowest < STICK_SPEED


@inlined_jit
def _coefficients(w, time, y, slope):
    """Adhesion field, tangential force coefficients, and their share in the cars' forces; deflections of contacts."""
    axle, c = w.axle, w.scratch
    patches = _find_patches(w, time, y)
    _find_declines(w, y)
    for i in range(0, axle.radius.size, WIDTH):
        v = _of_bodies(w, y, w.row.speed, axle.speed_row, i)
        peak = _peaks(w, y, i, patches)
        rim = load(axle.radius, i) * load(y, w.row.omega + i)
        slip = rim - v
        mu = tangential_coefficient(
            w.rail.curve_kind, w.rail.curve, slip, v, rim, peak, load(axle.contact, i)
        )
        if c.sticking[0]:
            brake = load(axle.holding_gain, i) * gather(y, axle.pressure_row, i)
            share = stuck_share(v, rim, brake)
            deflection = load(y, w.row.deflection + i)
            mu, rate = sticking_contact(mu, peak, slip, deflection, w.rail.presliding, share)
            store(slope, w.row.deflection + i, rate)
        store(c.peak, i, peak)
        store(c.mu, i, mu)
        store(c.load[0], i, mu * load(axle.static_load, i))
        if axle.pitches:
            store(c.load[1], i, mu * load(axle.unloading, i))


@inlined_jit
def _sum_of_car(values, car, k):
    """Sums over the axles of eight cars."""
    found = spread(0.0)
    for m in range(car.members.shape[0]):
        found = found + gather(values, car.members[m], k)
    return found


@inlined_jit
def _cars(w, y, slope):
    """Forces on the cars, and the work against resistance and gradient."""
    car, c = w.car, w.scratch
    lost = spread(0.0)
    end = w.rail.grade.size - 1.000001
    for k in range(0, car.mass.size, WIDTH):
        force = _sum_of_car(c.load[0], car, k)
        if w.axle.pitches:
            force = car_rail_force(force, _sum_of_car(c.load[1], car, k))
        v = _of_bodies(w, y, w.row.speed, car.speed_row, k)
        mass, air, curving = (
            load(car.mass, k),
            spread(w.rail.air_factor[0]),
            spread(w.rail.curving[0]),
        )
        downhill = gradient_force(mass, w.rail.grade[0])
        if not w.rail.uniform:
            x = _of_bodies(w, y, w.row.position, car.position_row, k) + load(car.offset, k)
            knot = minimum(
                maximum((x - w.rail.line_origin) * (1.0 / w.rail.line_spacing), 0.0), end
            )
            downhill = gradient_force(mass, look_up(w.rail.grade, knot))
            air = look_up(w.rail.air_factor, knot)
            if w.rail.curved:
                curving = look_up(w.rail.curving, knot)
        constant = load(car.resistance[0], k)
        if w.rail.curved:
            constant = constant + curving_resistance(mass, curving)
        drag = car_drag(
            v, constant, load(car.resistance[1], k), load(car.resistance[2], k), air, downhill,
        )  # fmt: skip
        store(c.car_force, k, force)
        store(c.net, k, force - drag)
        lost = lost + drag * v
    slope[w.row.work + 2] = total(lost)


@inlined_jit
def _rigid_body(w, y, slope):
    net = spread(0.0)
    for k in range(0, w.car.mass.size, WIDTH):
        net = net + load(w.scratch.net, k)
    slope[w.row.position] = y[w.row.speed]
    slope[w.row.speed] = total(net) * w.car.inverse_body_mass[0]
    slope[w.row.work + 3] = 0.0


@inlined_jit
def _coupled_bodies(w, y, slope):
    """Accelerations of the cars with the couplers between them, and the work that is lost there."""
    row, coupler, c = w.row, w.car.coupler, w.scratch
    lost = spread(0.0)
    for k in range(0, w.car.inverse_body_mass.size, WIDTH):
        elongation = load(y, row.position + k) - load(y, row.position + k + 1)
        rate = load(y, row.speed + k) - load(y, row.speed + k + 1)
        tension, damper = coupler_forces(
            elongation, rate,
            load(coupler[0], k), load(coupler[1], k), load(coupler[2], k), load(coupler[3], k),
        )  # fmt: skip
        if w.car.rubs:
            gear = w.car.draft_gear
            friction, creep, power = friction_draft_gear(
                coupler_stretch(elongation, load(coupler[3], k)), rate, load(y, row.gear + k),
                (
                    load(gear[0], k), load(gear[1], k), load(gear[2], k),
                    load(gear[3], k), load(gear[4], k), load(gear[5], k),
                ),
                load(gear[6], k), load(gear[7], k),
            )  # fmt: skip
            tension = tension + friction
            lost = lost + power
            store(slope, row.gear + k, creep)
        store(c.tension, WIDTH + k, tension)
        lost = lost + damper * rate
        # the coupler ahead is the one of the car before
        pull = load(c.tension, WIDTH + k - 1) - tension
        store(slope, row.position + k, load(y, row.speed + k))
        store(slope, row.speed + k, (load(c.net, k) + pull) * load(w.car.inverse_body_mass, k))
    slope[row.work + 3] = total(lost)


@inlined_jit
def _motors(w, time, y, slope):
    """Torque limits from the units' rim speeds, and the rate of the motor torques."""
    row, unit = w.row, w.unit
    share = power_taken(time, w.rail.receptivity)
    for j in range(0, unit.inverse_lag.size, WIDTH):
        speed = spread(0.0)
        for m in range(unit.members.shape[0]):
            speed = speed + load(unit.share[m], j) * gather(y, unit.members[m], j)
        if w.axle.parallel:
            store(w.scratch.unit_speed, j, speed * load(unit.shaft, j))
        place = load(unit.table_start, j) + limit_place(
            speed, 1.0 / EFFORT_SPEED_STEP, unit.table_size
        )
        slope_of_torque = motor_torque_rate(
            load(y, row.torque + j), load(w.scratch.command, j), look_up(unit.drive_table, place),
            share * look_up(unit.brake_table, place),
            where(load(unit.failure_time, j) > time, 1.0, spread(0.0)), load(unit.inverse_lag, j),
        )  # fmt: skip
        store(slope, row.torque + j, slope_of_torque)


@inlined_jit
def _is_braked(w, y):
    """Whether a cylinder holds pressure."""
    held = spread(0.0)
    for g in range(0, w.unit.inverse_times.shape[1], WIDTH):
        held = held + absolute(load(y, w.row.pressure + g))
    return is_nonzero(held)


@inlined_jit
def _wheels(w, y, slope):
    """Angular accelerations, and the works of motors, shoes and wheel-rail friction."""
    row, axle, c = w.row, w.axle, w.scratch
    driven, shod, braked, lost = spread(0.0), spread(0.0), _is_braked(w, y), spread(0.0)
    for i in range(0, axle.radius.size, WIDTH):
        v = _of_bodies(w, y, row.speed, axle.speed_row, i)
        normal = load(axle.static_load, i)
        if axle.pitches:
            carried = gather(c.car_force, axle.car, i)
            normal = axle_load(normal, load(axle.unloading, i), carried)
            store(c.normal, i, normal)
        force = load(c.mu, i) * normal
        store(c.force, i, force)
        r, omega = load(axle.radius, i), load(y, row.omega + i)
        gear, torque = load(axle.gear, i), gather(y, axle.torque_row, i)
        turned, stiffness = omega, load(axle.shaft[0], i)
        if axle.twists:
            turned = where(stiffness > 0.0, load(y, row.rotor + i), omega)
        if axle.parallel:
            torque = parallel_motor_torque(
                load(axle.motor[0], i), torque, load(axle.motor[1], i), load(axle.motor[2], i),
                gather(c.unit_speed, axle.unit, i), gear * turned,
            )  # fmt: skip
        motor = gear * torque
        driven = driven + motor * turned
        if axle.twists:
            rate, damping = turned - omega, load(axle.shaft[1], i)
            shaft = shaft_torque(load(y, row.twist + i), rate, stiffness, damping)
            shaft = where(stiffness > 0.0, shaft, motor)
            store(slope, row.twist + i, rate)
            store(slope, row.rotor + i, (motor - shaft) * load(axle.inverse_rotor, i))
            lost = lost + damping * rate * rate
            store(c.motor, i, motor)
            store(c.shaft, i, shaft)
            motor = shaft
        limit = spread(0.0)
        if braked:
            limit = load(axle.shoe_gain, i) * gather(y, axle.pressure_row, i)
            if axle.friction_fades:
                a, o, constant = (
                    load(axle.shoe_friction[0], i),
                    load(axle.shoe_friction[1], i),
                    load(axle.shoe_friction[2], i),
                )
                limit = limit * hyperbolic_speed_law(r * omega, a, o, constant)
        shoe, acceleration = wheelset(
            motor, force, r, omega, limit, load(axle.inertia, i), load(axle.inverse_inertia, i)
        )
        store(c.shoe, i, shoe)
        store(slope, row.omega + i, acceleration)
        power = force * slip_velocity(omega, r, v)
        store(slope, row.friction + i, power)
        if w.rail.recovers:
            rate = recovery_rate(
                load(y, row.recovery + i), power, v, w.rail.recovery_energy, w.rail.recovery_time
            )
            store(slope, row.recovery + i, rate)
        shod = shod + shoe * omega
    slope[row.work] = total(driven)
    slope[row.work + 1] = total(shod)
    if axle.twists:
        slope[row.work + 3] += total(lost)


@inlined_jit
def derivative(w, time, y, slope):
    """Fill `slope` (padded rows) with the derivative of the padded state `y` at `time` [s]."""
    _coefficients(w, time, y, slope)
    _cars(w, y, slope)
    if w.rigid:
        _rigid_body(w, y, slope)
    else:
        _coupled_bodies(w, y, slope)
    _motors(w, time, y, slope)
    _wheels(w, y, slope)
    for g in range(0, w.unit.inverse_times.shape[1], WIDTH):
        rate = cylinder_pressure_rate(
            load(y, w.row.pressure + g), load(w.scratch.target, g), load(w.scratch.valve, g),
            load(w.unit.inverse_times[0], g), load(w.unit.inverse_times[1], g),
        )  # fmt: skip
        store(slope, w.row.pressure + g, rate)


@jit
def find_limits(kind, curve, peak, speed, contact, limit, slip):
    """Adhesion limit and the slip velocity [m/s] there of as many axles as make whole blocks, into `limit` and `slip`."""
    for i in range(0, peak.size, WIDTH):
        most, top = adhesion_limit(kind, curve, load(peak, i), load(speed, i), load(contact, i))
        store(limit, i, most)
        store(slip, i, top)


# The plant compiled: a fixed-step integrator, with what acts between steps.
#
# Between steps the rail is read and changed (`alloc.old.plant.rail`), and brake commands pass through the cylinders' dead
# time.


@jit
def copy_row(source, first, target):
    """Fill `target` from `source`; compiled once, for wherever it is called is not where time goes."""
    for i in range(target.size):
        target[i] = source[first + i]


@inlined_jit
def pack(w, state, y):
    """Write `state` (rows,) to the padded `y`."""
    for i in range(state.size):
        y[w.place[i]] = state[i]


@inlined_jit
def unpack(w, y, state):
    """The inverse of `pack`."""
    for i in range(state.size):
        state[i] = y[w.place[i]]


@inlined_jit
def _note(w):
    """Keep what the right side has just computed and a record shows."""
    c, noted = w.scratch, w.noted
    copy_row(c.peak, 0, noted.peak)
    copy_row(c.mu, 0, noted.coefficient)
    copy_row(c.normal, 0, noted.load)
    copy_row(c.force, 0, noted.force)
    for i in range(w.size.axles):
        noted.brake[i] = c.shoe[i] / w.axle.radius[i]
    copy_row(c.motor, 0, noted.motor)
    copy_row(c.shaft, 0, noted.shaft)
    copy_row(c.slope, w.row.speed, noted.acceleration)
    copy_row(c.tension, WIDTH, noted.tension)


@inlined_jit
def _delay_pneumatics(w, target, valve):
    """Pass the brake commands through the dead time of each cylinder."""
    c = w.scratch
    slots = c.delay_target.shape[1]
    now = c.clock[0] % slots
    for g in range(w.size.groups):
        then = now - c.delay_steps[g]
        if then < 0:
            then += slots  # a remainder would cost more than the rest of this
        started = c.clock[0] >= c.delay_steps[g]
        c.delay_target[g, now] = target[g]
        c.delay_valve[g, now] = valve[g]
        c.target[g] = c.delay_target[g, then] if started else 0.0
        c.valve[g] = c.delay_valve[g, then] if started else 0.0
    c.clock[0] += 1


@inlined_jit
def _find_sticking(w):
    """Whether a contact may stick in the coming step, and the number of rows that change in it.

    A train that moves leaves no contact deflected: there nothing bears on it, and what it stored counts as lost already.
    """
    c, first = w.scratch, w.row.deflection
    was, now = c.sticking[0], near_rest(w, c.state)
    if was and not now:
        for i in range(first, w.row.end, WIDTH):
            store(c.state, i, spread(0.0))
    c.sticking[0] = now
    return w.row.end if now else first


@inlined_jit
def _copy(values, result, rows):
    for i in range(0, rows, WIDTH):
        store(result, i, load(values, i))


@inlined_jit
def _follow(c, weight, reach, rows):
    """Add the slope with this weight [s] to the step's end, and go `reach` [s] along it to the next stage; so many rows."""
    for i in range(0, rows, WIDTH):
        slope = load(c.slope, i)
        store(c.total, i, load(c.total, i) + weight * slope)
        store(c.stage, i, load(c.state, i) + reach * slope)


@inlined_jit
def inlined_advance(w, time, step, steps, state, inputs):
    """As `advance`, compiled into what calls it: the classical fourth-order Runge-Kutta method."""
    c = w.scratch
    pack(w, state, c.state)
    for j in range(w.size.units):
        c.command[j] = inputs.torque_command[j]
    for k in range(steps):
        _delay_pneumatics(w, inputs.pressure_target, inputs.valve)
        if w.rail.conditioned or w.rail.sandy:
            read_rail(w)
        rows = _find_sticking(w)
        _copy(c.state, c.stage, rows)
        _copy(c.state, c.total, rows)
        for stage in range(w.stages.shape[0]):
            reach, ahead, share = w.stages[stage, 0], w.stages[stage, 1], w.stages[stage, 2]
            derivative(w, time + (k + reach) * step, c.stage, c.slope)
            if k == 0 and stage == 0:
                _note(w)
            _follow(c, share * step, ahead * step, rows)
        _copy(c.total, c.state, rows)
        if w.rail.conditioned or w.rail.sandy:
            leave_rail(w, inputs.sand_rate)
    unpack(w, c.state, state)
    return time + steps * step


@jit
def advance(w, time, step, steps, state, inputs):
    """Advance `state` (rows,) in place by `steps` steps with constant `inputs`; return the new time [s].

    The workspace `w` stores the memory of the rail and of the brakes' dead time; `w.noted` has the adhesion field and the
    accelerations at the first instant.
    """
    return inlined_advance(w, time, step, steps, state, inputs)


__all__ = ["advance", "find_limits", "inlined_advance", "pack", "unpack", "workspace"]
