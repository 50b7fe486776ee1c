"""Problems of a control period, drawn: units, cars and trains on any gradient, with any slip, curve and torque."""

from collections.abc import Sequence

import numpy as np

from alloc.onboard.host import UnitContext
from mpc.belief import with_predicted_curve
from mpc.model import Units, curve_place, group_of, parameters, unit_of_axle
from mpc.period import HorizonProblem, Problem
from mpc.settings import MpcSettings
from tests.mpc.conftest import make_unit
from tests.mpc.groups import car_of_four, small_cars, unit


def _predicted(group: Sequence[UnitContext]) -> list[UnitContext]:
    return [with_predicted_curve(one) for one in group]


KINDS: dict[str, Units] = {
    "unit": with_predicted_curve(make_unit()),
    "unit of one axle": with_predicted_curve(make_unit(axles=1)),
    "car": _predicted(car_of_four()),
    "train": _predicted(small_cars(3)),
    "train without load transfer": _predicted([unit(k, k, 1, ()) for k in range(3)]),
}
"""Units, or groups of them, as controllers predict them."""


def drawn(kind: str, seed: int, settings: MpcSettings) -> Problem:
    """Problem `seed` of a kind: slip from none to three times the peak's, gradient within 30 per mille."""
    units = KINDS[kind]
    of_axle, m = unit_of_axle(units), len(group_of(units))
    rng = np.random.default_rng([seed, of_axle.size, m])
    values = parameters(units, rng.uniform(0.05, 0.25, m)[of_axle], rng.uniform(-0.03, 0.03))
    top, speed = rng.uniform(0.04, 0.5), rng.uniform(2.0, 30.0)
    values[curve_place(units)] = top, rng.uniform(1.0, 4.0)
    slip = rng.uniform(0.0, 3.0, of_axle.size) * top
    torque, upper = rng.uniform(0.0, 900.0, m), rng.uniform(600.0, 1100.0, m)
    period = HorizonProblem(
        state=np.concatenate([[speed], (speed + slip) / group_of(units)[0].radius, torque]),
        parameters=values,
        slip_limit=top * rng.uniform(0.5, 1.5, of_axle.size),
        target=rng.uniform(200.0, 1000.0, m),
        before=np.minimum(torque, upper),
        upper=upper,
        reference=rng.uniform(200.0, 800.0, m),
    )
    return Problem(units, settings, period)
