"""A train from railtoolkit vehicles, and what has to be assumed because the format does not say it.

The format gives masses, length, effort and resistance, but no wheelsets. Bogies are counted from the length, the driven ones
from `mass_traction`; each driven bogie is one traction unit.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from alloc.errors import PlantError
from alloc.plant.laws import GRAVITY
from alloc.plant.train import AirBrake, Car, Motors, TorqueLimit, Train
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
"""Time constant [s] of the brake cylinders, assumed: the format has a deceleration without build-up. So the brake is assumed
to be as quick as a good electropneumatic one, and the driver anticipates the rest."""
BRAKED_FALL = 0.05
"""Fall (per run) on which the full brake still reaches `a_braking`, assumed: the format gives the deceleration alone, on
whatever gradient. Running paths of standard railways stay below 0.04."""

ROTATION_MASS = {True: 1.09, False: 1.06}
"""Factor of the rotating masses of a driving vehicle, and of others, where the file has none: TrainRuns.jl, `Train`."""
PASSENGER_BRAKING, FREIGHT_BRAKING = 0.375, 0.225
"""Deceleration [m/s2] under the service brake where no vehicle has an `a_braking`, and with a freight wagon in the train:
Bruenger and Dahlhaus (2014), p. 74, the defaults of TrainRuns.jl."""

AIR_SPEED_MARGIN = 15.0 / 3.6
"""Headwind [m/s] that the resistance formula of traction units and coaches adds to the speed."""
REFERENCE_SPEED = 100.0 / 3.6


def resistance(vehicle: VehicleKeys, load_share: float = 0.0) -> tuple[float, float, float]:
    """A [N], B [N s/m], C [N s2/m2] of a vehicle with this share of its `load_limit`.

    Driving vehicles: Wende, Fahrdynamik des Schienenverkehrs (2003), p. 151; coaches and wagons: p. 153 (Sauthoff, Strahl).
    The coefficients of coaches and wagons act on mass and load. Those of driving vehicles are printed for the vehicle as
    it is, and stay so under load.
    """
    load = 0.0 if vehicle.powered else load_share * vehicle.load_limit
    weight = (vehicle.mass + load) * GRAVITY  # of tonnes: coefficients in per mille give N
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


def rotation_mass(vehicle: VehicleKeys) -> float:
    """Factor of the vehicle's rotating masses."""
    given = vehicle.rotation_mass
    return ROTATION_MASS[vehicle.powered] if given is None else given


def default_deceleration(vehicles: Sequence[VehicleKeys]) -> float:
    """Deceleration [m/s2] under the service brake of a train none of whose vehicles has an `a_braking`."""
    freight = any(vehicle.vehicle_type == "freight" for vehicle in vehicles)
    return FREIGHT_BRAKING if freight else PASSENGER_BRAKING


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
    vehicle: VehicleKeys,
    name: str,
    load_share: float = 0.0,
    deceleration: float | None = None,
    loading: float = 1.0,
) -> Car:
    """One car of the plant for a vehicle; an articulated one counts as one rigid car with all its bogies.

    `load_share` of its `load_limit` is on board. With a `deceleration` [m/s2] it has an air brake for it. `loading` is the
    mass of the loaded train over that of the empty one, in which proportion rotating masses grow, see `build_formation`.
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
    turning = max(rotation_mass(vehicle) - 1.0, 1e-3) * empty * loading
    rotating = turning * WHEEL_RADIUS**2
    motors = None
    if driving:
        speeds, efforts = zip(*(vehicle.tractive_effort or ()), strict=True)
        motors = Motors(
            group="1C2M",
            gear_ratio=GEAR_RATIO,
            drive=TorqueLimit.of_effort(speeds, efforts, WHEEL_RADIUS, GEAR_RATIO, sum(driven)),
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
        else air_brake(mass, 1.0 + turning / mass, len(driven), deceleration),
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

    `load_share` and `deceleration` as in `build_car`. Rotating masses as in running-time programs: the train's factor is
    the mean of its vehicles' over their empty masses, and multiplies the mass of the loaded train.
    """
    empty = sum(vehicle.mass for vehicle in vehicles)
    loading = 1.0 + load_share * sum(vehicle.load_limit for vehicle in vehicles) / empty
    try:
        cars = tuple(
            build_car(v, f"{v.id} {k + 1}", load_share, deceleration, loading)
            for k, v in enumerate(vehicles)
        )
        terms = [resistance(vehicle, load_share) for vehicle in vehicles]
        a, b, c = (sum(term[k] for term in terms) for k in range(3))
        effort = sum(v.tractive_effort[0][1] for v in vehicles if v.powered and v.tractive_effort)
        bare = Train(name=name, cars=cars, resistance=(a, b, c), source=source)
        plan = (effort - a) / (bare.mass + bare.rotating_mass)
        return replace(bare, planned_acceleration=plan)
    except PlantError as error:
        raise StudyError(f"{source}: {error}") from None
