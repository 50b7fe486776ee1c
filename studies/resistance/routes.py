"""Routes of the speed control's study: a train, its line with a tunnel and gradients, and the commanded speed."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from alloc.errors import OnboardError
from alloc.onboard.line_memory import LineMemory, Odometer, PositionDetector
from alloc.onboard.speed_controller import SpeedCommand
from alloc.plant.model import Model, build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.records import quantity
from studies.files.strict import parse, read_toml
from studies.scenario.onboard_keys import built, keys_of

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


# Routes drawn at random: a tunnel, a climb and a descent in any order and of any length, and stations.


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


# Errors of the position and of the line that a speed control knows: odometer, delay, map; each alone and all together.

LEAST_TUNNEL = 1.0
"""Length [m] of a tunnel whose mouths the map's errors bring together."""


@dataclass(frozen=True)
class LineErrors:
    """How wrong position and map are; a file gives them as a table of keys with units.

    `odometer_error`: bound of the share by which the odometer counts too much or too little. `reset_deviation` [m]: what a
    station leaves of the position's error. `delay` [s] of position and speed. `place_deviation` [m] of every tunnel
    mouth and gradient change in the map. `gradient_deviation`, `air_deviation`: shares by which each gradient, and the
    air resistance in the open and in tunnels, are wrong. Deviations are standard ones of a normal distribution, drawn per
    route and feature; the bound is that of a uniform one, drawn per route.
    """

    odometer_error: float = quantity(0.0, "1", most=0.2)
    reset_deviation: float = quantity(0.0, "m")
    delay: float = quantity(0.0, "s", most=10.0)
    place_deviation: float = quantity(0.0, "m")
    gradient_deviation: float = quantity(0.0, "1", most=1.0)
    air_deviation: float = quantity(0.0, "1", most=1.0)

    def __post_init__(self) -> None:
        names = [item.name for item in fields(self)]
        OnboardError.check("line errors", self, nonnegative=names, infinite=())

    @property
    def counts_wheels(self) -> bool:
        """Whether an odometer counts; without errors of it the true position is known."""
        return self.odometer_error > 0.0 or self.reset_deviation > 0.0

    def only(self, *names: str) -> "LineErrors":
        """The errors of these names alone."""
        return LineErrors(**{name: getattr(self, name) for name in names})


TYPICAL = LineErrors(
    odometer_error=0.005,
    reset_deviation=2.0,
    delay=0.2,
    place_deviation=20.0,
    gradient_deviation=0.05,
    air_deviation=0.1,
)
"""Assumed. Half a per cent corresponds to 4 mm of wear on wheels of 0.86 m that was not entered in the odometer."""
NONE, ODOMETER, DELAY, PLACES, GRADIENTS, AIR, ALL = (
    "none", "odometer", "delay", "places in the map", "gradients in the map", "air resistance", "all",
)  # fmt: skip
ARMS: Mapping[str, tuple[str, ...]] = {
    NONE: (),
    PLACES: ("place_deviation",),
    GRADIENTS: ("gradient_deviation",),
    AIR: ("air_deviation",),
    ODOMETER: ("odometer_error", "reset_deviation"),
    DELAY: ("delay",),
    ALL: tuple(item.name for item in fields(LineErrors)),
}
"""Arm of the study -> errors that it has; arms with true signals come first, for they share a run."""


def read_line_errors(path: str) -> LineErrors:
    """Errors from a TOML file; raises `StudyError` naming the key that is wrong."""
    data = read_toml(
        path, "line errors", "give a TOML file with keys such as odometer_error = 0.005"
    )
    owner = f"line errors file {path!r}"
    found: LineErrors = built(parse(keys_of(LineErrors), data, owner), LineErrors)
    return found


@dataclass(frozen=True)
class Draw:
    """What an event draws of the errors, as numbers without size, so that every arm has the same ones."""

    odometer: float
    """In [-1, 1]."""
    resets: tuple[float, ...]
    places: tuple[float, ...]
    gradients: tuple[float, ...]
    air: tuple[float, ...]

    @classmethod
    def of(cls, route: Route, generator: np.random.Generator) -> "Draw":
        """One draw for a route."""

        def normal(count: int) -> tuple[float, ...]:
            return tuple(float(x) for x in generator.standard_normal(count))

        line = route.line
        return cls(
            float(generator.uniform(-1.0, 1.0)),
            normal(len(route.stations)),
            normal(len(line.stations) + 2 * len(line.tunnels)),
            normal(len(line.stations)),
            normal(2),
        )


def believed(line: Line, errors: LineErrors, draw: Draw) -> LineBelief:
    """The line as a map with errors has it. Places keep their order; the beginning of the line is known."""
    shift = errors.place_deviation * np.array(draw.places)
    count = len(line.stations)
    stations = np.array(line.stations)
    stations[1:] = np.maximum(np.sort(stations[1:] + shift[1:count]), stations[0])
    mouths = np.array(line.tunnels).reshape(-1, 2) + shift[count:].reshape(-1, 2)
    mouths[:, 1] = np.maximum(mouths[:, 1], mouths[:, 0] + LEAST_TUNNEL)
    grades = np.array(line.grades) * (1.0 + errors.gradient_deviation * np.array(draw.gradients))
    first, second = np.maximum(1.0 + errors.air_deviation * np.array(draw.air), 0.0)
    tunnels = tuple((float(a), float(b)) for a, b in mouths)
    known = replace(
        line, stations=tuple(stations.tolist()), grades=tuple(grades.tolist()), tunnels=tunnels
    )
    return LineBelief(known, (float(first), float(second)))


def driven_axles(route: Route) -> tuple[int, ...]:
    """Axles with a motor, from the front: the source reads the turns of the motor."""
    found, first = [], 0
    for car in route.train.cars:
        found += [first + axle for axle, driven in enumerate(car.driven) if driven]
        first += len(car.axle_positions)
    return tuple(found)


def detector(
    route: Route, errors: LineErrors, draw: Draw, speed_noise: float, seed: int
) -> PositionDetector:
    """Where position and speed of a run of `route` come from."""
    odometer = None
    if errors.counts_wheels:
        odometer = Odometer(
            errors.odometer_error * draw.odometer,
            route.stations,
            tuple(errors.reset_deviation * x for x in draw.resets),
            driven_axles(route),
        )
    return PositionDetector(odometer, errors.delay, speed_noise, seed)


def with_errors(route: Route, errors: LineErrors, draw: Draw) -> Route:
    """The route with the belief that these errors leave."""
    return replace(route, belief=believed(route.line, errors, draw))


LADDER = (0.02, 0.04)
"""Further bounds of the odometer's error, to find where compensation by position ends to help."""


def rung(bound: float) -> str:
    """Name of the arm with this bound of the odometer's error."""
    return f"{ODOMETER} {100.0 * bound:g} %"


def arms_of(errors: LineErrors) -> dict[str, LineErrors]:
    """Errors of every arm: each alone, all, and the odometer's alone with each bound of `LADDER`."""
    found = {arm: errors.only(*names) for arm, names in ARMS.items()}
    alone = found[ODOMETER]
    return found | {rung(bound): replace(alone, odometer_error=bound) for bound in LADDER}
