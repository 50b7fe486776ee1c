"""The event of the MPC's closed-loop tests: adhesion falls under a train with free axles, and comes back."""

import numpy as np

from alloc.onboard.host import HostedController, each_unit
from alloc.onboard.parameters import Belief, Braking, Onboard, Sensors
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from alloc.simulation import DriverCommand, Event, simulate
from mpc.unit import MpcController

DROP, BACK = 4.0, 6.0
HIGH, LOW = 0.18, 0.12


def drop_event(
    command=0.8,
    speed=8.0,
    level=HIGH,
    drop=LOW / HIGH,
    sensors=None,
    curve=None,
    truth=None,
    **values,
):
    """The commuter set on a rail whose peak coefficient falls from 0.18 to 0.12 under the whole train at once.

    `curve`: the adhesion curve that the train is given, `truth`: the rail's; both are the piecewise one by default.
    """
    patch = Patch(drop, begin=DROP, until=BACK, fade=0.1)
    model = build(
        find_set("commuter-8car"), Rail(level, patches=(patch,), curve=truth or PiecewiseCurve())
    )
    # the motors brake the whole train: the model of the MPC knows of no air brake
    onboard = Onboard(
        belief=Belief(curve=curve or PiecewiseCurve()),
        sensors=sensors or Sensors(),
        braking=Braking(blended=False),
    )
    defaults = {"duration": 8.0, "initial_speed": speed}
    return Event("drop", model, DriverCommand((0.2,), (command,)), onboard, **(defaults | values))


def run_mpc(event, settings=None, controller=MpcController):
    """Run `event` with every unit its own `controller`; returns the run and the controllers, rear unit last."""
    made = []

    def make(context):
        made.append(controller(context, settings))
        return made[-1]

    return simulate(event, "alone", HostedController("mpc", "as told", each_unit(make))), made


def between(run, start, end):
    """Which of the recorded instants lie in [start, end) [s]."""
    time = run["time"].values
    return (time >= start - 1e-9) & (time < end)


def driven(run):
    """Which axles have a motor."""
    return run["axle_unit"].values >= 0


def adhesion_used(run, start=DROP + 0.8, end=BACK):
    """Mean tangential coefficient of the driven axles while adhesion is low, relative to it."""
    return float(np.mean(run["coefficient"].values[between(run, start, end)][:, driven(run)])) / LOW
