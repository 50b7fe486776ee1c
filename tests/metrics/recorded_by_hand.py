"""A recorded run made by hand: 44 instants of a train that no plant drove, in which no two things are alike.

Nothing here is physical. Every number differs from its neighbours, so that a wrong axle, sign, factor, window or order
changes some metric. Instants are 1/8 s apart from 2 s on, which binary numbers hold exactly. Axles 0 and 1 are unit 0's,
axle 2 has no motor, axles 3 to 5 are unit 1's. The driver coasts (instants 0 to 3), asks for traction (4 to 33) and
brakes (34 to 43).
"""

import numpy as np
import xarray as xr

PERIOD = 0.125
COUNT = 44


def course(otherwise, *pieces):
    """Values over time: each piece is (first instant, last instant, value); what no piece names is `otherwise`."""
    values = np.full(COUNT, otherwise, dtype=float)
    for first, last, value in pieces:
        values[first : last + 1] = value
    return values


def beside(*columns):
    """Courses side by side, (instants, columns)."""
    return np.column_stack(columns)


K = np.arange(COUNT)
SPEED = course(10.0, (34, 38, -2.0), (39, 43, 1.0))
SPEED[4:34] = 10.0 + 0.125 * np.arange(30)  # 12 m/s at instant 20
VARIABLES = {
    "position": ("time", 100.0 + K**2 / 8.0),
    "speed": ("time", SPEED),
    "acceleration": ("time", course(0.3, (4, 33, 0.6), (5, 5, -0.2), (34, 43, -0.4))),
    "driver_command": ("time", course(0.0, (4, 33, 0.8), (34, 43, -0.5))),
    "planned_coefficient": ("time", course(0.0, (4, 32, 0.16), (33, 33, 0.09), (34, 43, 0.10))),
    "motor_work": ("time", course(3e6, (0, 0, 2e6), (43, 43, 5.5e6))),
    "car_acceleration": (("time", "car"), beside(
        course(0.5, (10, 10, 0.75), (43, 43, 0.55)),
        course(0.0, (1, 1, 9.0), (20, 43, -0.5)),
        course(0.2),
    )),
    "slip_velocity": (("time", "axle"), beside(
        course(0.01, (12, 14, 0.15), (31, 32, 0.25)),
        course(0.01, (8, 12, 0.09), (10, 11, -0.30)),
        course(0.01, (30, 30, 0.6)),
        course(0.01, (2, 2, 0.4), (20, 23, 0.5)),
        course(0.01, (26, 27, 0.15), (36, 36, -0.7)),
        course(0.01),
    )),
    "peak_slip": (("time", "axle"), beside(*map(course, (0.10, 0.08, 0.10, 0.12, 0.10, 0.10)))),
    "rim_speed": (("time", "axle"), beside(
        course(9.0, (10, 10, 0.0)),
        course(9.0),
        course(9.0, (35, 41, 0.05)),
        course(9.0, (36, 36, -0.5)),
        course(9.0, (36, 37, -0.05)),
        course(9.0),
    )),
    "rail_force": (("time", "axle"), beside(
        course(4800.0, (0, 3, 100.0), (4, 5, 5200.0), (6, 7, 3000.0), (8, 11, 5200.0), (12, 14, 4000.0),
               (15, 19, 3000.0), (34, 43, -3000.0)),
        course(6200.0, (0, 3, 200.0), (4, 5, 10e3), (6, 7, 5000.0), (8, 11, 10e3), (12, 14, 8000.0),
               (15, 19, 5000.0), (34, 43, -2000.0)),
        course(-80.0, (34, 43, -4000.0)),
        course(300.0, (4, 19, 9e3), (20, 30, 10e3), (31, 33, 8e3), (34, 43, -6e3)),
        course(400.0, (4, 19, 12e3), (20, 30, 11e3), (31, 33, 9e3), (34, 43, -7e3)),
        course(500.0, (4, 30, 15e3), (31, 33, 13e3), (34, 43, -9e3)),
    )),
    "adhesion_limit": (("time", "axle"), beside(
        course(0.08, (0, 11, 0.10)), course(0.14), course(0.30),
        course(0.16), course(0.20, (20, 33, 0.12)), course(0.18),
    )),
    "axle_load": (("time", "axle"), beside(*map(course, (7e4, 9e4, 5e4, 9e4, 10e4, 13e4)))),
    "friction_work": (("time", "axle"), beside(
        course(900.0, (0, 0, 100.0), (43, 43, 2100.0)), course(900.0, (0, 0, 200.0)), course(50.0),
        course(5e3, (0, 0, 1e3)), course(7.0), course(0.0, (43, 43, 750.0)),
    )),
    "coupler_force": (("time", "coupler"), beside(course(1e3, (7, 7, 30e3)), course(2e3, (8, 8, -45e3)))),
    "cylinder_pressure": (("time", "brake_group"), beside(
        course(0.0, (10, 19, 2e5), (20, 29, 1e5), (30, 43, 3e5)),
        course(1e5, (15, 29, 1.5e5), (30, 43, 0.0)),
    )),
    "group_volume": ("brake_group", [0.01, 0.02]),
    "slipping": (("time", "unit"), beside(
        course(0, (2, 2, 1), (11, 13, 1), (16, 16, 1), (28, 28, 1)),
        course(0, (0, 0, 1), (25, 25, 1), (35, 35, 1)),
    ).astype(np.int8)),
    "coefficient_estimate": (("time", "unit"), beside(
        course(0.5, (2, 2, 0.15), (11, 11, 0.11), (16, 16, 0.13), (28, 28, 0.12)), course(0.7),
    )),
    "motor_torque": (("time", "unit"), beside(course(300.0, (40, 40, -500.0)), course(-10.0, (9, 9, 640.0)))),
    "shaft_swing": (("time", "axle"), beside(
        course(4500.0), course(100.0), course(99e3), course(200.0), course(0.0, (41, 41, 8960.0)), course(1.0),
    )),
    "torque_target": (("time", "unit"), beside(
        course(500.0, (0, 19, 1000.0)),
        course(800.0, (24, 26, 100.0), (34, 37, -800.0), (38, 43, -2000.0)),
    )),
    "torque_command": (("time", "unit"), beside(
        course(500.0, (0, 3, 0.0), (19, 19, 590.625)), course(700.0, (0, 3, 0.0), (43, 43, 865.0)),
    )),
    "torque_factor": (("time", "unit"), beside(course(1.0, (20, 24, 0.5), (34, 35, 0.5)), course(1.0, (38, 43, 0.9)))),
    "air_brake_force": (("time", "unit"), beside(course(0.0), course(0.0, (34, 43, 500.0)))),
    "drive_limit": (("time", "unit"), beside(course(500.0, (30, 33, 400.0)), course(640.0))),
    "brake_limit": (("time", "unit"), beside(course(10.0), course(20.0))),
    "axle_unit": ("axle", [0, 0, -1, 1, 1, 1]),
    "axle_group": ("axle", [0, 0, 1, -1, -1, -1]),
    "axle_static_load": ("axle", [7e4, 8e4, 5.2e4, 9e4, 10e4, 11e4]),
    "axle_turning_mass": ("axle", [400.0, 500.0, 100.0, 600.0, 700.0, 800.0]),
    "unit_static_load": ("unit", [1.5e5, 3e5]),
    "unit_gear": ("unit", [6.0, 7.0]),
    "unit_radius": ("unit", [0.5, 0.4]),
    "unit_parallel": ("unit", [0, 0]),
    "axle_radius": ("axle", [0.5, 0.5, 0.45, 0.4, 0.4, 0.4]),
    "axle_car": ("axle", [0, 0, 1, 2, 2, 2]),
    "car_speed": (("time", "car"), np.repeat(SPEED[:, None], 3, axis=1)),
}  # fmt: skip

ATTRIBUTES = {
    "train_mass": 60e3, "target_speed": 12.0, "blended_brakes": 1,
    "adhesion_curve": '{"class": "RationalCurve", "values": {"peak_slip": 0.1, "steepness": 2.0}}',
    "detections": 4, "unit_detections": 7, "telegrams_sent": 90, "telegrams_lost": 3, "fallbacks": 2, "blinded": 1,
    "locks": 6, "time_outs": 5, "rule_calls": 11, "rule_failures": 8, "rule_time_s": 0.25,
    "controller_failures": 9, "controller_median_s": 0.002, "controller_p99_s": 0.0075,
}  # fmt: skip


def recorded(**attributes):
    """The run, with these attributes in place of its own."""
    time = 2.0 + PERIOD * K
    return xr.Dataset(VARIABLES, {"time": time}, ATTRIBUTES | attributes).copy(deep=True)
