"""Prediction model of one traction unit: the plant's own equations on symbols, with believed values.

The unit is the smallest train of the plant: one rigid body with the unit's share of the train's mass, its driven
axles, one group of motors. Only states that decide its slip are kept. What differs between units is a parameter, so all
units with as many axles and the same kind of adhesion curve share one expression and one compilation.
"""

from dataclasses import dataclass, replace
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from alloc.onboard.host import UnitContext
from alloc.plant.array_model import ArrayModel, Local
from alloc.plant.equations import slip_velocity
from alloc.plant.model import Inputs, Model, build
from alloc.plant.rail import Rail
from alloc.plant.train import Car, Motors, TorqueLimit, Train

Floats = NDArray[np.float64]

UNBOUNDED_TORQUE = 1e9
"""Torque limit [N m] inside the model: the optimiser's bounds act instead, which keeps the model smooth."""

CONSTANTS = ("mass", "axle_load", "radius", "inertia", "gear_ratio", "torque_lag")
"""Values of a unit that the model takes as parameters, named as in `UnitContext`."""


@dataclass(frozen=True)
class UnitModel:
    """Symbolic right side of a unit; get it with `unit_model`.

    States (axles + 2,): car speed [m/s], angular speed of each wheelset [rad/s], motor torque [N m]. Input: torque
    command [N m]. Parameters (axles + 13,): peak coefficient of each axle, gradient (which stands for all drag), the
    `CONSTANTS` of the unit, the six parameters of its adhesion curve.
    """

    axles: int
    state: cs.SX
    torque: cs.SX
    parameters: cs.SX
    rate: cs.SX
    """Derivative of the state."""

    @property
    def states(self) -> int:
        """Number of states."""
        return self.axles + 2

    def right_side(self) -> cs.Function:
        """CasADi function (state, torque, parameters) -> derivative of the state."""
        return cs.Function("right_side", [self.state, self.torque, self.parameters], [self.rate])

    def step_function(self, step: float, substeps: int) -> cs.Function:
        """CasADi function (state, torque, parameters) -> state after `step` [s], classical Runge-Kutta."""
        f, h = self.right_side(), step / substeps
        x, u, p = self.state, self.torque, self.parameters
        for _ in range(substeps):
            k1 = f(x, u, p)
            k2 = f(x + 0.5 * h * k1, u, p)
            k3 = f(x + 0.5 * h * k2, u, p)
            k4 = f(x + h * k3, u, p)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return cs.Function("step", [self.state, u, p], [x])


def _plant(context: UnitContext) -> Model:
    """The unit as a train of the plant."""
    n = context.axles
    limit = TorqueLimit(UNBOUNDED_TORQUE, UNBOUNDED_TORQUE)
    car = Car(
        name=f"unit {context.unit + 1}",
        length=float(n + 1),
        empty_mass=context.mass,
        load=0.0,
        axle_positions=tuple(float(k + 1) for k in range(n)),
        bogie_of_axle=(0,) * n,
        wheel_radius=context.radius,
        wheel_inertia=(context.inertia,) * n,
        driven=(True,) * n,
        motors=Motors("1C4M", context.gear_ratio, limit, limit, context.torque_lag),
    )
    plant = build(Train(car.name, (car,)), Rail(1.0, curve=context.curve))
    # the unit also moves its share of the trailers: its mass is not what rests on its axles
    load = np.full(n, context.axle_load)
    return replace(plant, structure=plant.structure._replace(static_load=load))


_models: dict[tuple[int, int], UnitModel] = {}


def unit_model(context: UnitContext) -> UnitModel:
    """Prediction model for units with the axles and the kind of curve of `context`; one object for all of them.

    Raises `PlantError` where the unit's values are impossible.
    """
    plant = _plant(context)
    key = (context.axles, context.curve.kind)
    if key not in _models:
        _models[key] = _symbolic(plant, *key)
    return _models[key]


def _symbolic(plant: Model, n: int, curve_kind: int) -> UnitModel:
    layout = plant.layout
    state, torque = cs.SX.sym("state", n + 2), cs.SX.sym("torque")
    parameters = cs.SX.sym("parameters", n + 1 + len(CONSTANTS) + 6)
    peak, grade, q = parameters[:n], parameters[n], parameters[n + 1 + len(CONSTANTS) :]
    mass, load, radius, inertia, gear, lag = cs.vertsplit(
        parameters[n + 1 : n + 1 + len(CONSTANTS)]
    )
    symbols: dict[str, Any] = {
        "radius": radius, "inertia": inertia, "gear": gear, "static_load": load,
        "car_mass": mass, "body_mass": mass, "unit_lag": lag, "unit_gear": gear,
    }  # fmt: skip
    structure = plant.structure._replace(**symbols)
    arrays = ArrayModel(structure, layout, curve_kind, [q[k] for k in range(6)])
    rows = [layout.speed, layout.omega, layout.torque]
    whole = cs.SX.zeros(layout.rows)
    whole[rows[0]], whole[rows[1]], whole[rows[2]] = state[0], state[1 : n + 1], state[n + 1]
    none: Any = cs.SX(0, 1)
    command: Any = torque
    clean: Any = cs.SX(n, 1)
    rate = arrays.derivative(
        whole,
        Inputs(torque_command=command, pressure_target=none, valve=none, cleaning=clean),
        Local(
            peak=peak,
            grade=grade,
            air_factor=1.0,
            drive_limit=UNBOUNDED_TORQUE,
            brake_limit=UNBOUNDED_TORQUE,
            health=1.0,
        ),
    )
    return UnitModel(
        axles=n,
        state=state,
        torque=torque,
        parameters=parameters,
        rate=cs.cse(cs.vertcat(*(rate[block] for block in rows))),
    )


def substeps(context: UnitContext, step: float) -> int:
    """Runge-Kutta steps that make a prediction step of `step` [s], from the plant's own bound on stiffness."""
    return _plant(context).substeps(step)


def parameters(context: UnitContext, peak: float | Floats, grade: float = 0.0) -> Floats:
    """Parameters of the model for a unit: see `UnitModel`; `peak` one for all axles, or (axles,)."""
    constants = [getattr(context, name) for name in CONSTANTS]
    peaks = np.broadcast_to(np.asarray(peak, dtype=float), (context.axles,))
    return np.concatenate([peaks, [grade], constants, context.curve.q])


def slip_matrix(context: UnitContext) -> Floats:
    """Slip velocity of each axle [m/s] as a linear map of the state, (axles, states)."""
    unit = np.eye(context.axles + 2)
    return np.stack(
        [slip_velocity(unit[1 + i], context.radius, unit[0]) for i in range(context.axles)]
    )


def torque_per_coefficient(context: UnitContext) -> float:
    """Motor torque [N m] that holds a tangential coefficient of 1 on every axle of the unit without slip.

    It carries the rail forces and accelerates the wheelsets along with the train.
    """
    rim = context.inertia * context.axles / (context.radius**2 * context.mass)
    return context.axle_load * context.radius / context.gear_ratio * (1.0 + rim)


__all__ = [
    "CONSTANTS",
    "UnitModel",
    "parameters",
    "slip_matrix",
    "substeps",
    "torque_per_coefficient",
    "unit_model",
]
