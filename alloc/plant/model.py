"""From a train, a rail and a line to the arrays that the plant computes with."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from alloc.display import displayed
from alloc.errors import PlantError
from alloc.plant.environment import Environment, environment_of
from alloc.plant.equations import LOCK_TIME, STANDSTILL_SPEED
from alloc.plant.rail import Line, Rail, Receptivity
from alloc.plant.structure import Floats, Ints, Layout, Structure, structure_of
from alloc.plant.train import Train

STABLE_STEP = 2.0
"""Largest product of stiffness and step; RK4's limit on the negative real axis is 2.78."""

HIGHEST_SPEED = 100.0
"""Speed [m/s] up to which running resistance grows: no train here is faster."""

DRAFT_GEAR_TRAVEL = 0.1
"""Stretch [m] for which the stiffness of a stiffening draft gear is bounded; real ones end at 0.06 to 0.1 m."""


class Inputs(NamedTuple):
    """Inputs of the plant that are constant over a step."""

    torque_command: Floats  # (units,) motor torque [N m] of each motor of the unit
    pressure_target: Floats  # (groups,) [Pa]
    valve: Floats  # (groups,) 0 follow the target, 1 hold, 2 release
    sand_rate: Floats  # (sanders,) [kg/s per rail]


@displayed
@dataclass(frozen=True, repr=False)
class Model:
    """A train on a rail and a line; build it with `build`."""

    train: Train
    rail: Rail
    line: Line
    layout: Layout
    structure: Structure
    environment: Environment
    span: tuple[float, float]
    """Stretch of line in the tables [m]."""

    def __repr__(self) -> str:
        return f"<Model: train {self.train.name!r} on {repr(self.rail)[1:-1]}>"

    def initial_state(self, speed: float = 0.0, position: float = 0.0) -> Floats:
        """State (rows,) of a train that rolls without slip, brakes and motors off.

        `speed` [m/s] and `position` of the front [m]. Coupled cars stand at rest length. Raises `PlantError` if one is
        not finite.
        """
        PlantError.check(
            "initial state", {"speed": speed, "position": position}, finite=("speed", "position")
        )
        state = np.zeros(self.layout.rows)
        state[self.layout.position] = position
        state[self.layout.speed] = speed
        state[self.layout.omega] = speed / self.structure.radius
        return state

    def zero_inputs(self) -> Inputs:
        """Inputs with everything released."""
        n = self.layout
        return Inputs(*map(np.zeros, (n.units, n.groups, n.groups, n.sanders)))

    def stiffness(self) -> float:
        """Upper estimate [1/s] of the fastest rate: creep, resistance, locking wheels, couplers, motor lag, cylinders."""
        s, contact = self.structure, self.environment.contact
        peak = self.rail.greatest_peak()
        if self.environment.sandy:
            peak = max(peak, self.rail.sanded_coefficient)

        def of_contacts(stiffness: Floats) -> float:
            # wheels and body together: the fastest wheel's rate plus that of the body under all its axles
            carried = stiffness * s.static_load
            wheel = float((carried * s.radius**2 / s.inertia).max())
            body = np.bincount(s.axle_body, carried, minlength=s.body_mass.size)
            return wheel + float((body / s.body_mass).max())

        rates = [of_contacts(self.rail.curve.steepest_slope(peak) * contact)]
        slope = (1.0 / STANDSTILL_SPEED, 1.0, 2.0 * HIGHEST_SPEED * self.environment.line[1].max())
        drag = np.bincount(s.car_body, s.car_resistance @ slope, minlength=s.body_mass.size)
        rates.append(float((drag / s.body_mass).max()))
        if s.unit_lag.size:
            rates.append(float(1.0 / s.unit_lag.min()))
        if s.group_fill.size:
            rates += [1.0 / LOCK_TIME, float(1.0 / min(s.group_fill.min(), s.group_release.min()))]
            # contacts of braked wheels at rest
            spring = np.full_like(contact, peak / self.rail.presliding)
            rates.append(math.sqrt(of_contacts(spring)))
        if s.coupler.size:
            inverse = float((1.0 / s.body_mass[:-1] + 1.0 / s.body_mass[1:]).max())
            structure, loading, fluidity, damping = s.draft_gear[:, (0, 1, 6, 7)].T
            tangent = s.coupler[:, 0] + 3.0 * s.coupler[:, 1] * DRAFT_GEAR_TRAVEL**2 + structure
            damped = 2.0 * float((s.coupler[:, 2] + damping).max()) * inverse
            oscillation = math.sqrt(2.0 * float(tangent.max()) * inverse)
            # of wedges that slide, which the cars' motion hastens
            sliding = float(((structure + loading) * fluidity).max())
            rates += [damped, oscillation, sliding + damped + oscillation if sliding else 0.0]
        return max(rates)

    def substeps(self, step: float) -> int:
        """Integration steps into which `step` [s] must be divided to be stable."""
        return max(1, math.ceil(step * self.stiffness() / STABLE_STEP))


def build(
    train: Train,
    rail: Rail,
    line: Line | None = None,
    receptivity: Receptivity | None = None,
    failures: dict[int, float] | None = None,
    span: tuple[float, float] = (0.0, 5000.0),
) -> Model:
    """Put a train on a rail and a line.

    `failures`: time [s] at which a traction unit (0 = foremost) loses its motors. `span`: smallest and largest position [m]
    of the train's front that the line must cover. Raises `PlantError` where train, rail and line do not fit.
    """
    if not (all(math.isfinite(x) for x in span) and span[0] < span[1]):
        raise PlantError(f"span: {span} must be two finite positions, the smaller one first")
    line, receptivity = line or Line(), receptivity or Receptivity()
    structure, layout = structure_of(train)
    environment = environment_of(
        structure, layout, train, rail, line, receptivity, failures or {}, span
    )
    return Model(train, rail, line, layout, structure, environment, span)


__all__ = ["Environment", "Floats", "Inputs", "Ints", "Layout", "Model", "Structure", "build"]
