"""Forces of a whole train that rolls without slip, by position and speed: what a driver knows who knows train and line."""

import numpy as np

from alloc.plant.laws import (
    curving_resistance,
    gradient_force,
    hyperbolic_speed_law,
    limit_place,
    running_resistance,
)
from alloc.plant.model import Floats, Model
from alloc.plant.operations import look_up
from alloc.plant.train import EFFORT_SPEED_STEP


class TrainForces:
    """Effort, brake and resistance of `model`'s train, from the plant's own equations and tables, summed over the train."""

    def __init__(self, model: Model) -> None:
        s, e = model.structure, model.environment
        self.inertia = model.train.mass + model.train.rotating_mass
        """Mass with the rotating masses [kg]."""
        radius = np.array([s.radius[s.axle_unit == j].mean() for j in range(model.layout.units)])
        rims = s.unit_axles * s.unit_gear / radius
        self._speeds = EFFORT_SPEED_STEP * np.arange(s.drive_table.shape[1])
        self._drive, self._brake = s.drive_table, s.brake_table
        self._effort, self._electric = rims @ s.drive_table, rims @ s.brake_table
        self.peak_torque: Floats = s.drive_table.max(axis=1)
        """Greatest torque of each unit's motors [N m], (units,)."""
        self._mass, self._level = model.train.mass, s.car_resistance.sum(axis=0)
        self._shoe_gain, self._friction = s.shoe_gain, s.shoe_friction.T
        self._linear = s.car_resistance[:, 1].sum()
        # gradient, tunnels and curves by position of the front, each car where it stands
        self._places = np.arange(model.span[0], model.span[1] + e.line_spacing, e.line_spacing)
        under = (self._places[:, None] + s.car_offset - e.line_origin) / e.line_spacing
        knots = np.arange(e.line.shape[1])
        grade, air, curving = (np.interp(under, knots, row) for row in e.line)
        self._climbing = gradient_force(s.car_mass, grade).sum(axis=1)
        self._quadratic = air @ s.car_resistance[:, 2]
        curves = curving_resistance(s.car_mass, curving).sum(axis=1)
        self._constant = s.car_resistance[:, 0].sum() + curves

    def effort(self, speed: float) -> float:
        """Greatest tractive effort at the rims [N] at `speed` [m/s]."""
        return float(np.interp(speed, self._speeds, self._effort))

    def electric_brake(self, speed: float) -> float:
        """Greatest force of the electric brake at the rims [N] at `speed` [m/s]."""
        return float(np.interp(speed, self._speeds, self._electric))

    def torque(self, share: float, speed: float) -> Floats:
        """Torque of each unit's motors [N m] for a `share` of effort, or below 0 of electric brake, at `speed` [m/s].

        (units,)
        """
        table = self._drive if share >= 0.0 else self._brake
        place = limit_place(max(speed, 0.0), 1.0 / EFFORT_SPEED_STEP, self._speeds.size)
        return np.asarray(share * look_up(table.T, place))

    def resistance(self, position: float, speed: float) -> float:
        """Running resistance and gradient force [N] at `position` [m] of the front and `speed` [m/s]."""
        quadratic = np.interp(position, self._places, self._quadratic)
        constant = np.interp(position, self._places, self._constant)
        running = running_resistance(speed, constant, self._linear, quadratic, 1.0)
        return float(running) + self.climbing_at(position)

    def level_resistance(self, speed: float) -> float:
        """Running resistance [N] forward on level, straight and open line; at standstill that of setting off."""
        constant, linear, quadratic = self._level
        return float(constant + (linear + quadratic * speed) * speed)

    def climbing(self, grade: float) -> float:
        """Gradient force [N] on the whole train where all of it stands on this `grade`."""
        return float(gradient_force(self._mass, grade))

    def climbing_at(self, position: float) -> float:
        """Gradient force [N] with the front at `position` [m], each car where it stands."""
        return float(np.interp(position, self._places, self._climbing))

    def brake_pressure(self, force: float, speed: float) -> float:
        """Cylinder pressure [Pa] at which all shoes together brake with `force` [N] at the rims."""
        return force / float(self._shoe_gain @ hyperbolic_speed_law(speed, *self._friction))
