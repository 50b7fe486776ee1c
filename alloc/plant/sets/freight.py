"""Locomotive and container wagons with draft gear, as in RTRI's running tests with 5 and with 17 wagons."""

import math
from functools import partial

from alloc.plant.laws import GRAVITY, hyperbolic_speed_law
from alloc.plant.sets import SETS
from alloc.plant.train import AirBrake, Car, Coupler, Motors, TorqueLimit, Train

SOURCES = {
    "formation": "RTRI report, 3.1: diesel-electric locomotive DF200 and 5 or 17 loaded container wagons "
    "Koki 104 and 106",
    "locomotive": "DF200 (published data): 96 t on six axles, Bo-Bo-Bo; length 19.6 m",
    "wagon": "Koki 104 (published data): 20.4 m, about 19 t empty, 40 t of load; bogie centres 14.2 m, wheelbase 1.9 m",
    "brake force": "RTRI report, 3.2.2: locomotive about 60 kN in stops from 25 km/h in the third service step, taken at "
    "the middle of that speed range; wagons in proportion to mass; 350 kPa in that step and 500 kPa in emergency assumed",
    "friction": "assumed: (V + 150) / (2 V + 150), composition shoes relative to standstill; the report says that "
    "friction is a function of speed",
    "rigging": "RTRI report (7): constants of a wagon; one cylinder per bogie, since bogies are cut out one by one, of "
    "254 mm (10 inch, a usual size), efficiency 0.9 and shoe friction 0.25 at standstill assumed; the lever ratio, 4.9, "
    "follows from the brake force",
    "dead_time": "assumed: the brake pipe's wave runs at 250 m/s from the locomotive, and 0.3 s at the valve",
    "fill_time": "assumed: 3 s to fill, 6 s to release, slow cylinders of freight stock",
    "coupler": "assumed: rubber draft gear that stiffens (report, section 2), about 0.8 MN at 70 mm, 20 mm of slack, "
    "damping about a sixth of critical between two wagons at small amplitude",
    "motors": "assumed: 320 kW per axle, one inverter per motor, 250 kN at starting; gear ratio 4.96, wheels of 1.06 m",
    "wheel_inertia": "assumed: locomotive 260 kg m2 (larger wheels and motors), wagon 60 kg m2",
    "planned_acceleration": "assumed: needs a coefficient of 0.16 of the locomotive's axles",
    "resistance": "assumed: 2.0 kgf/t + 0.0006 V^2 kgf/t, V in km/h, of the order of published freight formulas",
}

STEP_PRESSURE = 350e3
LOCOMOTIVE_MASS = 96e3
STEP_FORCE = 60e3  # locomotive, third step, RTRI report Figs. 4 and 5
STEP_SPEED = 12.5 / 3.6  # a constant deceleration from 25 km/h has this mean speed
FRICTION = (37.5, 75.0, 0.5)  # (V + 150) / (2 V + 150)
STEP_FRICTION = hyperbolic_speed_law(STEP_SPEED, *FRICTION)
WAGON_MASS = (19e3, 40e3)  # empty, load
CYLINDERS = 2
PISTON_AREA = math.pi / 4.0 * 0.254**2
RIGGING_EFFICIENCY = 0.9
STANDSTILL_FRICTION = 0.25
EMERGENCY_PRESSURE = 500e3
PIPE_WAVE_SPEED = 250.0
VALVE_DEAD_TIME = 0.3
PLANNED_COEFFICIENT = 0.16
DRAFT_GEAR = Coupler(stiffness=4.0e6, stiffening=1.5e9, damping=1.2e5, slack=0.02)


def _gain(mass: float) -> float:
    """Brake force [N] of a whole car per pascal at standstill."""
    return STEP_FORCE * mass / LOCOMOTIVE_MASS / STEP_PRESSURE / STEP_FRICTION


LEVER_RATIO = _gain(sum(WAGON_MASS)) / (
    CYLINDERS * RIGGING_EFFICIENCY * PISTON_AREA * STANDSTILL_FRICTION
)


def _brake(mass: float, axles: int, distance: float) -> AirBrake:
    return AirBrake(
        maximum_pressure=EMERGENCY_PRESSURE,
        force_per_pascal=_gain(mass) / axles,
        fill_time=3.0,
        release_time=6.0,
        dead_time=VALVE_DEAD_TIME + distance / PIPE_WAVE_SPEED,
        friction=FRICTION,
    )


def _locomotive() -> Car:
    return Car(
        name="locomotive",
        length=19.6,
        empty_mass=LOCOMOTIVE_MASS,
        load=0.0,
        axle_positions=(1.8, 4.2, 8.6, 11.0, 15.4, 17.8),
        bogie_of_axle=(0, 0, 1, 1, 2, 2),
        wheel_radius=0.53,
        wheel_inertia=(260.0,) * 6,
        driven=(True,) * 6,
        motors=Motors(
            group="1C1M",
            gear_ratio=4.96,
            drive=TorqueLimit(peak=250e3 / 6 * 0.53 / 4.96, power=320e3),
            brake=TorqueLimit(peak=150e3 / 6 * 0.53 / 4.96, power=320e3, fade_speed=10.0 / 3.6),
        ),
        air_brake=_brake(LOCOMOTIVE_MASS, 6, 0.0),
    )


def _wagon(number: int) -> Car:
    empty, load = WAGON_MASS
    return Car(
        name=f"wagon {number}",
        length=20.4,
        empty_mass=empty,
        load=load,
        axle_positions=(2.15, 4.05, 16.35, 18.25),
        bogie_of_axle=(0, 0, 1, 1),
        wheel_radius=0.43,
        wheel_inertia=(60.0,) * 4,
        driven=(False,) * 4,
        air_brake=_brake(empty + load, 4, 19.6 + 20.4 * (number - 1)),
        pivot_height=0.7,
        speed_sensors=False,
    )


def train(wagons: int) -> Train:
    """Locomotive and `wagons` loaded wagons, coupled by draft gear."""
    cars = (_locomotive(), *(_wagon(k) for k in range(1, wagons + 1)))
    bare = Train(name=f"freight-{wagons}", cars=cars)
    tonnes = bare.mass / 1e3
    return Train(
        name=bare.name,
        cars=cars,
        resistance=(2.0 * GRAVITY * tonnes, 0.0, 0.0006 * 3.6**2 * GRAVITY * tonnes),
        couplers=(DRAFT_GEAR,) * wagons,
        planned_acceleration=PLANNED_COEFFICIENT
        * GRAVITY
        * LOCOMOTIVE_MASS
        / (bare.mass + bare.rotating_mass),
        source="RTRI report on brake force per car; composed, see sources",
        sources=SOURCES,
    )


SETS.register("freight-5", partial(train, 5))
SETS.register("freight-17", partial(train, 17))
