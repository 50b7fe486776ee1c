"""What a recorded run holds: one registry of variables, from which dimensions, units and names follow."""

from typing import NamedTuple


class Variable(NamedTuple):
    """Dimensions, CF unit and description of a recorded variable."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    kind: str | None = None
    """Type of its numbers where it is not that of the loop."""


VARIABLES: dict[str, Variable] = {
    "position": Variable(("time",), "m", "position of the train's front"),
    "speed": Variable(("time",), "m s-1", "mean speed of the train"),
    "acceleration": Variable(("time",), "m s-2", "mean acceleration of the train"),
    "driver_command": Variable(("time",), "m s-2", "acceleration asked for on level track"),
    "expected": Variable(("time",), "1", "coefficient that the plan needs of every unit"),
    "reference_speed": Variable(
        ("time",),
        "m s-1",
        "reference speed of the foremost traction unit; the train's if it has none",
    ),
    "slide_reference": Variable(
        ("time", "car"), "m s-1", "speed from which the car's slide protection measures slip"
    ),
    "case": Variable(("time",), "1", "case of the allocation: 0 none, 1 A, 2 B"),
    "level": Variable(("time",), "1", "level of the last allocation"),
    "car_speed": Variable(("time", "car"), "m s-1", "speed of the car"),
    "car_acceleration": Variable(("time", "car"), "m s-2", "acceleration of the car"),
    "rim_speed": Variable(("time", "axle"), "m s-1", "circumferential speed of the wheels"),
    "slip_velocity": Variable(("time", "axle"), "m s-1", "slip velocity, positive driving"),
    "coefficient": Variable(("time", "axle"), "1", "tangential force coefficient"),
    "adhesion_limit": Variable(
        ("time", "axle"), "1", "true adhesion coefficient: maximum over the slip"
    ),
    "peak_slip": Variable(("time", "axle"), "m s-1", "slip velocity of that maximum"),
    "rail_force": Variable(("time", "axle"), "N", "tangential force between wheel and rail"),
    "brake_force": Variable(
        ("time", "axle"), "N", "force of the brake shoes at the rim, against its rotation"
    ),
    "axle_load": Variable(("time", "axle"), "N", "axle load"),
    "friction_work": Variable(("time", "axle"), "J", "work dissipated between wheel and rail"),
    "motor_torque": Variable(("time", "unit"), "N m", "torque of each motor of the unit"),
    "torque_command": Variable(("time", "unit"), "N m", "torque command to each motor"),
    "torque_target": Variable(
        ("time", "unit"), "N m", "torque wanted of each motor under the limit"
    ),
    "limit": Variable(("time", "unit"), "1", "limit in force, as a coefficient"),
    "coefficient_estimate": Variable(
        ("time", "unit"), "1", "observer's estimate of the coefficient"
    ),
    "slipping": Variable(("time", "unit"), "1", "signal of the slip detector", "int8"),
    "fallen_back": Variable(
        ("time", "unit"), "1", "unit has heard nothing for too long and keeps the plan", "int8"
    ),
    "axles_seen": Variable(("time", "unit"), "1", "axles of the unit whose speed is known"),
    "torque_factor": Variable(
        ("time", "unit"), "1", "share of its target that the readhesion controller leaves a unit"
    ),
    "computed_acceleration": Variable(
        ("time", "unit"),
        "m s-2",
        "acceleration of the unit's axles as its slip detector computes it",
    ),
    "air_brake_force": Variable(
        ("time", "unit"), "N", "air brake force commanded per axle of the unit, at the rim"
    ),
    "cylinder_pressure": Variable(("time", "brake_group"), "Pa", "brake cylinder pressure"),
    "valve": Variable(
        ("time", "brake_group"),
        "1",
        "slide protection's valves: 0 supply, 1 hold, 2 release",
        "int8",
    ),
    "coupler_force": Variable(("time", "coupler"), "N", "coupler force, tension positive"),
    "motor_work": Variable(("time",), "J", "work of the motors at the wheels"),
    "shoe_work": Variable(("time",), "J", "work lost in brake shoes"),
    "resistance_work": Variable(("time",), "J", "work against resistance and gradient"),
    "coupler_work": Variable(("time",), "J", "work lost in couplers"),
    "axle_unit": Variable(("axle",), "1", "traction unit of the axle, 0 = foremost, -1: none"),
    "axle_car": Variable(("axle",), "1", "car of the axle, 0 = foremost"),
    "axle_group": Variable(("axle",), "1", "air brake group of the axle, 0 = foremost, -1: none"),
    "group_volume": Variable(("brake_group",), "m3", "volume of the group's brake cylinders"),
    "unit_static_load": Variable(("unit",), "N", "axle load of the unit's axles, summed"),
    "unit_gear": Variable(("unit",), "1", "gear ratio"),
    "unit_radius": Variable(("unit",), "m", "wheel radius"),
    "body_mass": Variable(
        ("body",), "kg", "mass of a car, or of the whole train where it is rigid"
    ),
}
