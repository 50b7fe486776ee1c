"""A train from railtoolkit vehicles, and what has to be assumed because the format does not say it.

The format gives masses, length, effort and resistance, but no wheelsets. Bogies are counted from the length, the driven ones
from `mass_traction`; each driven bogie is one traction unit.
"""

import math
from collections.abc import Sequence

from alloc.errors import PlantError
from alloc.plant.equations import GRAVITY
from alloc.plant.train import EFFORT_TABLE_LENGTH, AirBrake, Car, Motors, TorqueLimit, Train
from studies.files.study_error import StudyError
from studies.railtoolkit.keys import VehicleKeys

BOGIE_SPACING = 20.0
"""Typical distance [m] between bogies of a section (two bogies on a coach of 26 m, three under an articulated pair)."""
LARGEST_AXLE_LOAD = 22.5e3
"""Axle load [kg] of line category D: a heavier vehicle is given more bogies."""
BOGIE_WHEELBASE = 1.9
WHEEL_RADIUS = 0.43
"""New wheels of most European multiple units have 0.77 m to 0.92 m diameter; 0.86 m is the readhesion paper's."""
GEAR_RATIO = 7.07
"""Of the readhesion paper; it cancels between effort, torque and wheel."""
DRIVEN_INERTIA_RATIO = 2.0
"""Inertia of a driven wheelset with its gear and motor over that of a carrying one."""
SERVICE_PRESSURE = 380e3
"""Cylinder pressure [Pa] of a full service application, as usual in Europe."""
BRAKE_LAG = 0.2
"""Time constant [s] of the brake cylinders, assumed: the format knows a deceleration without build-up, so the brake is taken
as quick as a good electropneumatic one and the driver sees the rest coming."""
BRAKED_FALL = 0.05
"""Fall (per run) on which the full brake still reaches `a_braking`, assumed: the format gives the deceleration alone, on
whatever gradient. Running paths of standard railways stay below 0.04."""

AIR_SPEED_MARGIN = 15.0 / 3.6
"""Headwind [m/s] that the resistance formula of traction units and coaches adds to the speed."""
REFERENCE_SPEED = 100.0 / 3.6


def resistance(vehicle: VehicleKeys) -> tuple[float, float, float]:
    """A [N], B [N s/m], C [N s2/m2] of a vehicle.

    Driving vehicles: Wende, Fahrdynamik des Schienenverkehrs (2003), p. 151; coaches and wagons: p. 153 (Sauthoff, Strahl).
    """
    weight = 1e3 * vehicle.mass * GRAVITY * 1e-3  # so that coefficients in per mille give N
    margin = 0.0 if vehicle.vehicle_type == "freight" else AIR_SPEED_MARGIN
    air = vehicle.air_resistance * weight / REFERENCE_SPEED**2
    linear = 0.0
    if vehicle.powered:
        assert vehicle.mass_traction is not None
        driven = vehicle.mass_traction / vehicle.mass
        mean = driven * vehicle.base_resistance + (1.0 - driven) * vehicle.rolling_resistance
        constant = mean * weight
    else:
        constant = vehicle.base_resistance * weight
        if vehicle.vehicle_type == "passenger":
            linear = vehicle.rolling_resistance * weight / REFERENCE_SPEED
    return constant + air * margin**2, linear + 2.0 * air * margin, air


def bogie_count(vehicle: VehicleKeys) -> int:
    """Bogies of two axles under a vehicle, from its length and mass."""
    by_length = round(vehicle.length / BOGIE_SPACING) + 1
    by_mass = math.ceil(1e3 * vehicle.mass / (2.0 * LARGEST_AXLE_LOAD))
    return max(by_length, by_mass, 2)


def driven_bogies(vehicle: VehicleKeys) -> list[int]:
    """Which bogies drive: as many as `mass_traction` loads at the mean axle load, from both ends inwards."""
    count = bogie_count(vehicle)
    if not vehicle.powered:
        return []
    assert vehicle.mass_traction is not None
    driven = max(1, round(count * vehicle.mass_traction / vehicle.mass))
    order = sorted(range(count), key=lambda b: (min(b, count - 1 - b), b))
    return sorted(order[:driven])


def effort_table(vehicle: VehicleKeys) -> list[float]:
    """Tractive effort [N] at 0, 1, 2 ... km/h, linear between the given pairs, none beyond the last speed."""
    pairs = vehicle.tractive_effort or ()
    table = []
    for speed in range(min(EFFORT_TABLE_LENGTH, math.floor(pairs[-1][0]) + 1)):
        after = next(k for k, pair in enumerate(pairs) if pair[0] >= speed)
        if after == 0:
            table.append(pairs[0][1])
            continue
        (v0, f0), (v1, f1) = pairs[after - 1], pairs[after]
        table.append(f0 + (f1 - f0) * (speed - v0) / (v1 - v0))
    return [*table, 0.0]


def air_brake(mass: float, rotation_mass: float, axles: int, deceleration: float) -> AirBrake:
    """A brake on every axle of a car that gives `deceleration` [m/s2] on a fall of `BRAKED_FALL` at full pressure."""
    force = mass * (rotation_mass * deceleration + GRAVITY * BRAKED_FALL)
    return AirBrake(
        maximum_pressure=SERVICE_PRESSURE,
        force_per_pascal=force / (axles * SERVICE_PRESSURE),
        fill_time=BRAKE_LAG,
        release_time=BRAKE_LAG,
        dead_time=0.0,
    )


def build_car(
    vehicle: VehicleKeys, name: str, load_share: float = 0.0, deceleration: float | None = None
) -> Car:
    """One car of the plant for a vehicle; an articulated one counts as one rigid car with all its bogies.

    `load_share` of its `load_limit` is on board; the rotating mass is that of the loaded car, as running-time programs
    read `rotation_mass`. With a `deceleration` [m/s2] it has an air brake for it.
    """
    bogies, driving = bogie_count(vehicle), driven_bogies(vehicle)
    overhang = min(3.5, 0.25 * vehicle.length)
    spacing = (vehicle.length - 2.0 * overhang) / (bogies - 1)
    centres = [overhang + spacing * b for b in range(bogies)]
    driven = tuple(b in driving for b in range(bogies) for _ in range(2))
    empty, load = 1e3 * vehicle.mass, 1e3 * load_share * vehicle.load_limit
    mass = empty + load
    share = None
    if driving and vehicle.mass_traction is not None:
        on_driven = vehicle.mass_traction / vehicle.mass
        count, others = sum(driven), len(driven) - sum(driven)
        if others == 0:
            on_driven = 1.0
        rest = (1.0 - on_driven) / others if others else 0.0
        if rest > 0.0 or not others:
            share = tuple(on_driven / count if d else rest for d in driven)
    weights = [DRIVEN_INERTIA_RATIO if d else 1.0 for d in driven]
    rotating = max(vehicle.rotation_mass - 1.0, 1e-3) * mass * WHEEL_RADIUS**2
    motors = None
    if driving:
        scale = WHEEL_RADIUS / (GEAR_RATIO * sum(driven))
        torque = tuple(scale * effort for effort in effort_table(vehicle))
        motors = Motors(
            group="1C2M",
            gear_ratio=GEAR_RATIO,
            drive=TorqueLimit(peak=torque[0], power=0.0, table=torque),
            brake=TorqueLimit(peak=0.0, power=0.0),
        )
    half = 0.5 * BOGIE_WHEELBASE
    return Car(
        name=name,
        length=vehicle.length,
        empty_mass=empty,
        load=load,
        axle_positions=tuple(c + side for c in centres for side in (-half, half)),
        bogie_of_axle=tuple(b for b in range(bogies) for _ in range(2)),
        wheel_radius=WHEEL_RADIUS,
        wheel_inertia=tuple(rotating * w / sum(weights) for w in weights),
        driven=driven,
        motors=motors,
        air_brake=None
        if deceleration is None
        else air_brake(mass, vehicle.rotation_mass, len(driven), deceleration),
        axle_load_share=share,
    )


def build_formation(
    name: str,
    vehicles: Sequence[VehicleKeys],
    source: str,
    load_share: float = 0.0,
    deceleration: float | None = None,
) -> Train:
    """A rigid train of these vehicles, front to rear; its plan is its full effort at standstill.

    `load_share` and `deceleration` as in `build_car`. Resistance is that of the empty vehicles: the format's coefficients
    refer to `mass`.
    """
    try:
        cars = tuple(
            build_car(v, f"{v.id} {k + 1}", load_share, deceleration)
            for k, v in enumerate(vehicles)
        )
        terms = [resistance(vehicle) for vehicle in vehicles]
        a, b, c = (sum(term[k] for term in terms) for k in range(3))
        effort = sum(v.tractive_effort[0][1] for v in vehicles if v.powered and v.tractive_effort)
        moved = sum(v.rotation_mass * car.mass for v, car in zip(vehicles, cars, strict=True))
        return Train(
            name=name,
            cars=cars,
            resistance=(a, b, c),
            planned_acceleration=(effort - a) / moved,
            source=source,
        )
    except PlantError as error:
        raise StudyError(f"{source}: {error}") from None
