"""Everything that a run reads and writes, in one place: the plant's tables, the board's, what is drawn for both.

Here alone what is true becomes what is believed: `believed_train` fills the board's rows from the plant's and from what the
settings say is wrong.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.laws import GRAVITY
from alloc.onboard.columns import AXLE, BRAKE, UNIT
from alloc.onboard.rows import onboard_rows, radius_errors
from alloc.onboard.settings import Onboard
from alloc.onboard.telegrams import draw_telegrams, find_leaders
from alloc.plant.columns import PATCH, PLANT
from alloc.plant.dynamics import find_rates
from alloc.plant.rows import PlantRows, planned_coefficients, rows_of_train
from alloc.plant.train import Train
from alloc.schema.errors import OnboardError, PlantError
from alloc.schema.tables import Rows, put_fields

if TYPE_CHECKING:
    from alloc.run.event import Event

FASTEST = 100.0
"""Speed [m/s] that no train here exceeds."""


class World(NamedTuple):
    """Tables and arrays of a run. Of `plant`, `onboard`, `slide` and `run` there is one row.

    State: positions and speeds of the bodies, angular speeds of the axles, torques of the units, pressures of the brake
    groups, friction work of the axles; then work of motors, shoes, resistance and couplers.
    """

    # true
    state: NDArray[Any]
    stages: NDArray[Any]
    """(4, state): room for the integrator."""
    wheelsets: Rows
    cars: Rows
    drives: Rows
    cylinders: Rows
    patches: Rows
    line: Rows
    plant: Rows
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
    noise: NDArray[Any]
    """Noise of the speed sensors [m/s], (ticks or 1, axles)."""
    # on board
    axles: Rows
    units: Rows
    brakes: Rows
    onboard: Rows
    slide: Rows
    run: Rows
    rated_effort: NDArray[Any]
    """`effort` as the computers have it."""
    rated_retard: NDArray[Any]
    """`retard` as the computers have it."""
    command: NDArray[Any]
    """Acceleration that the driver asks for [m/s2], (ticks,)."""
    leader: NDArray[Any]
    """Foremost unit that works, as the train knows, (ticks,)."""
    report_tick: NDArray[Any]
    """Tick of the newest report of each unit that has arrived at the leader, (ticks, units)."""
    order_tick: NDArray[Any]
    """Tick of the newest order that has arrived at each unit, (ticks, units)."""
    memory: NDArray[Any]
    """Of the controller, (units, numbers)."""


TRUE = (
    "state", "stages", "wheelsets", "cars", "drives", "cylinders", "patches", "line", "plant", "effort", "retard",
    "curve", "scatter", "rail", "noise",
)  # fmt: skip
"""What of a world is true: nothing on board reads it."""


def world_of(event: "Event") -> World:
    """The world of an event before its first instant; raises `InputError` where its parts do not fit together."""
    train, rail, onboard, period = event.train, event.rail, event.onboard, event.onboard.period
    ticks, start, speed = event.ticks, event.initial_position, event.initial_speed
    truth = PlantRows(*(table.copy() for table in rows_of_train(train)))
    wheelsets, cars, drives, cylinders = truth[:4]
    axles, units, brakes, believed = believed_train(truth, train, onboard)
    for unit, time in event.failures.items():
        if not 0 <= unit < drives.size:
            reason = f"the train has no traction unit {unit + 1}; it has {drives.size}"
            raise PlantError(f"failures: {reason}")
        if np.isnan(time):
            raise PlantError(f"failures: time of traction unit {unit + 1} is not a number")
        drives[unit].failure = time
    for dropout in onboard.sensors.dropouts:
        if dropout.axle >= wheelsets.size:
            reason = (
                f"axle = {dropout.axle} of a dropout, but the last axle is {wheelsets.size - 1}"
            )
            raise OnboardError(f"sensors: {reason}")
        wheelsets[dropout.axle].lost, wheelsets[dropout.axle].back = dropout.begin, dropout.until
    # the line as far as the train may come; 0.3 m/s2: a gradient of 30 per mille
    hardest = max(abs(rate) for rate in event.command.accelerations) + 0.3
    fastest = min(FASTEST, abs(speed) + event.duration * hardest)
    end = start + event.duration * fastest + 50.0
    origin, line = event.line.rows(start - train.length - 70.0, end)
    load = wheelsets.static_load
    plant = PLANT.rows(
        1,
        period=period,
        step=event.step,
        line_origin=origin,
        line_spacing=event.line.spacing,
        body_mass=train.mass if train.couplers is None else 0.0,
        pitches=wheelsets.unloading.any(),
        parallel=drives.slip_torque.any(),
        speed=speed,
        position=start,
        **planned_coefficients(
            wheelsets, wheelsets.inertia, load, train.mass, True, int(believed["blended"])
        ),
    )
    rail.put_under(wheelsets, plant[0])
    put_fields(plant[0], event.receptivity, "receptivity_")
    patches, scatter, curve = PATCH.of(rail.patches), rail.scatter_ring(), rail.curve.values
    peak = rail.greatest_peak()
    shortest = find_rates(wheelsets, cars, drives, cylinders, curve, peak, plant[0])
    for fault in event.size_faults(shortest):
        raise event.make_error(fault)
    wheelsets.axle_load = load
    wheelsets.cell = np.floor((start + wheelsets.offset) / plant.cleaning_spacing[0])
    watched = int(units.axles.min(initial=4))
    board, valves, run = onboard_rows(onboard, believed, watched, speed)
    # it rolls without slip, motors and brakes off; coupled cars stand at rest length
    bodies = np.ones(1 if train.couplers is None else cars.size)
    rest = np.zeros(drives.size + cylinders.size + wheelsets.size + 4)
    state = np.concatenate([start * bodies, speed * bodies, speed / wheelsets.radius, rest])
    sensors, sent = onboard.sensors, onboard.telegrams
    noise = np.zeros((1, wheelsets.size))
    if sensors.speed_noise > 0.0:
        draws = np.random.default_rng([sensors.seed, 1])
        noise = sensors.speed_noise * draws.standard_normal((ticks, wheelsets.size))
    leader = np.zeros(ticks, dtype=np.int64)
    if units.size:
        leader = find_leaders(ticks, drives.failure, period)
    every = max(1, round(sent.period / period))
    report_tick, order_tick = draw_telegrams(
        leader, units.size, every, period, sent.latency, sent.jitter, sent.loss, sensors.seed
    )
    return World(
        state=state,
        stages=np.zeros((4, state.size)),
        wheelsets=wheelsets,
        cars=cars,
        drives=drives,
        cylinders=cylinders,
        patches=patches,
        line=line,
        plant=plant,
        effort=truth.effort,
        retard=truth.retard,
        curve=curve,
        scatter=scatter,
        rail=rail.cells(train.length),
        noise=noise,
        axles=axles,
        units=units,
        brakes=brakes,
        onboard=board,
        slide=valves,
        run=run,
        rated_effort=truth.effort,
        rated_retard=truth.retard,
        command=event.command.sampled(period * np.arange(ticks, dtype=np.float64)),
        leader=leader,
        report_tick=report_tick,
        order_tick=order_tick,
        memory=np.zeros((units.size, 0)),
    )


def believed_train(
    truth: PlantRows, train: Train, onboard: Onboard
) -> tuple[Rows, Rows, Rows, dict[str, float]]:
    """Rows of `AXLE`, `UNIT`, `BRAKE` and columns of `ONBOARD` of a train as its computers believe it.

    They believe the truth but for wheel radii, pay loads, and the factors of `onboard.belief`. Raises `OnboardError` where
    belief and train do not fit.
    """
    wheelsets, cars, drives, cylinders = truth[:4]
    sensors, belief, shares = onboard.sensors, onboard.belief, onboard.braking.car_shares
    if not drives.size and not cylinders.size:
        reason = "the train has no traction unit and no air brake"
        raise OnboardError(f"on board: {reason}; give at least one driven axle, or an air brake")
    for name, values, count, places in (
        ("belief: increments", belief.increments, wheelsets.size, "axles"),
        ("belief: unit_increments", belief.unit_increments, drives.size, "traction units"),
        ("belief: unit_deviation", belief.unit_deviation, drives.size, "traction units"),
        ("braking: car_shares", shares, cars.size, "cars"),
    ):
        if values is not None and len(values) != count:
            reason = f"{len(values)} values for {count} {places}; give one for each from the front"
            raise OnboardError(f"{name}: {reason}")
    errors = np.random.default_rng(sensors.seed).standard_normal(cars.size)
    loads = np.array([car.load for car in train.cars]) * (1.0 + sensors.load_error * errors)
    mass = np.array([car.mass for car in train.cars]) + np.maximum(loads, 0.0)
    load = wheelsets.static_load * (mass / cars.mass)[wheelsets.car]
    inertia, within = wheelsets.inertia * belief.inertia_factor, onboard.inertia_in_limit
    axles = AXLE.rows(
        wheelsets.size,
        unit=wheelsets.unit,
        brake=wheelsets.brake,
        radius=wheelsets.radius * (1.0 + radius_errors(onboard, wheelsets.size)),
        inertia=inertia,
        gear=wheelsets.gear,
    )
    blends = int(cylinders.size > 0 and (onboard.braking.blended or drives.size == 0))
    plans = planned_coefficients(wheelsets, inertia, load, mass.sum(), within, blends)
    turning = GRAVITY * inertia / wheelsets.radius**2 * within

    def load_and_turning(members: NDArray[np.int64]) -> tuple[float, float]:
        """Mean load of some axles, and what turns them at 1 m/s2 over it."""
        mean = load[members].mean()
        return mean, turning[members].mean() / (GRAVITY * mean)

    grown = np.asarray(belief.increments or np.zeros(wheelsets.size))
    units = UNIT.rows(
        drives.size,
        lag=drives.lag * belief.lag_factor,
        axles=drives.axles,
        seen=drives.axles,
        gear=drives.gear,
        deviation=belief.unit_deviation or 0.0,
    )
    for j, unit in enumerate(units):
        members = np.flatnonzero(wheelsets.unit == j)
        unit.first, unit.last = members[0], members[-1] + 1
        unit.load, share = load_and_turning(members)
        unit.turning, unit.brake_turning = share / plans["planned"], share / plans["brake_planned"]
        unit.radius, unit.inertia = axles.radius[members].mean(), inertia[members].mean()
        unit.increment = grown[members].mean()
    if belief.unit_increments is not None:
        units.increment = belief.unit_increments
    if units.size:
        weight = units.load * units.axles
        units.mass_share = weight / weight.mean()
    brakes = BRAKE.rows(
        cylinders.size,
        most_pressure=cylinders.most_pressure,
        gain=cylinders.gain * belief.brake_factor,
        friction_numerator=cylinders.friction_numerator,
        friction_offset=cylinders.friction_offset,
        friction_constant=cylinders.friction_constant,
    )
    for g, brake in enumerate(brakes):
        members = np.flatnonzero(wheelsets.brake == g)
        brake.unit, brake.axles = wheelsets.unit[members].max(), members.size
        brake.load, share = load_and_turning(members)
        brake.turning = share / plans["brake_planned"]
        brake.share = 1.0 if shares is None else shares[wheelsets.car[members[0]]]
    factor = belief.resistance_factor
    return (
        axles,
        units,
        brakes,
        plans
        | {
            "blended": blends,
            "train_mass": belief.mass_factor * mass.sum(),
            "resistance": factor * train.resistance[0],
            "resistance_linear": factor * train.resistance[1],
            "resistance_quadratic": factor * train.resistance[2],
        },
    )
