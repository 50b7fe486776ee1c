"""From a train, a rail and a line to the arrays that the plant computes with.

Lanes are scenarios advanced together: same train and line, own rail, own commands. Every array that may
differ between scenarios has the lane as its last dimension.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from alloc.errors import PlantError
from alloc.plant.environment import Environment, environment_of, environment_of_lanes
from alloc.plant.equations import LOCK_TIME
from alloc.plant.rail import Line, Rail, Receptivity
from alloc.plant.structure import Floats, Ints, Layout, Structure, structure_of
from alloc.plant.train import Train

STABLE_STEP = 2.0
"""Largest product of stiffness and step; RK4's limit on the negative real axis is 2.78."""

DRAFT_GEAR_TRAVEL = 0.1
"""Stretch [m] for which the stiffness of a stiffening draft gear is bounded; real ones end at 0.06 to 0.1 m."""


class Inputs(NamedTuple):
    """What acts on the plant and is constant over a step, (rows, lanes)."""

    torque_command: Floats  # (units, lanes) motor torque [N m] of each motor of the unit
    pressure_target: Floats  # (groups, lanes) [Pa]
    valve: Floats  # (groups, lanes) 0 follow the target, 1 hold, 2 release
    cleaning: Floats  # (axles, lanes) 0..1, set by the transport of conditioning


@dataclass(frozen=True, repr=False)
class Model:
    """A train on a line, in one or more lanes; build it with `build`."""

    train: Train
    rails: tuple[Rail, ...]
    line: Line
    layout: Layout
    structure: Structure
    environment: Environment
    span: tuple[float, float]

    def __repr__(self) -> str:
        lanes = "" if self.lanes == 1 else f", first of {self.lanes} lanes"
        return f"<Model: {self.train!r} on {self.rails[0]!r}{lanes}>"

    @property
    def lanes(self) -> int:
        """Number of scenarios advanced together."""
        return len(self.rails)

    def select_lanes(self, lanes: slice) -> "Model":
        """The same model with these of its lanes only; raises `PlantError` if none is left."""
        rails = self.rails[lanes]
        if not rails:
            raise PlantError(f"lanes: {lanes} selects none of {self.lanes} lanes")
        environment = environment_of_lanes(self.environment, lanes)
        return replace(self, rails=rails, environment=environment)

    def initial_state(self, speed: float | Floats = 0.0, position: float | Floats = 0.0) -> Floats:
        """State (rows, lanes) of a train that rolls without slip, brakes and motors off.

        `speed` [m/s] and `position` of the front [m]: one for all lanes, or (lanes,). Coupled cars stand at rest
        length. Raises `PlantError` if one is not finite.
        """
        given = {"speed": np.ravel(speed), "position": np.ravel(position)}
        PlantError.check("initial state", given, finite=("speed[]", "position[]"))
        state = np.zeros((self.layout.rows, self.lanes))
        state[self.layout.position] = position
        state[self.layout.speed] = speed
        state[self.layout.omega] = np.asarray(speed) / self.structure.radius[:, None]
        return state

    def zero_inputs(self) -> Inputs:
        """Inputs with everything released."""
        n, lanes = self.layout, self.lanes
        return Inputs(
            torque_command=np.zeros((n.units, lanes)),
            pressure_target=np.zeros((n.groups, lanes)),
            valve=np.zeros((n.groups, lanes)),
            cleaning=np.zeros((n.axles, lanes)),
        )

    def stiffness(self) -> float:
        """Estimate from above [1/s] of the fastest rate: creep, locking wheels, couplers, motor lag, cylinders."""
        s = self.structure
        slope = max(rail.curve.steepest_slope(rail.greatest_peak()) for rail in self.rails)
        # wheels and body together: the fastest wheel's rate plus that of the body under all its axles
        wheel = float((s.static_load * s.radius**2 / s.inertia).max())
        load = np.bincount(s.axle_body, s.static_load, minlength=s.body_mass.size)
        rates = [slope * (wheel + float((load / s.body_mass).max()))]
        if s.unit_lag.size:
            rates.append(float(1.0 / s.unit_lag.min()))
        if s.group_fill.size:
            rates += [1.0 / LOCK_TIME, float(1.0 / min(s.group_fill.min(), s.group_release.min()))]
        if s.coupler.size:
            inverse = float((1.0 / s.body_mass[:-1] + 1.0 / s.body_mass[1:]).max())
            tangent = s.coupler[:, 0] + 3.0 * s.coupler[:, 1] * DRAFT_GEAR_TRAVEL**2
            rates.append(2.0 * float(s.coupler[:, 2].max()) * inverse)
            rates.append(math.sqrt(2.0 * float(tangent.max()) * inverse))
        return max(rates)

    def substeps(self, step: float) -> int:
        """Integration steps into which `step` [s] must be divided to be stable."""
        return max(1, math.ceil(step * self.stiffness() / STABLE_STEP))


def build(
    train: Train,
    rail: Rail | Sequence[Rail],
    line: Line | None = None,
    receptivity: Receptivity | Sequence[Receptivity] | None = None,
    failures: dict[int, float] | Sequence[dict[int, float]] | None = None,
    span: tuple[float, float] = (0.0, 5000.0),
) -> Model:
    """Put a train on a rail and a line.

    `rail`: one rail, or one per lane. `failures`: time [s] at which a traction unit (0 = foremost) loses its motors.
    `span`: least and greatest position [m] of the train's front that the line must cover.
    Raises `PlantError` where train, rail and line do not fit.
    """
    rails = (rail,) if isinstance(rail, Rail) else tuple(rail)
    if not rails:
        raise PlantError("rail: no lane given; pass at least one Rail")
    if not (all(math.isfinite(x) for x in span) and span[0] < span[1]):
        raise PlantError(f"span: {span} must be two finite positions, the smaller one first")
    line = line or Line()
    if receptivity is None or isinstance(receptivity, Receptivity):
        receptivity = [receptivity or Receptivity()] * len(rails)
    if failures is None or isinstance(failures, dict):
        failures = [failures or {}] * len(rails)
    for name, given in (("receptivity", receptivity), ("failures", failures)):
        if len(given) != len(rails):
            raise PlantError(
                f"{name}: {len(given)} entries for {len(rails)} lanes; give one per lane, or one"
            )
    structure, layout = structure_of(train)
    environment = environment_of(layout, train, rails, line, receptivity, failures, span)
    return Model(train, rails, line, layout, structure, environment, span)


__all__ = ["Environment", "Floats", "Inputs", "Ints", "Layout", "Model", "Structure", "build"]
