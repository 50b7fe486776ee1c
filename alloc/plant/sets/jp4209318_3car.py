"""Three braked cars of the slide protection's demonstration: JP4209318, Table 2."""

from alloc.plant.adhesion import SlipRatioCurve
from alloc.plant.laws import GRAVITY
from alloc.plant.rail import Rail
from alloc.plant.sets import SETS
from alloc.plant.train import AirBrake, Car, Train

SOURCES = {
    "empty_mass": "JP4209318, Table 2: 4000 kg per wheel, 8 wheels a car",
    "wheel_inertia": "JP4209318, Table 2: 60 kg m2 per wheel, 120 kg m2 per wheelset",
    "wheel_radius": "JP4209318, Table 2: 0.43 m",
    "maximum_pressure": "JP4209318, Table 2: 550 kPa",
    "dead_time": "JP4209318, Table 2: 0.05 s",
    "fill_time": "JP4209318, Table 2: 1.2 s",
    "release_time": "JP4209318, Table 2: 1.2 s, one value for the cylinder",
    "friction": "JP4209318, Table 2: constant",
    "bogie_of_axle": "JP4209318: 4 axles a car, one supply and one release valve per bogie",
    "force_per_pascal": "calibrated on Tables 3 and 4 (studies.slides.jp4209318): 0.14362 of the axle load at 550 kPa",
    "axle_positions": "assumed: 20 m car, bogie centres 13.8 m, wheelbase 2.1 m, usual in Japan",
    "resistance": "assumed zero: the source prints none, and it is below 2 % of the brake force",
    "cylinder_volume": "assumed: four tread brake units of 0.7 l at their stroke, and pipes",
    "rail": "the source's Fig. 2 is lost: orderings as in its text, values calibrated on Tables 3 and 4",
}

SHOE_FORCE_SHARE = 0.14362
"""Shoe force per axle load at the maximum pressure."""
AXLE_MASS = 8000.0


def train(cars: int = 3, shoe_force_share: float = SHOE_FORCE_SHARE) -> Train:
    """The train with 1, 2 or 3 `cars` (Table 3), or any other number."""
    pressure = 550e3
    brake = AirBrake(
        maximum_pressure=pressure,
        force_per_pascal=shoe_force_share * AXLE_MASS * GRAVITY / pressure,
        fill_time=1.2,
        release_time=1.2,
        dead_time=0.05,
        friction=(0.0, 1.0, 1.0),
    )
    car = Car(
        name="car",
        length=20.0,
        empty_mass=4 * AXLE_MASS,
        load=0.0,
        axle_positions=(2.05, 4.15, 15.85, 17.95),
        bogie_of_axle=(0, 0, 1, 1),
        wheel_radius=0.43,
        wheel_inertia=(120.0,) * 4,
        driven=(False,) * 4,
        air_brake=brake,
    )
    return Train(
        name=f"jp4209318-{cars}car",
        cars=(car,) * cars,
        source="JP4209318, Table 2",
        sources=SOURCES,
    )


FRONT_ADHESION, SPEED_OFFSET = 0.097318, 371.63
"""Coefficient of the foremost axle at standstill, and the c [km/h] of its fall 1 / (1 + V/c) with speed."""
REAR_GAIN, REAR_FALL = 0.56088, 0.11272
"""Far back: more adhesion at standstill, as a share, and the relative fall with speed over the front's."""


def rail() -> Rail:
    """Wet rail as the text describes it: lower and more dependent on speed in front, higher behind wheels that slide."""
    rear = FRONT_ADHESION * (1.0 + REAR_GAIN)
    return Rail(
        level=1.0,
        speed_law=(FRONT_ADHESION * SPEED_OFFSET, SPEED_OFFSET, 0.0),
        rear_speed_law=(rear * REAR_FALL * SPEED_OFFSET, SPEED_OFFSET, rear * (1.0 - REAR_FALL)),
        rear_axles=10.078,
        conditioning=0.03,
        conditioning_slip=0.085197,
        curve=SlipRatioCurve(peak_slip_ratio=0.016262, residual_ratio=1.0),
    )


SETS.register("jp4209318-3car", train)
