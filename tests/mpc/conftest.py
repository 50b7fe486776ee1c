"""A unit with four axles and random problems for it, shared by the tests of the MPC."""

import math

import numpy as np
import pytest

from alloc.onboard.host import UnitContext, UnitSense
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, RationalCurve, SlipRatioCurve
from mpc.model import parameters
from mpc.period import HorizonProblem

CURVES = {
    "piecewise": PiecewiseCurve(), "polach": POLACH_WET, "slip-ratio": SlipRatioCurve(),
    "rational": RationalCurve(0.08, 2.5),
}  # fmt: skip


def make_unit(curve="piecewise", axles=4, believed=None, **values) -> UnitContext:
    defaults = {
        "unit": 0, "axles": axles, "radius": 0.43, "inertia": 155.0, "gear_ratio": 7.07,
        "axle_load": 78e3, "mass": 55e3, "torque_lag": 5e-3, "curve": believed or CURVES[curve],
        "period": 0.01,
    }  # fmt: skip
    return UnitContext(**(defaults | values))


@pytest.fixture(scope="session")
def context() -> UnitContext:
    return make_unit()


def _problem(context: UnitContext, seed: int) -> HorizonProblem:
    rng = np.random.default_rng(seed)
    n = context.axles
    peak = rng.uniform(0.05, 0.25, n) if seed % 2 else np.full(n, rng.uniform(0.05, 0.25))
    speed, torque = rng.uniform(2.0, 30.0), rng.uniform(0.0, 900.0)
    top = context.curve.limit(peak, speed)[1]
    omega = (speed + rng.uniform(0.0, 4.0, n) * top) / context.radius
    return HorizonProblem(
        state=np.concatenate([[speed], omega, [torque]]),
        parameters=parameters(context, peak, rng.uniform(-0.02, 0.02)),
        slip_limit=top,
        target=rng.uniform(300.0, 1000.0),
        before=torque,
        upper=1000.0,
    )


def _sense(speed=10.0, slip=0.02, torque=300.0, target=900.0, axles=4, **values) -> UnitSense:
    defaults = {
        "time": 0.0, "speed": speed, "omega": np.full(axles, (speed + slip) / 0.43),
        "torque": torque, "target": target, "drive_limit": 1150.0, "brake_limit": 1150.0,
        "coefficient": math.nan, "slipping": False,
    }  # fmt: skip
    return UnitSense(**(defaults | values))


@pytest.fixture(scope="session")
def make_context():
    """Function (name of the curve, axles, curve believed instead, values) -> context of a unit."""
    return make_unit


@pytest.fixture(scope="session")
def random_problem():
    """Function (context, seed) -> problem: slip from none to four times the peak's, peaks alike or not, any torque."""
    return _problem


@pytest.fixture(scope="session")
def make_sense():
    """Function (values) -> what a unit reads."""
    return _sense
