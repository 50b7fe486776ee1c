"""Short slip events of one motor car and one trailer: what solvers meet in the closed loop."""

from dataclasses import replace

import numpy as np

from alloc.event import DriverCommand, Event
from alloc.onboard.parameters import Braking, Onboard, Sensors
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.model import build, level_for
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Train

DURATION, DROP = 4.0, 1.0
"""Of an event, and instant from which adhesion is low [s]; torque is up within half a second."""
REFERENCE_SPEED = 15.0 / 3.6
"""Speed at which rails of every curve offer the drawn level [m/s]."""
CURVES = (PiecewiseCurve(), POLACH_WET, SlipRatioCurve())


def two_cars() -> Train:
    """The first trailer and the first motor car of the commuter set: one unit of four axles, with free axles beside it."""
    whole = find_set("commuter-8car")
    share = 2.0 / len(whole.cars)
    return replace(
        whole,
        name="commuter, two cars",
        cars=whole.cars[:2],
        resistance=tuple(share * value for value in whole.resistance),
    )


def drawn_event(seed: int, k: int) -> Event:
    """Event `k`: curves take turns, every fourth event is a stop; level, drop, speed and noise are drawn."""
    rng = np.random.default_rng([seed, k])
    curve, braking = CURVES[k % len(CURVES)], k % 4 == 3
    level, factor = rng.uniform(0.13, 0.17), rng.uniform(0.5, 0.75)
    noise = rng.uniform(0.0, 0.02) / 3.6
    speed = rng.uniform(15.0, 30.0) if braking else rng.uniform(4.0, 10.0)
    train = two_cars()
    if curve is POLACH_WET:
        level = level_for(POLACH_WET, level, REFERENCE_SPEED, train)
    low = Patch(factor, begin=DROP, until=DURATION + 1.0, fade=0.1)
    # the motors brake the whole train: the model of the MPC knows of no air brake
    onboard = Onboard(
        sensors=Sensors(speed_noise=noise, seed=seed + k), braking=Braking(blended=False)
    )
    return Event(
        f"drop-{seed}-{k}",
        build(train, Rail(level, patches=(low,), curve=curve)),
        DriverCommand((0.1,), (-0.8 if braking else 0.8,)),
        onboard,
        duration=DURATION,
        initial_speed=speed,
    )
