"""Errors of the position and of the line that a speed control knows: odometer, delay, map; each alone and all together."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from alloc.errors import OnboardError
from alloc.onboard.line_memory import Odometer, PositionDetector
from alloc.plant.rail import Line
from alloc.records import quantity
from studies.files.strict import parse, read_toml
from studies.resistance.routes import LineBelief, Route
from studies.scenario.record_keys import built, keys_of

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
