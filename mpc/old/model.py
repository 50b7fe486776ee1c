"""Prediction model of a unit or a group: the plant's own laws on CasADi symbols, with believed values.

In: what a unit knows of itself (`UnitContext`). Out: a `UnitModel` whose functions give the state's rate, step and cost
terms; parts that depend on parameters alone are folded out, to be computed once per control period.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, NamedTuple, TypeVar

import casadi as cs
import numpy as np

from alloc.old.onboard.host import UnitContext, UnitSense
from alloc.old.plant.adhesion import RationalCurve
from alloc.old.plant.array_model import ArrayModel, Local
from alloc.old.plant.laws import slip_velocity, tangential_coefficient
from alloc.old.plant.model import STABLE_STEP, Floats, Inputs, Ints, Model, build
from alloc.old.plant.rail import Rail
from alloc.old.plant.train import Car, Motors, TorqueLimit, Train
from mpc.old.condensing import Stiffness

# A model's functions without the parts that depend on its parameters alone: those are computed once per control period.
#
# Parameters are constant over a horizon, along which a model is evaluated hundreds of times. Expressions of parameters
# alone become a vector of constants, which the function "prepare" fills. A division by one of them becomes a
# multiplication. `casadi.extract_parametric` does the first, but leaves divisions, and CasADi turns a product with 1 /
# x back into a division by x.


PARAMETERS, FOLDED_CONSTANTS = "parameters", "constants"
"""Names of the input that is folded away, and of the one in its place."""

Made = TypeVar("Made")


def _walk(
    function: cs.Function,
    entry: Callable[[int, int], Made],
    number: Callable[[float], Made],
    combined: Callable[..., Made],
) -> list[list[Made]]:
    """Values of the nonzeros of each output of `function`.

    `entry`: of a nonzero of an input; `number`: of a number; `combined`: of an operation and one or two values.
    """
    outputs: list[list[Made]] = [
        [number(0.0)] * function.nnz_out(k) for k in range(function.n_out())
    ]
    work: dict[int, Made] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        read, written = function.instruction_input(k), function.instruction_output(k)
        if operation == cs.OP_OUTPUT:
            outputs[written[0]][written[1]] = work[read[0]]
        elif operation == cs.OP_INPUT:
            work[written[0]] = entry(*read)
        elif operation == cs.OP_CONST:
            work[written[0]] = number(function.instruction_constant(k))
        else:
            work[written[0]] = combined(operation, *(work[i] for i in read))
    return outputs


def without_clamps(expression: cs.SX, unbounded: float) -> cs.SX:
    """The dense `expression` without clamps that do nothing: to the range from -x to x where x is `unbounded` or 0.

    No torque is as large, and a brake that is not there holds nothing. A derivative of a clamp costs four divisions.
    """

    def combined(operation: int, a: cs.SX, b: cs.SX | None = None) -> cs.SX:
        if b is None:
            return cs.SX.unary(operation, a)
        other = {cs.OP_FMIN: cs.OP_FMAX, cs.OP_FMAX: cs.OP_FMIN}.get(operation)
        for bound, value in ((a, b), (b, a)) if other is not None else ():
            if bound.is_constant() and abs(float(bound)) == unbounded:
                return value
            empty = bound.is_zero() and value.op() == other
            if empty and any(value.dep(k).is_zero() for k in range(2)):
                return bound
        return cs.SX.binary(operation, a, b)

    symbols = cs.symvar(expression)
    function = cs.Function("expression", [cs.vertcat(*symbols)], [expression])
    (made,) = _walk(function, lambda _, place: symbols[place], cs.SX, combined)
    return cs.vertcat(*made)


class _Value(NamedTuple):
    """A result on the way."""

    expression: cs.SX
    constant: bool
    """Whether it stays the same over the horizon."""
    key: tuple[object, ...] = ()
    """How a constant is computed."""


class _Folding:
    """The constants that are found in one function after the other."""

    def __init__(self, parameters: cs.SX) -> None:
        self.parameters = parameters
        self._found: dict[tuple[object, ...], tuple[cs.SX, cs.SX]] = {}
        """Symbol and expression of each constant."""

    def outputs(self, function: cs.Function, inputs: list[cs.SX]) -> list[cs.SX]:
        """Nonzeros of the outputs of `function` of the symbols `inputs`, by the constants."""
        folded = function.index_in(PARAMETERS)
        outputs = _walk(
            function,
            lambda one, k: _Value(inputs[one][k], one == folded, (PARAMETERS, k)),
            lambda number: _Value(cs.SX(number), True, (number,)),
            self._combined,
        )
        return [cs.vertcat(*map(self._symbol, values)) for values in outputs]

    def _combined(self, operation: int, a: _Value, b: _Value | None = None) -> _Value:
        """The value of an operation."""
        if b is None:
            expression = cs.SX.unary(operation, a.expression)
            return _Value(expression, a.constant, (operation, a.key))
        if a.constant and b.constant:
            expression = cs.SX.binary(operation, a.expression, b.expression)
            return _Value(expression, True, (operation, a.key, b.key))
        if operation == cs.OP_DIV and b.constant:
            operation, b = cs.OP_MUL, _Value(1.0 / b.expression, True, (cs.OP_INV, b.key))
        return _Value(cs.SX.binary(operation, self._symbol(a), self._symbol(b)), False)

    def _symbol(self, value: _Value) -> cs.SX:
        """The value, or the symbol that stands for it."""
        if not value.constant or value.expression.is_constant():
            return value.expression
        if value.key not in self._found:
            symbol = cs.SX.sym(f"{FOLDED_CONSTANTS}_{len(self._found)}")
            self._found[value.key] = symbol, value.expression
        return self._found[value.key][0]

    def constants(self) -> tuple[cs.SX, cs.SX]:
        """Symbols, and what they stand for."""
        symbols, expressions = zip(*self._found.values(), strict=True)
        return cs.vertcat(*symbols), cs.vertcat(*expressions)


def folded(functions: dict[str, cs.Function]) -> dict[str, cs.Function]:
    """The functions with an input "constants" in place of "parameters", and "prepare": (parameters) -> constants.

    Outputs are vectors of the nonzeros. All of `functions` share the constants.
    """
    inputs = {name: list(function.sx_in()) for name, function in functions.items()}
    first = next(iter(functions))
    folding = _Folding(inputs[first][functions[first].index_in(PARAMETERS)])
    made = {}
    for name, function in functions.items():
        inputs[name][function.index_in(PARAMETERS)] = folding.parameters
        made[name] = folding.outputs(function, inputs[name])
    symbols, expressions = folding.constants()
    result = {}
    for name, function in functions.items():
        place, names = function.index_in(PARAMETERS), function.name_in()
        inputs[name][place], names[place] = symbols, FOLDED_CONSTANTS
        outputs = cs.cse(made[name])
        result[name] = cs.Function(name, inputs[name], outputs, names, function.name_out())
    prepare = cs.Function(
        "prepare", [folding.parameters], [cs.cse(expressions)], [PARAMETERS], [FOLDED_CONSTANTS]
    )
    return {"prepare": prepare, **result}


# The plant's right side on symbols in three steps: slips, coefficients, rates; so derivatives of a step are made once.


class Steps(NamedTuple):
    """The right side in steps, for derivatives that are computed once and used several times."""

    slip: cs.SX
    """Slip velocities by the state."""
    slip_symbol: cs.SX
    coefficient: cs.SX
    """Tangential coefficients by `slip_symbol` and the state."""
    coefficient_symbol: cs.SX
    rate: cs.SX
    """Right side by `coefficient_symbol` and the state."""

    def whole(self, expressions: list[cs.SX]) -> list[cs.SX]:
        """The expressions by state and torque alone."""
        pairs = (self.coefficient_symbol, self.coefficient), (self.slip_symbol, self.slip)
        for symbol, expression in pairs:
            expressions = cs.substitute(expressions, [symbol], [expression])
        return list(cs.cse(expressions))

    def jacobian(self, point: cs.SX) -> cs.SX:
        """Derivatives of the right side by `point`: a contact is differentiated once, whatever moves its slip."""
        slip = cs.jacobian(self.slip, point)
        coefficient = cs.jacobian(self.coefficient, self.slip_symbol) @ slip
        coefficient += cs.jacobian(self.coefficient, point)
        rate = cs.jacobian(self.rate, self.coefficient_symbol) @ coefficient
        rate += cs.jacobian(self.rate, self.slip_symbol) @ slip + cs.jacobian(self.rate, point)
        return cs.sparsify(self.whole([rate])[0])


class SteppedModel(ArrayModel):
    """The plant with slips and coefficients as symbols. Nothing sticks, so deflections stay zero."""

    def _contacts(self, state: Any, peak: Any) -> tuple[Any, Any, Any]:
        n, s = self.layout, self.structure
        speed, omega = self.body_of_axle @ state[n.speed], state[n.omega]
        self.slip = slip_velocity(omega, s.radius, speed)
        self.slip_symbol = cs.SX.sym("slip", n.axles)
        self.coefficient = tangential_coefficient(
            self.curve_kind,
            self.curve,
            self.slip_symbol,
            speed,
            s.radius * omega,
            peak,
            self.contact,
        )
        self.coefficient_symbol = cs.SX.sym("coefficient", n.axles)
        return self.slip_symbol, self.coefficient_symbol, cs.SX.zeros(n.axles)

    def steps(self, rate: cs.SX) -> Steps:
        """The right side `rate`, which came from `derivative`, in steps."""
        first = self.slip, self.slip_symbol, self.coefficient, self.coefficient_symbol
        return Steps(*first, rate)


# Prediction model of a traction unit, or of a group of them: the plant's own equations on symbols, with believed
# values.
#
# A group is the smallest train of the plant: one rigid body with the units' share of the train's mass, their cars and
# driven axles, one group of motors each. Only the states that determine slip are kept. Differences between groups are
# parameters, so all groups of the same shape and kind of adhesion curve share one expression and one compilation.


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

    Controllers predict on the rational curve; Polach's, whose stiffness is each unit's own, has no model. Raises
    `PlantError` where the units' values are impossible.
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
    sizes = [n, 1, 1, *[m] * len(CONSTANTS), m, CURVE_PARAMETERS, n * transfer]
    parameters = cs.SX.sym("parameters", sum(sizes))
    peak, grade, mass, load, radius, inertia, gear, lag, air, q, unloaded = cs.vertsplit(
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
    curve = [q[k] for k in range(CURVE_PARAMETERS)]
    # nothing sticks: the deflections of the contacts are no states of the model, and zero
    arrays = SteppedModel(structure, layout, curve_kind, curve, np.ones(n), Rail(1.0).presliding)
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
        stable=STABLE_STEP,
    )


def parameters(units: Units, peak: float | Floats, grade: float = 0.0) -> Floats:
    """Vector of the model's parameters.

    Its order is: peak coefficient of each axle, gradient (which represents all drag), mass, each of the `CONSTANTS` of all
    units, the torque of other brakes at each wheelset of a unit [N m], 0 here, and the six parameters of the adhesion curve.
    Where axle loads change, the unloading of each axle follows.

    `peak`: one for all axles, or (axles,).
    """
    group = group_of(units)
    moved = unloading(group)
    constants = [getattr(context, name) for name in CONSTANTS for context in group]
    peaks = np.broadcast_to(np.asarray(peak, dtype=float), moved.shape)
    mass = sum(context.mass for context in group)
    lost = moved if moved.any() else moved[:0]
    air = np.zeros(len(group))
    return np.concatenate([peaks, [grade, mass], constants, air, group[0].curve.q, lost])


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


# Units whose motors have failed: what is then wanted of the others, and of themselves.


def leading(senses: Sequence[UnitSense]) -> int:
    """Number of the foremost unit that works, which leads; of the last one where none does."""
    working = (j for j, sense in enumerate(senses) if sense.in_service)
    return next(working, len(senses) - 1)


class LostShare:
    """Part of the driver's plan that a group does not deliver because motors have failed."""

    def __init__(self, units: Sequence[UnitContext]) -> None:
        self._mass = np.array([unit.mass for unit in units])
        self._torque = np.array([torque_per_coefficient(unit) for unit in units])
        self._blended = units[0].blended

    def even(self, demand: float, leader: int) -> Floats:
        """Demand on each unit [N m], (units,), that is as even as the plan; `demand` on the `leader`."""
        return demand / self._torque[leader] * self._torque

    def wanted(
        self, demand: Floats, in_service: Sequence[bool], leader: int, planned: float
    ) -> Floats:
        """Demand on each unit [N m], signed, (units,); on one that has failed what is to be found elsewhere.

        That is its part of the plan, less what a rule has already laid on the others; nothing where air brakes give it.
        `demand` on those that work, signed; `planned` as `UnitSense` has it of the `leader`. While demand rises, or motors
        bound it, the leader's is below its plan, and so is what is lost.
        """
        works = np.array(in_service)
        if works.all():
            return demand
        at_rail = demand / self._torque
        sign = np.sign(demand[leader])
        coefficient = sign * min(abs(float(demand[leader])), planned) / self._torque[leader]
        lost = coefficient * self._mass[~works].sum()
        if not works[leader] or lost == 0.0 or (self._blended and sign < 0.0):
            return np.where(works, demand, 0.0)
        missing = coefficient * self._mass.sum() - self._mass[works] @ at_rail[works]
        share = min(max(float(missing / lost), 0.0), 1.0)
        return np.where(works, demand, share * coefficient * self._torque)
