"""Variables of a recorded run: one registry, from which dimensions, units and names follow."""

from typing import NamedTuple


class Variable(NamedTuple):
    """Dimensions, CF unit and description of a recorded variable."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    kind: str | None = None
    """Type of its numbers where it differs from that of the loop."""


_BY_DIMENSIONS: dict[tuple[str, ...], dict[str, tuple[str, ...]]] = {
    ("time",): {
        "position": ("m", "position of the train's front"),
        "speed": ("m s-1", "mean speed of the train"),
        "acceleration": ("m s-2", "mean acceleration of the train"),
        "driver_command": ("m s-2", "acceleration asked for on level track"),
        "expected": ("1", "coefficient that the plan needs of every unit"),
        "reference_deviation": (
            "m s-1",
            "standard deviation of the reference speed by its estimate",
        ),
        "reference_speed": (
            "m s-1",
            "reference speed of the foremost traction unit; the train's if it has none",
        ),
        "case": ("1", "case of the allocation: 0 none, 1 A, 2 B"),
        "level": ("1", "level of the last allocation"),
        "motor_work": ("J", "work of the motors at the wheels"),
        "shoe_work": ("J", "work lost in brake shoes"),
        "resistance_work": ("J", "work against resistance and gradient"),
        "coupler_work": ("J", "work lost in couplers"),
    },
    ("time", "car"): {
        "slide_reference": ("m s-1", "reference speed of the car, where cars move apart"),
        "car_speed": ("m s-1", "speed of the car"),
        "car_acceleration": ("m s-2", "acceleration of the car"),
    },
    ("time", "axle"): {
        "rim_speed": ("m s-1", "circumferential speed of the wheels"),
        "slip_velocity": ("m s-1", "slip velocity, positive driving"),
        "coefficient": ("1", "tangential force coefficient"),
        "adhesion_limit": ("1", "true adhesion coefficient: maximum over the slip"),
        "peak_slip": ("m s-1", "slip velocity of that maximum"),
        "rail_force": ("N", "tangential force between wheel and rail"),
        "brake_force": ("N", "force of the brake shoes at the rim, against its rotation"),
        "axle_load": ("N", "axle load"),
        "friction_work": ("J", "work dissipated between wheel and rail"),
    },
    ("time", "unit"): {
        "motor_torque": ("N m", "torque of each motor of the unit"),
        "drive_limit": ("N m", "most that each motor can pull with at the train's speed"),
        "brake_limit": (
            "N m",
            "most that each motor can brake with, as far as the line takes it up",
        ),
        "torque_command": ("N m", "torque command to each motor"),
        "torque_target": ("N m", "torque wanted of each motor under the limit"),
        "limit": ("1", "limit in force, as a coefficient"),
        "coefficient_estimate": ("1", "observer's estimate of the coefficient"),
        "slipping": ("1", "signal of the slip detector", "int8"),
        "fallen_back": ("1", "unit has heard nothing for too long and keeps the plan", "int8"),
        "axles_seen": ("1", "axles of the unit whose speed is known"),
        "torque_factor": ("1", "share of its target that the readhesion controller leaves a unit"),
        "computed_acceleration": (
            "m s-2",
            "acceleration of the unit's axles as its slip detector computes it",
        ),
        "air_brake_force": ("N", "air brake force commanded per axle of the unit, at the rim"),
        "increment": ("1", "increment of adhesion over the foremost unit, as learnt so far"),
        "increment_data": ("1", "data of the unit's increment that the run has given so far"),
        "increment_datum": ("1", "last datum of the unit's increment, nan before the first"),
    },
    ("time", "brake_group"): {
        "cylinder_pressure": ("Pa", "brake cylinder pressure"),
        "valve": ("1", "slide protection's valves: 0 supply, 1 hold, 2 release", "int8"),
    },
    ("time", "sander"): {"sand_rate": ("kg s-1", "sand that the sander lays on each rail")},
    ("time", "coupler"): {"coupler_force": ("N", "coupler force, tension positive")},
    ("axle",): {
        "axle_unit": ("1", "traction unit of the axle, 0 = foremost, -1: none"),
        "axle_car": ("1", "car of the axle, 0 = foremost"),
        "axle_group": ("1", "air brake group of the axle, 0 = foremost, -1: none"),
        "axle_static_load": ("N", "axle load at rest"),
        "axle_turning_mass": ("kg", "mass that would resist like the turning wheelset"),
    },
    ("brake_group",): {"group_volume": ("m3", "volume of the group's brake cylinders")},
    ("unit",): {
        "unit_static_load": ("N", "axle load of the unit's axles, summed"),
        "unit_gear": ("1", "gear ratio"),
        "unit_radius": ("m", "wheel radius"),
        "learnt_increment": ("1", "increment of adhesion over the foremost unit by the run's end"),
        "learnt_deviation": ("1", "standard deviation of that, where the learner states one"),
        "learnt_behind": ("1", "data behind that"),
        "learnt_waiting_sum": ("1", "sum of the data that wait to be used"),
        "learnt_waiting": ("1", "number of the data that wait to be used"),
        "learnt_updates": ("1", "how often the stored increment was changed"),
    },
    ("body",): {"body_mass": ("kg", "mass of a car, or of the whole train where it is rigid")},
}

VARIABLES: dict[str, Variable] = {
    name: Variable(dims, *rest)
    for dims, some in _BY_DIMENSIONS.items()
    for name, rest in some.items()
}
