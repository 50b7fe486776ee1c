"""A train from railtoolkit vehicles, and what has to be assumed because the format does not say it.

The format gives masses, length, effort and resistance, but no wheelsets. Bogies are counted from the length, the driven ones
from `mass_traction`; each driven bogie is one traction unit.
"""

import math
from collections.abc import Sequence

from alloc.plant.equations import GRAVITY
from alloc.plant.errors import PlantError
from alloc.plant.train import EFFORT_TABLE_LENGTH, Car, Motors, TorqueLimit, Train
from studies.errors import StudyError
from studies.railtoolkit import VehicleKeys

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


def build_car(vehicle: VehicleKeys, name: str) -> Car:
    """One car of the plant for a vehicle; an articulated one counts as one rigid car with all its bogies."""
    bogies, driving = bogie_count(vehicle), driven_bogies(vehicle)
    overhang = min(3.5, 0.25 * vehicle.length)
    spacing = (vehicle.length - 2.0 * overhang) / (bogies - 1)
    centres = [overhang + spacing * b for b in range(bogies)]
    driven = tuple(b in driving for b in range(bogies) for _ in range(2))
    mass = 1e3 * vehicle.mass
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
        empty_mass=mass,
        load=0.0,
        axle_positions=tuple(c + side for c in centres for side in (-half, half)),
        bogie_of_axle=tuple(b for b in range(bogies) for _ in range(2)),
        wheel_radius=WHEEL_RADIUS,
        wheel_inertia=tuple(rotating * w / sum(weights) for w in weights),
        driven=driven,
        motors=motors,
        axle_load_share=share,
    )


def build_formation(name: str, vehicles: Sequence[VehicleKeys], source: str) -> Train:
    """A rigid, empty train of these vehicles, front to rear; its plan is its full effort at standstill."""
    try:
        cars = tuple(build_car(v, f"{v.id} {k + 1}") for k, v in enumerate(vehicles))
        terms = [resistance(vehicle) for vehicle in vehicles]
        a, b, c = (sum(term[k] for term in terms) for k in range(3))
        effort = sum(v.tractive_effort[0][1] for v in vehicles if v.powered and v.tractive_effort)
        moved = sum(1e3 * v.mass * v.rotation_mass for v in vehicles)
        return Train(
            name=name,
            cars=cars,
            resistance=(a, b, c),
            planned_acceleration=(effort - a) / moved,
            source=source,
        )
    except PlantError as error:
        raise StudyError(f"{source}: {error}") from None
