"""The plant's tables: what is true. Nothing on board reads them; `alloc.run.wire` alone carries readings and commands.

In the plant traction is positive. A column is a line, or a field of a parameter.
"""

from dataclasses import replace

from alloc.plant.rail import LINE, PATCH, Rail, Receptivity
from alloc.plant.train import Coupler
from alloc.schema.tables import ONE, Column, Table, columns_of

# fmt: off

WHEELSET = Table(
    "axle",
    # the train
    car=Column(0, ONE, "car of the axle, 0 = foremost"),
    body=Column(0, ONE, "body that it pushes: its car, or 0, the whole rigid train"),
    unit=Column(-1, ONE, "traction unit of the axle, 0 = foremost, -1: none"),
    brake=Column(-1, ONE, "air brake group of the axle, 0 = foremost, -1: none"),
    offset=Column(0.0, "m", "position from the train's front, negative"),
    radius=Column(0.43, "m", "wheel radius"),
    inertia=Column(100.0, "kg m2", "inertia of the wheelset with what is geared to it, at the wheel"),
    gear=Column(0.0, ONE, "gear ratio; 0: not driven"),
    static_load=Column(1e5, "N", "axle load at rest"),
    unloading=Column(0.0, ONE, "axle load lost per newton of the car's rail force"),
    shoe_gain=Column(0.0, "N Pa-1", "shoe force at the rim over cylinder pressure, before friction"),
    # its speed sensor
    sensed=Column(1, ONE, "whether its speed is measured"),
    lost=Column(1e9, "s", "instant from which its speed signal is lost"),
    back=Column(1e9, "s", "instant at which that signal is back"),
    # the rail under it
    law_numerator=Column(0.0, "km h-1", "numerator of the speed law of adhesion", source="JP5484215 (12)"),
    law_constant=Column(0.15, ONE, "constant of the speed law of adhesion"),
    increment=Column(0.0, ONE, "growth of adhesion along the train", source="JP5484215 (15)"),
    contact=Column(1.0, ONE, "creep stiffness of its contacts over that of the curve"),
    # of the instant
    cleaned=Column(0.0, ONE, "degree to which wheels ahead have cleaned the rail under it", source="JP4209318 par. 0051"),
    recovery=Column(0.0, ONE, "degree to which dissipated energy has cleaned its own contact"),
    cell=Column(0, ONE, "last cell of rail that it has left behind"),
    offered=Column(0.0, ONE, "adhesion coefficient that the rail offers, parameter of the curve", True),
    coefficient=Column(0.0, ONE, "tangential force coefficient", True),
    axle_load=Column(0.0, "N", "axle load", True),
    rail_force=Column(0.0, "N", "tangential force between wheel and rail", True),
    brake_force=Column(0.0, "N", "force of the brake shoes at the rim, against its rotation", True),
    slip_velocity=Column(0.0, "m s-1", "slip velocity, positive driving", True),
    rim_speed=Column(0.0, "m s-1", "circumferential speed of the wheels", True),
    friction_work=Column(0.0, "J", "work dissipated between wheel and rail", True),
)

CAR = Table(
    "car",
    body=Column(0, ONE, "body that it is part of: itself, or 0, the whole rigid train"),
    mass=Column(4e4, "kg", "mass with load"),
    middle=Column(0.0, "m", "its middle from the train's front, negative"),
    resistance=Column(0.0, "N", "running resistance at rest"),
    resistance_linear=Column(0.0, "N s m-1", "part of the running resistance that grows with the speed"),
    resistance_quadratic=Column(0.0, "N s2 m-2", "part that grows with its square, the air's"),
    **{key: replace(column, default=0.0) for key, column in columns_of(Coupler).items()},  # of the one behind it
    # of the instant
    force=Column(0.0, "N", "rail force of its axles"),
    pitch=Column(0.0, ONE, "sum of its axles' coefficients times unloading"),
    car_speed=Column(0.0, "m s-1", "speed of the car", True),
    car_acceleration=Column(0.0, "m s-2", "acceleration of the car", True),
    coupler_force=Column(0.0, "N", "force of the coupler behind the car, tension positive", True),
)

DRIVE = Table(
    "unit",  # the motors of a traction unit
    lag=Column(0.005, "s", "time constant of the torque", source="readhesion paper, section 2.2"),
    failure=Column(1e9, "s", "instant at which its motors fail"),
    slip_torque=Column(0.0, "N m s rad-1", "motors in parallel on one frequency: torque over speed between motor and field"),
    axles=Column(4, ONE, "number of its axles"),
    gear=Column(7.0, ONE, "gear ratio"),
    radius=Column(0.43, "m", "wheel radius"),
    inertia=Column(100.0, "kg m2", "mean inertia of its wheelsets"),
    applied=Column(0.0, "N m", "torque command to each motor, positive driving"),
)

CYLINDER = Table(
    "brake_group",  # brake cylinders of a bogie, behind their pair of valves
    fill_time=Column(0.4, "s", "time constant of filling"),
    release_time=Column(0.4, "s", "time constant of releasing"),
    dead_time=Column(0.1, "s", "time from a command to the valves' response"),
    most_pressure=Column(4e5, "Pa", "largest pressure"),
    gain=Column(0.0, "N Pa-1", "shoe force of an axle over pressure, where its shoes work"),
    friction_numerator=Column(0.0, "km h-1", "numerator of shoe friction over speed"),
    friction_offset=Column(1.0, "km h-1", "offset of shoe friction over speed"),
    friction_constant=Column(1.0, ONE, "constant of shoe friction over speed"),
    # as commanded
    pressure_target=Column(0.0, "Pa", "pressure commanded", True),
    valve=Column(0.0, ONE, "slide protection's valves: 0 supply, 1 hold, 2 release", True, "JP4209318"),
    # of the instant
    filling=Column(0.0, "Pa", "pressure to which it fills, behind the dead time"),
    acting=Column(0.0, ONE, "position of its valves, behind the dead time"),
    cylinder_pressure=Column(0.0, "Pa", "brake cylinder pressure", True),
)

PLANT = Table(
    "plant",  # one row: what rail, line and integration have in common for all axles
    period=Column(0.01, "s", "control period"),
    step=Column(0.002, "s", "longest integration step"),
    rate=Column(0.0, "s-1", "fastest rate of shoes, motors and couplers"),
    contact_rate=Column(0.0, "s-1", "fastest rate of the contacts at standstill"),
    body_mass=Column(0.0, "kg", "mass of a rigid train; 0: cars move by themselves"),
    pitches=Column(0, ONE, "whether rail forces shift loads"),
    parallel=Column(0, ONE, "whether motors of a unit share a frequency"),
    curve_number=Column(0, ONE, "number of the adhesion curve in `alloc.plant.curves`"),
    law_offset=Column(1.0, "km h-1", "offset of the speed law of adhesion"),
    **columns_of(
        Rail, "scatter_length", "conditioning", "conditioning_slip", "cleaning_spacing", "recovered_coefficient",
        "recovery_energy", "recovery_time", "recovery_left",
    ),
    line_origin=Column(0.0, "m", "begin of the line's points"),
    line_spacing=Column(5.0, "m", "distance of the line's points"),
    **columns_of(Receptivity, prefix="receptivity_"),
    receptivity_phase=Column(0.0, "rad", "phase of that share"),
    planned=Column(0.0, "s2 m-1", "coefficient that each m/s2 asked for needs of every driven axle, by the true masses"),
    brake_planned=Column(0.0, "s2 m-1", "the same of every axle that acts in blended braking"),
    # of the instant
    planned_coefficient=Column(
        0.0, ONE, "coefficient that the driver's command needs of every acting axle, by true masses", True
    ),
    position=Column(0.0, "m", "position of the train's front", True),
    speed=Column(0.0, "m s-1", "mean speed of the train", True),
    acceleration=Column(0.0, "m s-2", "mean acceleration of the train", True),
    motor_work=Column(0.0, "J", "work of the motors at the wheels", True),
    shoe_work=Column(0.0, "J", "work lost in brake shoes", True),
    resistance_work=Column(0.0, "J", "work against resistance and gradient", True),
    coupler_work=Column(0.0, "J", "work taken in by couplers", True),
)

TABLES = (WHEELSET, CAR, DRIVE, CYLINDER, PATCH, LINE, PLANT)
