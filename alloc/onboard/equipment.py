"""What the train's computers know of their train: believed values, never the plant's state."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.errors import OnboardError
from alloc.onboard.parameters import Onboard
from alloc.plant.equations import GRAVITY
from alloc.plant.model import Model

Floats = NDArray[np.float64]


class Equipment(NamedTuple):
    """What the computers know of the train; believed values, one row per unit unless said otherwise."""

    axle_unit: NDArray[np.int64]  # (axles,)
    axle_body: NDArray[
        np.int64
    ]  # (axles,) body whose speed an axle tells: its car, or the whole rigid train
    axle_car: NDArray[np.int64]  # (axles,)
    unit_body: NDArray[np.int64]
    axle_radius: Floats  # (axles,)
    axles: Floats
    radius: Floats
    inertia: Floats
    gear: Floats
    empty_axle_mass: Floats
    load_per_axle: Floats
    axle_load: Floats  # with pay load [N]
    mass: Floats  # relative mass on the unit's axles, mean 1
    increment: Floats  # of each unit; only differences between units count
    deviation: Floats  # standard deviation of each unit's cap about the truth
    drive_table: Floats
    brake_table: Floats
    own_inertia: (
        Floats  # torque that turns a unit's own wheelsets, relative to what the rail receives
    )
    planned_share: float  # expected coefficient per m/s2 of commanded acceleration
    moved_mass: float  # that the rail forces of units and braked trailers accelerate [kg]
    blended: bool  # whether every car brakes itself, with air where it has no motors
    brake_inertia: Floats  # as own_inertia, braking
    brake_share: float  # as planned_share, braking
    axle_group: NDArray[np.int64]  # (axles,) air brake group, -1: none
    group_unit: NDArray[np.int64]  # (groups,) unit on whose axles it acts, -1: a trailer's
    group_body: NDArray[np.int64]  # (groups,)
    group_car: NDArray[np.int64]  # (groups,)
    group_axles: Floats  # (groups,)
    group_weight: Floats  # (groups,) load of an axle [N]
    group_inertia: Floats  # (groups,) as brake_inertia
    group_gain: Floats  # (groups,) force at the rim per axle and pascal
    group_friction: Floats  # (groups, 3)
    group_pressure: Floats  # (groups,) highest pressure [Pa]


def _load_signal(model: Model, onboard: Onboard) -> Floats:
    """Pay load of each car [kg] as the computers take it, (cars,): learnt, or from sensors with their errors."""
    cars, loads = model.train.cars, onboard.belief.loads
    if loads is None:
        generator = np.random.default_rng(onboard.sensors.seed)
        errors = onboard.sensors.load_error * generator.standard_normal(len(cars))
        return np.array([car.load for car in cars]) * (1.0 + errors)
    if len(loads) != len(cars):
        raise OnboardError(f"belief: {len(loads)} loads for {len(cars)} cars; give one per car")
    return np.asarray(loads, dtype=float)


def equipment(model: Model, onboard: Onboard) -> Equipment:
    """What the computers of `model`'s train believe; raises `OnboardError` where belief and train do not fit."""
    s, n = model.structure, model.layout
    if n.units == 0 and n.groups == 0:
        raise OnboardError(
            "on board: the train has no traction unit and no air brake; give at least one driven axle, or an air brake"
        )
    cars = model.train.cars
    load_signal = _load_signal(model, onboard)
    share = s.static_load / np.array([car.mass for car in cars])[s.axle_car] / GRAVITY
    empty = np.array([car.empty_mass for car in cars])[s.axle_car] * share
    load = np.maximum(load_signal, 0.0)[s.axle_car] * share
    loaded = empty + load
    belief = onboard.belief
    increments = belief.increments
    if increments is not None and len(increments) != n.axles:
        raise OnboardError(
            f"belief: {len(increments)} increments for {n.axles} axles; give one per axle from the front"
        )
    per_axle = np.zeros(n.axles) if increments is None else np.asarray(increments, dtype=float)
    for name in ("unit_increments", "unit_deviation"):
        given = getattr(belief, name)
        if given is not None and (len(given) != n.units or not np.all(np.isfinite(given))):
            raise OnboardError(
                f"belief: {name} = {given} must be {n.units} finite numbers, one per traction unit"
            )

    def mean(values: Floats) -> Floats:
        return np.array([values[s.axle_unit == j].mean() for j in range(n.units)], dtype=float)

    for dropout in onboard.sensors.dropouts:
        if dropout.axle >= n.axles:
            raise OnboardError(
                f"sensors: dropout of axle {dropout.axle}, but the train has {n.axles} axles, 0 to {n.axles - 1}"
            )
    axles = np.bincount(s.axle_unit[s.axle_unit >= 0], minlength=n.units).astype(float)
    empty_mean = mean(empty)
    turning = s.inertia / s.radius**2  # mass that would resist like the turning wheelset
    weight = mean(loaded) * axles
    train_mass = sum(car.empty_mass for car in cars) + float(np.maximum(load_signal, 0.0).sum())

    def moved(acting: NDArray[np.bool_]) -> float:
        """Mass that the plan accelerates; what turns the `acting` axles themselves comes on top of their limits."""
        return train_mass + float((turning[~acting] if onboard.inertia_in_limit else turning).sum())

    own = mean(turning) / mean(loaded) if onboard.inertia_in_limit else np.zeros(n.units)
    driven = s.axle_unit >= 0
    # a train without motors does nothing for a command to pull, and brakes with air whatever is said of blending
    planned_share = moved(driven) / (GRAVITY * float(weight.sum())) if n.units else 0.0
    blended = n.groups > 0 and (onboard.braking.blended or n.units == 0)
    braked = driven | (s.axle_group >= 0) if blended else driven
    brake_share = moved(braked) / (GRAVITY * float(loaded[braked].sum()))
    foremost = np.array(
        [np.flatnonzero(s.axle_group == g)[0] for g in range(n.groups)], dtype=np.int64
    )
    group_unit = np.array(
        [s.axle_unit[s.axle_group == g].max() for g in range(n.groups)], dtype=np.int64
    )
    pressures = [car.air_brake.maximum_pressure if car.air_brake else 0.0 for car in cars]
    return Equipment(
        axle_unit=s.axle_unit,
        axle_body=s.axle_body,
        axle_car=s.axle_car,
        unit_body=np.array(
            [s.axle_body[s.axle_unit == j][0] for j in range(n.units)], dtype=np.int64
        ),
        axle_radius=s.radius,
        axles=axles,
        radius=mean(s.radius),
        inertia=mean(s.inertia),
        gear=s.unit_gear,
        empty_axle_mass=empty_mean,
        load_per_axle=mean(load),
        axle_load=(empty_mean + mean(load)) * GRAVITY,
        mass=weight / weight.mean() if n.units else weight,
        increment=mean(per_axle)
        if belief.unit_increments is None
        else np.asarray(belief.unit_increments, dtype=float),
        deviation=np.zeros(n.units)
        if belief.unit_deviation is None
        else np.asarray(belief.unit_deviation, dtype=float),
        drive_table=s.drive_table,
        brake_table=s.brake_table,
        own_inertia=own / (GRAVITY * planned_share) if n.units else own,
        planned_share=planned_share,
        moved_mass=moved(braked),
        blended=blended,
        brake_inertia=own / (GRAVITY * brake_share),
        brake_share=brake_share,
        axle_group=s.axle_group,
        group_unit=group_unit,
        group_body=s.axle_body[foremost],
        group_car=s.axle_car[foremost],
        group_axles=np.bincount(s.axle_group[s.axle_group >= 0], minlength=n.groups).astype(float),
        group_weight=loaded[foremost] * GRAVITY,
        group_inertia=float(onboard.inertia_in_limit)
        * (turning / loaded)[foremost]
        / (GRAVITY * brake_share),
        # as built: a brake that has been cut out is what the computers do not know
        group_gain=np.array(
            [car.air_brake.force_per_pascal if car.air_brake else 0.0 for car in cars]
        )[s.axle_car[foremost]],
        group_friction=s.shoe_friction[foremost],
        group_pressure=np.array(pressures)[s.axle_car[foremost]],
    )
