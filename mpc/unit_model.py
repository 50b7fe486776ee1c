"""Prediction model of a traction unit, or of a group of them: the plant's own equations on symbols, with believed values.

A group is the smallest train of the plant: one rigid body with the units' share of the train's mass, their cars and driven
axles, one group of motors each. Only the states that determine slip are kept. Differences between groups are parameters, so
all groups of the same shape and kind of adhesion curve share one expression and one compilation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import casadi as cs
import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import CreepCurve, RationalCurve
from alloc.plant.adhesion_laws import POLACH, POLACH_BY_FRICTION
from alloc.plant.array_model import Local
from alloc.plant.equations import slip_velocity
from alloc.plant.model import Inputs, Model, build
from alloc.plant.rail import Rail
from alloc.plant.structure import Floats, Ints
from alloc.plant.train import Car, Motors, TorqueLimit, Train
from mpc.folding import without_clamps
from mpc.stepped_model import SteppedModel, Steps
from mpc.stiffness import Stiffness

Units = UnitContext | Sequence[UnitContext]
"""A unit alone, or a group, foremost first."""

UNBOUNDED_TORQUE = 1e9
"""Torque limit [N m] inside the model: the optimiser's bounds act instead, which keeps the model smooth."""

CURVE_PARAMETERS = 6
"""Of the model, for the adhesion curve."""

CONSTANTS = ("axle_load", "radius", "inertia", "gear_ratio", "torque_lag")
"""Values of each unit that the model takes as parameters after the mass, named as in `UnitContext`."""


def group_of(units: Units) -> tuple[UnitContext, ...]:
    """The units as a group. One that comes alone takes its axle loads for constant, whatever its car does."""
    if isinstance(units, UnitContext):
        return (replace(units, unloading=()),)
    return tuple(units)


def cars_of(units: Units) -> list[tuple[UnitContext, ...]]:
    """The units of each car of the group."""
    return [
        tuple(members) for _, members in groupby(group_of(units), key=lambda context: context.car)
    ]


def unit_of_axle(units: Units) -> Ints:
    """Number within the group of each axle's unit, (axles,)."""
    group = group_of(units)
    return np.repeat(np.arange(len(group)), [context.axles for context in group])


def unloading(units: Units) -> Floats:
    """Load [N] that each axle loses per newton of its car's rail force, (axles,)."""
    return np.concatenate(
        [context.unloading or (0.0,) * context.axles for context in group_of(units)]
    )


def creep_stiffnesses(units: Units) -> Floats:
    """Creep stiffness of each unit over that of the first, (units,); (0,) where the curve has none."""
    group = group_of(units)
    if not isinstance(group[0].curve, CreepCurve):
        return np.zeros(0)
    return np.array([context.curve.q[4] for context in group]) / group[0].curve.q[4]


@dataclass(frozen=True, eq=False)
class UnitModel:
    """Symbolic right side of a group; get it with `unit_model`.

    States (axles + 1 + units,): speed [m/s], angular speed of each wheelset [rad/s], motor torque of each unit [N m].
    Input (units,): torque commands [N m]. Parameters: see `parameters`.
    """

    axles: int
    units: int
    state: cs.SX
    torque: cs.SX
    parameters: cs.SX
    rate: cs.SX
    """Derivative of the state."""
    steps: Steps
    """The same."""

    @property
    def states(self) -> int:
        """Number of states."""
        return self.axles + 1 + self.units


def _car(group: tuple[UnitContext, ...]) -> Car:
    """A car that holds the units `group`; per-unit values are set afterwards."""
    first, n = group[0], sum(context.axles for context in group)
    limit = TorqueLimit(UNBOUNDED_TORQUE, UNBOUNDED_TORQUE)
    return Car(
        name=f"units from {first.unit + 1}",
        length=float(n + 1),
        empty_mass=sum(context.mass for context in group),
        load=0.0,
        axle_positions=tuple(float(k + 1) for k in range(n)),
        bogie_of_axle=(0,) * n,
        wheel_radius=first.radius,
        wheel_inertia=(first.inertia,) * n,
        driven=(True,) * n,
        motors=Motors("1C4M", first.gear_ratio, limit, limit, first.torque_lag),
    )


def _plant(group: tuple[UnitContext, ...]) -> Model:
    """The group as a train of the plant."""
    train = Train("group", tuple(map(_car, cars_of(group))))
    plant = build(train, Rail(1.0, curve=group[0].curve))
    unit = unit_of_axle(group)

    def values(name: str) -> Floats:
        return np.array([getattr(context, name) for context in group], dtype=float)

    s = plant.structure._replace(
        axle_unit=unit,
        unit_axles=np.bincount(unit).astype(float),
        radius=values("radius")[unit],
        inertia=values("inertia")[unit],
        gear=values("gear_ratio")[unit],
        unit_gear=values("gear_ratio"),
        unit_lag=values("torque_lag"),
        # the units also move their share of the trailers: their mass is not what rests on their axles
        static_load=values("axle_load")[unit],
        unloading=unloading(group),
    )
    return replace(plant, structure=s, layout=plant.layout._replace(units=len(group)))


_models: dict[tuple[object, ...], UnitModel] = {}


def unit_model(units: Units) -> UnitModel:
    """Prediction model for groups of the shape and the kind of curve of `units`; one object for all of them.

    Raises `PlantError` where the units' values are impossible.
    """
    group = group_of(units)
    plant = _plant(group)
    shape = (tuple(plant.structure.axle_unit), tuple(plant.structure.axle_car))
    key = (*shape, group[0].curve.kind, bool(unloading(group).any()))
    if key not in _models:
        _models[key] = _symbolic(plant, group[0].curve.kind)
    return _models[key]


def _symbolic(plant: Model, curve_kind: int) -> UnitModel:
    layout, unit = plant.layout, plant.structure.axle_unit.tolist()
    n, m = layout.axles, layout.units
    transfer = bool(plant.structure.unloading.any())
    state, torque = cs.SX.sym("state", n + 1 + m), cs.SX.sym("torque", m)
    creeps = curve_kind in (POLACH, POLACH_BY_FRICTION)
    sizes = [n, 1, 1, *[m] * len(CONSTANTS), m * creeps, m, 6, n * transfer]
    parameters = cs.SX.sym("parameters", sum(sizes))
    peak, grade, mass, load, radius, inertia, gear, lag, contact, air, q, unloaded = cs.vertsplit(
        parameters, np.concatenate([[0], np.cumsum(sizes)]).tolist()
    )

    def by_axle(values: cs.SX) -> cs.SX:
        return cs.vertcat(*(values[j] for j in unit))

    symbols: dict[str, Any] = {
        "radius": by_axle(radius), "inertia": by_axle(inertia), "gear": by_axle(gear),
        "static_load": by_axle(load), "unit_lag": lag, "unit_gear": gear, "body_mass": mass,
        # only the sum of the cars' masses acts on a rigid body on one gradient
        "car_mass": cs.repmat(mass / layout.cars if layout.cars > 1 else mass, layout.cars, 1),
    }  # fmt: skip
    if transfer:
        symbols["unloading"] = unloaded
    structure = plant.structure._replace(**symbols)
    stiffness = by_axle(contact) if creeps else np.ones(n)
    curve = [q[k] for k in range(6)]
    # nothing sticks: the deflections of the contacts are no states of the model, and zero
    arrays = SteppedModel(structure, layout, curve_kind, curve, stiffness, Rail(1.0).presliding)
    rows = [layout.speed, layout.omega, layout.torque]
    whole = cs.SX.zeros(layout.rows)
    whole[rows[0]], whole[rows[1]], whole[rows[2]] = state[0], state[1 : n + 1], state[n + 1 :]
    inputs: dict[str, Any] = {
        "torque_command": torque, "pressure_target": cs.SX(0, 1), "valve": cs.SX(0, 1),
        "sand_rate": cs.SX(0, 1),
    }  # fmt: skip
    unbounded = {"drive_limit": UNBOUNDED_TORQUE, "brake_limit": UNBOUNDED_TORQUE, "health": 1.0}
    local = Local(peak=peak, grade=grade, air_factor=1.0, **unbounded)
    rate = arrays.derivative(whole, Inputs(**inputs), local)
    rate[rows[1]] += by_axle(air) / by_axle(inertia)
    steps = arrays.steps(
        without_clamps(cs.vertcat(*(rate[block] for block in rows)), UNBOUNDED_TORQUE)
    )
    return UnitModel(n, m, state, torque, parameters, steps.whole([steps.rate])[0], steps)


def substeps(units: Units, step: float) -> int:
    """Runge-Kutta steps that make a prediction step of `step` [s], from the plant's own bound on stiffness."""
    return _plant(group_of(units)).substeps(step)


def stiffness_of(units: Units, step: float) -> Stiffness:
    """Stiffness of a group, from that of the plant on a very steep curve and on a very flat one."""
    group, extreme = group_of(units), 1e9
    plant = _plant(group)

    def fastest(slope: float) -> float:
        curve = RationalCurve(peak_slip=2.0 / slope, steepness=2.0)
        return replace(plant, rail=Rail(1.0, curve=curve)).stiffness()

    rational = isinstance(group[0].curve, RationalCurve)
    return Stiffness(
        slope=float(fastest(extreme) / extreme),
        rest=float(fastest(1.0 / extreme)),
        axles=int(unit_of_axle(group).size),
        curve=curve_place(group).start if rational else -1,
        most=plant.substeps(step),
    )


def parameters(units: Units, peak: float | Floats, grade: float = 0.0) -> Floats:
    """Vector of the model's parameters.

    Its order is: peak coefficient of each axle, gradient (which represents all drag), mass, each of the `CONSTANTS` of all
    units, their `creep_stiffnesses`, the torque of other brakes at each wheelset of a unit [N m], 0 here, and the six
    parameters of the adhesion curve. Where axle loads change, the unloading of each axle follows.

    `peak`: one for all axles, or (axles,).
    """
    group = group_of(units)
    moved = unloading(group)
    constants = [getattr(context, name) for name in CONSTANTS for context in group]
    peaks = np.broadcast_to(np.asarray(peak, dtype=float), moved.shape)
    mass = sum(context.mass for context in group)
    lost = moved if moved.any() else moved[:0]
    creep = creep_stiffnesses(group)
    air = np.zeros(len(group))
    return np.concatenate([peaks, [grade, mass], constants, creep, air, group[0].curve.q, lost])


def curve_place(units: Units) -> slice:
    """Where among the `parameters` the first two of the adhesion curve stand: those of the rational one."""
    moved = unloading(units)
    begin = parameters(units, 0.0).size - CURVE_PARAMETERS - moved.size * bool(moved.any())
    return slice(begin, begin + 2)


def air_place(units: Units) -> slice:
    """Where among the `parameters` the torques of other brakes stand, (units,)."""
    end = curve_place(units).start
    return slice(end - len(group_of(units)), end)


def slip_matrix(units: Units) -> Floats:
    """Slip velocity of each axle [m/s] as a linear map of the state, (axles, states)."""
    group = group_of(units)
    unit = unit_of_axle(group)
    rows = np.eye(unit.size + 1 + len(group))
    return np.stack(
        [slip_velocity(rows[1 + i], group[j].radius, rows[0]) for i, j in enumerate(unit)]
    )


def torque_per_coefficient(context: UnitContext) -> float:
    """Motor torque [N m] for a tangential coefficient of 1 on every axle of the unit without slip.

    It includes the rail forces and the acceleration of the wheelsets along with the train.
    """
    rim = context.inertia * context.axles / (context.radius**2 * context.mass)
    return context.axle_load * context.radius / context.gear_ratio * (1.0 + rim)
