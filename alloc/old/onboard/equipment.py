"""The computers' description of their train: believed values, never the plant's state."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.errors import OnboardError
from alloc.old.onboard.brakes import Sanders
from alloc.old.onboard.increment_learning import Increments, first_increments
from alloc.old.onboard.parameters import Belief, Onboard
from alloc.old.plant.laws import GRAVITY
from alloc.old.plant.model import Floats, Model, Structure
from alloc.old.records import filled

Numbers = NDArray[np.int64]


class BrakeGroups(NamedTuple):
    """Air brake groups, one row per group."""

    unit: Numbers  # unit on whose axles it acts, -1: a trailer's
    body: Numbers
    car: Numbers
    axles: Floats
    share: Floats  # of the plan that is asked of it
    weight: Floats  # mean load of its axles [N]
    inertia: Floats  # as `Equipment.brake_inertia`
    gain: Floats  # force at the rim per axle and pascal
    friction: Floats  # (groups, 3)
    pressure: Floats  # highest pressure [Pa]


class Chain(NamedTuple):
    """The train as its computers believe it to move: bodies with draft gears between them."""

    mass: Floats  # (bodies,) without what turns [kg]
    train_mass: float
    resistance: Floats  # (bodies, 3)
    coupler: Floats  # (bodies - 1, 4)
    steps: int  # into which a control period is divided
    turning: Floats  # (axles,) mass that would resist like the turning wheelset [kg]
    load: Floats  # (axles,) [N]


class Equipment(NamedTuple):
    """What the computers know of the train; believed values, one row per unit unless said otherwise."""

    axle_unit: Numbers  # (axles,)
    axle_body: Numbers  # (axles,) body whose speed an axle tells: its car, or the whole rigid train
    axle_car: Numbers  # (axles,)
    axle_group: Numbers  # (axles,) air brake group, -1: none
    axle_radius: Floats  # (axles,) as believed
    axle_sensed: NDArray[np.bool_]  # (axles,) whether it has a speed sensor
    unit_body: Numbers
    axles: Floats
    radius: Floats
    inertia: Floats
    gear: Floats
    response: Floats  # share of a step of the torque command that is there a control period later
    empty_axle_mass: Floats
    load_per_axle: Floats
    axle_load: Floats  # with pay load [N]
    mass: Floats  # relative mass on the unit's axles, mean 1
    learnt: Increments  # before the run; only differences between units count
    drive_table: Floats
    brake_table: Floats
    own_inertia: Floats  # torque that turns its own wheelsets, relative to what the rail receives
    planned_share: float  # expected coefficient per m/s2 of commanded acceleration
    blended: bool  # whether every car brakes itself, with air where it has no motors
    brake_inertia: Floats  # as own_inertia, braking
    brake_share: float  # as planned_share, braking
    group: BrakeGroups
    chain: Chain
    sander: Sanders


class _Weights(NamedTuple):
    """Masses as the computers take them [kg]; (axles,) but for the train's."""

    empty: Floats
    load: Floats
    loaded: Floats
    turning: Floats  # mass that would resist like the turning wheelset
    cars: Floats  # (cars,) with load
    train: float


def equipment(model: Model, onboard: Onboard) -> Equipment:
    """What the computers of `model`'s train believe; raises `OnboardError` where belief and train do not fit."""
    s, n = model.structure, model.layout
    _check(model, onboard)
    radius = s.radius * (1.0 + _radius_errors(onboard, n.axles))
    weights = _weights(model, onboard)
    axles = np.bincount(s.axle_unit[s.axle_unit >= 0], minlength=n.units).astype(float)
    empty, load = _unit_means(model, weights.empty), _unit_means(model, weights.load)
    weight = _unit_means(model, weights.loaded) * axles
    plan = _plan(model, onboard, weights, weight)
    return filled(
        Equipment,
        s,
        axle_radius=radius,
        axle_sensed=np.array([car.speed_sensors for car in model.train.cars])[s.axle_car],
        unit_body=np.array(
            [s.axle_body[s.axle_unit == j][0] for j in range(n.units)], dtype=np.int64
        ),
        axles=axles,
        radius=_unit_means(model, radius),
        inertia=_unit_means(model, s.inertia),
        gear=s.unit_gear,
        response=-np.expm1(-onboard.period / s.unit_lag),
        empty_axle_mass=empty,
        load_per_axle=load,
        axle_load=(empty + load) * GRAVITY,
        mass=weight / weight.mean() if n.units else weight,
        learnt=first_increments(
            onboard.learning,
            onboard.belief.learnt,
            _increments(model, onboard.belief),
            onboard.belief.unit_deviation,
        ),
        **plan,
        group=_brake_groups(model, onboard, weights, plan["brake_share"]),
        chain=_chain(model, onboard, weights),
        sander=Sanders(
            body=s.axle_body[s.axle_sander >= 0],
            rate=np.array([one.rate for one in model.train.sanders], dtype=float),
            amount=np.array([one.amount or np.inf for one in model.train.sanders], dtype=float),
        ),
    )


def _radius_errors(onboard: Onboard, axles: int) -> Floats:
    """Relative errors of the wheel radii that the computers believe in.

    Where they compared the wheels before the run, each error is that of all, and the posterior deviation of its own.
    """
    most, left = onboard.sensors.radius_error, onboard.reference.radius_prior
    generator = np.random.default_rng([onboard.sensors.seed, 3])
    errors = most * generator.uniform(-1.0, 1.0, axles)
    if most == 0.0 or left == onboard.reference.radius_deviation:
        return errors
    return errors.mean() + left * generator.standard_normal(axles)


def _check(model: Model, onboard: Onboard) -> None:
    n, belief = model.layout, onboard.belief
    if n.units == 0 and n.groups == 0:
        raise OnboardError(
            "on board: the train has no traction unit and no air brake; give at least one driven axle, or an air brake"
        )
    for name, count, places in (
        ("loads", n.cars, "cars"), ("increments", n.axles, "axles"),
        ("unit_increments", n.units, "traction units"), ("unit_deviation", n.units, "traction units"),
    ):  # fmt: skip
        given = getattr(belief, name)
        if given is not None and (len(given) != count or not np.all(np.isfinite(given))):
            raise OnboardError(
                f"belief: {len(given)} {name} for {count} {places}; give a finite number for each from the front"
            )
    if belief.learnt is not None and len(belief.learnt.increment) != n.units:
        raise OnboardError(
            f"belief: learnt increments of {len(belief.learnt.increment)} traction units for {n.units}; give what this one "
            "has learnt"
        )
    shares = onboard.braking.car_shares
    if shares is not None and len(shares) != n.cars:
        raise OnboardError(
            f"braking: {len(shares)} car_shares for {n.cars} cars; give one for each from the front"
        )
    for dropout in onboard.sensors.dropouts:
        if dropout.axle >= n.axles:
            raise OnboardError(
                f"sensors: dropout of axle {dropout.axle}, but the train has {n.axles} axles, 0 to {n.axles - 1}"
            )


def _unit_means(model: Model, values: Floats) -> Floats:
    """Mean over each unit's axles of `values` (axles,)."""
    members = model.structure.axle_unit
    return np.array([values[members == j].mean() for j in range(model.layout.units)], dtype=float)


def _increments(model: Model, belief: Belief) -> Floats:
    per_axle = np.zeros(model.layout.axles)
    if belief.increments is not None:
        per_axle = np.asarray(belief.increments, dtype=float)
    if belief.unit_increments is not None:
        return np.asarray(belief.unit_increments, dtype=float)
    return _unit_means(model, per_axle)


def _weights(model: Model, onboard: Onboard) -> _Weights:
    s, cars = model.structure, model.train.cars
    # pay load of each car: learnt, or from sensors with their errors
    if onboard.belief.loads is None:
        generator = np.random.default_rng(onboard.sensors.seed)
        errors = onboard.sensors.load_error * generator.standard_normal(len(cars))
        signal = np.array([car.load for car in cars]) * (1.0 + errors)
    else:
        signal = np.asarray(onboard.belief.loads, dtype=float)
    share = s.static_load / np.array([car.mass for car in cars])[s.axle_car] / GRAVITY
    empty = np.array([car.empty_mass for car in cars])[s.axle_car] * share
    load = np.maximum(signal, 0.0)[s.axle_car] * share
    own = np.array([car.empty_mass for car in cars]) + np.maximum(signal, 0.0)
    return _Weights(empty, load, empty + load, s.inertia / s.radius**2, own, float(own.sum()))


def _plan(model: Model, onboard: Onboard, weights: _Weights, weight: Floats) -> dict[str, Any]:
    """What follows from the masses that the plan accelerates; `weight` (units,): mass on each unit's axles."""
    s, n = model.structure, model.layout
    turning, loaded = weights.turning, weights.loaded

    def moved(acting: NDArray[np.bool_]) -> float:
        """Mass that the plan accelerates; what turns the `acting` axles themselves comes on top of their limits."""
        resisting = turning[~acting] if onboard.inertia_in_limit else turning
        return weights.train + float(resisting.sum())

    own = np.zeros(n.units)
    if onboard.inertia_in_limit:
        own = _unit_means(model, turning) / _unit_means(model, loaded)
    driven = s.axle_unit >= 0
    # a train without motors does nothing for a command to pull, and brakes with air whatever is said of blending
    blended = n.groups > 0 and (onboard.braking.blended or n.units == 0)
    braked = driven | (s.axle_group >= 0) if blended else driven
    planned_share = moved(driven) / (GRAVITY * float(weight.sum())) if n.units else 0.0
    brake_share = moved(braked) / (GRAVITY * float(loaded[braked].sum()))
    return {
        "blended": blended,
        "planned_share": planned_share,
        "brake_share": brake_share,
        "own_inertia": own / (GRAVITY * planned_share) if n.units else own,
        "brake_inertia": own / (GRAVITY * brake_share),
    }


STABLE_ANGLE = 0.3
"""Angle [rad] by which the fastest mode of the believed draft gears may turn per step."""


GEAR_DAMPING = 0.3
"""Greatest relative damping that is believed of friction draft gears: more would be stiff."""


def _springs(s: Structure, mass: Floats) -> Floats:
    """Couplers (bodies - 1, 4) as springs between masses (bodies,) [kg], friction draft gears before they begin to slide."""
    structure, damping = s.draft_gear[:, 0], s.draft_gear[:, -1]
    coupler = s.coupler.copy()
    rubs = structure > 0.0
    between = 1.0 / (1.0 / mass[:-1] + 1.0 / mass[1:])
    most = 2.0 * GEAR_DAMPING * np.sqrt(structure * between)
    coupler[rubs, 0] = structure[rubs]
    coupler[rubs, 2] = np.minimum(damping, most)[rubs]
    return coupler


def _chain(model: Model, onboard: Onboard, weights: _Weights) -> Chain:
    s, belief = model.structure, onboard.belief
    bodies = s.body_mass.size
    mass: Any = belief.mass_factor * np.bincount(s.car_body, weights.cars, bodies)
    resistance: Any = np.stack([np.bincount(s.car_body, x, bodies) for x in s.car_resistance.T])
    coupler = _springs(s, mass)
    coupler[:, :2] *= belief.coupler_factor
    return Chain(
        mass, float(mass.sum()), belief.resistance_factor * resistance.T.copy(), coupler,
        stable_steps(coupler, mass, onboard.period), weights.turning, weights.loaded * GRAVITY,
    )  # fmt: skip


def stable_steps(coupler: Floats, mass: Floats, period: float) -> int:
    """Into how many steps a period [s] is divided for draft gears (bodies - 1, 4) between masses (bodies,) [kg]."""
    if mass.size == 1:
        return 1
    between = 1.0 / mass[:-1] + 1.0 / mass[1:]
    fastest = float(np.sqrt(2.0 * coupler[:, 0] * between).max())
    return max(1, math.ceil(period * fastest / STABLE_ANGLE))


def _brake_groups(
    model: Model, onboard: Onboard, weights: _Weights, brake_share: float
) -> BrakeGroups:
    s, n, cars = model.structure, model.layout, model.train.cars
    members = [s.axle_group == g for g in range(n.groups)]
    foremost = np.array([np.flatnonzero(axles)[0] for axles in members], dtype=np.int64)
    # as built: a brake that has been cut out is what the computers do not know
    brakes = [car.air_brake for car in cars]
    gain = np.array([brake.force_per_pascal if brake else 0.0 for brake in brakes])
    pressure = np.array([brake.maximum_pressure if brake else 0.0 for brake in brakes])
    loaded, turning = (
        np.array([values[axles].mean() for axles in members], dtype=float)
        for values in (weights.loaded, weights.turning)
    )
    return BrakeGroups(
        unit=np.array([s.axle_unit[axles].max() for axles in members], dtype=np.int64),
        body=s.axle_body[foremost],
        car=s.axle_car[foremost],
        axles=np.bincount(s.axle_group[s.axle_group >= 0], minlength=n.groups).astype(float),
        share=np.array(onboard.braking.car_shares or (1.0,) * n.cars, dtype=float)[
            s.axle_car[foremost]
        ],
        weight=loaded * GRAVITY,
        inertia=float(onboard.inertia_in_limit) * turning / loaded / (GRAVITY * brake_share),
        gain=gain[s.axle_car[foremost]],
        friction=s.shoe_friction[foremost],
        pressure=pressure[s.axle_car[foremost]],
    )
