"""The plant on whole arrays: assembly of the same laws for NumPy (single states or many) and CasADi (SX).

The environment (peak coefficients, gradients, torque limits) is an argument. So a controller can put its belief in the
place of the truth.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.plant.laws import (
    HOLDING_BRAKE,
    axle_load,
    car_drag,
    car_rail_force,
    coupler_forces,
    coupler_stretch,
    curving_resistance,
    cylinder_pressure_rate,
    friction_draft_gear,
    gradient_force,
    hyperbolic_speed_law,
    motor_torque_rate,
    parallel_motor_torque,
    recovery_rate,
    shaft_torque,
    slip_velocity,
    sticking_contact,
    stuck_share,
    tangential_coefficient,
    wheelset,
)
from alloc.old.plant.model import Inputs, Layout, Model, Structure
from alloc.old.plant.operations import where

Array = Any
"""NumPy array (rows,) or (rows, instants), or CasADi column."""


class Local(NamedTuple):
    """The environment where the train is now; rows as named, with or without instants."""

    peak: Array  # (axles,) peak coefficient
    grade: Array  # (cars,)
    air_factor: Array  # (cars,)
    drive_limit: Array  # (units,) motor torque [N m]
    brake_limit: Array  # (units,)
    health: Array  # (units,) 1, or 0 for failed motors
    curving: Array = 0.0  # (cars,) resistance of the curve per weight


def _matrix(index: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Selection (len(index), count): row i picks column index[i]; index -1 picks nothing."""
    matrix = np.zeros((index.size, count))
    chosen = index >= 0
    matrix[np.flatnonzero(chosen), index[chosen]] = 1.0
    return matrix


class ArrayModel:
    """Right side of the plant for whole arrays; build once, call often."""

    def __init__(
        self, structure: Structure, layout: Layout, curve_kind: int, curve: Array, contact: Array,
        presliding: float, recovery: tuple[float, float] = (1.0, 1.0),
    ) -> None:  # fmt: skip
        """`contact` (axles,): creep stiffness over that among the parameters `curve`; the rest is of `Rail`.

        `presliding` [m]; `recovery`: energy [J/m] and time [s].
        """
        self.structure, self.layout = structure, layout
        self.curve_kind, self.curve = curve_kind, curve
        self.contact, self.presliding, self.recovery = contact, presliding, recovery
        self.body_of_axle = _matrix(structure.axle_body, layout.bodies)
        self.car_of_axle = _matrix(structure.axle_car, layout.cars)
        self.unit_of_axle = _matrix(structure.axle_unit, layout.units)
        self.group_of_axle = _matrix(structure.axle_group, layout.groups)
        self.body_of_car = _matrix(structure.car_body, layout.bodies)
        n = layout.bodies
        self.stretch_of_body = np.eye(n)[:-1] - np.eye(n)[1:] if n > 1 else np.zeros((0, n))

    @classmethod
    def of(cls, model: Model) -> "ArrayModel":
        """Array form of a built model."""
        e = model.environment
        return cls(
            model.structure, model.layout, e.curve_kind, e.curve, e.contact, e.presliding,
            (e.recovery_energy, e.recovery_time),
        )  # fmt: skip

    def _column(self, values: NDArray[np.float64], like: Array) -> Array:
        """A parameter (rows,) shaped to act elementwise on `like`."""
        return values[:, None] if getattr(like, "ndim", 1) == 2 else values

    def _contacts(self, state: Array, peak: Array) -> tuple[Array, Array, Array]:
        """Slip velocity [m/s], coefficient and rate of deflection [m/s] of every axle."""
        s, n = self.structure, self.layout
        speed = self.body_of_axle @ state[n.speed]
        omega = state[n.omega]
        radius = self._column(s.radius, omega)
        slip = slip_velocity(omega, radius, speed)
        rim, contact = radius * omega, self._column(self.contact, omega)
        mu = tangential_coefficient(self.curve_kind, self.curve, slip, speed, rim, peak, contact)
        held = s.shoe_gain / (s.static_load * HOLDING_BRAKE)
        brake = self._column(held, omega) * (self.group_of_axle @ state[n.pressure])
        share = stuck_share(speed, rim, brake)
        mu, rate = sticking_contact(mu, peak, slip, state[n.deflection], self.presliding, share)
        return slip, mu, rate

    def _rail_forces(self, mu: Array) -> Array:
        """Rail force [N] of every axle with the coefficient `mu`."""
        s = self.structure
        load, unloading = self._column(s.static_load, mu), self._column(s.unloading, mu)
        car_force = car_rail_force(
            self.car_of_axle.T @ (mu * load), self.car_of_axle.T @ (mu * unloading)
        )
        return mu * axle_load(load, unloading, self.car_of_axle @ car_force)

    def forces(self, state: Array, peak: Array) -> tuple[Array, Array, Array]:
        """Slip velocity [m/s], coefficient and rail force [N] of every axle."""
        slip, mu, _ = self._contacts(state, peak)
        return slip, mu, self._rail_forces(mu)

    def rotor_speeds(self, state: Array) -> Array:
        """Angular speed [rad/s] of every axle's rotor over its gear ratio; its own where the drive is rigid."""
        omega = state[self.layout.omega]
        if not self.layout.shafts:
            return omega
        elastic = self._column(self.structure.axle_shaft[1], omega) > 0.0
        return where(elastic, state[self.layout.rotor], omega)

    def shaft_torques(self, state: Array) -> Array:
        """Torque that the drives hand on to every wheelset [N m], at the wheel."""
        motor = self.motor_torques(state)
        if not self.layout.shafts:
            return motor
        _, stiffness, damping = (self._column(one, motor) for one in self.structure.axle_shaft)
        rate = self.rotor_speeds(state) - state[self.layout.omega]
        shaft = shaft_torque(state[self.layout.twist], rate, stiffness, damping)
        return where(stiffness > 0.0, shaft, motor)

    def motor_torques(self, state: Array) -> Array:
        """Torque of the motors on every axle [N m], at the wheel."""
        omega = self.rotor_speeds(state)
        gear = self._column(self.structure.gear, omega)
        torque = self.unit_of_axle @ state[self.layout.torque]
        if not self.structure.axle_motor[0].any():
            return gear * torque
        own = gear * omega
        mean = self.unit_of_axle @ (
            (self.unit_of_axle.T @ own) / self._column(self.structure.unit_axles, omega)
        )
        kind, breakdown, slip = (self._column(one, omega) for one in self.structure.axle_motor)
        return gear * parallel_motor_torque(kind, torque, breakdown, slip, mean, own)

    def wheelsets(self, state: Array, force: Array) -> tuple[Array, Array]:
        """Torque of the brake shoes on every wheelset [N m] under its rail force [N], and angular acceleration [rad/s2]."""
        s, n = self.structure, self.layout
        omega = state[n.omega]
        radius = self._column(s.radius, omega)
        a, o, c = (self._column(s.shoe_friction[:, k], omega) for k in range(3))
        grip = hyperbolic_speed_law(radius * omega, a, o, c)
        cylinder = self.group_of_axle @ state[n.pressure]
        limit = self._column(s.shoe_gain, omega) * radius * cylinder * grip
        inertia = self._column(s.inertia - s.axle_shaft[0], omega)
        motor, inverse = self.shaft_torques(state), 1.0 / inertia
        shoe, rate = wheelset(motor, force, radius, omega, limit, inertia, inverse)
        return shoe, rate

    def coupler_forces(self, state: Array) -> tuple[Array, Array, Array]:
        """Tension of every coupler [N], power lost in it [W], and rate of its wedges' travel [m/s], (bodies - 1,).

        Without friction draft gears the rates are those of no coupler, (0,).
        """
        n, s = self.layout, self.structure
        speed = state[n.speed]
        spring = [self._column(s.coupler[:, k], speed) for k in range(4)]
        elongation, rate = (self.stretch_of_body @ state[part] for part in (n.position, n.speed))
        tension, damper = coupler_forces(elongation, rate, *spring)
        if not n.draft_gears:
            return tension, damper * rate, state[n.gear_travel]
        *gear, fluidity, damping = (self._column(s.draft_gear[:, k], speed) for k in range(8))
        stretch = coupler_stretch(elongation, spring[3])
        friction, creep, lost = friction_draft_gear(
            stretch, rate, state[n.gear_travel], tuple(gear), fluidity, damping
        )
        return tension + friction, damper * rate + lost, creep

    def derivative(self, state: Array, inputs: Inputs, local: Local) -> Array:
        """Derivative of the state, (rows,) or (rows, instants); rows as in `Layout`."""
        s, n = self.structure, self.layout
        column = self._column
        speed, omega = state[n.speed], state[n.omega]
        slip, mu, deflection_rate = self._contacts(state, local.peak)
        force = self._rail_forces(mu)
        shoe, omega_rate = self.wheelsets(state, force)
        car_speed = self.body_of_car @ speed
        r0, r1, r2 = (column(s.car_resistance[:, k], car_speed) for k in range(3))
        mass = column(s.car_mass, car_speed)
        constant = r0 + curving_resistance(mass, local.curving)
        downhill = gradient_force(mass, local.grade)
        drag = car_drag(car_speed, constant, r1, r2, local.air_factor, downhill)
        tension, lost, creep = self.coupler_forces(state)
        body_force = (
            self.body_of_axle.T @ force
            - self.body_of_car.T @ drag
            - self.stretch_of_body.T @ tension
        )
        torque_rate = motor_torque_rate(
            state[n.torque],
            inputs.torque_command,
            local.drive_limit,
            local.brake_limit,
            local.health,
            1.0 / column(s.unit_lag, omega),
        )
        pressure_rate = cylinder_pressure_rate(
            state[n.pressure],
            inputs.pressure_target,
            inputs.valve,
            1.0 / column(s.group_fill, omega),
            1.0 / column(s.group_release, omega),
        )
        motor, turned = self.motor_torques(state), self.rotor_speeds(state)
        acceleration = body_force / column(s.body_mass, speed)
        parts = [speed, acceleration, omega_rate, torque_rate, pressure_rate, creep]
        twisting = []
        if n.shafts:
            rotor, _, damping = (column(one, omega) for one in s.axle_shaft)
            rate = turned - omega
            twisting = [damping * rate * rate]
            parts += [(motor - self.shaft_torques(state)) / where(rotor > 0.0, rotor, 1.0), rate]
        if n.recoveries:
            energy, time = self.recovery
            along = self.body_of_axle @ speed
            parts += [recovery_rate(state[n.recovery], force * slip, along, energy, time)]
        powers = [[motor * turned], [shoe * omega], [drag * car_speed], [lost, *twisting]]
        if isinstance(state, np.ndarray):
            works = [sum(one.sum(axis=0, keepdims=True) for one in power) for power in powers]
            return np.concatenate([*parts, force * slip, *works, deflection_rate])
        import casadi

        works = [sum(casadi.sum1(one) for one in power) for power in powers]
        return casadi.vertcat(*parts, force * slip, *works, deflection_rate)
