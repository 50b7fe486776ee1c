"""What follows from recorded states by the plant's own laws: forces, coefficients, accelerations of the cars."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.plant.array_model import ArrayModel
from alloc.plant.model import Model

Floats = NDArray[np.float64]


def physical_variables(
    model: Model, states: Floats, peaks: Floats, body_accelerations: Floats
) -> dict[str, NDArray[Any]]:
    """Everything that follows from the recorded states by the plant's own laws; first dimension: instants."""
    n, s = model.layout, model.structure
    arrays = ArrayModel.of(model)
    state, peak = states.T, peaks.T
    slip, mu, force = arrays.forces(state, peak)
    speed = state[n.speed]
    share = s.body_mass / s.body_mass.sum()
    limit, top = model.rails[0].curve.limit(peak, arrays.body_of_axle @ speed)
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
        "acceleration": body_accelerations @ share,
        "car_speed": (arrays.body_of_car @ speed).T,
        "car_acceleration": body_accelerations @ arrays.body_of_car.T,
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
        "group_volume": np.array(
            [
                car.air_brake.cylinder_volume
                for car in model.train.cars
                if car.air_brake is not None
                for _ in range(max(car.bogie_of_axle) + 1)
            ]
        ),
        "unit_static_load": unit_load,
        "unit_gear": s.unit_gear,
        "unit_radius": unit_radius / np.maximum(s.unit_axles, 1.0),
        "body_mass": s.body_mass,
    }
