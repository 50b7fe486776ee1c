"""The problem of several units in one: its solver, and its targets and limits in a period."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.structure import Floats
from alloc.rules.exact import exact_limits
from mpc.belief import with_predicted_curve
from mpc.demand import tracked_coefficient
from mpc.horizon import HorizonProblem, cost_of
from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings
from mpc.stiffness import no_steeper
from mpc.unit_model import air_place, curve_place, parameters, unit_of_axle


class WheelsAndRail(NamedTuple):
    """What a group believes of what its wheels meet, in the direction of the demand."""

    peak: Floats
    """Peak coefficient, (axles,)."""
    slip_limit: Floats
    """Slip that should not be exceeded [m/s], (axles,)."""
    carried: Floats
    """Motor torque that the weakest axle of each unit carries [N m], (units,)."""
    air: Floats
    """Torque of the air brake at each wheelset of a unit [N m], (units,)."""


class GroupProblem:
    """Makes the problems of a group and has their solver; axles unit by unit, foremost first."""

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings, steps: int | None = None
    ) -> None:
        """`steps`: most SQP steps, if others than those of the settings."""
        group = tuple(map(with_predicted_curve, contexts))
        self._settings = settings
        own = settings if steps is None else replace(settings, iterations=steps)
        self.solver = RealTimeIteration(group, own, settings.group.evenness)
        terms = cost_of(group, settings).unit
        self.share, self._scale = terms.share, terms.scale
        self.unit = unit_of_axle(group)
        """Number of each axle's unit, (axles,)."""
        self._first = np.flatnonzero(np.diff(self.unit, prepend=-1))
        self.radius = np.array([context.radius for context in group])[self.unit]
        """Of each axle's wheels [m], (axles,)."""
        self._parameters = parameters(group, settings.belief.initial)
        self._curve, self._air = curve_place(group), air_place(group)

    def problem(
        self,
        state: tuple[float, Floats, Floats],
        rail: WheelsAndRail,
        curve: Floats,
        target: Floats,
        before: Floats,
        limit: Floats,
    ) -> HorizonProblem:
        """The problem from `state` on: speed [m/s], angular speeds (axles,), torques (units,).

        `curve`: peak slip [m/s] and steepness of all, taken less steep where the axles' highest peak would make it too
        steep to predict with. `target`, torques `before` and motors' `limit` [N m], (units,).
        """
        speed, omega, torque = state
        carried = rail.carried
        self._parameters[: omega.size] = rail.peak
        self._parameters[self._curve] = no_steeper(curve[0], curve[1], rail.peak.max())
        self._parameters[self._air] = rail.air
        target = self._tracked(target, rail)
        return HorizonProblem(
            state=np.concatenate([[speed], omega, torque]),
            parameters=self._parameters,
            slip_limit=rail.slip_limit,
            target=target,
            before=before,
            upper=np.minimum(limit, (1.0 + self._settings.headroom) * carried),
            reference=even_split(target, carried, limit, self._scale, self.share),
        )

    def _tracked(self, target: Floats, rail: WheelsAndRail) -> Floats:
        """What the group tracks of `target` [N m], (units,): its total as far as `mpc.demand` says of all units."""
        scale, w = self._settings.weights.coefficient_scale, self._settings.weights
        carried = rail.carried * scale / self._scale
        slips = np.minimum.reduceat(rail.slip_limit, self._first)
        most = np.array(
            [
                tracked_coefficient(held, slip, scale, w.tracking, w.slip, w.slip_scale)
                for held, slip in zip(carried, slips, strict=True)
            ]
        )
        allowed = float(self.share @ most)
        wanted = float(self.share @ (target * scale / self._scale))
        return target if wanted <= allowed else target * (allowed / wanted)


def even_split(
    target: Floats, carried: Floats, limit: Floats, scale: Floats, share: Floats
) -> Floats:
    """Torques [N m] that give the total of `target` at one coefficient, except for units that cannot; (units,).

    This is the exact level that par. 0050 of JP5484215 names, with what the units are believed to carry as caps. For a unit
    that has not slipped, that belief is a guess. Loads in proportion to it would send untested units to their peak; one
    level asks no more of them than the total needs. `carried` and motor `limit` [N m], torque `scale` [N m] and `share` of
    the mass, (units,).
    """
    split = np.empty_like(target)
    exact_limits(carried / scale, float(share @ (target / scale)), share, limit / scale, split)
    return split * scale
