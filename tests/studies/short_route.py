"""A route of a minute and a half for tests of the speed control."""

from functools import lru_cache

from alloc.onboard.speed_controller import SpeedCommand
from alloc.plant.rail import Line
from alloc.plant.sets import find_set
from studies.resistance.routes import Route


@lru_cache(maxsize=1)
def short_route() -> Route:
    """The loaded commuter train goes from 12 to 18 m/s and meets a tunnel, then a climb."""
    train = find_set("commuter-8car").loaded((6e3,) * 8)
    line = Line((0.0, 1250.0, 1550.0), (0.0, 0.02, 0.0), ((650.0, 950.0),), 3.0, 1.0)
    return Route("short", train, line, SpeedCommand((2.0,), (18.0,), 0.4, 12.0), 108.0)
