"""What follows from recorded states by the plant's own laws: forces, coefficients, accelerations of the cars."""

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from alloc.plant.array_model import ArrayModel
from alloc.plant.car import EFFORT_SPEED_STEP
from alloc.plant.model import Floats, Layout, Model

MOST_IN_PRODUCT = 8192
"""Numbers of a matrix that meets a vector at once: BLAS starts threads for more, which cost more than they save."""


class PlantRecord(NamedTuple):
    """What the loop writes of the plant; first dimension: instants."""

    time: Floats
    state: Floats
    peak: Floats
    body_acceleration: Floats

    @classmethod
    def allocate(cls, records: int, n: Layout) -> "PlantRecord":
        """Empty record of `records` instants."""
        sizes = (n.rows, n.axles, n.bodies)
        return cls(np.zeros(records), *(np.zeros((records, size)) for size in sizes))

    def until(self, records: int) -> "PlantRecord":
        """The first instants of the record."""
        return PlantRecord(*(values[:records] for values in self))


class _Chosen:
    """`matrix @ values` and `matrix.T @ values` for a matrix that picks row `index[i]` (-1: none) into row i.

    A product would wake the threads of BLAS: it takes no less time, and twice the processors'.
    """

    def __init__(self, index: NDArray[np.int64], count: int, back: bool = False) -> None:
        self.index, self.count, self.back = index, count, back

    @property
    def T(self) -> "_Chosen":
        """The transposed: sums the rows that were picked from the same one."""
        return _Chosen(self.index, self.count, not self.back)

    def __matmul__(self, values: Floats) -> Floats:
        if not self.back:
            if (self.index < 0).any():  # -1 picks the last row: zeros that are put there for it
                values = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
            return np.take(values, self.index, axis=0)
        total = np.zeros((self.count, *values.shape[1:]))
        for i, row in enumerate(self.index):
            if row >= 0:
                total[row] += values[i]
        return total


def _arrays(model: Model) -> ArrayModel:
    """The plant on whole arrays, without products of matrices."""
    n, s = model.layout, model.structure
    arrays: Any = ArrayModel.of(model)
    arrays.body_of_axle = _Chosen(s.axle_body, n.bodies)
    arrays.car_of_axle = _Chosen(s.axle_car, n.cars)
    arrays.unit_of_axle = _Chosen(s.axle_unit, n.units)
    arrays.group_of_axle = _Chosen(s.axle_group, n.groups)
    arrays.body_of_car = _Chosen(s.car_body, n.bodies)
    return cast(ArrayModel, arrays)


def _mean_of_bodies(share: Floats, values: Floats) -> Floats:
    """Mean over the bodies of `values` (instants, bodies), weighted by `share`; in parts, see `MOST_IN_PRODUCT`."""
    step = max(1, MOST_IN_PRODUCT // share.size)
    parts = [values[k : k + step] @ share for k in range(0, len(values), step)]
    return np.concatenate(parts)


def _motor_limits(model: Model, time: Floats, speed: Floats) -> tuple[Floats, Floats]:
    """Most that each motor can drive and brake with [N m], (instants, units), without slip at `speed` (instants, bodies)."""
    s, n, e = model.structure, model.layout, model.environment
    mean, amplitude, period, phase = e.receptivity
    taken = np.clip(mean + amplitude * np.sin(2.0 * np.pi * time / period + phase), 0.0, 1.0)
    works = e.failure_time > time[:, None]
    drive, brake = np.zeros((2, time.size, n.units))
    for j in range(n.units):
        own = speed[:, s.axle_body[s.axle_unit == j][0]]
        knots = EFFORT_SPEED_STEP * np.arange(s.drive_table.shape[1])
        drive[:, j] = np.interp(np.abs(own), knots, s.drive_table[j])
        brake[:, j] = taken * np.interp(np.abs(own), knots, s.brake_table[j])
    return drive * works, brake * works


def physical_variables(model: Model, record: PlantRecord) -> dict[str, NDArray[Any]]:
    """Everything that follows from the recorded states by the plant's own laws; first dimension: instants."""
    n, s = model.layout, model.structure
    arrays = _arrays(model)
    state, peak = record.state.T, record.peak.T
    slip, mu, force = arrays.forces(state, peak)
    speed = state[n.speed]
    share = s.body_mass / s.body_mass.sum()
    contact = model.environment.contact[:, None]
    limit, top = model.rail.curve.limit(peak, arrays.body_of_axle @ speed, contact)
    work = state[n.work]
    with np.errstate(divide="ignore", invalid="ignore"):
        load = np.where(mu != 0.0, force / mu, s.static_load[:, None])
    driven = s.axle_unit >= 0
    unit_load, unit_radius = (
        np.bincount(s.axle_unit[driven], values[driven], minlength=n.units)
        for values in (s.static_load, s.radius)
    )
    drive_limit, brake_limit = _motor_limits(model, record.time, speed.T)
    return {
        "position": state[n.position][0],
        "speed": _mean_of_bodies(share, speed.T),
        "acceleration": _mean_of_bodies(share, record.body_acceleration),
        "car_speed": (arrays.body_of_car @ speed).T,
        "car_acceleration": np.take(record.body_acceleration, s.car_body, axis=1),
        "rim_speed": (s.radius[:, None] * state[n.omega]).T,
        "slip_velocity": slip.T,
        "coefficient": mu.T,
        "adhesion_limit": limit.T,
        "peak_slip": np.broadcast_to(top, limit.shape).T,
        "rail_force": force.T,
        "brake_force": (arrays.wheelsets(state, force)[0] / s.radius[:, None]).T,
        "axle_load": load.T,
        "friction_work": state[n.friction_work].T,
        "motor_torque": state[n.torque].T,
        "drive_limit": drive_limit,
        "brake_limit": brake_limit,
        "cylinder_pressure": state[n.pressure].T,
        "coupler_force": arrays.coupler_forces(state)[0].T,
        "motor_work": work[0],
        "shoe_work": work[1],
        "resistance_work": work[2],
        "coupler_work": work[3],
        "axle_unit": s.axle_unit,
        "axle_car": s.axle_car,
        "axle_group": s.axle_group,
        "axle_static_load": s.static_load,
        "axle_turning_mass": s.inertia / s.radius**2,
        "group_volume": np.array([brake.cylinder_volume for brake in model.train.brake_groups]),
        "unit_static_load": unit_load,
        "unit_gear": s.unit_gear,
        "unit_radius": unit_radius / np.maximum(s.unit_axles, 1.0),
        "body_mass": s.body_mass,
    }
