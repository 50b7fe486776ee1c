"""Impossible parameters raise `PlantError` that names what is wrong."""

import math
import re

import pytest

from alloc.errors import PlantError
from alloc.plant.adhesion import PiecewiseCurve, PolachCurve, RationalCurve, SlipRatioCurve
from alloc.plant.model import build
from alloc.plant.rail import Line, Patch, Rail, Receptivity
from alloc.plant.sets import find_set
from alloc.plant.train import AirBrake, Coupler, Motors, Sander, TorqueLimit, Train
from tests.plant.conftest import FLAT, make_car

NAN, INF = math.nan, math.inf


def _motors(**changes):
    return Motors(**({"group": "1C4M", "gear_ratio": 7.0, "drive": FLAT, "brake": FLAT} | changes))


def _brake(**changes):
    return AirBrake(**({"maximum_pressure": 4e5, "force_per_pascal": 0.05} | changes))


def _train(**changes):
    return Train(**({"name": "t", "cars": (make_car(),)} | changes))


FAULTS = [
    *[(make_car, {"mass": value}, "empty_mass") for value in (0.0, -1.0, NAN, INF)],
    *[(make_car, {name: NAN}, name) for name in ("length", "wheel_radius", "load", "pivot_height")],
    *[(make_car, {name: -1.0}, name) for name in ("load", "centre_of_mass_height", "pivot_height")],
    *[(make_car, {name: 0.0}, name) for name in ("length", "wheel_radius")],
    (make_car, {"wheel_inertia": (150.0, -1.0, 150.0, 150.0)}, "wheel_inertia"),
    (make_car, {"wheel_inertia": (150.0, NAN, 150.0, 150.0)}, "wheel_inertia"),
    (make_car, {"wheel_inertia": (0.0,) * 4}, "wheel_inertia"),
    (make_car, {"wheel_inertia": (150.0,) * 3}, "wheel_inertia has 3 entries for 4"),
    (make_car, {"driven": (True,) * 5}, "driven has 5 entries for 4"),
    (make_car, {"bogie_of_axle": (0, 0)}, "bogie_of_axle has 2 entries"),
    (make_car, {"bogie_of_axle": (0, 0, 2, 2)}, "bogie_of_axle"),
    (make_car, {"bogie_of_axle": (1, 1, 2, 2)}, "bogie_of_axle"),
    (make_car, {"axle_positions": ()}, "axle_positions"),
    (make_car, {"axle_positions": (2.0, 1.0, 3.0, 4.0)}, "axle_positions"),
    (make_car, {"axle_positions": (2.0, 4.0, 14.0, 21.0)}, "axle_positions"),
    (make_car, {"axle_positions": (-1.0, 4.0, 14.0, 16.0)}, "axle_positions"),
    (make_car, {"axle_positions": (2.0, NAN, 14.0, 16.0)}, "axle_positions"),
    (make_car, {"motors": None}, "no motors"),
    (make_car, {"axle_load_share": (0.5, 0.5)}, "axle_load_share"),
    (make_car, {"axle_load_share": (0.5, 0.5, 0.5, 0.5)}, "axle_load_share"),
    (make_car, {"axle_load_share": (0.5, NAN, 0.1, 0.1)}, "axle_load_share"),
    (make_car, {"axle_load_share": (0.5, -0.1, 0.1, 0.1)}, "axle_load_share"),
    (_motors, {"group": "1C8M"}, "group"),
    *[(_motors, {"gear_ratio": value}, "gear_ratio") for value in (0.0, NAN)],
    *[(_motors, {"torque_lag": value}, "torque_lag") for value in (0.0, -1e-3, NAN)],
    *[(TorqueLimit, {"peak": value, "power": 1e5}, "peak") for value in (-1.0, NAN)],
    (TorqueLimit, {"peak": 1.0, "power": INF}, "power"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "pull_out_speed": 0.0}, "pull_out_speed"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "pull_out_speed": NAN}, "pull_out_speed"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "fade_speed": -1.0}, "fade_speed"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "table": ()}, "table"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "table": (1.0, NAN)}, "table"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "table": (1.0, -1.0)}, "table"),
    *[(_brake, {name: NAN}, name) for name in ("maximum_pressure", "fill_time", "dead_time")],
    *[(_brake, {name: 0.0}, name) for name in ("maximum_pressure", "fill_time", "release_time")],
    *[(_brake, {name: -0.1}, name) for name in ("force_per_pascal", "dead_time")],
    (_brake, {"friction": (1.0, 0.0, 1.0)}, "friction"),
    (_brake, {"friction": (NAN, 1.0, 1.0)}, "friction"),
    (_brake, {"friction": (0.0, 1.0)}, "friction"),
    *[(Coupler, {"stiffness": value}, "stiffness") for value in (0.0, -1.0, NAN)],
    *[(Coupler, {name: -1.0}, name) for name in ("stiffening", "damping", "slack")],
    (_train, {"cars": ()}, "no cars"),
    (_train, {"couplers": (Coupler(),)}, "1 couplers for 1 cars"),
    (_train, {"resistance": (1.0, NAN, 1.0)}, "resistance"),
    (_train, {"resistance": (-1.0, 0.0, 1.0)}, "resistance"),
    (_train, {"resistance": (1.0, 0.0)}, "resistance"),
    (_train, {"planned_acceleration": NAN}, "planned_acceleration"),
    *[(Rail, {"level": value}, "level") for value in (0.0, -0.1, NAN, INF)],
    (Rail, {"level": 0.1, "speed_law": "shinkanzen"}, "speed_law"),
    (Rail, {"level": 0.1, "speed_law": (1.0, 0.0, 0.0)}, "speed_law"),
    (Rail, {"level": 0.1, "speed_law": (1.0, 2.0)}, "speed_law"),
    (
        Rail,
        {"level": 0.1, "rear_speed_law": (1.0, 2.0, 0.0)},
        "must have the offset 1.0 of speed_law",
    ),
    (Rail, {"level": 0.1, "rear_speed_law": (1.0, 1.0, math.inf)}, "three finite numbers"),
    (Rail, {"level": 0.1, "rear_axles": 0.0}, "rear_axles"),
    (Rail, {"level": 0.1, "scatter": -0.01}, "scatter"),
    (Rail, {"level": 0.1, "scatter_length": 0.0}, "scatter_length"),
    (Rail, {"level": 0.1, "seed": -1}, "seed"),
    (Rail, {"level": 0.1, "seed": 0.5}, "seed"),
    (Rail, {"level": 0.1, "increments": (0.0, NAN)}, "increments"),
    (Rail, {"level": 0.1, "conditioning": NAN}, "conditioning"),
    (Rail, {"level": 0.1, "conditioning_slip": 0.0}, "conditioning_slip"),
    (Rail, {"level": 0.1, "cleaning_spacing": 0.0}, "cleaning_spacing"),
    *[
        (Rail, {"level": 0.1, name: 0.0}, name)
        for name in ("sanded_coefficient", "sand_saturation")
    ],
    *[(Rail, {"level": 0.1, "sand_decay": value}, "sand_decay") for value in (-0.1, 1.1, NAN)],
    *[(Sander, {"axle": axle, "rate": 0.1}, "axle") for axle in (-1, 0.5, True)],
    *[(Sander, {"axle": 0, "rate": value}, "rate") for value in (0.0, -1.0, NAN)],
    (Sander, {"axle": 0, "rate": 0.1, "amount": 0.0}, "amount"),
    (make_car, {"sanders": (Sander(4, 0.1),)}, "sanders at axles"),
    (make_car, {"sanders": (Sander(2, 0.1), Sander(2, 0.1))}, "sanders at axles"),
    *[(Patch, {"factor": value}, "factor") for value in (0.0, -1.0, NAN)],
    (Patch, {"factor": 0.5, "edge": 0.0}, "edge"),
    (Patch, {"factor": 0.5, "fade": 0.0}, "fade"),
    (Patch, {"factor": 0.5, "start": 10.0, "end": 5.0}, "start"),
    (Patch, {"factor": 0.5, "begin": NAN}, "begin"),
    (Line, {"stations": (0.0, 1.0)}, "2 stations and 1 grades"),
    (Line, {"stations": (), "grades": ()}, "0 stations"),
    (Line, {"stations": (0.0, -1.0), "grades": (0.0, 0.1)}, "stations"),
    (Line, {"grades": (NAN,)}, "grades"),
    (Line, {"tunnels": ((5.0, 5.0),)}, "tunnel"),
    (Line, {"tunnels": ((NAN, 5.0),)}, "tunnel"),
    (Line, {"tunnel_factor": 0.0}, "tunnel_factor"),
    (Line, {"spacing": 0.0}, "spacing"),
    (Receptivity, {"period": 0.0}, "period"),
    (Receptivity, {"mean": -0.1}, "mean"),
    (Receptivity, {"phase": NAN}, "phase"),
    (PiecewiseCurve, {"residual_ratio": 1.0}, "residual_ratio"),
    (PiecewiseCurve, {"residual_ratio": NAN}, "residual_ratio"),
    *[(PiecewiseCurve, {n: 0.0}, n) for n in ("micro_slope", "top_curvature", "macro_slope")],
    *[(PolachCurve, {n: NAN}, n) for n in ("adhesion_factor", "slip_factor", "creep_stiffness")],
    *[(PolachCurve, {n: -1.0}, n) for n in ("decay", "ratio_at_infinity")],
    *[(SlipRatioCurve, {"peak_slip_ratio": value}, "peak_slip_ratio") for value in (0.0, 1.0, NAN)],
    *[(SlipRatioCurve, {"residual_ratio": value}, "residual_ratio") for value in (-0.1, 1.1, NAN)],
    *[
        (RationalCurve, {n: v}, n)
        for n in ("peak_slip", "steepness")
        for v in (0.0, -1.0, NAN, INF)
    ],
]


def test_impossible_parameter_is_named():
    wrong = []
    for make, fields, named in FAULTS:
        try:
            made = make(**fields)
        except PlantError as error:
            wrong += [] if re.search(named, str(error)) else [f"{fields}: {error}"]
        else:
            wrong.append(f"{fields}: {made}")
    assert not wrong


RAIL = Rail(0.2)
MISFITS = [
    ({"rail": Rail(0.2, increments=(0.0, 0.1))}, "increments: 2 values for 4 axles"),
    ({"span": (5.0, 1.0)}, "span"),
    ({"span": (0.0, NAN)}, "span"),
    ({"failures": {7: 1.0}}, "no traction unit 8"),
    ({"failures": {-1: 1.0}}, "no traction unit 0"),
    ({"failures": {0: NAN}}, "traction unit 1"),
]


@pytest.mark.parametrize(("arguments", "named"), MISFITS, ids=[str(n) for _, n in MISFITS])
def test_train_rail_and_line_that_do_not_fit(arguments, named):
    with pytest.raises(PlantError, match=named):
        build(_train(), **({"rail": RAIL} | arguments))


@pytest.mark.parametrize("name", ["speed", "position"])
@pytest.mark.parametrize("value", [NAN, INF])
def test_initial_state_that_is_not_finite(name, value):
    with pytest.raises(PlantError, match=name):
        build(_train(), RAIL).initial_state(**{name: value})


def test_loads_need_one_per_car():
    with pytest.raises(PlantError, match="2 loads for 1 cars"):
        _train().loaded((1.0, 2.0))


def test_unknown_set_suggests_the_nearest():
    with pytest.raises(PlantError, match="did you mean 'freight-17'"):
        find_set("freigt-17")
    with pytest.raises(PlantError, match="Known: one-axle"):
        find_set("zzz")


def test_plant_error_is_a_value_error():
    assert issubclass(PlantError, ValueError)
