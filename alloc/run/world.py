"""Everything that a run reads and writes, in one place; tables by their names."""

from typing import Any, NamedTuple

from numpy.typing import NDArray

from alloc.schema.tables import Rows


class World(NamedTuple):
    """Tables and arrays of a run. Of `plant`, `onboard`, `slide` and `run` there is one row.

    State: positions and speeds of the bodies, angular speeds of the axles, torques of the units, pressures of the brake
    groups, friction work of the axles; then work of motors, shoes, resistance and couplers.
    """

    state: NDArray[Any]
    stages: NDArray[Any]
    """(4, state): room for the integrator."""
    axles: Rows
    cars: Rows
    units: Rows
    brakes: Rows
    patches: Rows
    line: Rows
    plant: Rows
    onboard: Rows
    slide: Rows
    run: Rows
    effort: NDArray[Any]
    """Largest pulling torque of each motor [N m] every km/h, (units, speeds)."""
    retard: NDArray[Any]
    """Largest braking torque of each motor [N m] every km/h, (units, speeds)."""
    curve: NDArray[Any]
    """What the law of the adhesion curve takes, see `alloc.plant.curves`."""
    scatter: NDArray[Any]
    """Ring of knots [1]."""
    rail: NDArray[Any]
    """Ring of cells: degree to which wheels have cleaned each."""
    command: NDArray[Any]
    """Acceleration that the driver asks for [m/s2], (ticks,)."""
    noise: NDArray[Any]
    """Noise of the speed sensors [m/s], (ticks or 1, axles)."""
    leader: NDArray[Any]
    """Foremost unit that works, as the train knows, (ticks,)."""
    report_tick: NDArray[Any]
    """Tick of the newest report of each unit that has arrived at the leader, (ticks, units)."""
    order_tick: NDArray[Any]
    """Tick of the newest order that has arrived at each unit, (ticks, units)."""
    memory: NDArray[Any]
    """Of the controller, (units, numbers)."""
