"""Routes drawn at random: a tunnel, a climb and a descent in any order and of any length, and stations."""

from typing import NamedTuple

import numpy as np

from alloc.onboard.speed_controller import SpeedCommand
from alloc.plant.rail import Line
from alloc.plant.sets import find_set
from studies.resistance.routes import FULL_LOAD, LINE_SPACING, Route


class Range(NamedTuple):
    """What a kind of route is drawn from; pairs are the ends of uniform distributions."""

    train: str
    cruise: tuple[float, float]
    """[m/s]"""
    below: float
    """Speed at the start of the run below the cruise [m/s]."""
    rate: float
    """Acceleration up to the cruise [m/s2]."""
    start: float
    """Where the first point may lie [m]: a minute behind the ramp of the speed, whose end moves the integrator too."""
    stretch: tuple[float, float]
    """Between two points [m]."""
    steepest: float
    """Gradients are a quarter of it to all of it, as rise per run."""
    tunnel_factor: tuple[float, float]
    stations: tuple[float, float]
    """Between two stations [m]."""


RANGES = {
    "commuter": Range(
        "commuter-8car", (16.0, 20.0), 3.0, 0.3, 1150.0, (400.0, 600.0), 0.025, (1.3, 2.5), (1000.0, 2500.0)
    ),
    "high-speed": Range(
        "high-speed-16car", (64.0, 72.0), 3.0, 0.12, 5300.0, (1300.0, 1900.0), 0.012, (1.3, 2.5), (30e3, 60e3)
    ),
}  # fmt: skip
"""All assumed. The last station lies up to a spacing behind the start."""
BLOCKS = ("tunnel", "climb", "descent")
SETTLING, START = 12.0, 2.0
"""Time [s] of the run after the last point and the train behind it; instant of the command."""


def drawn_route(name: str, generator: np.random.Generator) -> Route:
    """A route of the kind `name` of `RANGES`."""
    of = RANGES[name]
    cruise = float(generator.uniform(*of.cruise))
    first = max(cruise - of.below, 0.0)
    load = float(generator.uniform(0.0, 1.0)) * FULL_LOAD[name]
    train = find_set(of.train)
    train = train.loaded((load,) * len(train.cars))
    place, blocks = of.start, list(generator.permutation(BLOCKS))
    stations, grades, tunnels = [0.0], [0.0], []
    for block in blocks:
        begin = place + float(generator.uniform(*of.stretch))
        place = begin + float(generator.uniform(*of.stretch))
        if block == "tunnel":
            tunnels.append((begin, place))
        else:
            size = float(of.steepest * generator.uniform(0.25, 1.0))
            stations += [begin, place]
            grades += [size if block == "climb" else -size, 0.0]
    factor = float(generator.uniform(*of.tunnel_factor))
    line = Line(tuple(stations), tuple(grades), tuple(tunnels), factor, LINE_SPACING)
    length = sum(car.length for car in train.cars)
    ramp = (cruise - first) / of.rate
    rest = place + length - START * first - 0.5 * (first + cruise) * ramp
    duration = round(START + ramp + rest / cruise + SETTLING, 1)
    stops = [-float(generator.uniform(0.0, of.stations[1]))]
    while stops[-1] < place:
        stops.append(stops[-1] + float(generator.uniform(*of.stations)))
    command = SpeedCommand((START,), (cruise,), of.rate, first)
    return Route(name, train, line, command, duration, tuple(stops))
