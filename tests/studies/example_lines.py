"""Made-up lines, short, so that a run takes a moment: one with its railcar, and a route for the speed control."""

from functools import lru_cache
from itertools import pairwise

from alloc.onboard.speed_controller import SpeedCommand
from alloc.plant.rail import Line
from alloc.plant.sets import find_set
from studies.railtoolkit.vehicles import (
    PointOfInterest,
    RollingStock,
    RunningPath,
    Section,
    VehicleKeys,
    build_formation,
)
from studies.resistance.routes import Route

_SECTIONS = (
    # start m, limit km/h, gradient per mille
    (0.0, 40.0, 0.0), (600.0, 80.0, 4.0), (2100.0, 80.0, 18.0), (3400.0, 110.0, 12.0),
    (5200.0, 110.0, -6.0), (7000.0, 60.0, -14.0), (7080.0, 100.0, -14.0), (8300.0, 100.0, 0.0),
    (10400.0, 120.0, 2.0), (12300.0, 90.0, -3.0), (14000.0, 50.0, 0.0), (15000.0, 50.0, 0.0),
)  # fmt: skip
EXAMPLE_PATH = RunningPath(
    "example line",
    tuple(
        Section(start, following[0], 1e-3 * grade, limit / 3.6)
        for (start, limit, grade), following in pairwise(_SECTIONS)
    ),
    (
        PointOfInterest(2100.0, "foot of the climb"),
        PointOfInterest(5200.0, "summit"),
        PointOfInterest(7080.0, "bridge clear", "rear"),
        PointOfInterest(14000.0, "entry signal"),
    ),
)
EXAMPLE_RAILCAR = VehicleKeys(
    name="example railcar",
    id="X1",
    vehicle_type="multiple unit",
    length=42.0,
    mass=70.0,
    load_limit=16.0,
    mass_traction=46.0,
    rotation_mass=1.08,
    base_resistance=3.0,
    rolling_resistance=1.5,
    air_resistance=4.0,
    speed_limit=120.0,
    a_braking=-0.5,
    # 90 kN, then 620 kW at the wheels
    tractive_effort=(
        (0.0, 90e3),
        *((float(v), min(90e3, 620e3 * 3.6 / v)) for v in range(1, 121)),
    ),
)


def example_stock(load_share: float = 1.0) -> RollingStock:
    """The example railcar, loaded, as a train that runs a line."""
    vehicle = EXAMPLE_RAILCAR
    assert vehicle.speed_limit is not None
    assert vehicle.a_braking is not None
    deceleration = -vehicle.a_braking
    train = build_formation(
        vehicle.name, [vehicle], "made up for an example", load_share, deceleration
    )
    return RollingStock(train, vehicle.speed_limit / 3.6, deceleration)


@lru_cache(maxsize=1)
def short_route() -> Route:
    """The loaded commuter train goes from 12 to 18 m/s and meets a tunnel, then a climb."""
    train = find_set("commuter-8car").loaded((6e3,) * 8)
    line = Line((0.0, 1250.0, 1550.0), (0.0, 0.02, 0.0), ((650.0, 950.0),), 3.0, 1.0)
    return Route("short", train, line, SpeedCommand((2.0,), (18.0,), 0.4, 12.0), 108.0)
