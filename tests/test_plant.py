"""The plant against an independent one on whole arrays, against scipy, and by what holds for every train."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from alloc.onboard.columns import BRAKE, RUN, UNIT
from alloc.plant import dynamics as plant
from alloc.plant.columns import CAR, CYLINDER, DRIVE, LINE, PATCH, PLANT, WHEELSET
from alloc.plant.curves import CURVES
from alloc.run import event, wire
from tests.cases import looped

ROWS = ["y", "stages", "wheelsets", "cars", "drives", "cylinders", "patches", "line", "effort", "retard", "curve", "scatter",
        "rail", "plant", "commands"]  # fmt: skip
FORMS = ("rigid", "one car", "two cars", "three cars")


class Train:
    """Two driven axles of a unit, then two of a trailer, per car; every column another value per row."""

    def __init__(self, form="three cars", kind="piecewise", seed=1, **of_plant):
        self.g = g = np.random.default_rng(seed)
        cars = {"rigid": 3, "one car": 1, "two cars": 2, "three cars": 3}[form]
        n, rigid = 4 * cars, form == "rigid"
        car, place = np.repeat(np.arange(cars), 4), np.tile([0, 1, 2, 3], cars)
        driven = place < 2
        self.wheelsets = WHEELSET.rows(
            n, car=car, body=0 * car if rigid else car, unit=np.where(driven, car, -1), brake=2 * car + place // 2,
            offset=-20.0 * car - 3.0 * place, radius=g.uniform(0.4, 0.46, n), inertia=g.uniform(80, 160, n),
            gear=np.where(driven, 6.0 + car, 0.0), static_load=g.uniform(9e4, 1.1e5, n),
            unloading=np.tile([0.1, 0.02, -0.03, -0.09], cars), shoe_gain=g.uniform(0.02, 0.04, n),
            law_numerator=g.uniform(1, 3, n), law_constant=g.uniform(0.05, 0.1, n), increment=0.002 * np.arange(n) - 0.01,
            contact=g.uniform(0.8, 1.2, n), cleaned=g.random(n), recovery=g.random(n),
        )  # fmt: skip
        mass = np.bincount(car, self.wheelsets.static_load) / 9.80665
        self.cars = CAR.rows(
            cars, body=0 if rigid else np.arange(cars), mass=mass, middle=-20.0 * np.arange(cars) - 8.0,
            resistance=g.uniform(300, 600, cars), resistance_linear=g.uniform(5, 20, cars),
            resistance_quadratic=g.uniform(1, 4, cars), stiffness=2e6 + 1e5 * np.arange(cars), stiffening=1e9,
            damping=2e4, slack=0.01 + 0.001 * np.arange(cars),
        )  # fmt: skip
        ups = np.arange(cars)
        self.drives = DRIVE.rows(cars, axles=2, lag=0.05 + 0.03 * ups, radius=0.42 + 0.01 * ups,
                               applied=3e3 - 2.5e3 * ups, slip_torque=10.0 * ups, failure=1e9)  # fmt: skip
        m = 2 * cars
        self.cylinders = CYLINDER.rows(m, fill_time=g.uniform(0.3, 0.5, m), release_time=g.uniform(0.2, 0.4, m),
                                 dead_time=g.uniform(0.0, 0.1, m), friction_numerator=8.0, friction_offset=40.0,
                                 friction_constant=0.15, filling=g.uniform(1e5, 4e5, m),
                                 acting=np.arange(m) % 3)  # fmt: skip
        self.patches = PATCH.rows(2, factor=[0.6, 1.4], start=[90.0, -1e6], end=[120.0, 1e6], edge=[20.0, 5.0],
                                  begin=[-1e6, -1.0], until=[1e6, 2.0], fade=[0.2, 3.0])  # fmt: skip
        self.line = LINE.rows(
            9,
            grade=g.uniform(-0.02, 0.02, 9),
            air=g.uniform(1, 2, 9),
        )
        self.effort, self.retard = (
            g.uniform(1e3, 4e3, (cars, 120)),
            g.uniform(1e3, 4e3, (cars, 120)),
        )
        curve = CURVES[kind]()
        self.curve, self.scatter, self.rail = (
            curve.values,
            0.01 * g.standard_normal(50),
            np.zeros(4096),
        )
        given = {
            "body_mass": mass.sum() if rigid else 0.0, "pitches": 1, "parallel": 1, "law_offset": 30.0,
            "scatter_length": 7.0, "conditioning": 0.2, "line_origin": 40.0, "line_spacing": 10.0,
            "receptivity_mean": 0.7, "receptivity_amplitude": 0.2,
        }  # fmt: skip
        made = given | {"curve_number": curve.number} | of_plant
        self.plant = PLANT.rows(1, **made)[0]
        self.bodies, self.commands = (1 if rigid else cars), CYLINDER.record(400, m)
        self.commands.pressure_target = 2e5
        self.y = np.zeros(2 * self.bodies + 2 * n + cars + m + 4)
        self.stages = np.zeros((4, self.y.size))

    def state(self, speed):
        """A random state near `speed` [m/s]; micro and macro slip, and a coupler in each of its parts."""
        g, n, y = self.g, self.wheelsets.size, np.zeros(self.y.size)
        b, units, groups = self.bodies, self.drives.size, self.cylinders.size
        y[:b], y[b : 2 * b] = (
            100.0 - 0.02 * np.arange(b) * g.uniform(-1, 1),
            speed + 0.2 * g.standard_normal(b),
        )
        rim = y[b + self.wheelsets.body] + g.choice([0.01, 0.04, 0.5, -0.02, -1.0], n) * g.uniform(
            0.5, 1.5, n
        )
        rest = [
            rim / self.wheelsets.radius,
            3e3 * g.uniform(-1, 1, units),
            3e5 * g.random(groups),
            g.random(n + 4),
        ]
        y[2 * b :] = np.concatenate(rest)
        return y

    def slope(self, y, t=0.5):
        dy = np.full(y.size, np.nan)
        rows = [getattr(self, name) for name in ROWS[2:12]]
        plant.derivative(t, y, dy, *rows, self.plant)
        return dy

    def run(self, seconds, step=0.002, period=0.01):
        self.plant.step, self.plant.period = step, period
        for k in range(round(seconds / period)):
            plant.advance_period(k * period, *[getattr(self, name) for name in ROWS])
        return self.y


def independent(t, y, w):
    """The right side once more, on whole arrays and in other words."""
    a, c, u, p, b = w.wheelsets, w.cars, w.drives, w.plant, w.bodies
    n, m, groups = a.size, u.size, w.cylinders.size
    x, v, omega, torque, pressure, _ = np.split(y, np.cumsum([b, b, n, m, groups]))
    place, speed, on = x[a.body] + a.offset, v[a.body], a.unit >= 0

    def step(z):
        z = np.clip(z, 0.0, 1.0)
        return 6 * z**5 - 15 * z**4 + 10 * z**3

    offered = a.law_numerator / (3.6 * abs(speed) + p.law_offset) + a.law_constant
    for one in w.patches:
        acting = step((t - one.begin) / one.fade + 0.5) * step((one.until - t) / one.fade + 0.5)
        acting = (
            acting
            * step((place - one.start) / one.edge + 0.5)
            * step((one.end - place) / one.edge + 0.5)
        )
        offered = offered * (1 - acting) + offered * acting * one.factor
    knot = np.floor(place / p.scatter_length).astype(int)
    share = step(place / p.scatter_length - knot)
    offered = (
        offered
        + (1 - share) * w.scatter[knot % 50]
        + share * w.scatter[(knot + 1) % 50]
        + a.increment
    )
    offered = np.maximum(offered * (1 + p.conditioning * a.cleaned), 1e-3)
    if p.recovered_coefficient:
        offered = offered + (a.recovery + a.cleaned - a.recovery * a.cleaned) * np.maximum(
            p.recovered_coefficient - offered, 0.0
        )
    curve = next(one() for one in CURVES.values() if one.number == p.curve_number)
    mu = curve(a.radius * omega - speed, offered, speed, a.contact)
    pull = np.bincount(a.car, mu * a.static_load)
    if p.pitches:
        pull = pull / (1 + np.bincount(a.car, mu * a.unloading))
    force = mu * (a.static_load - p.pitches * a.unloading * pull[a.car])
    mean = np.array([omega[a.unit == j].mean() for j in range(m)])
    alive = t < u.failure
    motor = torque[a.unit] + (alive * u.slip_torque)[a.unit] * a.gear * (mean[a.unit] - omega)
    at_wheel = np.where(on, a.gear * motor, 0.0)
    friction = 8.0 / (3.6 * abs(a.radius * omega) + 40.0) + 0.15
    bound, other = (
        a.shoe_gain * pressure[a.brake] * friction * a.radius,
        at_wheel - a.radius * force,
    )
    shoe = np.clip(other + a.inertia * omega / 2e-3, -bound, bound)
    vc, xc = v[c.body], x[c.body] + c.middle
    points = np.clip((xc - p.line_origin) / p.line_spacing, 0, 8 - 1e-6)
    grade, air = (np.interp(points, np.arange(9), w.line[k]) for k in ("grade", "air"))
    drag = c.resistance + c.resistance_linear * abs(vc) + c.resistance_quadratic * air * vc**2
    drag = drag * vc / np.hypot(vc, 0.05) + c.mass * 9.80665 * np.sin(np.arctan(grade))
    stretch = -np.diff(x) - np.clip(-np.diff(x), -0.5 * c.slack[: b - 1], 0.5 * c.slack[: b - 1])
    tension = (c.stiffness[: b - 1] + 1e9 * stretch**2) * stretch - 2e4 * np.diff(v) * np.clip(
        abs(stretch) * 1e3, 0, 1
    )
    net = (
        np.bincount(a.body, force)
        - np.bincount(c.body, drag)
        + np.append(0, tension)
        - np.append(tension, 0)
    )
    kmh = np.minimum(3.6 * abs(mean) * u.radius, 119 - 1e-6)
    drive, brake = (np.array([np.interp(k, np.arange(120), one) for k, one in zip(kmh, table, strict=True)])
                    for table in (w.effort, w.retard))  # fmt: skip
    brake = brake * np.clip(
        p.receptivity_mean + p.receptivity_amplitude * np.sin(2 * np.pi * t / p.receptivity_period),
        0,
        1,
    )
    rate = (alive * np.clip(u.applied, -brake, drive) - torque) / u.lag
    s = w.cylinders
    filling = np.choose(
        s.acting.astype(int), [(s.filling - pressure) / s.fill_time, 0, -pressure / s.release_time]
    )
    works = [at_wheel @ omega, shoe @ omega, drag @ vc, tension @ -np.diff(v)]
    return np.concatenate([v, net / np.bincount(c.body, c.mass), (other - shoe) / a.inertia, rate, filling,
                           force * (a.radius * omega - speed), works])  # fmt: skip


@looped("form", FORMS)
def test_right_side_is_that_of_an_independent_plant(form):
    for kind in (
        "piecewise",
        "polach-wet",
        "polach-by-friction",
        "slip-ratio",
        "rational",
        "exponential-difference",
    ):
        w = Train(
            form,
            kind,
            recovered_coefficient=0.15 if kind == "rational" else 0.0,
            pitches=int(kind != "slip-ratio"),
        )
        w.drives.failure[-1] = 1.0
        for speed, t in (
            (10.0, 0.5),
            (24.0, 3.0),
            (-6.0, 0.2),
            (0.1, 1.5),
            (60.0, 0.5),
        ):  # beyond the motors' table
            for _ in range(5):
                y = w.state(speed)
                assert np.allclose(w.slope(y, t), independent(t, y, w), rtol=1e-9, atol=1e-7)


@looped("form", FORMS)
def test_power_of_motors_goes_somewhere(form):
    w = Train(form)
    n, b = w.wheelsets.size, w.bodies
    for _ in range(20):
        y = w.state(10.0)
        dy = w.slope(y)
        mass = np.bincount(w.cars.body, w.cars.mass)
        kinetic = (
            mass * y[b : 2 * b] @ dy[b : 2 * b]
            + w.wheelsets.inertia * y[2 * b : 2 * b + n] @ dy[2 * b : 2 * b + n]
        )
        motors, shoes, lost, coupled = dy[-4:]
        assert kinetic + shoes + lost + coupled + dy[-4 - n : -4].sum() == pytest.approx(
            motors, rel=1e-9, abs=1e-3
        )


@looped("form", FORMS)
def test_solution_is_that_of_scipy(form):
    w = Train(form)
    w.cylinders.acting, w.cylinders.filling, w.cylinders.dead_time = 0.0, 2e5, 0.0
    w.plant.conditioning, w.scatter[:] = 0.0, 0.0
    w.y[:] = w.state(10.0)
    found = solve_ivp(
        independent, (0.0, 0.1), w.y.copy(), args=(w,), rtol=1e-8, atol=1e-8, max_step=2e-3
    )
    speeds = slice(w.bodies, 2 * w.bodies + w.wheelsets.size)
    assert np.allclose(w.run(0.1, step=0.0005)[speeds], found.y[speeds, -1], atol=1e-6)


@looped("form", FORMS)
def test_driving_is_braking_in_a_mirror(form):
    w = Train(
        form, receptivity_mean=1.0, receptivity_amplitude=0.0, conditioning=0.0, scatter_length=0.0
    )
    w.retard, w.line, w.patches = w.effort, LINE.rows(1), w.patches[1:]
    y, b = w.state(10.0), w.bodies
    forward, flip = w.slope(y), np.ones(y.size)
    flip[: 2 * b + w.wheelsets.size + w.drives.size] = -1.0
    w.drives.applied *= -1.0
    w.wheelsets.unloading *= -1.0
    np.testing.assert_allclose(w.slope(y * flip), forward * flip, rtol=1e-9, atol=1e-6)


def wheels_after(step, period=0.02, seconds=0.02):
    """Angular speeds beyond the peak of a rail whose adhesion changes in time, smoothly."""
    w = Train("rigid", scatter_length=0.0, conditioning=0.0, pitches=0, receptivity_amplitude=0.0)
    w.patches = PATCH.rows(1, factor=3.0, begin=0.02, fade=0.1)
    w.wheelsets.static_load, w.wheelsets.inertia, w.cylinders.dead_time, w.drives.slip_torque = (
        2e4,
        300.0,
        0.0,
        0.0,
    )
    w.wheelsets.law_numerator, w.wheelsets.law_constant, w.wheelsets.increment = (
        0.0,
        0.03,
        0.0,
    )  # no kinks in time
    w.effort[:] = w.retard[:] = 1e3
    w.commands.pressure_target, w.drives.applied = 0.0, 300.0
    w.y[1], w.y[2:14] = 5.0, 5.3 / w.wheelsets.radius
    return w.run(seconds, step, period)[2:14].copy()


def test_integrator_is_of_fourth_order():
    best = wheels_after(0.02 / 256)
    errors = [np.abs(wheels_after(0.02 / k) - best).max() for k in (2, 4, 8)]
    assert np.all(np.abs(np.diff(np.log2(errors)) + 4.0) < 0.6)


def test_neither_half_the_step_nor_the_period_matters():
    assert np.allclose(wheels_after(0.002), wheels_after(0.001), atol=1e-8)
    assert np.allclose(wheels_after(0.0025, 0.02), wheels_after(0.0025, 0.005), rtol=1e-13)
    assert np.array_equal(wheels_after(0.003), wheels_after(0.02 / 7))


@looped("kind", CURVES)
def test_steps_are_as_short_as_the_contacts_need(kind):
    w = Train("three cars", kind)
    most = (w.wheelsets.law_numerator / w.plant.law_offset + w.wheelsets.law_constant).max()
    most = (1.4 * most + 0.06) * (1.0 + w.plant.conditioning)  # patch, increments and scatter
    shortest = plant.find_rates(w.wheelsets, w.cars, w.drives, w.cylinders, w.curve, most, w.plant)
    assert shortest <= w.plant.step
    for speed in (0.5, 15.0):  # where the curve goes by creep, a fast train takes longer steps
        start, found = w.state(speed), []
        for step in (event.STEP, shortest / 4):
            w.y[:], w.wheelsets.cell, w.rail[:] = start, 0, 0.0
            found.append(w.run(0.5, step)[3:6].copy())
        assert np.allclose(*found, atol=0.005)


def test_a_locked_wheel_stays_locked_until_it_is_released():
    w = Train("one car", conditioning=0.0)
    w.cylinders.dead_time, w.cylinders.fill_time, w.drives.applied, w.drives.slip_torque = (
        0.0,
        0.05,
        0.0,
        0.0,
    )
    w.wheelsets.shoe_gain = 0.5
    w.y[0], w.y[1], w.y[2:6] = 100.0, 20.0, 20.0 / w.wheelsets.radius
    w.run(1.5)
    assert np.all(np.abs(w.y[2:6]) < 1e-9)
    assert 10.0 < w.y[1] < 19.5
    w.commands.pressure_target, speed = 0.0, w.y[1]
    w.run(3.0)
    assert np.allclose(w.wheelsets.radius * w.y[2:6], w.y[1], atol=0.1)
    assert w.y[1] < speed


def test_cylinders_respond_after_their_dead_time_as_asked():
    w = Train("one car")
    w.cylinders.dead_time, w.cylinders.fill_time = [0.0, 0.025], 0.4
    w.commands.valve[20:, 0] = 1.0
    w.run(0.3, step=0.0025)
    pressure = w.y[2 + 4 + 1 :][:2]
    assert pressure == pytest.approx(2e5 * (1.0 - np.exp(-np.array([0.2, 0.275]) / 0.4)), rel=1e-6)


def test_wheels_that_slip_clean_the_rail_for_those_behind():
    for recovered in (0.0, 0.3):
        w = Train(
            "rigid",
            conditioning=0.0 if recovered else 0.3,
            recovered_coefficient=recovered,
            scatter_length=0.0,
        )
        w.patches, w.wheelsets.cleaned, w.wheelsets.recovery, w.commands.pressure_target = (
            w.patches[:0],
            0.0,
            0.0,
            0.0,
        )
        w.drives.applied = [2.5e3, 0.0, 0.0]
        w.effort[:], w.wheelsets.increment = 4e3, -0.05
        w.y[0], w.y[1], w.y[2:14] = 100.0, 15.0, 15.0 / w.wheelsets.radius
        w.run(2.5)
        slip = np.abs(w.wheelsets.slip_velocity)
        assert slip[:2].min() > 0.5 > 0.1 > slip[2:].max()
        assert w.wheelsets.cleaned[0] == 0.0
        assert np.all(w.wheelsets.cleaned[2:6] > 0.1)
        assert w.wheelsets.recovery.max() == (w.wheelsets.recovery[:2].max() if recovered else 0.0)


def test_a_failed_unit_pulls_no_more():
    w = Train("rigid", conditioning=0.0)
    w.drives.failure[0], w.y[0], w.y[1], w.y[2:14] = 0.2, 100.0, 10.0, 10.0 / w.wheelsets.radius
    w.commands.pressure_target, w.drives.applied, w.effort[:] = 0.0, 500.0, 4e3
    assert np.allclose(w.run(1.0)[14:17], [0.0, 500.0, 500.0], atol=0.1)


def test_the_record_has_what_follows_from_the_state():
    w = Train("three cars")
    y, row = w.state(10.0), w.plant
    dy = w.slope(y)
    plant.note_instant(y, dy, w.wheelsets, w.cars, w.drives, w.cylinders, row)
    assert (row.position, row.motor_work, row.coupler_work) == (y[0], y[-4], y[-1])
    assert row.speed == pytest.approx(w.cars.mass @ y[3:6] / w.cars.mass.sum())
    assert row.acceleration == pytest.approx(w.cars.mass @ dy[3:6] / w.cars.mass.sum())
    assert np.array_equal(w.wheelsets.rim_speed, w.wheelsets.radius * y[6:18])
    assert np.array_equal(w.cylinders.cylinder_pressure, y[21:27])


def test_the_oracle_is_told_what_the_next_steps_carry():
    w, run = Train("rigid", conditioning=0.0, scatter_length=0.0, pitches=0), RUN.rows(1)[0]
    w.patches = PATCH.rows(1, factor=0.5, start=101.0, edge=0.01)
    w.wheelsets.static_load, w.wheelsets.increment = 1e5, 0.0
    w.wheelsets.law_numerator, w.wheelsets.law_constant = 0.0, 0.2
    units, brakes = UNIT.rows(3, load=1e5), BRAKE.rows(6)
    rows = [getattr(w, name) for name in (*ROWS[1:12], "plant")]
    # at 40 m/s the front is on the patch within 0.15 s
    for speed, truth in ((0.0, 0.2 * wire.USED), (40.0, 0.1 * wire.USED)):
        w.y[0], w.y[1], w.y[2:14] = 100.0, speed, speed / w.wheelsets.radius
        wire.tell_limits(0.0, w.y, *rows, units, brakes, run)
        assert units.truth[0] == pytest.approx(truth)
        assert units.truth[2] == pytest.approx(0.2 * wire.USED)


@looped("form", FORMS)
def test_compiled_and_plain_python_agree(form):
    helpers = {name: one for name, one in vars(plant).items() if hasattr(one, "py_func")}
    for kind, recovered in (("piecewise", 0.0), ("polach-wet", 0.2)):
        w, plain = (
            Train(form, kind, recovered_coefficient=recovered),
            Train(form, kind, recovered_coefficient=recovered),
        )
        w.y[:] = plain.y[:] = w.state(8.0)
        w.run(0.02)
        with pytest.MonkeyPatch.context() as patch:
            for name, one in helpers.items():
                patch.setattr(plant, name, one.py_func)
            plain.run(0.02)
        assert np.allclose(w.y, plain.y, rtol=1e-12, atol=1e-12)
        for rows, others in (
            (w.wheelsets, plain.wheelsets),
            (w.cars, plain.cars),
            (w.cylinders, plain.cylinders),
        ):
            assert all(
                np.allclose(rows[key], others[key], rtol=1e-12, atol=1e-12)
                for key in rows.dtype.names
            )
