"""A route of half a minute for tests of the speed control."""

from functools import lru_cache

from alloc.onboard.speed_control import SpeedCommand
from alloc.plant.rail import Line
from alloc.plant.sets import find_set
from studies.speed_routes import Route


@lru_cache(maxsize=1)
def short_route() -> Route:
    """The loaded commuter train at 15 m/s meets a tunnel, then a climb, and goes on at 18 m/s."""
    train = find_set("commuter-8car").loaded((6e3,) * 8)
    line = Line((0.0, 500.0, 700.0), (0.0, 0.02, 0.0), ((100.0, 300.0),), 2.0, 1.0)
    return Route("short", train, line, SpeedCommand((8.0,), (16.0,), 0.3, 15.0), 65.0)
