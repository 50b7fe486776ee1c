"""Routes of the speed control's study: a train, its line with a tunnel and gradients, and the commanded speed."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from alloc.onboard.line_memory import LineMemory
from alloc.onboard.speed_controller import SpeedCommand
from alloc.plant.model import Model, build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Train

DRY = Rail(0.3)
"""Adhesion that no torque of the speed control reaches."""
LINE_SPACING = 1.0
"""Metres over which gradient and tunnel change."""


class Point(NamedTuple):
    """A place where the resistance changes."""

    position: float
    """[m]"""
    kind: str
    """"tunnel mouth" or "gradient change"."""


class LineBelief(NamedTuple):
    """Line that the train believes in."""

    line: Line
    """Gradients and tunnels; `tunnel_factor` and curves are not read."""
    air: tuple[float, float] = (1.0, 1.0)
    """K1 and K2 over the true air resistance, open and tunnel."""


@dataclass(frozen=True)
class Route:
    """Specification of a run: a loaded train on its line under a speed command.

    `stations` [m]: where an odometer is reset. `belief`: the line that the train believes in, the line itself if None.
    """

    name: str
    train: Train
    line: Line
    command: SpeedCommand
    duration: float
    stations: tuple[float, ...] = ()
    belief: LineBelief | None = None

    def model(self) -> Model:
        """The plant."""
        end = 100.0 + self.duration * max(*self.command.speeds, self.command.initial)
        return build(self.train, DRY, self.line, span=(0.0, end))

    def memory(self, reading: str = "middle") -> LineMemory:
        """What the train remembers of the line, read at its "front", its "middle" or in the middle of all "cars"."""
        lengths = np.array([car.length for car in self.train.cars])
        masses = np.array([car.mass for car in self.train.cars])
        ends, line = np.cumsum(lengths), self.belief.line if self.belief else self.line
        offsets = {
            "front": (0.0,),
            "middle": (-0.5 * float(ends[-1]),),
            "cars": tuple((0.5 * lengths - ends).tolist()),
        }[reading]
        grades = tuple(100.0 * grade for grade in line.grades)
        shares = (
            tuple(tuple((of / of.sum()).tolist()) for of in (lengths, masses))
            if reading == "cars"
            else ()
        )
        return LineMemory(line.stations, grades, line.tunnels, offsets, *shares)

    @property
    def length(self) -> float:
        """Of the train [m]."""
        return sum(car.length for car in self.train.cars)

    @property
    def points(self) -> tuple[Point, ...]:
        """Places where the resistance changes, along the line."""
        mouths = [Point(x, "tunnel mouth") for tunnel in self.line.tunnels for x in tunnel]
        changes = [
            Point(x, "gradient change")
            for k, x in enumerate(self.line.stations)
            if k and self.line.grades[k] != self.line.grades[k - 1]
        ]
        return tuple(sorted(mouths + changes, key=lambda point: point.position))

    def true_weights(self, weights: int = 3) -> np.ndarray:
        """The plant's own coefficients (W1, W2, W3 = mass without rotating mass, A, B), (weights,)."""
        a, b, c = self.train.resistance
        factor = self.line.tunnel_factor
        return np.array([c, factor * c, self.train.mass, a, b])[:weights]

    def believed_weights(self, weights: int = 3) -> np.ndarray:
        """The same as the train believes them, (weights,)."""
        found = self.true_weights(weights)
        if self.belief:
            found[:2] *= self.belief.air
        return found

    def one_car(self) -> "Route":
        """The same route of the train's first motor car alone: where its resistance changes, it does so at once."""
        k = next(k for k, car in enumerate(self.train.cars) if car.motors is not None)
        car, (a, b, c) = self.train.cars[k], self.train.resistance
        by_mass, by_length = car.mass / self.train.mass, car.length / self.length
        resistance = (a * by_mass, b * by_mass, c * by_length)
        train = replace(self.train, cars=(car,), resistance=resistance)
        return replace(self, name=f"{self.name}, one car", train=train)

    def square_only(self) -> "Route":
        """The same route of a train whose running resistance is C V^2 alone, as the source takes it to be."""
        train = replace(self.train, resistance=(0.0, 0.0, self.train.resistance[2]))
        return replace(self, name=f"{self.name}, V² alone", train=train)


def route(
    name: str,
    tunnel_factor: float | None = None,
    load_share: float = 0.0,
    gradient: float | None = None,
    cruise: float | None = None,
) -> Route:
    """A route by name; what is not given is the route's own. `load_share` of `FULL_LOAD`, `gradient` as rise per run.

    All lines and loads are assumed.
    """
    if name == "commuter":
        found, first, speed, grade, factor, rate = "commuter-8car", 0.0, 20.0, 0.025, 2.0, 0.3
        stretch, start = 500.0, 1700.0
    else:
        found, first, speed, grade, factor, rate = "high-speed-16car", 62.0, 70.0, 0.012, 1.8, 0.12
        stretch, start = 2000.0, 7500.0
    speed, grade = cruise or speed, grade if gradient is None else gradient
    first = min(first, speed - 8.0 * (first > 0.0)) if first else 0.0
    train = find_set(found)
    train = train.loaded(tuple(load_share * FULL_LOAD[name] for _ in train.cars))
    x = start + stretch * np.arange(6)
    line = Line(
        stations=(0.0, x[2], x[3], x[4], x[5]),
        grades=(0.0, grade, 0.0, -grade, 0.0),
        tunnels=((x[0], x[1]),),
        tunnel_factor=tunnel_factor or factor,
        spacing=LINE_SPACING,
    )
    command = SpeedCommand((2.0,), (speed,), rate, first)
    ramp = (speed - first) / rate
    rest = x[5] + stretch - 2.0 * first - 0.5 * (first + speed) * ramp
    return Route(name, train, line, command, round(2.0 + ramp + rest / speed, 1))


FULL_LOAD = {"commuter": 12e3, "high-speed": 7e3}
"""Pay load of a full car [kg], assumed: 200 and 100 passengers with luggage."""
ROUTES = ("commuter", "high-speed")
