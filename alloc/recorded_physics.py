"""What follows from recorded states by the plant's own laws: forces, coefficients, accelerations of the cars."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.plant.array_model import ArrayModel
from alloc.plant.model import Floats, Layout, Model


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


def physical_variables(model: Model, record: PlantRecord) -> dict[str, NDArray[Any]]:
    """Everything that follows from the recorded states by the plant's own laws; first dimension: instants."""
    n, s = model.layout, model.structure
    arrays = ArrayModel.of(model)
    state, peak = record.state.T, record.peak.T
    slip, mu, force = arrays.forces(state, peak)
    speed = state[n.speed]
    share = s.body_mass / s.body_mass.sum()
    limit, top = model.rail.curve.limit(peak, arrays.body_of_axle @ speed)
    work = state[n.work]
    with np.errstate(divide="ignore", invalid="ignore"):
        load = np.where(mu != 0.0, force / mu, s.static_load[:, None])
    driven = s.axle_unit >= 0
    unit_load, unit_radius = (
        np.bincount(s.axle_unit[driven], values[driven], minlength=n.units)
        for values in (s.static_load, s.radius)
    )
    return {
        "position": state[n.position][0],
        "speed": share @ speed,
        "acceleration": record.body_acceleration @ share,
        "car_speed": (arrays.body_of_car @ speed).T,
        "car_acceleration": record.body_acceleration @ arrays.body_of_car.T,
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
        "cylinder_pressure": state[n.pressure].T,
        "coupler_force": arrays.coupler_forces(state)[0].T,
        "motor_work": work[0],
        "shoe_work": work[1],
        "resistance_work": work[2],
        "coupler_work": work[3],
        "axle_unit": s.axle_unit,
        "axle_car": s.axle_car,
        "axle_group": s.axle_group,
        "group_volume": np.array([brake.cylinder_volume for brake in model.train.brake_groups]),
        "unit_static_load": unit_load,
        "unit_gear": s.unit_gear,
        "unit_radius": unit_radius / np.maximum(s.unit_axles, 1.0),
        "body_mass": s.body_mass,
    }
