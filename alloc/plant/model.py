"""From a train, a rail and a line to the arrays that the plant computes with.

Lanes are scenarios advanced together: same train and line, own rail, own commands. Every array that may
differ between scenarios has the lane as its last dimension.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.errors import PlantError
from alloc.plant.equations import LOCK_TIME
from alloc.plant.rail import Line, Rail, Receptivity, axle_values
from alloc.plant.train import Train

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STABLE_STEP = 2.0
"""Largest product of stiffness and step; RK4's limit on the negative real axis is 2.78."""

DRAFT_GEAR_TRAVEL = 0.1
"""Stretch [m] for which the stiffness of a stiffening draft gear is bounded; real ones end at 0.06 to 0.1 m."""


class Structure(NamedTuple):
    """What belongs to the train alone. Axles, cars, bodies, units and brake groups count from the front."""

    axle_body: Ints  # (axles,) the body (car, or the whole rigid train) an axle pushes
    axle_car: Ints
    axle_unit: Ints  # -1: no motor
    axle_group: Ints  # -1: no air brake
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
    unit_axles: Floats  # number of axles of each unit
    unit_lag: Floats
    unit_gear: Floats
    drive_table: Floats  # (units, EFFORT_TABLE_LENGTH) torque per motor [N m]
    brake_table: Floats
    group_fill: Floats
    group_release: Floats
    shoe_gain: Floats  # (axles,) force at the rim per pascal
    shoe_friction: Floats  # (axles, 3)


class Environment(NamedTuple):
    """What the train meets, per lane: rail, line, receptivity, failures."""

    curve_kind: int
    curve: Floats  # parameters of the adhesion curve
    law: Floats  # (3, axles, lanes)
    increment: Floats  # (axles, lanes)
    patch: Floats  # (patches, 7, lanes): factor, start, end, edge, begin, until, fade
    noise: Floats  # (lanes, knots)
    noise_length: Floats  # (lanes,)
    noisy: bool
    conditioning: Floats  # (2, lanes): gain, slip ratio
    conditioned: bool
    cleaning_spacing: float
    line_origin: float
    line_spacing: float
    line: Floats  # (2, points): grade, air factor
    receptivity: Floats  # (4, lanes): mean, amplitude, period, phase
    failure_time: Floats  # (units, lanes) [s]; inf: never


class Inputs(NamedTuple):
    """What acts on the plant and is constant over a step, (rows, lanes)."""

    torque_command: Floats  # (units, lanes) motor torque [N m] of each motor of the unit
    pressure_target: Floats  # (groups, lanes) [Pa]
    valve: Floats  # (groups, lanes) 0 follow the target, 1 hold, 2 release
    cleaning: Floats  # (axles, lanes) 0..1, set by the transport of conditioning


@dataclass(frozen=True)
class Layout:
    """Rows of the state array (rows, lanes)."""

    bodies: int
    axles: int
    cars: int
    units: int
    groups: int

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
    def friction_work(self) -> slice:
        """Work dissipated between wheel and rail by each axle [J]: JP4209318 (28), for driving too."""
        start = self.pressure.stop
        return slice(start, start + self.axles)

    @property
    def work(self) -> slice:
        """Works [J]: of the motors, lost in the shoes, against resistance and gradient, lost in couplers."""
        start = self.friction_work.stop
        return slice(start, start + 4)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.work.stop


def _structure(train: Train) -> tuple[Structure, Layout]:
    cars = train.cars
    rigid = train.couplers is None
    axle: dict[str, list[float]] = {name: [] for name in ("car", "unit", "group", "offset", "gear")}
    unit_rows: list[tuple[int, float, float, Floats, Floats]] = []
    groups: list[tuple[float, float]] = []
    shoe_gain: list[float] = []
    friction: list[tuple[float, float, float]] = []
    front = 0.0
    for c, car in enumerate(cars):
        unit_of_axle = {}
        for members in car.units():
            assert car.motors is not None
            for i in members:
                unit_of_axle[i] = len(unit_rows)
            gear = car.motors.gear_ratio
            unit_rows.append(
                (
                    len(members),
                    car.motors.torque_lag,
                    gear,
                    car.motors.drive.tabulate(car.wheel_radius, gear),
                    car.motors.brake.tabulate(car.wheel_radius, gear),
                )
            )
        first_group = len(groups)
        if car.air_brake is not None:
            groups += [(car.air_brake.fill_time, car.air_brake.release_time)] * (
                max(car.bogie_of_axle) + 1
            )
        for i, position in enumerate(car.axle_positions):
            axle["car"].append(c)
            axle["unit"].append(unit_of_axle.get(i, -1))
            axle["gear"].append(
                car.motors.gear_ratio if car.motors is not None and i in unit_of_axle else 0.0
            )
            axle["group"].append(
                -1 if car.air_brake is None else first_group + car.bogie_of_axle[i]
            )
            axle["offset"].append(-(front + position))
            brake = car.air_brake
            works = brake is not None and car.bogie_of_axle[i] not in brake.cut_out
            shoe_gain.append(brake.force_per_pascal if brake is not None and works else 0.0)
            friction.append((0.0, 1.0, 0.0) if car.air_brake is None else car.air_brake.friction)
        front += car.length
    mass = np.array([car.mass for car in cars])
    length = np.array([car.length for car in cars])
    a, b, quadratic = train.resistance
    resistance = np.stack(
        [a * mass / mass.sum(), b * mass / mass.sum(), quadratic * length / length.sum()], axis=1
    )
    car_body = np.zeros(len(cars), dtype=np.int64) if rigid else np.arange(len(cars))
    axle_car = np.array(axle["car"], dtype=np.int64)
    table = (len(unit_rows), 0) if not unit_rows else None
    structure = Structure(
        axle_body=car_body[axle_car],
        axle_car=axle_car,
        axle_unit=np.array(axle["unit"], dtype=np.int64),
        axle_group=np.array(axle["group"], dtype=np.int64),
        axle_offset=np.array(axle["offset"]),
        radius=np.concatenate([np.full(len(car.axle_positions), car.wheel_radius) for car in cars]),
        inertia=np.concatenate([np.array(car.wheel_inertia, dtype=float) for car in cars]),
        gear=np.array(axle["gear"]),
        static_load=np.concatenate([car.static_axle_loads for car in cars]),
        unloading=np.concatenate([car.unloading_factors() for car in cars])
        * float(train.load_transfer),
        car_body=car_body,
        car_offset=-(np.cumsum(length) - 0.5 * length),
        car_mass=mass,
        car_resistance=resistance,
        body_mass=np.array([mass.sum()]) if rigid else mass,
        coupler=np.array(
            [[k.stiffness, k.stiffening, k.damping, k.slack] for k in train.couplers or ()]
        ).reshape(-1, 4),
        unit_axles=np.array([float(row[0]) for row in unit_rows]),
        unit_lag=np.array([row[1] for row in unit_rows]),
        unit_gear=np.array([row[2] for row in unit_rows]),
        drive_table=np.zeros(table) if table else np.stack([row[3] for row in unit_rows]),
        brake_table=np.zeros(table) if table else np.stack([row[4] for row in unit_rows]),
        group_fill=np.array([g[0] for g in groups]),
        group_release=np.array([g[1] for g in groups]),
        shoe_gain=np.array(shoe_gain),
        shoe_friction=np.array(friction),
    )
    layout = Layout(
        bodies=structure.body_mass.size,
        axles=axle_car.size,
        cars=len(cars),
        units=len(unit_rows),
        groups=len(groups),
    )
    return structure, layout


def _environment(
    layout: Layout,
    train: Train,
    rails: Sequence[Rail],
    line: Line,
    receptivity: Sequence[Receptivity],
    failures: Sequence[dict[int, float]],
    span: tuple[float, float],
) -> Environment:
    kinds = {(rail.curve.kind, tuple(rail.curve.q), rail.cleaning_spacing) for rail in rails}
    if len(kinds) > 1:
        raise PlantError(
            "lanes: all rails advanced together need the same adhesion curve and cleaning_spacing; "
            "run different curves in separate batches"
        )
    lanes = len(rails)
    patches = max(len(rail.patches) for rail in rails)
    patch = np.empty((patches, 7, lanes))
    patch[:] = np.array([1.0, -1e6, 1e6, 5.0, -1e6, 1e6, 1.0])[None, :, None]
    law = np.empty((3, layout.axles, lanes))
    failure = np.full((layout.units, lanes), np.inf)
    for b, rail in enumerate(rails):
        law[:, :, b] = rail.axle_laws(layout.axles)
        for p, item in enumerate(rail.patches):
            patch[p, :, b] = (
                item.factor, item.start, item.end, item.edge, item.begin, item.until, item.fade,
            )  # fmt: skip
        for unit, time in failures[b].items():
            if not 0 <= unit < layout.units:
                raise PlantError(
                    f"failure: the train has no traction unit {unit + 1}; it has {layout.units}"
                )
            if math.isnan(time):
                raise PlantError(f"failure: time of traction unit {unit + 1} is not a number")
            failure[unit, b] = time
    rail = rails[0]
    length = sum(car.length for car in train.cars)
    origin, table = line.tabulate(span[0] - length - 50.0, span[1] + 50.0)
    return Environment(
        curve_kind=rail.curve.kind,
        curve=rail.curve.q,
        law=law,
        increment=np.stack(
            [axle_values(r.increments, layout.axles, "rail increments") for r in rails], axis=1
        ),
        patch=patch,
        noise=np.stack([r.noise_table() for r in rails]),
        noise_length=np.array([r.scatter_length for r in rails]),
        noisy=any(r.scatter > 0.0 for r in rails),
        conditioning=np.array([[r.conditioning, r.conditioning_slip] for r in rails]).T.copy(),
        conditioned=any(r.conditioning > 0.0 for r in rails),
        cleaning_spacing=rail.cleaning_spacing,
        line_origin=origin,
        line_spacing=line.spacing,
        line=table,
        receptivity=np.array(
            [[r.mean, r.amplitude, r.period, r.phase] for r in receptivity]
        ).T.copy(),
        failure_time=failure,
    )


@dataclass(frozen=True, repr=False)
class Model:
    """A train on a line, in one or more lanes; build it with `build`."""

    train: Train
    rails: tuple[Rail, ...]
    line: Line
    layout: Layout
    structure: Structure
    environment: Environment
    span: tuple[float, float]

    def __repr__(self) -> str:
        lanes = "" if self.lanes == 1 else f", first of {self.lanes} lanes"
        return f"<Model: {self.train!r} on {self.rails[0]!r}{lanes}>"

    @property
    def lanes(self) -> int:
        """Number of scenarios advanced together."""
        return len(self.rails)

    def initial_state(self, speed: float | Floats = 0.0, position: float | Floats = 0.0) -> Floats:
        """State (rows, lanes) of a train that rolls without slip, brakes and motors off.

        `speed` [m/s] and `position` of the front [m]: one for all lanes, or (lanes,). Coupled cars stand at rest
        length. Raises `PlantError` if one is not finite.
        """
        given = {"speed": np.ravel(speed), "position": np.ravel(position)}
        PlantError.check("initial state", given, finite=("speed[]", "position[]"))
        state = np.zeros((self.layout.rows, self.lanes))
        state[self.layout.position] = position
        state[self.layout.speed] = speed
        state[self.layout.omega] = np.asarray(speed) / self.structure.radius[:, None]
        return state

    def zero_inputs(self) -> Inputs:
        """Inputs with everything released."""
        n, lanes = self.layout, self.lanes
        return Inputs(
            torque_command=np.zeros((n.units, lanes)),
            pressure_target=np.zeros((n.groups, lanes)),
            valve=np.zeros((n.groups, lanes)),
            cleaning=np.zeros((n.axles, lanes)),
        )

    def stiffness(self) -> float:
        """Estimate from above [1/s] of the fastest rate: creep, locking wheels, couplers, motor lag, cylinders."""
        s = self.structure
        slope = max(rail.curve.steepest_slope(rail.greatest_peak()) for rail in self.rails)
        # wheels and body together: the fastest wheel's rate plus that of the body under all its axles
        wheel = float((s.static_load * s.radius**2 / s.inertia).max())
        load = np.bincount(s.axle_body, s.static_load, minlength=s.body_mass.size)
        rates = [slope * (wheel + float((load / s.body_mass).max()))]
        if s.unit_lag.size:
            rates.append(float(1.0 / s.unit_lag.min()))
        if s.group_fill.size:
            rates += [1.0 / LOCK_TIME, float(1.0 / min(s.group_fill.min(), s.group_release.min()))]
        if s.coupler.size:
            inverse = float((1.0 / s.body_mass[:-1] + 1.0 / s.body_mass[1:]).max())
            tangent = s.coupler[:, 0] + 3.0 * s.coupler[:, 1] * DRAFT_GEAR_TRAVEL**2
            rates.append(2.0 * float(s.coupler[:, 2].max()) * inverse)
            rates.append(math.sqrt(2.0 * float(tangent.max()) * inverse))
        return max(rates)

    def substeps(self, step: float) -> int:
        """Integration steps into which `step` [s] must be divided to be stable."""
        return max(1, math.ceil(step * self.stiffness() / STABLE_STEP))


def build(
    train: Train,
    rail: Rail | Sequence[Rail],
    line: Line | None = None,
    receptivity: Receptivity | Sequence[Receptivity] | None = None,
    failures: dict[int, float] | Sequence[dict[int, float]] | None = None,
    span: tuple[float, float] = (0.0, 5000.0),
) -> Model:
    """Put a train on a rail and a line.

    `rail`: one rail, or one per lane. `failures`: time [s] at which a traction unit (0 = foremost) loses its motors.
    `span`: least and greatest position [m] of the train's front that the line must cover.
    Raises `PlantError` where train, rail and line do not fit.
    """
    rails = (rail,) if isinstance(rail, Rail) else tuple(rail)
    if not rails:
        raise PlantError("rail: no lane given; pass at least one Rail")
    if not (all(math.isfinite(x) for x in span) and span[0] < span[1]):
        raise PlantError(f"span: {span} must be two finite positions, the smaller one first")
    line = line or Line()
    if receptivity is None or isinstance(receptivity, Receptivity):
        receptivity = [receptivity or Receptivity()] * len(rails)
    if failures is None or isinstance(failures, dict):
        failures = [failures or {}] * len(rails)
    for name, given in (("receptivity", receptivity), ("failures", failures)):
        if len(given) != len(rails):
            raise PlantError(
                f"{name}: {len(given)} entries for {len(rails)} lanes; give one per lane, or one"
            )
    structure, layout = _structure(train)
    environment = _environment(layout, train, rails, line, receptivity, failures, span)
    return Model(train, rails, line, layout, structure, environment, span)
