"""The demonstration of JP4209318 with an electric brake: readhesion controllers and the MPC as slide protection.

Same rail, train and brake force; motors take the place of the shoes. Nothing of it is in the source: it asks what its air
brake's slide protection is worth beside one that acts within milliseconds.
"""

from dataclasses import replace

from alloc.event import DriverCommand, Event
from alloc.onboard.parameters import Belief, Onboard, ReferenceSpeed
from alloc.plant.equations import GRAVITY
from alloc.plant.model import build
from alloc.plant.sets import jp4209318_3car
from alloc.plant.train import InverterGroup, Motors, TorqueLimit, Train
from studies.slides.jp4209318 import INITIAL_SPEED, Undisclosed

GEAR_RATIO = 7.07
"""Of the readhesion paper; it cancels between torque and force."""
FADE_SPEED = 5.0 / 3.6
"""Speed [m/s] below which the electric brake fades, and to which its stops are measured."""
RISE_TIME = 2.5
"""Time [s] in which the brake rises, evenly: as much distance is lost as with the cylinders' lag of 1.2 s and their dead
time of 0.05 s."""
DURATION = 60.0
"""Time [s] longer than any stop here."""
REFERENCE_MARGIN = 0.02
"""Of the reference speed's bound [m/s2]. No axle runs free: each m/s2 of it lets the reference drift by 1 m/s in a second
while all axles slide. The line is known to be level."""


def electric_train(cars: int, group: InverterGroup, shoe_force_share: float) -> Train:
    """The train of Table 2 with a motor on every axle, which brakes with this share of the axle load; no air brake.

    `group`: motors per inverter. The wheelsets' inertia stays that of Table 2.
    """
    train = jp4209318_3car.train(cars, shoe_force_share)
    car = train.cars[0]
    load = float(car.static_axle_loads[0])
    peak = shoe_force_share * load * car.wheel_radius / GEAR_RATIO
    motors = Motors(
        group=group,
        gear_ratio=GEAR_RATIO,
        drive=TorqueLimit(peak=peak, power=1e9),
        brake=TorqueLimit(peak=peak, power=1e9, fade_speed=FADE_SPEED),
    )
    driven = (True,) * len(car.axle_positions)
    return replace(
        train,
        name=f"{train.name} electric",
        cars=tuple(replace(c, driven=driven, motors=motors, air_brake=None) for c in train.cars),
    )


def electric_event(
    undisclosed: Undisclosed, group: InverterGroup = "1C4M", cars: int = 3, step: float = 1e-3
) -> Event:
    """A full electric brake application from 100 km/h; to be run under the rule `alone`.

    The units believe in the rail's true curve and bound their reference speed by the forces that they estimate.
    """
    train = electric_train(cars, group, undisclosed.shoe_force_share)
    rail = undisclosed.rail()
    # what the brake gives a train that rolls; its rotating parts take their share of the force
    rolling = train.mass / (train.mass + train.rotating_mass)
    wanted = undisclosed.shoe_force_share * GRAVITY * rolling
    return Event(
        name=f"JP4209318, {cars} cars, electric brake {group}",
        model=build(train, rail, span=(0.0, 1500.0)),
        command=DriverCommand((0.0,), (-wanted,)),
        onboard=Onboard(
            rise_time=RISE_TIME,
            belief=Belief(curve=rail.curve),
            reference=ReferenceSpeed("forces", REFERENCE_MARGIN),
        ),
        duration=DURATION,
        initial_speed=INITIAL_SPEED,
        step=step,
        target_speed=FADE_SPEED,
    )
