"""From a train, a rail and a line to the arrays that the plant computes with.

In: `Train`, `Rail`, `Line`. Out: a `Model` with the `Layout` of the state, the `Structure` (train as arrays) and the
`Environment` (rail and line as arrays). `build` makes it.
"""

import math
from dataclasses import astuple, dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.display import displayed
from alloc.old.errors import PlantError
from alloc.old.plant.adhesion import AdhesionCurve
from alloc.old.plant.laws import INDUCTION, LOCK_TIME, STANDSTILL_SPEED
from alloc.old.plant.rail import Line, Patches, Rail, Receptivity, axle_values, patch_arrays
from alloc.old.plant.train import NO_CHARACTERISTIC, Car, DraftGear, Train
from alloc.old.records import Made

# From a train to the arrays that the plant computes with.


Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


NO_WEDGES = (0.0,) * 8
"""`DraftGear.wedges` of a coupler without friction."""


class Structure(NamedTuple):
    """What belongs to the train alone. Axles, cars, bodies, units and brake groups count from the front."""

    axle_body: Ints  # (axles,) the body (car, or the whole rigid train) an axle pushes
    axle_car: Ints
    axle_unit: Ints  # -1: no motor
    axle_group: Ints  # -1: no air brake
    axle_sander: Ints  # that lays sand ahead of it, -1: none
    axle_offset: Floats  # position relative to the train's front [m], <= 0
    radius: Floats
    inertia: Floats
    gear: Floats  # motor torque times gear is wheel torque; 0: no motor
    static_load: Floats  # [N]
    unloading: Floats
    car_body: Ints
    car_offset: Floats  # middle of the car relative to the train's front [m]
    car_mass: Floats
    car_resistance: Floats  # (cars, 3)
    body_mass: Floats
    coupler: Floats  # (bodies - 1, 4): stiffness, stiffening, damping, slack
    draft_gear: Floats  # (bodies - 1, 8): `DraftGear.wedges`
    unit_axles: Floats  # number of axles of each unit
    unit_lag: Floats
    unit_gear: Floats
    axle_motor: Floats  # (3, axles) of the motor's unit: `Motors.characteristic`
    axle_shaft: (
        Floats  # (3, axles) `Motors.shaft`: inertia of the rotor, stiffness, damping, at the wheel
    )
    drive_table: Floats  # (units, EFFORT_TABLE_LENGTH) torque per motor [N m]
    brake_table: Floats
    group_fill: Floats
    group_release: Floats
    shoe_gain: Floats  # (axles,) force at the rim per pascal
    shoe_friction: Floats  # (axles, 3)


class Layout(NamedTuple):
    """Sizes of a train, and with them the rows of the state array (rows,)."""

    bodies: int
    axles: int
    cars: int
    units: int
    groups: int
    draft_gears: int
    """Couplers between the bodies where any of them has friction, else 0."""
    sanders: int
    pitching: int = 0
    """Axles where the force of its car unloads any of them, else 0."""
    shafts: int = 0
    """Axles where the drive of any of them twists, else 0."""
    recoveries: int = 0
    """Axles where their slip raises the rail's adhesion, else 0."""

    @property
    def position(self) -> slice:
        """Position of the train's front, as each body implies it [m]."""
        return slice(0, self.bodies)

    @property
    def speed(self) -> slice:
        """Speed of each body [m/s]."""
        return slice(self.bodies, 2 * self.bodies)

    @property
    def omega(self) -> slice:
        """Angular speed of each wheelset [rad/s]."""
        start = 2 * self.bodies
        return slice(start, start + self.axles)

    @property
    def torque(self) -> slice:
        """Motor torque of each unit's motors [N m], at the shaft, per motor."""
        start = self.omega.stop
        return slice(start, start + self.units)

    @property
    def pressure(self) -> slice:
        """Brake cylinder pressure of each group [Pa]."""
        start = self.torque.stop
        return slice(start, start + self.groups)

    @property
    def gear_travel(self) -> slice:
        """Travel of the wedges of each draft gear [m], positive in draft."""
        start = self.pressure.stop
        return slice(start, start + self.draft_gears)

    @property
    def rotor(self) -> slice:
        """Angular speed [rad/s] of each axle's rotor over its gear ratio; 0 where the drive is rigid."""
        start = self.gear_travel.stop
        return slice(start, start + self.shafts)

    @property
    def twist(self) -> slice:
        """Twist of each axle's drive [rad], at the wheel."""
        start = self.rotor.stop
        return slice(start, start + self.shafts)

    @property
    def recovery(self) -> slice:
        """Degree 0..1 to which each axle's own slip has cleaned its contact."""
        start = self.twist.stop
        return slice(start, start + self.recoveries)

    @property
    def friction_work(self) -> slice:
        """Work dissipated between wheel and rail by each axle [J]: JP4209318 (28), for driving too.

        At standstill it contains what the contact stores, a few joules.
        """
        start = self.recovery.stop
        return slice(start, start + self.axles)

    @property
    def work(self) -> slice:
        """Works [J]: of the motors, lost in the shoes, against resistance and gradient, lost in couplers and drives."""
        start = self.friction_work.stop
        return slice(start, start + 4)

    @property
    def deflection(self) -> slice:
        """Deflection of each axle's contact [m] near standstill, see `alloc.old.plant.laws`."""
        start = self.work.stop
        return slice(start, start + self.axles)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.deflection.stop


class _Axle(NamedTuple):
    """An axle's part of `Structure`."""

    car: int
    unit: int
    group: int
    sander: int
    offset: float
    gear: float
    shoe_gain: float
    shoe_friction: tuple[float, float, float]


def _axles(car: Car, number: int, front: float, unit: int, group: int, sander: int) -> list[_Axle]:
    """Axles of `car`, whose front is `front` [m] behind the train's; its first unit, brake group and sander are given."""
    brake, motors = car.air_brake, car.motors
    unit_of_axle = {i: unit + j for j, members in enumerate(car.units()) for i in members}
    sander_of_axle = {one.axle: sander + k for k, one in enumerate(car.sanders)}
    axles = []
    for i, (position, bogie) in enumerate(zip(car.axle_positions, car.bogie_of_axle, strict=True)):
        works = brake is not None and bogie not in brake.cut_out
        axles.append(
            _Axle(
                number,
                unit_of_axle.get(i, -1),
                -1 if brake is None else group + bogie,
                sander_of_axle.get(i, -1),
                -(front + position),
                motors.gear_ratio if motors is not None and i in unit_of_axle else 0.0,
                brake.force_per_pascal * brake.friction_factor if brake and works else 0.0,
                (0.0, 1.0, 0.0) if brake is None else brake.friction,
            )
        )
    return axles


def structure_of(train: Train) -> tuple[Structure, Layout]:
    """Arrays of the train, and the rows of its state."""
    cars, brakes, rigid = train.cars, train.brake_groups, train.couplers is None
    couplers = train.couplers or ()
    axles: list[_Axle] = []
    units = [(car, len(members)) for car in cars for members in car.units()]
    front, unit, group, sander = 0.0, 0, 0, 0
    for c, car in enumerate(cars):
        axles += _axles(car, c, front, unit, group, sander)
        front, unit, group = front + car.length, unit + len(car.units()), group + car.brake_groups
        sander += len(car.sanders)
    motors = [(car.motors, car.wheel_radius) for car, _ in units if car.motors is not None]
    drive = [motor.drive.tabulate(radius, motor.gear_ratio) for motor, radius in motors]
    brake = [motor.brake.tabulate(radius, motor.gear_ratio) for motor, radius in motors]
    columns = zip(_Axle._fields, zip(*axles, strict=True), strict=True)
    axle = {name: np.array(values) for name, values in columns}
    inertia = np.concatenate([np.array(car.wheel_inertia, dtype=float) for car in cars])
    shaft = np.array(
        [motors[j][0].shaft(whole) if j >= 0 else (0.0,) * 3 for j, whole in zip(axle["unit"], inertia, strict=True)]
    ).T  # fmt: skip
    mass = np.array([car.mass for car in cars])
    length = np.array([car.length for car in cars])
    a, b, quadratic = train.resistance
    car_body = np.zeros(len(cars), dtype=np.int64) if rigid else np.arange(len(cars))
    structure = Structure(
        axle_body=car_body[axle["car"]],
        axle_car=axle["car"],
        axle_unit=axle["unit"],
        axle_group=axle["group"],
        axle_sander=axle["sander"],
        axle_offset=axle["offset"],
        radius=np.concatenate([np.full(len(car.axle_positions), car.wheel_radius) for car in cars]),
        inertia=inertia,
        gear=axle["gear"],
        static_load=np.concatenate([car.static_axle_loads for car in cars]),
        unloading=np.concatenate([car.unloading_factors() for car in cars])
        * float(train.load_transfer),
        car_body=car_body,
        car_offset=-(np.cumsum(length) - 0.5 * length),
        car_mass=mass,
        car_resistance=np.stack(
            [a * mass / mass.sum(), b * mass / mass.sum(), quadratic * length / length.sum()],
            axis=1,
        ),
        body_mass=np.array([mass.sum()]) if rigid else mass,
        coupler=np.array(
            [
                (0.0, 0.0, 0.0, one.slack) if isinstance(one, DraftGear) else astuple(one)
                for one in couplers
            ]
        ).reshape(-1, 4),
        draft_gear=np.array(
            [one.wedges() if isinstance(one, DraftGear) else NO_WEDGES for one in couplers]
        ).reshape(-1, len(NO_WEDGES)),
        unit_axles=np.array([float(count) for _, count in units]),
        unit_lag=np.array([motor.torque_lag for motor, _ in motors]),
        unit_gear=np.array([motor.gear_ratio for motor, _ in motors]),
        axle_motor=np.array(
            [motors[j][0].characteristic if j >= 0 else NO_CHARACTERISTIC for j in axle["unit"]]
        ).T,
        axle_shaft=shaft,
        drive_table=np.stack(drive) if drive else np.zeros((0, 0)),
        brake_table=np.stack(brake) if brake else np.zeros((0, 0)),
        group_fill=np.array([one.fill_time for one in brakes]),
        group_release=np.array([one.release_time for one in brakes]),
        shoe_gain=axle["shoe_gain"],
        shoe_friction=axle["shoe_friction"],
    )
    sizes = (structure.body_mass.size, len(axles), len(cars), len(units), len(brakes))
    rubs = any(isinstance(one, DraftGear) for one in couplers)
    gears, shafts = len(couplers) if rubs else 0, len(axles) if shaft.any() else 0
    pitching = len(axles) if structure.unloading.any() else 0
    return structure, Layout(*sizes, gears, sander, pitching, shafts)


# From a rail and a line to the arrays that the plant computes with.


class Environment(NamedTuple):
    """Surroundings of the train: rail, line, receptivity, failures."""

    curve_kind: int
    curve: Floats  # parameters of the adhesion curve
    contact: Floats  # (axles,) creep stiffness over that among the parameters
    presliding: float
    law: Floats  # (3, axles)
    increment: Floats  # (axles,)
    patch: Patches
    noise: Floats  # (NOISE_KNOTS + 2,) a ring: its first knots again at the end
    noise_length: float
    noisy: bool
    conditioning: float  # gain
    conditioning_slip: float  # slip ratio
    conditioned: bool
    recovered: float  # coefficient of clean contacts
    recovery_energy: float  # [J/m]
    recovery_time: float  # [s]
    recovery_left: float  # share that an axle leaves on the rail
    cleaning_spacing: float
    sandy: bool  # whether the train has sanders
    sanded: float  # coefficient of sanded rail
    sand_saturation: float  # [kg/m]
    sand_kept: float  # share that an axle leaves
    line_origin: float
    line_spacing: float
    line: Floats  # (3, points): grade, air factor, resistance of curves per weight
    receptivity: Floats  # (4,): mean, amplitude, period, phase
    failure_time: Floats  # (units,) [s]; inf: never


def axle_contacts(curve: AdhesionCurve, structure: Structure) -> Floats:
    """Creep stiffness of each axle's contacts over that in the parameters of `curve`, (axles,).

    A wheel carries half of its axle's load.
    """
    return curve.contact(0.5 * structure.static_load, structure.radius)


def offered_by(curve: AdhesionCurve, level: float, speed: float, structure: Structure) -> float:
    """Adhesion that a rail of `level` and `curve` offers to a train at `speed` [m/s].

    It is the largest force of all axles over their weight: the curve's maximum, averaged with the static axle loads as
    weights. Heavy axles have the softer contacts.
    """
    share = structure.static_load / structure.static_load.sum()
    limit = curve.limit(level, speed, axle_contacts(curve, structure))[0]
    return float(np.broadcast_to(limit, share.shape) @ share)


def level_for(curve: AdhesionCurve, adhesion: float, speed: float, train: Train) -> float:
    """Level of a rail whose `curve` offers `adhesion` to `train` at `speed` [m/s]: the inverse of `offered_by`."""
    level, structure = adhesion, structure_of(train)[0]
    for _ in range(20):  # the maximum of Polach's curve grows a little less than in proportion
        before, level = level, level * adhesion / offered_by(curve, level, speed, structure)
        if level == before:
            break
    return level


def environment_of(
    structure: Structure,
    layout: Layout,
    train: Train,
    rail: Rail,
    line: Line,
    receptivity: Receptivity,
    failures: dict[int, float],
    span: tuple[float, float],
) -> Environment:
    """Surroundings of a train on `rail`; raises `PlantError` where train, rail and failures do not fit together."""
    failure = np.full(layout.units, np.inf)
    for unit, time in failures.items():
        if not 0 <= unit < layout.units:
            raise PlantError(
                f"failure: the train has no traction unit {unit + 1}; it has {layout.units}"
            )
        if math.isnan(time):
            raise PlantError(f"failure: time of traction unit {unit + 1} is not a number")
        failure[unit] = time
    length = sum(car.length for car in train.cars)
    origin, table = line.tabulate(span[0] - length - 50.0, span[1] + 50.0)
    noise = rail.noise_table()
    return Environment(
        curve_kind=rail.curve.kind,
        curve=rail.curve.q,
        contact=axle_contacts(rail.curve, structure),
        presliding=rail.presliding,
        law=rail.axle_laws(layout.axles),
        increment=axle_values(rail.increments, layout.axles, "rail increments"),
        patch=patch_arrays(rail.patches),
        noise=np.append(noise, noise[:2]),
        noise_length=rail.scatter_length,
        noisy=rail.scatter > 0.0,
        conditioning=rail.conditioning,
        conditioning_slip=rail.conditioning_slip,
        conditioned=rail.conditioning > 0.0 or layout.recoveries > 0,
        recovered=rail.recovered_coefficient,
        recovery_energy=rail.recovery_energy,
        recovery_time=rail.recovery_time,
        recovery_left=rail.recovery_left,
        cleaning_spacing=rail.cleaning_spacing,
        sandy=layout.sanders > 0,
        sanded=rail.sanded_coefficient,
        sand_saturation=rail.sand_saturation,
        sand_kept=1.0 - rail.sand_decay,
        line_origin=origin,
        line_spacing=line.spacing,
        line=table,
        receptivity=np.array(astuple(receptivity)),
        failure_time=failure,
    )


STABLE_STEP = 2.0
"""Largest product of stiffness and step; RK4's limit on the negative real axis is 2.78."""

HIGHEST_SPEED = 100.0
"""Speed [m/s] up to which running resistance grows: no train here is faster."""

DRAFT_GEAR_TRAVEL = 0.1
"""Stretch [m] for which the stiffness of a stiffening draft gear is bounded; real ones end at 0.06 to 0.1 m."""


class Inputs(NamedTuple):
    """Inputs of the plant that are constant over a step."""

    torque_command: Floats  # (units,) motor torque [N m] of each motor of the unit
    pressure_target: Floats  # (groups,) [Pa]
    valve: Floats  # (groups,) 0 follow the target, 1 hold, 2 release
    sand_rate: Floats  # (sanders,) [kg/s per rail]


@displayed
@dataclass(frozen=True, repr=False)
class Model:
    """A train on a rail and a line; build it with `build`."""

    train: Train
    rail: Rail
    line: Line
    layout: Layout
    structure: Structure
    environment: Environment
    span: tuple[float, float]
    """Stretch of line in the tables [m]."""

    @cached_property
    def made(self) -> Made:
        """What runs of this model share."""
        return Made()

    def __repr__(self) -> str:
        return f"<Model: train {self.train.name!r} on {repr(self.rail)[1:-1]}>"

    def initial_state(self, speed: float = 0.0, position: float = 0.0) -> Floats:
        """State (rows,) of a train that rolls without slip, brakes and motors off.

        `speed` [m/s] and `position` of the front [m]. Coupled cars stand at rest length. Raises `PlantError` if one is
        not finite.
        """
        PlantError.check(
            "initial state", {"speed": speed, "position": position}, finite=("speed", "position")
        )
        state = np.zeros(self.layout.rows)
        state[self.layout.position] = position
        state[self.layout.speed] = speed
        state[self.layout.omega] = speed / self.structure.radius
        if self.layout.shafts:
            elastic = self.structure.axle_shaft[1] > 0.0
            state[self.layout.rotor] = np.where(elastic, state[self.layout.omega], 0.0)
        return state

    def zero_inputs(self) -> Inputs:
        """Inputs with everything released."""
        n = self.layout
        return Inputs(*map(np.zeros, (n.units, n.groups, n.groups, n.sanders)))

    def stiffness(self) -> float:
        """Upper estimate [1/s] of the fastest rate: creep, resistance, locking wheels, couplers, motor lag, cylinders."""
        s, contact = self.structure, self.environment.contact
        peak = self.rail.greatest_peak()
        if self.environment.sandy:
            peak = max(peak, self.rail.sanded_coefficient)

        def of_contacts(stiffness: Floats) -> float:
            # wheels and body together: the fastest wheel's rate plus that of the body under all its axles
            carried = stiffness * s.static_load
            wheel = float((carried * s.radius**2 / (s.inertia - s.axle_shaft[0])).max())
            body = np.bincount(s.axle_body, carried, minlength=s.body_mass.size)
            return wheel + float((body / s.body_mass).max())

        rates = [of_contacts(self.rail.curve.steepest_slope(peak) * contact)]
        slope = (1.0 / STANDSTILL_SPEED, 1.0, 2.0 * HIGHEST_SPEED * self.environment.line[1].max())
        drag = np.bincount(s.car_body, s.car_resistance @ slope, minlength=s.body_mass.size)
        rates.append(float((drag / s.body_mass).max()))
        if s.unit_lag.size:
            rates.append(float(1.0 / s.unit_lag.min()))
            rates.append(float(self._motor_rates().max()))
            rates.append(float(self._shaft_rates().max()))
        if self.layout.recoveries:
            rates.append(1.0 / self.rail.recovery_time)
        if s.group_fill.size:
            rates += [1.0 / LOCK_TIME, float(1.0 / min(s.group_fill.min(), s.group_release.min()))]
            # contacts of braked wheels at rest
            spring = np.full_like(contact, peak / self.rail.presliding)
            rates.append(math.sqrt(of_contacts(spring)))
        if s.coupler.size:
            inverse = float((1.0 / s.body_mass[:-1] + 1.0 / s.body_mass[1:]).max())
            structure, loading, fluidity, damping = s.draft_gear[:, (0, 1, 6, 7)].T
            tangent = s.coupler[:, 0] + 3.0 * s.coupler[:, 1] * DRAFT_GEAR_TRAVEL**2 + structure
            damped = 2.0 * float((s.coupler[:, 2] + damping).max()) * inverse
            oscillation = math.sqrt(2.0 * float(tangent.max()) * inverse)
            # of wedges that slide, which the cars' motion hastens
            sliding = float(((structure + loading) * fluidity).max())
            rates += [damped, oscillation, sliding + damped + oscillation if sliding else 0.0]
        return max(rates)

    def _motor_rates(self) -> Floats:
        """Rate [1/s] at which motors on one inverter bring each wheelset to their mean speed, (axles,)."""
        s = self.structure
        kind, breakdown, slip = s.axle_motor
        steepest = s.drive_table.max(initial=0.0), s.brake_table.max(initial=0.0)
        slope = np.where(kind == INDUCTION, 2.0 * breakdown / slip, 2.0 * max(steepest) / slip)
        turned = np.where(s.axle_shaft[0] > 0.0, s.axle_shaft[0], s.inertia)
        return np.asarray(np.where(kind > 0.0, slope * s.gear**2 / turned, 0.0))

    def _shaft_rates(self) -> Floats:
        """Upper estimate [1/s] of the rate of each twisting drive, under its contact, (axles,)."""
        s = self.structure
        rotor, stiffness, damping = s.axle_shaft
        inverse = np.where(
            rotor > 0.0, 1.0 / np.maximum(rotor, 1e-9) + 1.0 / (s.inertia - rotor), 0.0
        )
        return np.asarray(np.sqrt(stiffness * inverse) + damping * inverse)

    def substeps(self, step: float) -> int:
        """Integration steps into which `step` [s] must be divided to be stable."""
        return max(1, math.ceil(step * self.stiffness() / STABLE_STEP))


def build(
    train: Train,
    rail: Rail,
    line: Line | None = None,
    receptivity: Receptivity | None = None,
    failures: dict[int, float] | None = None,
    span: tuple[float, float] = (0.0, 5000.0),
) -> Model:
    """Put a train on a rail and a line.

    `failures`: time [s] at which a traction unit (0 = foremost) loses its motors. `span`: smallest and largest position [m]
    of the train's front that the line must cover. Raises `PlantError` where train, rail and line do not fit.
    """
    if not (all(math.isfinite(x) for x in span) and span[0] < span[1]):
        raise PlantError(f"span: {span} must be two finite positions, the smaller one first")
    line, receptivity = line or Line(), receptivity or Receptivity()
    structure, layout = structure_of(train)
    if rail.recovered_coefficient:
        layout = layout._replace(recoveries=layout.axles)
    environment = environment_of(
        structure, layout, train, rail, line, receptivity, failures or {}, span
    )
    return Model(train, rail, line, layout, structure, environment, span)


__all__ = ["Environment", "Floats", "Inputs", "Ints", "Layout", "Model", "Structure", "build"]
